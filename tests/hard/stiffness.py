"""Stiffness and ratios: stiff springs and dampers, fast modes, heavy on light, no inertia."""

from __future__ import annotations

from functools import cache

import numpy as np
from flexiblescenes import STEEL, rod
from scipy.integrate import solve_ivp

from flexmb.model import Model
from tests.accuracyscenes import SCENES
from tests.accuracyscenes.machines import four_bar
from tests.accuracyscenes.oscillators import linear, on_rails
from tests.accuracyscenes.textbook import Linkage, found_once
from tests.hard.case import Hard, largest

G = 9.81


def every(step, *without):
    """Fields by method: controlled steps, and fixed ones of this length [s]."""
    fixed = {"accuracy": None, "step": step}
    methods = {
        "auto": {}, "generalized-alpha": fixed, "explicit-rk": {}, "radau": {},
        "fixed auto": fixed, "controlled generalized-alpha": {}, "fixed radau": fixed,
        "fixed explicit-rk": fixed,
        "hht": fixed, "newmark": fixed, "trapezoidal": fixed, "baumgarte": fixed,
        "coordinate-partitioning": {},
    }  # fmt: skip
    return {name: fields for name, fields in methods.items() if name not in without}


ARM, BALL, HALF, SLIDER, K, C = 0.3, 5.0, 0.5, 3.0, 8e5, 4e4
CENTRE = (ARM * 0.5 + BALL) / (ARM + BALL)
ACROSS, ALONG = ARM / 3 + BALL + 0.05, 0.05  # about the hinge
SHAFT = 0.4


def governor():
    """Two arms with balls on a free shaft; springs and dampers hold a sleeve by their middles.

    After the IFToMM benchmark A05: stiffness 8e5 N/m, damping 4e4 N s/m.
    """
    made = Model("flyball governor", gravity=[0, 0, -G])
    spin = {"angular_velocity": [0, 0, 2 * np.pi]}
    made.add_body("shaft", mass=2, inertia=[1, 1, SHAFT], **spin)
    made.add_joint("bearing", "revolute", between=["ground", "shaft"], axis="z")
    made.add_body("sleeve", mass=SLIDER, inertia=[0.1] * 3, position=[0, 0, -np.sqrt(0.75)], **spin)
    made.add_joint("guide", "prismatic", between=["shaft", "sleeve"], axis="z")
    own = ACROSS - (ARM + BALL) * CENTRE**2
    for name, side in (("right", 1), ("left", -1)):
        made.add_body(name, mass=ARM + BALL, center=[0, 0, -CENTRE], inertia=[own, own, ALONG],
                      orientation={"axis": "y", "angle": -side * np.pi / 6})  # fmt: skip
        made.add_marker(f"{name}.middle", position=[0, 0, -HALF])
        made.add_joint(name, "revolute", between=["shaft", name], axis="y")
        made.add_force(f"stay_{name}", "spring-damper", between=["sleeve", f"{name}.middle"],
                       stiffness=K, damping=C, free_length=HALF)  # fmt: skip
    made.add_sensor("open", "angle", joint="right")
    made.add_sensor("sleeve", "position", of="sleeve")
    made.add_sensor("hinge", "reaction", joint="right")
    return made


def struck_governor():
    """A force of 200 N that sets in on its sleeve."""
    made = governor()
    force = {"type": "step", "t0": 0.49799, "t1": 0.49819, "y0": 0.0, "y1": 200.0}
    made.add_force("blow", "force", at="sleeve", value=[0, 0, force])
    return made


