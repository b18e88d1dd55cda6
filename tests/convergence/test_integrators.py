"""Orders of the integrators by slope, rigid and flexible, each judged by another method.

Generalized-alpha: 2 for positions, velocities, accelerations and reported multipliers; Radau IIA:
5; explicit Runge-Kutta on the index-1 form: 5 and 8.
"""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line
from truthkit import order, run

from flexmb.fe import rectangle, reduce
from flexmb.model import Model

_STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7800.0}
REPORTED = ("q", "v", "vd", "lam")


def chain():
    """Three bodies on spherical joints, the last one thrown, bent out of a plane: chaotic later."""
    made = Model("chain", gravity=[0, -9.81, 0])
    place = np.zeros(3)
    for k in range(3):
        spin = {"angular_velocity": [1.0, 2.0, 3.0]} if k == 2 else {}
        end = np.array([1.0, 0.0, 0.1 * k])
        made.add_body(
            f"b{k}", mass=1.0 + k, center=[0.5, 0.1, 0], inertia=[0.02, 0.1, 0.09],
            position=place.tolist(), **spin,
        )  # fmt: skip
        made.add_marker(f"b{k}.end", position=end.tolist())
        made.add_joint(f"j{k}", "spherical", between=[f"b{k - 1}.end" if k else "ground", f"b{k}"])
        place = place + end
    return made


def flexible_pendulum():
    """A rod of steel, 0.8 m by 3 mm square, with two bending modes each way (25 and 69 Hz)."""
    made = Model("rod", gravity=[0, -9.81, 3.0])
    rod = reduce(
        line(8, end=(0.8, 0, 0)), material=_STEEL, interfaces={"root": "root"}, modes=4,
        sections={"all": rectangle(0.003, 0.003)},
    )  # fmt: skip
    made.add_body("rod", rod)
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("root", "acceleration", of="rod.root")
    return made


MODELS = {"rigid chain": (chain, 1.0), "flexible pendulum": (flexible_pendulum, 0.5)}


@pytest.fixture(scope="module", params=MODELS)
def truth(request):
    """A model, its duration, and a run of order 8 with far shorter steps."""
    make, duration = MODELS[request.param]
    model = make()
    best = run(model, duration=duration, step=duration / 4000, outputs=20, method="explicit-rk")
    return model, duration, best


def distances(runs, judge):
    """Largest difference of each reported table, relative to its largest value."""
    return {
        name: [
            np.abs(getattr(one, name) - getattr(judge, name)).max()
            / np.abs(getattr(judge, name)).max()
            for one in runs
        ]
        for name in REPORTED
    }


def slopes(truth, counts, **knobs):
    model, duration, judge = truth
    h = duration / np.array(counts)
    runs = [run(model, duration=duration, step=step, outputs=20, **knobs) for step in h]
    return {name: (order(h, errors), errors) for name, errors in distances(runs, judge).items()}


def test_explicit_methods_have_their_order(truth):
    """The flexible one near its limit of stability, where slopes are those of long steps."""
    flexible = truth[1] < 1.0
    for p, rigid in ((5, (200, 400)), (8, (40, 80))):
        counts = (600, 1200) if flexible else rigid
        for name, (found, errors) in slopes(truth, counts, method="explicit-rk", order=p).items():
            assert found > p - 0.35 or max(errors) < 1e-11, (p, name, errors)


@pytest.mark.parametrize("radius", [0.9, 0.5])
def test_generalized_alpha_has_order_two(truth, radius):
    knobs = {"spectral_radius": radius, "newton_tolerance": 1e-9}
    for name, (found, errors) in slopes(truth, (2000, 4000, 8000), **knobs).items():
        assert 1.9 < found < 2.15, (name, errors)


def test_radau_has_order_five(truth):
    """Multipliers and accelerations too, where no stiff mode is damped."""
    counts = (160, 320, 640) if truth[1] == 1.0 else (400, 800)
    knobs = {"method": "radau", "newton_tolerance": 1e-11}
    for name, (found, errors) in slopes(truth, counts, **knobs).items():
        assert 4.6 < found < 5.6 or max(errors) < 1e-10, (name, errors)


def test_rows_within_steps_of_radau_have_order_five(truth):
    """At listed times that no step ends at; of velocities above three, the order of a cubic."""
    model, duration, _ = truth
    times = (duration * np.array([0.1234, 0.3217, 0.5551, 0.7613, 0.9871])).tolist()
    judge = run(model, duration=duration, step=duration / 4000, outputs=times, method="explicit-rk")
    counts = np.array((160, 320, 640) if duration == 1.0 else (400, 800))
    runs = [
        run(model, duration=duration, step=duration / n, outputs=times, method="radau",
            newton_tolerance=1e-11)
        for n in counts
    ]  # fmt: skip
    errors = distances(runs, judge)
    assert order(1.0 / counts, errors["q"]) > 4.6, errors
    assert order(1.0 / counts, errors["v"]) > 3.2, errors


def test_newton_leaves_what_its_tolerance_says(truth):
    """Against Newton's method down to round-off: its tolerance is relative to the accelerations.

    Within 30 times, for what the steps leave adds up.
    """
    model, duration, _ = truth
    tolerances = np.array([1e-6, 1e-8, 1e-10])
    *runs, converged = [
        run(model, duration=duration, step=duration / 2000, outputs=20, newton_tolerance=left)
        for left in (*tolerances, 1e-30)
    ]
    for name, errors in distances(runs, converged).items():
        assert np.all(np.array(errors) < 30.0 * tolerances), (name, errors)
