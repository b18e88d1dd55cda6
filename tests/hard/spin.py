"""Spin: rotors, tops and gyroscopes, critical speeds, blades above their first frequency."""

from __future__ import annotations

from functools import cache

import numpy as np
from femeshes import line
from flexiblescenes import rod as bar
from scipy.integrate import solve_ivp
from truthkit import reference

from flexmb.fe import rectangle, reduce
from flexmb.model import Model
from tests.hard.case import Hard, largest

G, IMPLICIT = 9.81, {"auto": {}, "generalized-alpha": {}, "radau": {}}  # else: round-off


def ways(step, fixed_alpha=None, textbook=True):
    """Controlled steps, and fixed ones of a size [s] by all methods."""
    fixed = {"accuracy": None, "step": step}
    alpha = {"accuracy": None, "step": fixed_alpha or step}
    chosen = {"auto": {}, "generalized-alpha": alpha, "explicit-rk": {}, "radau": {},
              "fixed explicit-rk": fixed, "fixed radau": fixed}  # fmt: skip
    return chosen | ({"baumgarte": fixed, "coordinate-partitioning": fixed} if textbook else {})


def rotor(speed):
    """A rotor on a hinge, unbalanced by 1 mm."""
    made = Model("rotor")
    made.add_body("rotor", mass=1, center=[1e-3, 0, 0], inertia=[0.01, 0.01, 0.02],
                  angular_velocity=[0, 0, speed])  # fmt: skip
    made.add_marker("rotor.rim", position=[0.1, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "rotor"], axis="z")
    made.add_sensor("rim", "position", of="rotor.rim")
    made.add_sensor("turn", "angle", joint="bearing")
    made.add_sensor("load", "reaction", joint="bearing", on="J", quantity="force", axes="global")
    return made


def off_rotor(speed):
    """All turns are counted, and the bearing carries m e w²: in turns of the whole, and over it."""

    def judge(run):
        angle = speed * run.time
        load = run["load.x"] + 1j * run["load.y"] + 1e-3 * speed**2 * np.exp(1j * angle)
        rim = run["rim.x"] + 1j * run["rim.y"] - 0.1 * np.exp(1j * angle)
        return max(largest(run["turn"] - angle), largest(rim) / 0.1,
                   largest(load) / (1e-3 * speed**2))  # fmt: skip

    return judge


def free_body(speed):
    """A symmetric body thrown with a spin and a nutation; A = 2 and C = 1.2 kg m²."""
    made = Model("free")
    made.add_body("b", mass=1, inertia=[2, 2, 1.2], angular_velocity=[0.1 * speed, 0, speed])
    made.add_marker("b.p", position=[0, 0, 1.0])
    made.add_marker("b.q", position=[1.0, 0, 0])
    for name in "pq":
        made.add_sensor(name, "position", of=f"b.{name}")
    return made


def off_free_body(speed):
    """It turns about L by |L| t/A after a turn about its axis by (1 - C/A) w t (Goldstein 5.6)."""
    spun = np.array([0.1 * speed, 0, speed])
    L = spun * [2, 2, 1.2] / 2

    def rotate(axis, angle, x):
        """Rodrigues' formula: (n, 3)."""
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        return c * x + s * np.cross(axis, x) + (1 - c) * (x @ axis)[:, None] * axis

    def judge(run):
        off = 0.0
        for name, point in (("p", [0, 0, 1.0]), ("q", [1.0, 0, 0])):
            x = np.tile(point, (len(run.time), 1)).astype(float)
            x = rotate(np.array([0, 0, 1.0]), (1 - 1.2 / 2) * speed * run.time, x)
            x = rotate(L / np.linalg.norm(L), np.linalg.norm(L) * run.time, x)
            off = max(off, largest(np.stack([run[f"{name}.{c}"] for c in "xyz"]) - x.T))
        return off

    return judge


