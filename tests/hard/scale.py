"""Scale: micrometres to kilometres, microseconds to days, small motions far away, units."""

from __future__ import annotations

import numpy as np
from flexiblescenes import rod
from scipy.integrate import solve_ivp

from flexmb.model import Model
from tests.accuracyscenes import SCENES
from tests.accuracyscenes.oscillators import on_rails
from tests.hard.case import Hard, largest
from tests.hard.stiffness import every

SIZES = {"of micrometres": 1e-6, "of kilometres": 1e3}


def off_sized(name, size):
    """Largest departure from the closed form or the equations of a scene, over the motion."""
    truth = SCENES[name].truth

    def judge(run):
        pairs = [
            (run[c] / (1.0 if run.unit(c) == "rad" else size), v)
            for c, v in truth(run.time).items()
        ]
        return max(largest(a - v) / np.ptp(v) for a, v in pairs)

    return judge


def vibration(rate, place, swing):
    """1 kg at a place [m], swinging with this rate [rad/s] and amplitude [m]."""
    made = on_rails([1], [place])
    made.add_force("spring", "spring-damper", between=["ground", "m0"], stiffness=rate**2,
                   free_length=place - swing)  # fmt: skip
    return made


def off_vibration(rate, place, swing):
    rest = place - swing

    def judge(run):
        return largest(run["p0.x"] - rest - (place - rest) * np.cos(rate * run.time)) / swing

    return judge


_FLOOR = {"controlled generalized-alpha": "accuracy 0.0001 was asked for and"}


def vibration_case(why, rate, place, swing, misses=None):
    turn = 2 * np.pi / rate
    return Hard(
        why, "The cosine to 1e-3 of its amplitude over ten swings, or the error is said.", 1e-3,
        lambda: vibration(rate, place, swing), off_vibration(rate, place, swing),
        {"duration": 10 * turn, "outputs": 100, "accuracy": 1e-4}, every(turn / 2000),
        misses=misses or {},
    )  # fmt: skip


def floating():
    """A body that nothing holds or pulls, thrown and spun about its middle axis."""
    made = Model("floating")
    made.add_body("box", mass=2, inertia=[1, 2, 2.5], velocity=[1, 0, 0],
                  angular_velocity=[0, 0, 3])  # fmt: skip
    made.add_sensor("box", "position", of="box")
    return made


def bar(modes):
    """A steel bar of 1 m that swings on a pin, with so many modes of 120 beams."""
    made = Model("bar", gravity=[0, -9.81, 0])
    made.add_body("rod", rod(0.02, 1.0, 120, modes))
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip")
    return made


def off_rigid_bar(run):
    """The pendulum of a rigid bar: it bends by some 5e-5 of its length."""
    inertia = 1 / 3 + 0.02**2 / 12
    angle = solve_ivp(lambda _, y: [y[1], -9.81 * 0.5 / inertia * np.cos(y[0])], (0, run.time[-1]),
                      [0.0, 0.0], "DOP853", run.time, rtol=1e-12, atol=1e-12).y[0]  # fmt: skip
    return largest(run["tip.x"] - np.cos(angle), run["tip.y"] - np.sin(angle))


def bar_case(modes):
    """That bar against the rigid one."""
    fixed = {"accuracy": None, "step": 1e-3}
    return Hard(
        f"A steel bar swings on a pin, with {modes} modes and those of its interfaces.",
        "The swing of a rigid bar to 1e-4 of its length: it bends by some 5e-5.",
        1e-4, lambda: bar(modes), off_rigid_bar, {"duration": 0.2, "outputs": 20},
        {"auto": {}, "generalized-alpha": fixed, "fixed radau": fixed}, slow=modes > 0,
    )  # fmt: skip


CASES = {
    **{
        f"a four-bar {words}": Hard(
            f"All lengths times {size:g}, and gravity, so that times stay.",
            "Lagrange's equations to 1e-3 of the motion.",
            1e-3, lambda size=size: SCENES["four-bar"].make(size), off_sized("four-bar", size),
            {"duration": 1.0, "outputs": 100, "accuracy": 1e-4}, every(2.5e-4),
        )
        for words, size in SIZES.items()
    },
    "microseconds": vibration_case("A swing of 1 µs and 1 nm.", 2e6 * np.pi, 1.0, 1e-9, _FLOOR),
    "days": vibration_case("A swing of one day.", 2 * np.pi / 86400, 10.0, 1.0),
    "1 µm, 100 m from the origin": vibration_case(
        "Round-off of places is 1e-8 of the motion.", 20.0, 100.0, 1e-6, _FLOOR
    ),
    "no modes": bar_case(0),
    "300 modes": bar_case(300),
    "no gravity and no force": Hard(
        "Nothing but inertia.", "A straight line to 1e-9 of the way.", 1e-9, floating,
        lambda run: largest(run["box.x"] - run.time, run["box.y"]),
        {"duration": 1.0, "outputs": 20, "accuracy": 1e-4}, every(1e-3),
    ),
}  # fmt: skip
