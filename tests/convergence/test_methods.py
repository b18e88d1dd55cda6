"""One suite over all methods that a scene can name: orders, first rows, events, small steps.

Each is judged by Dormand and Prince's method of order 8 with far shorter steps; that one by closed
forms in `tests/truth`.
"""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes import AWAY, moved, truth_of
from accuracyscenes import SCENES as KNOWN
from accuracyscenes.judging import judged
from femeshes import line
from samebytes import assert_same_bytes
from truthkit import order, run

import flexmb
from flexmb.analysis.dynamics import integration as module
from flexmb.engine.compiled_units import interpretation
from flexmb.fe import rectangle, reduce
from flexmb.model import Model
from flexmb.model.scenes.dynamics import METHODS

REPORTED = ("q", "v", "vd", "lam")
GAINS = {"baumgarte_alpha": 20.0, "baumgarte_beta": 20.0}
# Each method with its options and its order.
CASES = {
    "generalized-alpha": ({"method": "generalized-alpha"}, 2),
    "undamped": ({"method": "generalized-alpha", "spectral_radius": 1.0}, 2),
    "hht": ({"method": "hht"}, 2),
    "newmark": ({"method": "newmark", "gamma": 0.6}, 1),
    "trapezoidal": ({"method": "trapezoidal"}, 2),
    "radau": ({"method": "radau", "newton_tolerance": 1e-12}, 5),
    "explicit-rk": ({"method": "explicit-rk"}, 8),
    "explicit-rk 5": ({"method": "explicit-rk", "order": 5}, 5),
    "baumgarte": ({"method": "baumgarte", **GAINS}, 8),
    "baumgarte 5": ({"method": "baumgarte", "order": 5, **GAINS}, 5),
    "coordinate-partitioning": ({"method": "coordinate-partitioning"}, 8),
    "coordinate-partitioning 5": ({"method": "coordinate-partitioning", "order": 5}, 5),
}
# Numbers of steps by order: of rigid scenes, and of the flexible one.
COUNTS = {
    1: ((2000, 4000), (4000, 8000)),
    2: ((1000, 2000), (4000, 8000)),
    5: ((160, 320), (600, 1200)),
    8: ((80, 160), (600, 1200)),
}
EXACT = 1e-10  # what round-off leaves of a slope


def test_the_suite_knows_every_method():
    assert {options["method"] for options, _ in CASES.values()} | {"auto"} == set(METHODS)


def links(n, spin=0.0):
    """n links of 1 m on hinges, let go from the horizontal, the last one perhaps thrown."""
    made = Model("links", gravity=[0, -9.81, 0])
    for k in range(n):
        thrown = {"angular_velocity": [0, 0, spin]} if k == n - 1 else {}
        made.add_body(f"b{k}", mass=1 + k, center=[0.5, 0, 0], inertia=[0.02, 0.1, 0.09],
                      position=[k, 0, 0], **thrown)  # fmt: skip
        made.add_marker(f"b{k}.end", position=[1, 0, 0])
        made.add_joint(f"j{k}", "revolute", between=[f"b{k - 1}.end" if k else "ground", f"b{k}"],
                       axis="z")  # fmt: skip
    return made


def driven():
    """Two links, the first one turned to and fro."""
    made = links(2)
    made.add_driver("motor", joint="j0", angle="0.3*sin(5*t)")
    return made


def loop():
    """A crank-rocker in space, whose hinges repeat three equations, and a spring."""
    made = Model("crank-rocker", gravity=[0, -9.81, 0])
    corners = np.array([[0, 0], [0, 0.7], [2.3, 1.6], [2, 0]])
    for name, a, b in (("crank", 0, 1), ("coupler", 1, 2), ("rocker", 3, 2)):
        end = [*(corners[b] - corners[a]), 0]
        spin = {"angular_velocity": [0, 0, 8.0]} if name == "crank" else {}
        made.add_body(name, mass=1, inertia=[0.1] * 3, center=(0.5 * np.array(end)).tolist(),
                      position=[*corners[a], 0], markers={"end": {"position": end}},
                      **spin)  # fmt: skip
    made.add_marker("ground.right", position=[2, 0, 0])
    for name, ends in (
        ("left", ["ground", "crank"]),
        ("top", ["crank.end", "coupler"]),
        ("corner", ["rocker.end", "coupler.end"]),
        ("right", ["ground.right", "rocker"]),
    ):
        made.add_joint(name, "revolute", between=ends, axis="z")
    made.add_force("spring", "spring-damper", between=["ground", "rocker.end"], stiffness=50,
                   damping=1, free_length=2.0)  # fmt: skip
    return made