def heavy_top():
    """The top of the papers on generalized-alpha: 150 rad/s, 15 kg, its axis along y."""
    of = reference("rigid_bodies", "heavy_top_lie_group")["params"]
    made = Model("heavy top", gravity=of["g"])
    made.add_body("top", mass=of["m"], center=of["X_com_body"], inertia=of["J_com_body"],
                  angular_velocity=of["Omega0_body"])  # fmt: skip
    made.add_joint("pin", "spherical", between=["ground", "top"])
    made.add_sensor("centre", "position", of="top.center")
    return made


def off_heavy_top(run):
    off = 0.0
    for time, row in reference("rigid_bodies", "heavy_top_lie_group")["values"].items():
        at = np.flatnonzero(np.abs(run.time - float(time)) < 1e-9)
        for k in at:
            off = max(off, largest([run[f"centre.{c}"][k] for c in "xyz"] - np.array(row["com"])))
    return off


TOP = {"C": 0.02, "A": 0.03 + 2 * 0.3**2, "tilt": 0.6, "spin": 1e4}


def precession():
    """Rates of the slow one of A p² cos tilt - C s p + m g l = 0 (Goldstein 5.7)."""
    pull = 2 * G * 0.3
    root = np.sqrt((TOP["C"] * TOP["spin"]) ** 2 - 4 * TOP["A"] * np.cos(TOP["tilt"]) * pull)
    return 2 * pull / (TOP["C"] * TOP["spin"] + root)


def fast_top():
    """A top that turns with 1e4 rad/s and goes round with 0.03 rad/s."""
    made, tilt, rate = Model("fast top", gravity=[0, 0, -G]), TOP["tilt"], precession()
    axis = np.array([0, -np.sin(tilt), np.cos(tilt)])
    spin = (TOP["spin"] - rate * np.cos(tilt)) * axis + [0, 0, rate]
    made.add_body("top", mass=2, center=[0, 0, 0.3], inertia=[0.03, 0.03, 0.02],
                  orientation={"axis": "x", "angle": tilt},
                  angular_velocity=list(spin))  # fmt: skip
    made.add_joint("point", "spherical", between=["ground", "top"])
    made.add_sensor("centre", "position", of="top.center")
    return made


def off_fast_top(run):
    """Of its way in the run."""
    angle, reach = precession() * run.time, 0.3 * np.sin(TOP["tilt"])
    gap = largest(run["centre.x"] - reach * np.sin(angle), run["centre.y"] + reach * np.cos(angle))
    return gap / (reach * angle[-1])


def gyroscope():
    """A rotor in two gimbals, its axis level: a weight on the inner one lets it go round."""
    made, rate = Model("gyroscope", gravity=[0, 0, -G]), GYRO["rate"]
    made.add_body("outer", mass=0.5, inertia=[0.004, 0.004, 0.003], angular_velocity=[0, 0, rate])
    made.add_body("inner", mass=0.3, inertia=[0.001, 0.002, 0.002], angular_velocity=[0, 0, rate])
    made.add_body("rotor", mass=2, inertia=[0.004, 0.0025, 0.0025],
                  angular_velocity=[GYRO["spin"], 0, rate])  # fmt: skip
    made.add_marker("inner.arm", position=[0.1, 0, 0])
    made.add_joint("up", "revolute", between=["ground", "outer"], axis="z")
    made.add_joint("level", "revolute", between=["outer", "inner"], axis="y")
    made.add_joint("axle", "revolute", between=["inner", "rotor"], axis="x")
    made.add_force("weight", "force", at="inner.arm", value=[0, 0, -GYRO["weight"]])
    made.add_sensor("round", "angle", joint="up")
    made.add_sensor("tilt", "angle", joint="level")
    return made


GYRO = {"spin": 5000.0, "weight": 4.0}
GYRO["rate"] = 0.1 * GYRO["weight"] / (0.004 * GYRO["spin"])


def off_gyroscope(run):
    """C s p = F a: it goes round steadily, and its axis stays level."""
    return max(largest(run["round"] - GYRO["rate"] * run.time), largest(run["tilt"]))