@found_once
def governor_truth(t):
    """Opening, place of the sleeve and the force in a hinge.

    Lagrange in the opening of the arms and the place of the sleeve, with the momentum of the shaft
    kept; the force is Newton's law for an arm.
    """

    def about(a):
        return SHAFT + 0.1 + 2 * (ACROSS * np.sin(a) ** 2 + ALONG * np.cos(a) ** 2)

    momentum = 2 * np.pi * about(np.pi / 6)

    def slope(_, y):
        a, s, da, ds = y
        u = np.array([HALF * np.sin(a), s + HALF * np.cos(a)])
        d = np.hypot(*u)
        by_a, by_s = -HALF * s * np.sin(a) / d, u[1] / d
        pull = K * (d - HALF) + C * (by_a * da + by_s * ds)
        swing = (ACROSS - ALONG) * np.sin(a) * np.cos(a) * (momentum / about(a)) ** 2
        weight = (ARM + BALL) * G * CENTRE * np.sin(a)
        return [da, ds, (swing - weight - pull * by_a) / ACROSS, -G - 2 * pull * by_s / SLIDER]

    y = solve_ivp(slope, (0, t[-1]), [np.pi / 6, -np.sqrt(0.75), 0, 0], "Radau", t,
                  rtol=1e-10, atol=1e-12).y  # fmt: skip
    a, s, da, _ = y
    d2a, d2s = np.array([slope(0, row) for row in y.T]).T[2:]
    spin = momentum / about(a)
    braked = -spin * (2 * (ACROSS - ALONG) * np.sin(2 * a) * da) / about(a)
    out = np.cos(a) * d2a - np.sin(a) * (da**2 + spin**2)
    round_ = 2 * np.cos(a) * da * spin + np.sin(a) * braked
    up = np.sin(a) * d2a + np.cos(a) * da**2
    u = np.array([HALF * np.sin(a), -HALF * np.cos(a) - s])
    pull = -SLIDER * (d2s + G) / 2 / ((s + HALF * np.cos(a)) / np.hypot(*u))
    m = (ARM + BALL) * CENTRE
    force = np.array([m * out + pull * u[0] / np.hypot(*u), m * round_,
                      m * up + (ARM + BALL) * G + pull * u[1] / np.hypot(*u)])  # fmt: skip
    return {"open": a, "sleeve": s, "hinge": np.sqrt((force**2).sum(axis=0))}


def off_governor(run):
    """Errors of opening, sleeve and the force in a hinge over their peak-to-peak."""
    truth = governor_truth(run.time)
    a, s, force = truth["open"], truth["sleeve"], truth["hinge"]
    found = np.hypot(np.hypot(run["hinge.x"], run["hinge.y"]), run["hinge.z"])
    turned = np.abs(run["open"] - run["open"][0]) - np.abs(a - a[0])
    return (largest(turned) / np.ptp(a), largest(run["sleeve.z"] - s) / np.ptp(s),
            largest(found - force) / np.ptp(force))  # fmt: skip


MIXED = (1e3, 1e10, 1e4, 1e9, 1e5, 1e8, 1e6, 1e7)


def mixed_chain():
    """Masses of 1 kg in a row on springs of 1e3 to 1e10 N/m, all let go 0.1 m off."""
    n = len(MIXED)
    made = on_rails([1] * n, [1.1 + k for k in range(n)])
    for k, stiffness in enumerate(MIXED):
        ends = [f"m{k - 1}" if k else "ground", f"m{k}"]
        made.add_force(f"k{k}", "spring-damper", between=ends, stiffness=stiffness, free_length=1)
    return made


def off_chain(run):
    n = len(MIXED)
    x = linear(np.eye(n), np.eye(n) - np.eye(n, k=-1), MIXED, np.zeros((n, n)), [0.1] * n, run.time)
    return max(largest(run[f"p{k}.x"] - 1 - k - x[k]) for k in range(n)) / np.ptp(x)


def on_bushings():
    """A four-bar whose pins are bushings of 1e8 N/m."""
    made = four_bar()
    for name, joint in list(made.joints.items()):
        del made.joints[name]
        made.add_force(name, "bushing", between=list(joint.between), stiffness=1e8, damping=1e3)
    return made


def off_four_bar(run):
    truth = SCENES["four-bar"].truth(run.time)
    return max(largest(run[c] - v) / np.ptp(v) for c, v in truth.items() if c in run)