def flexible():
    """A rod of steel on a hinge, 0.8 m by 3 mm square, four modes."""
    steel = {"E": 2.1e11, "nu": 0.3, "density": 7800.0}
    made = Model("rod", gravity=[0, -9.81, 3.0])
    rod = reduce(
        line(8, end=(0.8, 0, 0)), material=steel, interfaces={"root": "root"}, modes=4,
        sections={"all": rectangle(0.003, 0.003)},
    )  # fmt: skip
    made.add_body("rod", rod)
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    return made


def pressed():
    """A ball that swings on a plane that it never leaves, thrown along it."""
    made = Model("pressed", gravity=[0, 0, -9.81])
    made.add_body("ball", mass=2, inertia=[0.1] * 3, position=[0, 0, 0.485],
                  velocity=[1.0, 0, 0], angular_velocity=[1.0, 2.0, 0.5])  # fmt: skip
    made.add_force("floor", "contact", between=["ground", "ball"], stiffness=1e3, exponent=1,
                   shapes=[{"type": "plane"}, {"type": "sphere", "radius": 0.5}])  # fmt: skip
    return made


SCENES = {
    "rigid": (lambda: links(3, 3.0), 0.8),
    "driven": (driven, 1.0),
    "closed loop": (loop, 0.5),
    "flexible": (flexible, 0.5),
    "contact": (pressed, 1.0),
}


QUICK = ("closed loop", "flexible")


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in SCENES],
)
def truth(request):
    """A scene, its duration, and a run of order 8 with far shorter steps."""
    make, duration = SCENES[request.param]
    model = make()
    steps = {"outputs": 20, "step": duration / 4000}
    return request.param, model, run(model, duration=duration, method="explicit-rk", **steps)


def relative(one, judge, name, rows=slice(None)):
    """Largest difference of a reported table, over its largest value."""
    wanted = getattr(judge, name)
    scale = np.abs(wanted).max(initial=0.0) or 1.0
    return np.abs(getattr(one, name)[rows] - wanted[rows]).max(initial=0.0) / scale


@pytest.mark.parametrize("case", CASES)
def test_every_method_has_its_order(truth, case):
    """Positions, velocities, accelerations and reactions; in the first row no step has erred."""
    scene, model, judge = truth
    options, p = CASES[case]
    counts = np.array(COUNTS[p][scene == "flexible"])
    duration = judge.t[-1]
    runs = [run(model, duration=duration, step=duration / n, outputs=20, **options) for n in counts]
    for name in REPORTED:
        errors = [relative(one, judge, name) for one in runs]
        if max(errors) > EXACT:
            found = order(1.0 / counts, np.array(errors) + 1e-300)
            assert found > p - 0.4, (name, errors)
        assert relative(runs[0], judge, name, slice(0, 1)) < EXACT, name


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=() if case in ("hht", "radau") else pytest.mark.slow)
        for case in CASES
    ],
)
def test_small_fixed_steps_are_not_worse(case):
    """What Newton's method leaves, and round-off, do not add up over many short steps."""
    options, p = CASES[case]
    model, duration = loop(), 0.002 if p == 8 or "order" in options else 0.02
    judge = run(model, duration=duration, step=duration / 400, outputs=4, method="explicit-rk")
    errors = []
    for step in (1e-4, 2e-6):
        one = run(model, duration=duration, step=step, outputs=4, **options)
        errors.append(max(relative(one, judge, name) for name in REPORTED))
    assert errors[1] < max(2.0 * errors[0] * 0.02 ** min(p, 2), 1e-9), errors