JEFFCOTT = {"m": 1.0, "J": 5e-3, "e": 1e-3, "k": 1e4, "c": 8.0, "up": 150.0}


def jeffcott():
    """An unbalanced disc on springs of 1e4 N/m, sped up by 150 rad/s² through 100 rad/s."""
    of, made = JEFFCOTT, Model("Jeffcott rotor", plane="xy")
    made.add_body("disc", mass=of["m"], center=[of["e"], 0, 0], inertia=[1, 1, of["J"]])
    made.add_force("shaft", "bushing", between=["ground", "disc"],
                   stiffness=[of["k"], of["k"], 0], damping=[of["c"], of["c"], 0])  # fmt: skip
    made.add_driver("motor", marker="disc", angle=f"{of['up']}/2*t**2")
    made.add_sensor("disc", "position", of="disc")
    return made


def off_jeffcott(run):
    """The equations of Jeffcott with the turn given: m (z + e exp(i a))'' + c z' + k z = 0."""
    of = JEFFCOTT

    def rates(t, y):
        a, w = of["up"] / 2 * t**2, of["up"] * t
        z, v = y[0] + 1j * y[1], y[2] + 1j * y[3]
        acc = -(of["k"] * z + of["c"] * v) / of["m"]
        acc -= of["e"] * (1j * of["up"] - w**2) * np.exp(1j * a)
        return [v.real, v.imag, acc.real, acc.imag]

    # the placed disc is at rest with its centre of figure, which its springs hold at the origin
    y = solve_ivp(rates, (0, run.time[-1]), [0.0] * 4, "DOP853", run.time, rtol=1e-11, atol=1e-13).y
    return largest(run["disc.x"] - y[0], run["disc.y"] - y[1]) / largest(y[0], y[1])


@cache
def beam(stiffening=True):
    """A beam with EI = rho A = length = 1 and alpha = L sqrt(A/I) = 346."""
    return reduce(
        line(12, end=(1, 0, 0)), material={"E": 12e8, "nu": 0.3, "density": 1e4}, modes=6,
        interfaces={"root": "root", "tip": "tip"}, sections={"all": rectangle(0.01, 0.01)},
        geometric_stiffening="full" if stiffening else "none",
    )  # fmt: skip


def blade(speed, stiffening=True, start=0.0):
    """A blade on a hub, sped up smoothly within `start` seconds (0: it turns at once)."""
    made = Model("blade")
    spun = {} if start else {"angular_velocity": [0, 0, speed]}
    made.add_body("blade", beam(stiffening), **spun)
    made.add_joint("hub", "revolute", between=["ground", "blade.root"], axis="z")
    if start:
        law = {"type": "step5", "t1": start, "y1": speed}
        made.add_driver("motor", joint="hub", angle=law, prescribes="velocity")
    else:
        made.add_driver("motor", joint="hub", angle=f"{speed}*t")
        made.add_force("kick", "force", at="blade.tip", value=[0, 0, 1e-4])
    made.add_sensor("tip", "position", of="blade.tip")
    return made


def off_flap(run):
    """Flap at a speed of 12: F/k (1 - cos w t) of the first mode has the period of 13.17 rad/s."""
    wanted = float(reference("geometric_stiffening", "rotating_cantilever")["flap"]["12"][0])
    z, t = run["tip.z"] - run["tip.z"].mean(), run.time
    lines = np.abs(np.fft.rfft(z * np.hanning(len(z)), n=2**17))
    return abs(2 * np.pi * np.fft.rfftfreq(2**17, t[1] - t[0])[lines.argmax()] / wanted - 1)


def off_grown(speed):
    """After the spin-up it is straight, and longer by L (tan k / k - 1), k = w L sqrt(rho/E)."""

    def judge(run):
        k = speed * np.sqrt(1e4 / 12e8)
        last = run.time > 0.9 * run.time[-1]
        reach = np.hypot(run["tip.x"][last], run["tip.y"][last]).mean()
        return max(abs(reach - np.tan(k) / k), largest(run["tip.z"]))

    return judge