@cache
def fast_rod():
    return rod(0.02, 0.3, 40, 60)


def short_waves():
    """A steel bar on a pin with 60 modes, the fastest of more than 1e6 rad/s."""
    made = Model("short waves", gravity=[0, -G, 0])
    made.add_body("rod", fast_rod())
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip")
    return made


def off_rigid_rod(run):
    """The pendulum of a rigid bar: it bends by 1e-5 of its length."""
    inertia = 0.3**2 / 3 + 0.02**2 / 12
    y = solve_ivp(lambda _, y: [y[1], -G * 0.15 / inertia * np.cos(y[0])], (0, run.time[-1]),
                  [0.0, 0.0], "DOP853", run.time, rtol=1e-12, atol=1e-12).y[0]  # fmt: skip
    return largest(run["tip.x"] / 0.3 - np.cos(y), run["tip.y"] / 0.3 - np.sin(y))


@cache
def damped_bar():
    return rod(0.01, 1.0, 20, 16)


def cantilever(ratio=1.0, **words):
    """A cantilever of 1 m, all modes damped alike, loaded at once with 10 N at its tip."""
    made = Model("cantilever")
    made.add_body("beam", damped_bar(), damping={"ratio": ratio}, **words)
    made.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    made.add_force("load", "force", at="beam.tip", value=[0, 10.0, 0])
    made.add_sensor("tip", "position", of="beam.tip")
    return made


def off_cantilever(swing, below=np.inf):
    """Sum over the modes of Euler's beam, each at its share of F L^3/(3 E I) when swing(wt) ends.

    Modes from a frequency [1/s] on are there at once.
    """

    def judge(run):
        roots = [1.875104069, 4.694091133, 7.854757438, *(np.pi * (np.arange(4, 12) - 0.5))]
        rate = np.array(roots) ** 2 * np.sqrt(STEEL["E"] * 0.01**2 / 12 / STEEL["density"])
        moves = np.where(rate < below, 1.0, 0.0)[:, None] * swing(np.outer(rate, run.time))
        share = 12 / np.array(roots) ** 4
        truth = 10 / (3 * STEEL["E"] * 0.01**4 / 12) * share @ (1 - moves)
        return largest(run["tip.y"] - truth) / np.ptp(truth)

    return judge


def swing_of_2_percent(wt):
    """Of what is let go with a damping of 2 %."""
    root = np.sqrt(1 - 0.02**2)
    return np.exp(-0.02 * wt) * (np.cos(root * wt) + 0.02 / root * np.sin(root * wt))


def two_links(masses):
    """A double pendulum from the horizontal with links of 1 m."""
    made = Model("two links", gravity=[0, -G, 0])
    for k, m in enumerate(masses):
        made.add_body(f"b{k}", mass=m, center=[0.5, 0, 0], inertia=[0.01 * m, 0.1 * m, 0.1 * m],
                      position=[k, 0, 0])  # fmt: skip
        made.add_marker(f"b{k}.end", position=[1, 0, 0])
        made.add_joint(f"j{k}", "revolute", between=[f"b{k - 1}.end" if k else "ground", f"b{k}"],
                       axis="z")  # fmt: skip
        made.add_sensor(f"end{k}", "position", of=f"b{k}.end")
    return made


def off_links(masses):
    def judge(run):
        row = Linkage(masses, 0.1 * np.array(masses), np.tril(np.ones((2, 2))) - 0.5 * np.eye(2),
                      gravity=-1j * G)  # fmt: skip
        ends = np.cumsum(np.exp(1j * row.run([0, 0], [0, 0], range(2), run.time)), axis=0)
        return max(largest(run[f"end{k}.x"] + 1j * run[f"end{k}.y"] - ends[k]) for k in range(2))

    return judge