@pytest.mark.seconds
@pytest.mark.parametrize("case", ["trapezoidal", "baumgarte", "coordinate-partitioning"])
def test_plain_python_takes_the_same_steps(case):
    options, _ = CASES[case]
    knobs = {"duration": 0.02, "step": 5e-3, "outputs": 2, **options}
    compiled = run(loop(), **knobs)
    with interpretation():
        plain = run(loop(), **knobs)
    for name in REPORTED:
        assert relative(plain, compiled, name) < 1e-11, name


def hitting():
    """A mass on a guide that a spring pulls against a stop, again and again."""
    made = Model("hitting")
    made.add_body("m", mass=1, inertia=[1, 1, 1], position=[-0.5, 0, 0])
    made.add_joint("guide", "prismatic", between=["ground", "m"], axis="x")
    made.add_force("pull", "translational-spring-damper", joint="guide", stiffness=20, free=1.0)
    made.add_force("wall", "translational-stop", joint="guide", upper=0.3, stiffness=2e4)
    made.add_sensor("m", "position", of="m")
    return made


@pytest.mark.parametrize("case", CASES)
def test_every_method_meets_its_accuracy_over_events(case):
    """A stop that is hit five times; methods of low order are asked for less."""
    options, p = CASES[case]
    options = {key: value for key, value in options.items() if key not in _FIXED}
    accuracy = 1e-3 if p <= 2 else 1e-6
    knobs = {"duration": 3.0, "outputs": 60}
    exact = run(hitting(), method="explicit-rk", accuracy=1e-10, **knobs)
    found = run(hitting(), accuracy=accuracy, **options, **knobs)
    assert found.statistics["events"] >= 8
    error = np.abs(found["m.x"] - exact["m.x"]).max() / np.ptp(exact["m.x"])
    assert error < 3.0 * accuracy


_FIXED = ("gamma", "newton_tolerance")  # options of runs with fixed steps


@pytest.mark.parametrize("case", CASES)
def test_a_stopped_run_goes_on_to_the_same_bytes(case, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_CHUNK_WORK", 1)
    monkeypatch.setattr(module, "_MIN_CHUNK", 30)
    options, _ = CASES[case]
    model = loop()
    model.set_dynamics(duration=0.2, step=1e-3, outputs=50, **options)
    whole = flexmb.simulate(model, output=tmp_path / "whole")
    with pytest.warns(flexmb.FlexmbWarning):
        part = flexmb.simulate(model, output=tmp_path / "part", progress=Interrupt(0.4))
    assert part.status == "stopped" and 5 < len(part.time) < 45
    done = flexmb.resume(part)
    assert done.status == "finished"
    assert_same_bytes(whole.path, done.path)


class Interrupt:
    """Progress that presses Ctrl-C at a share of the run."""

    def __init__(self, share):
        self.share = share

    def __call__(self, phase, fraction, detail=""):
        if phase == "integrate" and self.share <= fraction < 1.0:
            raise KeyboardInterrupt


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.0, 0.5, 0.95, 0.97, 0.99, 1.0])
@pytest.mark.parametrize("scene", SCENES)
def test_every_spectral_radius_is_stable_over_many_steps(scene, radius):
    """What joints hold does not grow, without numerical damping either: it is projected then."""
    make, _ = SCENES[scene]
    knobs = {"method": "generalized-alpha", "spectral_radius": radius, "outputs": 200}
    found = run(make(), duration=100.0, step=1e-3, **knobs)
    assert found.statistics["failed_steps"] == 0
    assert found.drift[:, 0].max() < 1e-8
    moved = np.ptp(found.energy, axis=0).max()
    assert found.mismatch() < 0.02 * moved or scene == "rigid" or radius < 0.9


@pytest.mark.parametrize("asked", [1e-6, 1e-8])
def test_what_is_stiff_is_so_a_kilometre_away(asked):
    """What rings there by the tolerance moves less than round-off of places."""
    scene = KNOWN["stiff damper"]
    found = judged(moved(scene.make(1.0)), lambda t: truth_of(scene, t, 1.0, AWAY),
                   duration=scene.duration, outputs=scene.outputs, accuracy=asked)  # fmt: skip
    assert found.is_reached(asked) and found.statistics["method"] == "radau"
    assert found.steps < 2000  # 1.5 million by the explicit method