def shaft(speed):
    """A shaft between two bearings, an unbalanced disc in its middle, above its critical speed."""
    made = Model("shaft")
    made.add_body("shaft", rotor_shaft(), angular_velocity=[speed, 0, 0])
    made.add_body("disc", mass=DISC["m"], center=[0, DISC["e"], 0], position=[0.25, 0, 0],
                  inertia=[2e-3, 1e-3, 1e-3], angular_velocity=[speed, 0, 0])  # fmt: skip
    made.add_marker("ground.right", position=[0.5, 0, 0])
    made.add_joint("seat", "fixed", between=["shaft.middle", "disc"])
    made.add_joint("left", "spherical", between=["ground", "shaft.left"])
    made.add_joint("right", "in-line", between=["ground.right", "shaft.right"], axis="x")
    made.add_sensor("disc", "position", of="disc")
    return made


DISC = {"m": 2.0, "e": 1e-4}


@cache
def rotor_shaft():
    """Steel, 0.5 m between its bearings, 10 mm square."""
    return reduce(
        line(8, end=(0.5, 0, 0)), modes=4,
        interfaces={"left": "root", "middle": "middle", "right": "tip"},
        material={"E": 2.1e11, "nu": 0.3, "density": 7800.0},
        sections={"all": rectangle(0.01, 0.01)},
    )  # fmt: skip


def off_shaft(speed):
    """Whirl of Jeffcott's rotor: e w²/(w0² - w²), with half the shaft's mass as its first mode."""
    k = 48 * 2.1e11 * 0.01**4 / 12 / 0.5**3
    m = DISC["m"] + 0.4857 * 7800 * 1e-4 * 0.5  # 17/35 of the shaft: its kinetic energy in w(x)

    def judge(run):
        whirl = DISC["m"] * DISC["e"] * speed**2 / (k - m * speed**2)
        return largest(np.hypot(run["disc.y"], run["disc.z"]) / abs(whirl) - 1)

    return judge


def column(share):
    """A column between pins under a share of Euler's load, kicked aside at its top."""
    made = Model("column")
    made.add_body("column", beam())
    made.add_marker("ground.end", position=[1, 0, 0])
    made.add_joint("root", "universal", between=["ground", "column.root"], axis="y",
                   second_axis="z")  # fmt: skip
    made.add_joint("tip", "in-line", between=["ground.end", "column.tip"], axis="x")
    made.add_force("load", "force", at="column.tip", value=[-share * np.pi**2, 0, 0])
    kick = {"type": "step", "t0": 0.01, "t1": 0.02, "y1": 1e-4}
    made.add_force("kick", "torque", at="column.tip", value=[0, 0, kick])
    made.add_sensor("slope", "orientation", of="column.tip")
    made.set_validity(load_factor="any")
    return made


def off_column(share):
    """w² = pi⁴ (1 - P/P_cr) (Timoshenko, Vibration Problems in Engineering, 5.11)."""
    wanted = np.pi**2 * np.sqrt(1 - share)

    def judge(run):
        y, t = run["slope.gamma"] - run["slope.gamma"].mean(), run.time
        lines = np.abs(np.fft.rfft(y * np.hanning(len(y)), n=2**17))
        found = 2 * np.pi * np.fft.rfftfreq(2**17, t[1] - t[0])[lines.argmax()]
        return abs((found / wanted) ** 2 - 1)

    return judge


FLEXIBLE = {
    "auto": {}, "generalized-alpha": {"accuracy": None, "step": 1e-3}, "radau": {},
    "explicit-rk": {}, "fixed radau": {"accuracy": None, "step": 5e-3},
}  # fmt: skip


def driven_shaft():
    """A balanced shaft of steel that a driver spins up."""
    made = Model("driven shaft")
    made.add_body("shaft", bar(0.03, 0.5, 8, 4))
    made.add_joint("bearing", "revolute", between=["ground", "shaft.root"], axis="x")
    made.add_driver("motor", joint="bearing", angle="100*t**2")
    made.add_sensor("turn", "angle", joint="bearing")
    return made