def thin_rod(own):
    """A rod on a ball joint with hardly any inertia about its own axis, or none."""
    made = Model("thin rod", gravity=[0, 0, -G])
    made.add_body("rod", mass=1, center=[0.5, 0, 0], inertia=[own, 1 / 12, 1 / 12])
    made.add_marker("rod.end", position=[1, 0, 0])
    made.add_joint("pin", "spherical", between=["ground", "rod"])
    made.add_sensor("end", "position", of="rod.end")
    return made


def off_thin(run):
    y = solve_ivp(lambda _, y: [y[1], -1.5 * G * np.cos(y[0])], (0, run.time[-1]), [0.0, 0.0],
                  "DOP853", run.time, rtol=1e-12, atol=1e-12).y[0]  # fmt: skip
    return largest(run["end.x"] - np.cos(y), run["end.z"] - np.sin(y))


BEYOND = {"fixed explicit-rk": "limit of stability", "baumgarte": "limit of stability"}
RUN = {"duration": 1.0, "outputs": 100, "accuracy": 1e-4}


def links_case(why, masses):
    """A double pendulum with links of these masses."""
    return Hard(
        why, "Both ends follow Lagrange's equations to 5e-4 of a link, by fixed steps of 1 ms too.",
        5e-4, lambda: two_links(masses), off_links(masses), RUN, every(1e-3),
    )  # fmt: skip


