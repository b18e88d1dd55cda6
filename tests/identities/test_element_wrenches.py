"""Sensors of reactions of force elements, against what the forces do to their bodies."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import interpreted

CODE = """
from enginekit import Bench
from flexmb.engine.consistent import RESIDUAL, solve_level
from flexmb.model import Model

rng = np.random.default_rng(4)
turn = {"axis": [1, 2, 3], "angle": 0.7}
forces = {
    "spring": ("spring-damper", dict(stiffness=30, damping=2, free_length=0.5)),
    "law": ("spring-damper", dict(spring_force="3*x**3", damper_force="v", value="2*t")),
    "bush": ("bushing", dict(stiffness=[1, 2, 3], rotational_stiffness=4, damping=1)),
    "beam": ("beam", dict(E=10, G=4, A=1, Iy=1, Iz=1, J=2, damping=0.2)),
    "stop": ("stop", dict(upper=0.1, stiffness=3, exponent=2)),
    "touch": ("contact", dict(shapes=[{"type": "sphere", "radius": r} for r in (0.2, 0.4)],
                              stiffness=20, restitution=0.7,
                              friction={"static": 0.4, "dynamic": 0.3, "stiffness": 9})),
    "push": ("force", dict(value=["t", 1, 2], axes="body")),
    "twist": ("torque", dict(value=["t", 1, 2], axes="global")),
    "alone": ("force", dict(value=[1, 2, "t"], axes="body")),
}
for name, (kind, fields) in forces.items():
    made = Model(name)
    for body, place in (("a", [0, 0, 0]), ("b", [1, 0.4, -0.3])):
        made.add_body(body, mass=1, inertia=[1, 1, 1], position=place, orientation=turn)
        made.add_marker(f"{body}.eye", position=[0.1, 0.2, 0.3], orientation=turn)
    pair = ["a.eye", "b.eye"]
    if kind in ("force", "torque"):
        fields = fields | {"at": pair[1]} | ({} if name == "alone" else {"reaction": pair[0]})
    else:
        fields = fields | {"between": pair}
    made.add_force("f", kind, **fields)
    sides = "J" if name == "alone" else "IJ"
    for side in sides:
        for what in ("force", "moment"):
            made.add_sensor(f"{what}{side}", "reaction", force="f", on=side, quantity=what,
                            axes="global")
    bench = Bench(made, as_compiled=True)
    bench.randomise(9)
    if name == "touch":  # wherever the random state has put them
        bench.sys.contacts["ri"], bench.sys.contacts["rj"] = 5.0, 7.0
    bench.work.now.kept[:] = 0.3
    bench.work.now.span[:] = 0.1
    bench.at(vd=0.0)
    W, body = bench.work.now.marker["W"], bench.sys.parts.markers["body"]
    acts = [W[body == "ab".index("a" if side == "I" else "b")].sum(axis=0) for side in sides]
    found[name] = [bench.channels, np.concatenate(acts)]
    if name == "law":
        places = [solve_level(bench.sys, bench.state, bench.work, RESIDUAL)]
        bench.sys.elements.laws["J"] = bench.sys.elements.laws["I"]
        places += [solve_level(bench.sys, bench.state, bench.work, RESIDUAL)]
        found["no length"] = places
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return interpreted(CODE, tmp_path_factory.mktemp("wrenches"))


@pytest.mark.parametrize(
    "name", ["spring", "law", "bush", "beam", "stop", "touch", "push", "twist", "alone"]
)
def test_what_is_read_is_what_acts(found, name):
    read, acts = found[name]
    assert np.abs(acts).max() > 0.1
    np.testing.assert_allclose(read, acts, rtol=0, atol=1e-12 * np.abs(acts).max())


def test_a_law_of_no_length_is_told(found):
    """−1 − its row, and 0 where all is well."""
    np.testing.assert_array_equal(found["no length"], [0, -1])
