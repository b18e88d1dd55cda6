"""Shapes of shell elements: axes, order of nodes, warp, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from shellkit import CORNERS, KINDS, PLY, SECTIONS, corners

from flexmb.errors import MeshError
from flexmb.fe.elements.element_blocks import ADVICE, FAMILIES
from flexmb.fe.elements.shell_fields import flatten, warp
from flexmb.fe.sections.shell_section import shell

ROUND = 1e-12  # rounding of sums of a few hundred products, relative to the largest


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["thick", "layered"])
def test_the_first_node_does_not_matter(kind, name):
    """Edges keep their sense of shear whichever node an element begins with."""
    x, section = corners(kind, 0.05), SECTIONS[name]
    k = x.shape[1]
    turned = np.arange(6 * k).reshape(k, 6)[np.roll(np.arange(k), -1)].ravel()
    family, rolled = FAMILIES[kind], np.roll(x, -1, axis=1)
    u = np.linspace(-1e-3, 1e-3, 6 * k)
    pairs = [
        (family.stiffness(x, section)[0], family.stiffness(rolled, section)[0]),
        (family.mass(x, section).Mab[0], family.mass(rolled, section).Mab[0]),
        (
            family.geometric_stiffness(x, section, u[None])[0],
            family.geometric_stiffness(rolled, section, u[None, turned])[0],
        ),
    ]
    for here, there in pairs:
        wanted = here[..., turned, :][..., turned]
        assert there == pytest.approx(wanted, abs=ROUND * np.abs(here).max())


def test_turning_an_element_over_exchanges_its_faces():
    x, section = corners("triangle"), SECTIONS["thick"]
    over, u = [0, 2, 1], np.linspace(-1e-3, 1e-3, 18)
    K = FAMILIES["triangle"].stiffness(x[:, over], section)[0]
    turned = np.arange(18).reshape(3, 6)[over].ravel()
    here = FAMILIES["triangle"].stiffness(x, section)[0]
    assert K == pytest.approx(here[turned][:, turned], abs=ROUND * K.max())
    s = FAMILIES["triangle"].stress(x, section)[0] @ u
    other = FAMILIES["triangle"].stress(x[:, over], section)[0] @ u[turned]
    assert other[:, ::-1] == pytest.approx(s[over], abs=1e-9 * np.abs(s).max())


def test_default_direction_of_axis_1():
    """x projected on the element, y where the element faces x."""
    level = flatten(CORNERS[None]).axes[0]
    facing = flatten(CORNERS[None][:, :, [2, 0, 1]]).axes[0]
    assert level == pytest.approx(np.eye(3))
    assert facing[:, 0] == pytest.approx([0, 1, 0])
    assert facing[:, 2] == pytest.approx([1, 0, 0])


def test_bad_shapes_are_found():
    good = CORNERS
    folded = CORNERS[[0, 2, 1, 3]]
    concave = np.array([[0.0, 0, 0], [1, 0, 0], [0.2, 0.2, 0], [0, 1, 0]])
    collapsed = CORNERS[[0, 1, 1, 3]]
    x = np.stack([good, folded, concave, collapsed, np.zeros((4, 3)), good * 1e-4])
    assert FAMILIES["quad"].defects(x).tolist() == [1, 2, 3, 4]
    flat = np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2]])
    assert FAMILIES["triangle"].defects(np.stack([CORNERS[:3], flat])).tolist() == [1]


def test_warp_is_the_height_over_the_size():
    x = np.array([[0, 0, 0.01], [2, 0, -0.01], [2, 2, 0.01], [0, 2, -0.01]])[None]
    assert warp(x) == pytest.approx([0.005], rel=1e-3)
    assert warp(corners("quad")) == pytest.approx([0.0], abs=1e-15)
    assert warp(corners("triangle")) == pytest.approx([0.0], abs=1e-15)


def test_orientation_along_the_normal_is_refused():
    section = shell(0.01, material=PLY, orientation=(0.0, 0.0, 2.0))
    with pytest.raises(MeshError, match="orientation is normal to 1 shell"):
        FAMILIES["quad"].stiffness(CORNERS[None], section)


def test_strongly_warped_quadrilaterals_are_refused():
    x = np.array([[0, 0, 0.5], [2, 0, -0.5], [2, 2, 0.5], [0, 2, -0.5]])[None]
    with pytest.raises(MeshError, match="1 quadrilaterals are warped.*0.25 of their size.*finer"):
        FAMILIES["quad"].mass(x, SECTIONS["thin"])


def test_surfaces_with_mid_sides_are_refused_with_advice():
    assert not {"triangle6", "quad8", "quad9"} & set(FAMILIES)
    for kind in ("triangle6", "quad8", "quad9"):
        assert "first-order" in ADVICE[kind]
