"""Mass properties: closed forms against quadrature, and what can be."""

from __future__ import annotations

import re

import numpy as np
import pytest
from truthkit import run

from flexmb.errors import SceneError
from flexmb.model import Model

SHAPES = [
    {"type": "box", "size": [0.1, 0.2, 0.3]},
    {"type": "cylinder", "radius": 0.1, "length": 0.3},
    {"type": "cylinder", "radius": 0.1, "length": 0.3, "axis": "y"},
    {"type": "sphere", "radius": 0.1},
]


def _inside(shape, x):
    if shape["type"] == "box":
        return (np.abs(x) <= np.array(shape["size"]) / 2).all(axis=-1)
    if shape["type"] == "sphere":
        return (x**2).sum(axis=-1) <= shape["radius"] ** 2
    k = "xyz".index(shape.get("axis", "z"))
    across = (x**2).sum(axis=-1) - x[..., k] ** 2
    return (across <= shape["radius"] ** 2) & (np.abs(x[..., k]) <= shape["length"] / 2)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: s["type"] + s.get("axis", ""))
def test_shapes_agree_with_counting_cells(shape):
    n, half = 100, 0.16
    c = (np.arange(n) + 0.5) / n * 2 * half - half
    x = np.stack(np.meshgrid(c, c, c, indexing="ij"), axis=-1)
    mass = _inside(shape, x) * 1000.0 * (2 * half / n) ** 3
    squares = np.array([(mass * x[..., k] ** 2).sum() for k in range(3)])
    body = Model().add_body("b", shape=shape, density=1000)
    found = body.mass_properties
    if shape["type"] == "box":  # cells do not fit the box: the exact formula is checked instead
        assert found.mass == pytest.approx(6.0)
        assert found.inertia[0, 0] == pytest.approx(6.0 * (0.2**2 + 0.3**2) / 12)
        return
    assert found.mass == pytest.approx(mass.sum(), rel=2e-2)
    wanted = (squares.sum() - squares) / mass.sum()
    np.testing.assert_allclose(np.diag(found.inertia) / found.mass, wanted, rtol=1e-2)


def test_given_inertia_in_three_ways():
    matrix = [[2, 0.1, 0], [0.1, 3, 0], [0, 0, 4]]
    table = {"xx": 2, "yy": 3, "zz": 4, "xy": 0.1}
    for inertia in (matrix, table, np.array(matrix)):
        body = Model().add_body("b", mass=1, inertia=inertia, center=[1, 0, 0])
        np.testing.assert_array_equal(body.mass_properties.inertia, matrix)
        np.testing.assert_array_equal(body.mass_properties.center, [1, 0, 0])


def test_a_shape_with_a_mass_scales_its_inertia():
    model = Model(parameters={"m": 2.5})
    body = model.add_body("b", mass="2*m", shape={"type": "sphere", "radius": 1})
    assert body.mass_properties.inertia[0, 0] == pytest.approx(0.4 * 5)


def test_a_library_material_gives_the_density():
    body = Model().add_body("b", shape={"type": "box", "size": [1, 1, 1]}, material="steel")
    assert body.mass_properties.mass == 7850


def test_a_thin_plate_lies_on_the_limit_and_passes():
    assert Model().add_body("plate", mass=1, inertia=[1, 1, 2]).mass_properties.mass == 1


@pytest.mark.parametrize(
    ("fields", "slip"),
    [
        ({"density": 7.85}, r"bodies.b: density 7.85 kg/m\^3 .* given in g/cm\^3\? .* 7850 kg"),
        ({"density": "7850 t/mm^3"}, r"given in kg/m\^3\? Then it is 7850"),
        ({"density": 1.0}, None),  # of an example
        ({"density": 25.0}, None),  # foam
        ({"density": 1e-3}, None),  # hardly any mass
        ({"mass": 1e-3}, None),
    ],
)
def test_densities_of_shapes_that_slipped_are_named(fields, slip):
    model = Model()
    model.add_body("b", shape={"type": "box", "size": [1, 1, 1]}, **fields)
    (sentence,) = model.warnings() or ("",)
    assert bool(sentence) == bool(slip) and (not slip or re.search(slip, sentence))


def on_an_arm(inertia, plane=None, place=(-1.0, 0.0, 0.0)):
    """A body of 2 kg with a pin 1 m from its centre."""
    made = Model("point", plane=plane)
    made.add_body("bob", mass=2.0, inertia=inertia, position=[1, 0, 0])
    made.add_marker("bob.pin", position=list(place))
    made.add_joint("pin", "revolute", between=["ground", "bob.pin"], axis="z")
    return made


def test_an_inertia_that_round_off_loses_is_named_with_its_cure():
    """Less than 1e-12 m a² about an axis that the arm is not along; in a plane, of its normal."""
    (sentence,) = on_an_arm([1.0, 1.9e-12, 1.0]).warnings()
    assert sentence.startswith("bodies.bob.inertia: 1.9e-12 kg m^2 is round-off beside its mass")
    assert "arm of 1 m to a joint" in sentence and "at least 2e-09 kg m^2" in sentence
    for quiet in ([1e-20, 1e-11, 1e-11], [1.0, 2.1e-12, 1.0]):
        assert not on_an_arm(quiet).warnings()
    assert not on_an_arm([1e-11, 1.9e-12, 1e-11], "xy").warnings()
    assert on_an_arm([1.0, 1.0, 1e-13], "xy").warnings()
    assert not on_an_arm([1e-20] * 3, place=(0, 0, 0)).warnings()


@pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")
def test_explicit_methods_refuse_it_and_implicit_ones_do_not():
    """Their steps would shrink by round-off, or errors be five times what was asked for."""
    made = on_an_arm([1e-13] * 3)
    knobs = {"duration": 0.1, "outputs": 2, "accuracy": 1e-4}
    with pytest.raises(SceneError, match='bodies.bob.inertia: 1e-13 .* method = "radau"'):
        run(made, method="explicit-rk", **knobs)
    told = run(made, **knobs).statistics
    assert told["method"] == "radau" and told["steps"] < 50
    assert told["reason_of_method"] == "an inertia that is round-off"


def test_a_point_that_a_guide_does_not_let_turn_is_no_mistake():
    """Its inertia has no say."""
    made = on_an_arm([1e-13] * 3)
    made.add_joint("guide", "prismatic", between=["ground", "bob"], axis="x")
    assert not made.warnings()
