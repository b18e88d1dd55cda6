"""Work and energy: what is stored changes by the works of drivers, dampers and forces alone.

Works are integrals of powers by the order of the method, so the balance closes to that order with
fixed steps; under error control to about the accuracy asked for.
"""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes.judging import judged
from accuracyscenes.mounts import inverted
from accuracyscenes.textbook import integrated
from femeshes import line
from scipy.integrate import simpson
from scipy.special import ellipk
from truthkit import order, run

from flexmb.fe import rectangle, reduce
from flexmb.model import Model

STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7800.0}


def swinging():
    """Gravity alone: two links of a spatial chain, thrown."""
    made = Model("thrown", gravity=[1.0, -9.81, 2.0])
    for k in range(2):
        made.add_body(
            f"b{k}", mass=1.0 + k, center=[0.5, 0.1, 0], inertia=[0.02, 0.1, 0.09],
            position=[k, 0, 0.1 * k], angular_velocity=[1.0, 2.0, 3.0 - k],
        )  # fmt: skip
        made.add_marker(f"b{k}.end", position=[1, 0, 0.1])
        made.add_sensor(f"b{k}", "position", of=f"b{k}.end")
    made.add_joint("first", "spherical", between=["ground", "b0"])
    made.add_joint("second", "revolute", between=["b0.end", "b1"], axis="y")
    return made


def loaded():
    """Springs and dampers of all kinds, actuators, forces that stay and that turn with the body."""
    made = swinging()
    made.add_body("ram", mass=2.0, inertia=[0.1, 0.2, 0.1], position=[0.5, 0, 0])
    made.add_joint("guide", "prismatic", between=["ground", "ram"], axis="x")
    made.add_sensor("ram", "position", of="ram")
    made.add_force("line", "spring-damper", between=["ram", "b1.end"], stiffness=60, damping=3)
    made.add_force(
        "coil", "rotational-spring-damper", joint="second", stiffness=8, damping=0.4, free="20 deg",
        value="3*sin(6*t)",
    )  # fmt: skip
    made.add_force(
        "gas", "translational-spring-damper", joint="guide", stiffness=90, damping=5, free=0.4,
        value="10*cos(4*t)",
    )  # fmt: skip
    made.add_force("push", "force", at="b0.end", value=["4*t", "sin(7*t)", "2"])
    made.add_force("jet", "force", at="b1.end", value=["3", "2*cos(5*t)", "1"], axes="body")
    made.add_force("twist", "torque", at="b1", value=["0.5", "0.2*t", "-0.4"], axes="body")
    return made


