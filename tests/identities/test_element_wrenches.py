"""Sensors of reactions of force elements, against what the forces do to their bodies."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, slope

from flexmb.engine.compiled_calls import solve_stage
from flexmb.engine.initial_conditions import RESIDUAL
from flexmb.engine.method import SUCCESS, ZERO_LENGTH
from flexmb.model import Model

TURN = {"axis": [1, 2, 3], "angle": 0.7}
SPHERES = [{"type": "sphere", "radius": r} for r in (0.2, 0.4)]
FORCES = {
    "spring": ("spring-damper", {"stiffness": 30, "damping": 2, "free_length": 0.5}),
    "law": ("spring-damper", {"spring_force": "3*x**3", "damper_force": "v", "value": "2*t"}),
    "bush": ("bushing", {"stiffness": [1, 2, 3], "rotational_stiffness": 4, "damping": 1,
                         "preload": [3, -1, 2], "preload_torque": [0.5, 1, -2]}),
    "beam": ("beam", {"E": 10, "G": 4, "A": 1, "Iy": 1, "Iz": 1, "J": 2, "damping": 0.2}),
    "stop": ("stop", {"upper": 0.1, "stiffness": 3, "exponent": 2}),
    "touch": ("contact", {"shapes": SPHERES, "stiffness": 20, "restitution": 0.7,
                          "friction": {"static": 0.4, "dynamic": 0.3, "stiffness": 9}}),
    "corners": ("contact", {"stiffness": 20, "restitution": 0.7, "shapes": [
        {"type": "points", "points": [[0.3, 0.1, 0], [-0.2, 0.4, 0.1], [0, -0.3, 0.5]]},
        {"type": "plane"}]}),
    "push": ("force", {"value": ["t", 1, 2], "axes": "body"}),
    "twist": ("torque", {"value": ["t", 1, 2], "axes": "global"}),
    "alone": ("force", {"value": [1, 2, "t"], "axes": "body"}),
}  # fmt: skip


def bench_of(name):
    """Two bodies with a force between them, and sensors of its wrenches; sides that have any."""
    kind, fields = FORCES[name]
    made = Model(name)
    for body, place in (("a", [0, 0, 0]), ("b", [1, 0.4, -3 if name == "corners" else -0.3])):
        made.add_body(body, mass=1, inertia=[1, 1, 1], position=place, orientation=TURN)
        made.add_marker(f"{body}.eye", position=[0.1, 0.2, 0.3], orientation=TURN)
    pair = ["a.eye", "b.eye"]
    if kind in ("force", "torque"):
        fields = fields | {"at": pair[1]} | ({} if name == "alone" else {"reaction": pair[0]})
    else:
        fields = fields | {"between": pair}
    made.add_force("f", kind, **fields)
    sides = "J" if name in ("alone", "corners") else "IJ"
    for side in sides:
        for what in ("force", "moment"):
            made.add_sensor(
                f"{what}{side}", "reaction", force="f", on=side, quantity=what, axes="global"
            )
    bench = Bench(made)
    bench.randomise(9)
    return bench, sides


@pytest.mark.parametrize("name", FORCES)
def test_what_is_read_is_what_acts(name):
    bench, sides = bench_of(name)
    if name == "touch":  # wherever the random state has put them
        contacts = bench.sys.kinds["contacts"].rows
        contacts["ri"], contacts["rj"] = 5.0, 7.0
    if name == "corners":
        bench.sys.kinds["contacts"].rows["ri"] = 20.0
    bench.work.now.history[:] = 1e3 if name == "corners" else 0.3
    bench.work.now.span[:] = 0.1
    bench.at(vd=0.0)
    W, body = bench.work.now.marker["W"], bench.sys.parts.markers["body"]
    acts = [W[body == "ab".index("a" if side == "I" else "b")].sum(axis=0) for side in sides]
    acts = np.concatenate(acts)
    assert np.abs(acts).max() > 0.1
    np.testing.assert_allclose(bench.channels, acts, rtol=0, atol=1e-12 * np.abs(acts).max())


def test_a_preload_acts_on_J_without_any_deflection():
    """And its opposite on I, both at the same point."""
    made = Model("preload")
    for body in "ab":
        made.add_body(body, mass=1, inertia=[1, 1, 1])
    pull = {"preload": [1, -2, 3], "preload_torque": [4, 5, -6]}
    made.add_force("f", "bushing", between=["a", "b"], free="together", **pull)
    for side in "JI":
        for what in ("force", "moment"):
            made.add_sensor(
                f"{what}{side}", "reaction", force="f", on=side, quantity=what, axes="global"
            )
    wanted = np.array([1.0, -2, 3, 4, 5, -6])
    np.testing.assert_allclose(Bench(made).at().channels, [*wanted, *-wanted], atol=1e-15)


@pytest.mark.parametrize("name", ["spring", "law", "bush", "beam", "stop", "corners"])
def test_what_is_stored_is_what_forces_take(name):
    """dE = -F.dx along any small motion from rest, with preloads, laws and any exponent."""
    bench, _ = bench_of(name)
    if name == "corners":
        bench.sys.kinds["contacts"].rows["ri"], bench.sys.kinds["contacts"].rows["n"] = 20.0, 2.3
    bench.work.now.history[:] = 1e3
    q, d = bench.q.copy(), np.random.default_rng(3).standard_normal(bench.layout.nv)
    found = slope(lambda s: bench.at(0.0, bench.moved(q, s * d), 0.0, 0.0).energies[3])
    wanted = bench.at(0.0, q, 0.0, 0.0).residual @ d
    assert abs(wanted) > 0.1
    assert found == pytest.approx(wanted, rel=1e-8)


def test_a_law_of_no_length_is_told():
    """The status, and the row."""
    bench, _ = bench_of("law")
    assert solve_stage(bench.sys, bench.state, bench.work, RESIDUAL) == SUCCESS
    rows = bench.sys.kinds["force_characteristics"].rows
    rows["J"] = rows["I"]
    bench.work.failed_element[0] = -1
    assert solve_stage(bench.sys, bench.state, bench.work, RESIDUAL) == ZERO_LENGTH
    assert bench.work.failed_element[0] == 0