CASES = {
    "a flyball governor": Hard(
        "Springs of 8e5 N/m and dampers of 4e4 N s/m hold a sleeve: rates of 20 to 1e4 1/s.",
        "Opening and sleeve follow Lagrange's equations to 5e-5 of their range, 5 accuracies.",
        5e-5, governor, lambda run: max(off_governor(run)[:2]),
        {"duration": 1.0, "outputs": 100, "accuracy": 1e-5}, every(1e-3), stops=BEYOND,
        quick=("controlled generalized-alpha",),
    ),
    "the hinge of the governor": Hard(
        "Its force hangs on speeds of 1e-4 m/s in dampers of 4e4 N s/m.",
        "Newton's law for an arm to 3 % of its range: steps of 1 ms do not see the first 0.1 ms; "
        "methods that damp nothing ring by it, with half of the steps too.",
        0.03, governor, lambda run: off_governor(run)[2],
        {"duration": 1.0, "outputs": 100, "accuracy": 1e-5},
        every(1e-3, "fixed explicit-rk")
        | dict.fromkeys(("newmark", "trapezoidal"), {"accuracy": None, "step": 5e-4}),
        stops=BEYOND, slow=True,
    ),
    "the hinge of the governor at every step": Hard(
        "Dampers of 1e4 1/s by fixed steps of 2 ms, which their method repeats with changing sign.",
        "The force in a hinge, 12 to 21 % of its range off, is said to alternate.",
        np.inf, governor, lambda run: off_governor(run)[2],
        {"duration": 0.1, "outputs": 50, "accuracy": None, "step": 2e-3},
        {"generalized-alpha": {}, "hht": {}, "trapezoidal": {}},
        warns="alternates from step to step",
    ),
    "the hinge of the governor after a blow": Hard(
        "A force sets in two steps of 1 ms before an output, 100 steps after the last one.",
        "The force in a hinge, 6 to 9 % of its range off there, is said to alternate.",
        np.inf, struck_governor, lambda run: off_governor(run)[2],
        {"duration": 0.6, "outputs": 6, "accuracy": None, "step": 1e-3},
        {"generalized-alpha": {}, "hht": {}, "trapezoidal": {}},
        warns="alternates from step to step",
    ),
    "springs of 1e3 to 1e10 N/m": Hard(
        "Eight masses in a row vibrate with 10 to 1e5 rad/s.",
        "The modes of the chain, by singular values, to 1e-3 of the motion.",
        1e-3, mixed_chain, off_chain, {**RUN, "duration": 0.4},
        every(5e-4, "explicit-rk", "coordinate-partitioning"), stops=BEYOND,
    ),
    "springs of 1e3 to 1e10 N/m, explicitly": Hard(
        "1e5 rad/s limit the steps to 2e-5 s.",
        "The same; it takes as many steps as its stability demands.",
        1e-3, mixed_chain, off_chain, {**RUN, "duration": 0.4},
        {"explicit-rk": {}, "coordinate-partitioning": {}}, slow=True,
    ),
    "bushings for joints": Hard(
        "The pins of a four-bar of 3 kg are bushings of 1e8 N/m.",
        "The motion of the four-bar with pins to 1e-3: loads over stiffness are 1e-6 m.",
        1e-3, on_bushings, off_four_bar, {**RUN, "duration": 0.4}, every(5e-4), stops=BEYOND,
        seconds=True,
    ),
    "modes of 1e6 rad/s": Hard(
        "A steel bar that swings has 60 modes, up to 1e6 rad/s; fixed steps of 1 ms.",
        "The swing of a rigid bar to 1e-4: it bends by 1e-5 of its length.",
        1e-4, short_waves, off_rigid_rod, {**RUN, "duration": 0.1, "accuracy": 1e-3},
        every(1e-3, "explicit-rk", "coordinate-partitioning", "controlled generalized-alpha"),
        stops=BEYOND, seconds=True,
    ),
    "damping of 100 %": Hard(
        "All modes of a cantilever are damped critically: rates of 50 to 1e5 1/s, no vibration.",
        "The sum of the modes of Euler's beam to 2e-4: half of it are shear and rotary inertia.",
        2e-4, cantilever, off_cantilever(lambda wt: (1 + wt) * np.exp(-wt)),
        {**RUN, "duration": 0.1}, every(1e-4),
    ),
    "1e8 on 1": links_case("The outer link has 1 kg, the inner one 1e-8 kg.", [1e-8, 1]),
    "1 on 1e8": links_case("The inner link has 1 kg, the outer one 1e-8 kg.", [1, 1e-8]),
    "hardly any inertia": Hard(
        "A rod on a ball joint is free about its own axis, with 1e-12 of its inertia there.",
        "A pendulum to 5e-4 of its length.",
        5e-4, lambda: thin_rod(1e-13), off_thin, RUN, every(1e-3),
    ),
    "quasi-static modes beside dynamic ones": Hard(
        "Modes without mass give way to reactions at once, and reactions follow from them.",
        "The sum of the modes of Euler's beam to 1 %: the frame of mean axes turns with them.",
        0.01, lambda: cantilever(0.02, deformation={"band": [0, 500]}),
        off_cantilever(swing_of_2_percent, 2 * np.pi * 500), {**RUN, "duration": 0.1},
        {"auto": {}, "generalized-alpha": {"accuracy": None, "step": 1e-4}, "radau": {},
         "explicit-rk": {}, "baumgarte": {"accuracy": None, "step": 1e-5},
         "coordinate-partitioning": {}},
        stops={"baumgarte": "knows no quasi-static modes",
               "coordinate-partitioning": "knows no quasi-static modes"},
    ),
    "a loaded cantilever at rest": Hard(
        "From the equilibrium of its modes of up to 1e5 1/s, only round-off moves: no rate of the "
        "motion, and no error, tells a step.",
        "It stays to 1e-6 of its deflection.",
        1e-6, lambda: cantilever(0.02), lambda run: np.ptp(run["tip.y"]) / run["tip.y"][0],
        {**RUN, "duration": 0.05, "start": "quasi-static"},
        {"auto": {}, "generalized-alpha": {"accuracy": None, "step": 1e-3}, "explicit-rk": {},
         "radau": {}, "coordinate-partitioning": {}},
        slow=True, quick=("auto", "explicit-rk"),
    ),
    "no inertia": Hard(
        "The same with none: no torque about the axis could be answered.",
        "Refused as the body is read: moments must be positive.",
        0.0, lambda: thin_rod(0.0), methods={"auto": {}},
        run=RUN, stops={"all": "must all be positive"},
    ),
}  # fmt: skip