def driven(rod=None):
    """A slider-crank turned by a motor, its slider braked; the rod rigid, or as given."""
    made = Model("crank", gravity=[0, -9.81, 0])
    made.add_body("crank", mass=1.0, center=[0.05, 0, 0], inertia=[0.01] * 3)
    made.add_marker("crank.pin", position=[0.1, 0, 0])
    if rod is None:
        made.add_body("rod", mass=0.8, center=[0.2, 0, 0], inertia=[1e-4, 0.013, 0.013],
                      position=[0.1, 0, 0], markers={"tip": {"position": [0.4, 0, 0]}})  # fmt: skip
    else:
        made.add_body("rod", rod, position=[0.1, 0, 0])
    made.add_body("slider", mass=0.5, inertia=[0.01] * 3, position=[0.5, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "spherical", between=["crank.pin", "rod" if rod is None else "rod.root"])
    made.add_joint("wrist", "cylindrical", between=["rod.tip", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_driver("motor", joint="bearing", angle="30*t + 0.5*sin(40*t)")
    made.add_force("brake", "translational-spring-damper", joint="guide", stiffness=200, damping=30,
                   free=0.5)  # fmt: skip
    made.add_sensor("slider", "position", of="slider")
    made.add_sensor("angle", "angle", joint="bearing")
    return made


def flexible_driven():
    return driven(
        reduce(
            line(8, end=(0.4, 0, 0)), material=STEEL, interfaces={"root": "root", "tip": "tip"},
            modes=4, damping={"ratio": 0.02, "of": "free"},
            sections={"all": rectangle(0.006, 0.02)},
        )
    )  # fmt: skip


# What each scene exchanges, its steps and how long it is run.
SCENES = {
    "gravity": (swinging, ("kinetic", "gravity"), 4e-3, 1.0),
    "springs and loads": (
        loaded, ("kinetic", "gravity", "spring", "damper_work", "applied_work"), 4e-3, 1.0,
    ),
    "driven": (driven, ("kinetic", "gravity", "spring", "driver_work", "damper_work"), 4e-4, 0.4),
    "driven, flexible": (
        flexible_driven,
        ("kinetic", "strain", "gravity", "spring", "driver_work", "damper_work"), 4e-5, 0.2,
    ),
}  # fmt: skip
# Each method, its order, and its longest of three steps over the one above.
METHODS = {
    "generalized-alpha": ({"method": "generalized-alpha", "newton_tolerance": 1e-10}, 2, 1),
    "order 5": ({"method": "explicit-rk", "order": 5}, 5, 8),
    "order 8": ({"method": "explicit-rk", "order": 8}, 8, 12),
    "radau": ({"method": "radau", "newton_tolerance": 1e-12}, 5, 4),
}
CASES = [
    pytest.param(name, method, marks=pytest.mark.slow)
    if (name, method) == ("driven, flexible", "generalized-alpha") else (name, method)
    for name in SCENES for method in METHODS
    if name != "driven, flexible" or not method.startswith("order")  # which no stiff body is for
]  # fmt: skip


def imbalance(result):
    """Largest departure of stored energy less works, over the largest of them."""
    return result.mismatch() / np.ptp(result.energy, axis=0).max()


@pytest.mark.parametrize(("name", "method"), CASES)
def test_the_balance_closes_with_the_order_of_the_works(name, method):
    make, exchanged, h, duration = SCENES[name]
    knobs, p, share = METHODS[method]
    if method == "radau":  # above what round-off of reactions leaves
        share *= {"driven": 4, "driven, flexible": 16}.get(name, 1)
    steps, made = np.array([1, 1 / 2, 1 / 4]) * share * h, make()
    outputs = round(duration / steps[0])  # all steps as long as they are told
    runs = [
        run(made, step=s, duration=outputs * steps[0], outputs=outputs, start="quasi-static",
            **knobs)
        for s in steps
    ]  # fmt: skip
    errors = [imbalance(one) for one in runs]
    seen = 3 if errors[-1] > (1e-9 if "flexible" in name else 1e-14) else 2  # above round-off
    # of what is conserved, or nearly so, errors fall faster
    assert p - 0.2 < order(steps[:seen], errors[:seen]) < p + (0.2 if p == 2 else 2.5), errors
    assert errors[-1] < (2e-5 if p <= 3 else 1e-7)
    sizes = dict(zip(runs[-1].layout.energies, np.ptp(runs[-1].energy, axis=0), strict=True))
    for column, size in sizes.items():
        # Each that is exchanged counts for more than the balance is off; all others are nothing.
        assert (size > 100 * runs[-1].mismatch()) == (column in exchanged), sizes


@pytest.mark.parametrize(("name", "method"), [*CASES, *((name, "auto") for name in SCENES)])
def test_the_balance_closes_to_the_accuracy_asked_for(name, method):
    make, _, _, duration = SCENES[name]
    made = make()
    knobs, *_ = METHODS.get(method, ({"method": "auto"},))
    knobs = {key: value for key, value in knobs.items() if key != "newton_tolerance"}
    for accuracy in (1e-3, 1e-5):
        result = run(
            made, accuracy=accuracy, duration=duration, outputs=400, start="quasi-static", **knobs
        )
        error = imbalance(result)
        assert error < (10 if result.statistics["method"] == "radau" else 5) * accuracy
        assert result.statistics["energy_balance_error"] == pytest.approx(error, rel=0.3)


@pytest.mark.parametrize("accuracy", [None, 1e-5])
def test_works_are_those_of_reported_reactions_and_speeds(accuracy):
    """∫ M φ̇ dt of the motor and −∫ c ẋ² dt of the brake, by Simpson's rule over the outputs.

    With 400 outputs over 0.4 s, the fastest of some 100 rad/s, it errs by (0.1)⁴/180.
    """
    steps = {"step": 1e-4} if accuracy is None else {"accuracy": accuracy}
    result = run(driven(), duration=0.4, outputs=400, **steps)
    t, crank, slider = result.t, *(result.layout.bodies[k] for k in (0, 2))
    at = 12 * result.layout.reactions.index("drivers.motor")
    power = result.reactions[:, at + 5] * result.v[:, crank.iv + 5]
    given = result.stored("driver_work")
    taken = result.stored("damper_work")
    brake = -30 * result.v[:, slider.iv] ** 2
    for found, rate in ((given, power), (taken, brake)):
        wanted = simpson(rate, x=t)
        assert found[-1] - found[0] == pytest.approx(wanted, abs=3e-5 * np.abs(np.ptp(found)))
        # Also in between, which a wrong sign of what cancels over a turn would not survive.
        half = len(t) // 2 + 1
        wanted = simpson(rate[:half], x=t[:half])
        assert found[half - 1] - found[0] == pytest.approx(wanted, abs=3e-5 * np.abs(np.ptp(found)))


def test_the_work_of_a_driver_is_of_the_order_of_the_motion():
    """Kapitza's pendulum: 50 times its energy goes in and out, and the work is that energy.

    1.5 % of it were missing, of a motion that was right within 1e-5.
    """
    found = run(inverted(), duration=5.0, outputs=333, accuracy=1e-4, method="radau")
    y, speed = 0.05 * np.cos(100 * found.t), -5.0 * np.sin(100 * found.t)

    def slope(t, x):
        return [x[1], 0.25 * (9.81 - 500 * np.cos(100 * t)) * np.sin(x[0]) / 0.0825]

    lean, rate = integrated(slope, [0.4, 0.0], found.t)
    across, up = 0.25 * rate * np.cos(lean), speed - 0.25 * rate * np.sin(lean)
    energy = 0.5 * (speed**2 + across**2 + up**2 + 0.02 * rate**2)
    energy += 9.81 * (2 * y + 0.25 * np.cos(lean))
    work = found.stored("driver_work")
    apart = np.abs(work - work[0] - energy + energy[0]).max()
    assert apart < 5e-4 * np.ptp(energy)


@pytest.mark.parametrize(
    ("method", "steps"), [("radau", 100), ("generalized-alpha", 100), ("auto", 0)]
)
def test_rows_at_the_turns_of_a_swing_are_compared_with_what_moves_between_them(method, steps):
    """One row a period T = 4 K/ω of a pendulum, at its turn: at rest, at one height.

    What is off was compared with itself: a mismatch of 99.99998 % was told.
    """
    made = Model("swing", gravity=[0, -9.81, 0])
    made.add_body("b", mass=1.0, center=[0.5, 0, 0], inertia=[0.1] * 3)
    made.add_joint("pin", "revolute", between=["ground", "b"], axis="z")
    period = 4.0 * ellipk(0.5) / np.sqrt(9.81 * 0.5 / 0.35)
    knobs = {"step": period / steps} if steps else {}
    times = [k * period for k in range(6)]
    result = run(made, duration=5 * period, outputs=times, method=method, **knobs)
    assert result.statistics["energy_balance_error"] < 2e-5


def test_gravity_energy_is_that_of_the_height_over_the_origin():
    """m g h of a ball that falls from 2 km, beside nothing else."""
    made = Model("fall", gravity=[0, 0, -9.81])
    made.add_body("ball", mass=2.0, inertia=[1, 1, 1], position=[300.0, 0, 2000.0])
    made.add_sensor("height", "position", of="ball")
    made.add_sensor("weight", "energy", quantity="gravity")
    found = run(made, duration=2.0, outputs=4)
    height = 2000.0 - 0.5 * 9.81 * found.t**2
    np.testing.assert_allclose(found["height.z"], height, rtol=1e-12)
    np.testing.assert_allclose(found.q[:, 2], height, rtol=1e-12)
    np.testing.assert_allclose(found["weight"], 2.0 * 9.81 * height, rtol=1e-12)


def test_what_rests_a_kilometre_away_has_no_energy_to_lose():
    """Round-off of places moves a bob on a stiff bushing, by 1e-21 J: no share of that is said."""
    place = [1000.0, -300.0, 500.0]
    made = Model("rest", gravity=[0, 0, 0])
    made.add_marker("ground.bearing", position=place)
    made.add_body("wheel", mass=1, inertia=[0.4] * 3, center=[0.1, 0.2, -0.3], position=place,
                  orientation={"axis": [1, 2, 3], "angle": 0.7})  # fmt: skip
    made.add_joint("pin", "revolute", between=["ground.bearing", "wheel"], axis=[1, 1, 1])
    made.add_marker("wheel.rim", position=[0.3, 0.1, 0.2])
    made.add_body("bob", mass=1, inertia=[0.1] * 3, position=[1001.0, *place[1:]])
    made.add_force("bushing", "bushing", between=["wheel.rim", "bob"], stiffness=1e4, damping=10,
                   rotational_stiffness=100)  # fmt: skip
    found = judged(made, duration=1.0, outputs=50, accuracy=1e-3)
    assert found.statistics["energy_balance_error"] < 0.05
    assert not any("energy" in note for note in found.notes)