CASES = {
    "a balanced shaft that spins up": Hard(
        "No bearing carries anything, the end alone is an output. It begins twisted as it stays.",
        "The angle of its driver to 1e-9 rad; reactions of round-off have no error.",
        1e-9, driven_shaft, lambda run: largest(run["turn"] - 100 * run.time**2),
        {"duration": 0.5, "outputs": (0.5,), "start": "quasi-static"}, IMPLICIT,
    ),
    "a rotor at 315 rad/s": Hard(
        "17 turns from one output to the next.",
        "All turns are counted, rim and centrifugal load of the bearing to 1e-6.",
        1e-6, lambda: rotor(315.0), off_rotor(315.0),
        {"duration": 1.0, "outputs": 3, "accuracy": 1e-6}, ways(1e-3),
        slow=True, quick=("auto", "generalized-alpha", "radau"),
    ),
    "a rotor at 1e5 rad/s": Hard(
        "400 turns from one output to the next.",
        "The same, to 1e-6: round-off of 5000 rad is 1e-12.",
        1e-6, lambda: rotor(1e5), off_rotor(1e5),
        {"duration": 0.05, "outputs": 2, "accuracy": 1e-6}, ways(5e-6),
        slow=True, quick=("generalized-alpha",),
    ),
    "steps of sixteen turns": Hard(
        "A fixed step of 1 ms at 1e5 rad/s.",
        "Told, with the step that would do. (Methods that rotate exactly count all turns yet.)",
        np.inf, lambda: rotor(1e5), run={"duration": 0.1, "outputs": 5, "step": 1e-3},
        methods={name: {} for name in ("auto", "generalized-alpha", "explicit-rk", "radau",
                                       "baumgarte", "coordinate-partitioning")},
        warns="in a step of 0.001 s",
        slow=True, quick=("auto", "explicit-rk"),
    ),
    "a thrown body at 315 rad/s": Hard(
        "It nutates: no axis is at rest.",
        "Two points of it to 1e-4 m by Goldstein's closed form, over 50 turns.",
        1e-4, lambda: free_body(315.0), off_free_body(315.0),
        {"duration": 1.0, "outputs": 3, "accuracy": 1e-6}, ways(1e-3, 1e-5),
        slow=True, quick=("auto",),
    ),
    "a thrown body at 1e5 rad/s": Hard(
        "160 turns in 10 ms, three outputs.",
        "The same, to 1e-4 m.",
        1e-4, lambda: free_body(1e5), off_free_body(1e5),
        {"duration": 0.01, "outputs": 3, "accuracy": 1e-6}, ways(2e-6, 5e-8),
        slow=True, quick=("auto",),
    ),
    "the heavy top of the papers": Hard(
        "150 rad/s, nutation to its point and back.",
        "Centre of mass by elliptic functions (V2) to 1e-4 m over 48 turns.",
        1e-4, heavy_top, off_heavy_top, {"duration": 2.0, "outputs": 20, "accuracy": 1e-6},
        ways(1e-3, 2e-5),
        slow=True, quick=("auto", "fixed radau"),
    ),
    "a fast top": Hard(
        "Spin 1e4 rad/s, precession 0.03 rad/s: 3e5 to 1.",
        "Way of the slow precession to 5e-3 of it: what generalized-alpha, of order 2, has with "
        "126 steps a turn.",
        5e-3, fast_top, off_fast_top, {"duration": 0.5, "outputs": 2, "accuracy": 1e-5},
        ways(5e-5, 5e-6),
        slow=True,
    ),
    "a gyroscope": Hard(
        "5000 rad/s in gimbals whose axes move by 4 mrad: their errors hide below its motion.",
        "Level, and C s p = F a: both angles to 1e-5 rad.",
        1e-5, gyroscope, off_gyroscope, {"duration": 0.2, "outputs": 3, "accuracy": 1e-5},
        ways(1e-4, 1e-5), slow=True, quick=("fixed radau", "radau"),
    ),
    "a rotor through its critical speed": Hard(
        "Unbalance passes 100 rad/s at 150 rad/s²: the whirl grows and turns over.",
        "Jeffcott's equations by another solver, to 1e-3 of the largest whirl.",
        1e-3, jeffcott, off_jeffcott, {"duration": 2.0, "outputs": 200, "accuracy": 1e-5},
        ways(1e-3, 1e-4),
        slow=True, quick=("auto", "radau", "generalized-alpha"),
    ),
    "a shaft above its critical speed": Hard(
        "Begun at 2.3 times the critical speed from a quasi-static start.",
        "It begins in its whirl and stays: e w²/(w0² - w²) to 0.5 %, Ritz with one shape.",
        5e-3, lambda: shaft(400.0), off_shaft(400.0),
        {"duration": 0.1, "outputs": 20, "accuracy": 1e-4, "start": "quasi-static"},
        {"auto": {}, "generalized-alpha": {"accuracy": None, "step": 2e-5}, "radau": {},
         "fixed radau": {"accuracy": None, "step": 2e-4}},
        slow=True, quick=("auto",),
    ),
    "a blade at 3.4 times its first frequency": Hard(
        "Without stiffening it would fold up.",
        "Flap frequency by Frobenius series (V2) to 0.5 %.",
        5e-3, lambda: blade(12.0), off_flap, {"duration": 4.0, "outputs": 400, "accuracy": 1e-4},
        FLEXIBLE, slow=True,
    ),
    "the same blade without stiffening": Hard(
        "The inconsistent set of equations: rotation softens and does not stiffen.",
        "Refused: it means nothing above the first frequency.",
        0.0, lambda: blade(12.0, False), run={"duration": 4.0, "outputs": 40, "accuracy": 1e-4},
        methods=FLEXIBLE, stops={"all": "centrifugal stiffening is left out"},
        slow=True, quick=("auto",),
    ),
    "at half its first frequency without stiffening": Hard(
        "Stable, and its lag 4.3 % too slow (V2).",
        "Told, with the share that is missing.",
        np.inf, lambda: blade(2.0, False), run={"duration": 0.3, "outputs": 10, "accuracy": 1e-4},
        methods={name: FLEXIBLE[name] for name in ("auto", "generalized-alpha", "fixed radau")},
        warns="is too low by about 4.3 %",
        slow=True, quick=("fixed radau",),
    ),
    "a spin-up to ten times the first frequency": Hard(
        "From rest to 35 rad/s of a blade whose first frequency is 3.5.",
        "Straight afterwards, and longer by L (tan k/k - 1): to 1e-4 m.",
        1e-4, lambda: blade(35.0, True, 20.0), off_grown(35.0),
        {"duration": 22.0, "outputs": 110, "accuracy": 1e-4},
        {"auto": {}, "generalized-alpha": {"accuracy": None, "step": 1e-3},
         "fixed radau": {"accuracy": None, "step": 5e-3}}, slow=True,
    ),
    "a column at 95 % of Euler's load": Hard(
        "A twentieth of its stiffness is left.",
        "The square of its frequency by Euler's load to 5 %.",
        0.05, lambda: column(0.95), off_column(0.95),
        {"duration": 15.0, "outputs": 300, "start": "quasi-static"},
        {"generalized-alpha": {"step": 2e-3}, "fixed radau": {"step": 5e-3}}, slow=True,
    ),
    "a column at 105 % of Euler's load": Hard(
        "It gives way: its deflection grows without bound.",
        "The run stops where it is bent too far, and names the load factor.",
        0.0, lambda: column(1.05),
        run={"duration": 30.0, "outputs": 600, "start": "quasi-static"},
        methods={"generalized-alpha": {"step": 2e-3}, "fixed radau": {"step": 5e-3}},
        stops={"all": "of those that buckle it"}, slow=True,
    ),
}  # fmt: skip
