"""Long time: a million steps and more; energy, momentum and phase as methods promise."""

from __future__ import annotations

import numpy as np
from scipy.special import ellipk

import flexmb
from flexmb.flexbody import load
from flexmb.model import Model
from tests.accuracyscenes import SCENES
from tests.accuracyscenes.oscillators import undamped
from tests.cases.test_spacecraft import SCENE as SPACECRAFT
from tests.cases.test_spacecraft import momentum
from tests.hard.case import Hard, largest
from tests.hard.stiffness import rod

PLANETARY_GEAR = SPACECRAFT.parents[1] / "planetary_gear" / "scene.toml"
RATE = 10.0  # rad/s, of the mass on its spring


def fixed(step, *methods):
    """Fixed steps of this length [s]."""
    return {name: {"accuracy": None, "step": step} for name in methods}


def amplification(method, h):
    """(A, end): A to the n times (x, x', x'' by the spring) is the oscillator after n steps.

    The formulas of the books: Newmark; Hilber, Hughes & Taylor (1977); Chung & Hulbert (1993); the
    stability function of Radau IIA, Hairer & Wanner (1996) §IV.5; else the exponential.
    """
    z = 1j * RATE * h
    if method == "radau":
        return (1 + 2 * z / 5 + z**2 / 20) / (1 - 3 * z / 5 + 3 * z**2 / 20 - z**3 / 60)
    rho, alpha = 0.8, -0.1
    m, f, gamma, beta = {
        "generalized-alpha": ((2 * rho - 1) / (rho + 1), rho / (rho + 1), None, None),
        "hht": (0.0, -alpha, None, None), "newmark": (0.0, 0.0, 0.5, 0.25),
        "trapezoidal": (0.0, 0.0, 0.5, 0.25),
    }.get(method, (None,) * 4)  # fmt: skip
    if m is None:
        return np.exp(z)
    gamma = 0.5 + f - m if gamma is None else gamma
    beta = 0.25 * (gamma + 0.5) ** 2 if beta is None else beta
    w = (RATE * h) ** 2
    # unknown x1, h v1, h^2 a1; (1 - m) a1 + m a0 + w ((1 - f) x1 + f x0) = 0
    left = [[1, 0, -beta], [0, 1, -gamma], [w * (1 - f), 0, 1 - m]]
    right = [[1, 1, 0.5 - beta], [0, 1, 1 - gamma], [-w * f, 0, -m]]
    return np.linalg.solve(left, right)


def off_dissipation(run):
    """What the spring's mass does beyond what the method's own formula says, over 0.1 m."""
    method, h = str(run.statistics["method"]), float(run.statistics["step_s"])
    A, x = amplification(method, h), run["p0.x"] - 0.9
    steps = np.rint(run.time / h).astype(int)
    if np.ndim(A) == 0:
        truth = 0.1 * (A**steps).real
    else:
        # algorithmic acceleration at the start: that of the time (m - f) h later, near enough
        first = np.array([0.1, 0.0, -0.1 * (RATE * h) ** 2])
        truth = np.array([(np.linalg.matrix_power(A, n) @ first)[0] for n in steps])
    return largest(x - truth) / 0.1


def off_energy(run):
    """Change of the energy, over what moves between its kinds."""
    kinds = [run.energy[name] for name in ("kinetic", "strain", "gravity", "spring")]
    return largest(sum(kinds) - sum(kind[0] for kind in kinds)) / np.ptp(kinds[0])


def spacecraft():
    made = flexmb.load_scene(SPACECRAFT)
    made.checks.clear()
    return made


def off_momentum(run):
    """Momentum and moment of momentum of all bodies, over the largest of the wheel."""
    files = {name: load(path) for name, path in run.flexbodies.items()}
    parts = [momentum(run, body, files) for body in run.layout.bodies]
    wheel = parts[[body.name for body in run.layout.bodies].index("wheel")]
    return largest(sum(parts)) / largest(wheel)


def off(truth):
    def judge(run):
        return max(largest(run[c] - v) / np.ptp(v) for c, v in truth(run.time).items())

    return judge


def planetary_gear():
    made = flexmb.load_scene(PLANETARY_GEAR)
    made.checks.clear()
    return made


def off_planetary_gear(run):
    """One freedom with a linear damper; Willis' ratios of arm and planet, in radians."""
    i, p, module, thick = 3.5, 1 / 3.5 - 24 / 18 * (1 - 1 / 3.5), 2e-3, 0.012
    sun, planet = (7850 * thick * np.pi * (module * z / 2) ** 2 for z in (24, 18))  # kg
    J = sun * (module * 24 / 2) ** 2 / 2 + 3 * planet * (module * 18 / 2) ** 2 / 2 * p**2
    J += (4e-4 + 3 * planet * (module * 42 / 2) ** 2) / i**2
    speed, T = 0.4 * i**2 / 0.05, J * i**2 / 0.05
    sun = speed * (run.time - T * (1 - np.exp(-run.time / T)))
    return largest(run["sun"] - sun, run["arm"] - sun / i, run["planet"] - p * sun)


def flexible_pendulum():
    """A steel bar of 1 m on a pin, with four modes, let go level."""
    made = Model("flexible pendulum", gravity=[0, -9.81, 0])
    made.add_body("rod", rod(0.01, 1.0, 20, 4))
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip")
    return made


STEPS = ("fixed auto", "generalized-alpha", "fixed radau", "fixed explicit-rk", "hht",
         "newmark", "trapezoidal", "baumgarte", "fixed coordinate-partitioning")  # fmt: skip
CONTROLLED = {"auto": {}, "explicit-rk": {}, "radau": {}}


def swinging():
    """A rod of 1 m on a pin, let go horizontally."""
    made = Model("swinging", gravity=[0, -9.81, 0])
    made.add_body("rod", mass=1, center=[0.5, 0, 0], inertia=[1e-3, 1 / 12, 1 / 12])
    made.add_joint("pin", "revolute", between=["ground", "rod"], axis="z")
    made.add_sensor("swing", "angle", joint="pin")
    return made


WHOLE_SWING = 4 * ellipk(0.5) / np.sqrt(1.5 * 9.81)  # s: m = sin² of half the amplitude


def off_whole_swing(run):
    """The larger one of what is off, and what is stated."""
    return max(largest(run["swing"]), run.statistics["measured_error_of_positions"])


CASES = {
    "one output after a whole swing": Hard(
        "Both outputs show the rod where it began and at rest.",
        "It is there again to 1e-4 rad, and the error stated is one of its swing.",
        1e-4, swinging, off_whole_swing,
        {"duration": WHOLE_SWING, "outputs": 1, "accuracy": 1e-4},
        {"auto": {}, "generalized-alpha": {}, "explicit-rk": {}, "radau": {}},
    ),
    "the damping of each method": Hard(
        "20 000 steps of 2 ms, 6400 radians of a mass on a spring without damper.",
        "What the formula of the method in the books leaves of the swing, to 1e-5 of it.",
        1e-5, undamped, off_dissipation, {"duration": 40.0, "outputs": 20}, fixed(2e-3, *STEPS),
    ),
    "the damping of each method, 1e6 steps": Hard(
        "The same for 1e6 steps.", "The same.",
        1e-4, undamped, off_dissipation, {"duration": 2000.0, "outputs": 20},
        fixed(2e-3, *STEPS), slow=True,
    ),
    "a double pendulum, 1e6 steps": Hard(
        "A chaotic motion of 1000 s by fixed steps of 1 ms.",
        "Its energy to 1 %: what generalized-alpha and hht damp (others: 1e-7) at 15 rad/s.",
        1e-2, lambda: SCENES["double pendulum"].make(1.0), off_energy,
        {"duration": 1000.0, "outputs": 500}, fixed(1e-3, *STEPS[:3], "hht"), slow=True,
    ),
    "the momentum of a spacecraft": Hard(
        "Panels of plates swing as a wheel turns the bus, which nothing holds.",
        "Momentum and moment of momentum of all bodies to 1e-10 of the wheel's: nothing acts. "
        "generalized-alpha leaves 3.3e-4 of the square of its step in s and needs one of 0.5 ms.",
        1e-10, spacecraft, off_momentum, {"duration": 1.5, "outputs": 15, "accuracy": 1e-6},
        {**CONTROLLED, **fixed(5e-4, "generalized-alpha")}, slow=True,
    ),
    "a flexible pendulum, 1e6 steps": Hard(
        "A steel bar that swings for 1000 s; its vibrations of the start are damped by the method.",
        "Energy to 1e-3 of the swing's, of which they have 1e-5.",
        1e-3, flexible_pendulum, off_energy,
        {"duration": 1000.0, "outputs": 500}, fixed(1e-3, *STEPS[:3]),
        slow=True,
    ),
    "a planetary gear, 1e4 turns": Hard(
        "A motor turns the sun for 650 s against a damper, 63 000 rad.",
        "The closed form and Willis' ratios to 1e-3 rad: a tooth is 0.26 rad.",
        1e-3, planetary_gear, off_planetary_gear,
        {"duration": 650.0, "outputs": 500, "accuracy": 1e-6},
        {**CONTROLLED, **fixed(1e-3, "generalized-alpha", "fixed radau")}, slow=True,
    ),
    "a driven slider-crank, many turns": Hard(
        "The crank is driven for 200 s.", "No drift of phase: the closed form to 1e-9.",
        1e-9, lambda: SCENES["driven slider-crank"].make(1.0),
        off(SCENES["driven slider-crank"].truth),
        {"duration": 200.0, "outputs": 100, "accuracy": 1e-6},
        CONTROLLED, slow=True, quick=("auto", "explicit-rk"),
    ),
    "a driven slider-crank, 1e4 turns": Hard(
        "The crank is driven for 3142 s.", "The same.",
        1e-9, lambda: SCENES["driven slider-crank"].make(1.0),
        off(SCENES["driven slider-crank"].truth),
        {"duration": 3142.0, "outputs": 1000, "accuracy": 1e-6},
        {"auto": {}, **fixed(1e-2, "fixed radau", "generalized-alpha")}, slow=True,
    ),
}  # fmt: skip
