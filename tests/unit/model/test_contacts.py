"""Contacts and frictions as a scene says them: written as read, the same in all unit systems."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.engine.compile import compile_system
from flexmb.engine.forces.contact_pair import damping_factor, plane_modulus
from flexmb.model import Model


def scene(units="SI"):
    """A ball and a tube on points, lengths and masses in the units told."""
    mm = units == "mm-t-s"
    length, mass, stiffness = (1e3, 1e-3, 1e8 / 1e3**1.5) if mm else (1.0, 1.0, 1e8)
    made = Model("contact", units=units)
    made.add_body("ball", mass=2 * mass, inertia=[4e-3 * mass * length**2] * 3,
                  position=[0, 0, 0.3 * length])  # fmt: skip
    made.add_body("tube", mass=mass, inertia=[1e-2 * mass * length**2] * 3)
    made.add_force(
        "touch", "contact", between=["ball", "tube"], restitution=0.5, stiffness=stiffness,
        shapes=[
            {"type": "sphere", "radius": 0.1 * length},
            {"type": "cylinder", "radius": 0.5 * length, "axis": "y", "side": "inside"},
        ],
        friction={"static": 0.3, "dynamic": 0.2, "stiffness": 1e5 if not mm else 1e2},
    )  # fmt: skip
    made.add_force(
        "feet", "contact", between=["ground", "tube"], stiffness=stiffness, damping="flores",
        shapes=[
            {"type": "plane"},
            {"type": "points", "points": [[0.1 * length, 0, 0.01 * length], [0, 0, 0.02 * length]]},
        ],
    )  # fmt: skip
    made.add_joint("slide", "prismatic", between=["ground", "tube"], axis="x")
    made.add_force("rub", "joint-friction", joint="slide", dynamic=0.1, length=0.2 * length,
                   stiffness=1e5 if not mm else 1e2)  # fmt: skip
    return made


def test_a_scene_is_written_as_it_was_read():
    model = scene("mm-t-s")
    again = Model.from_scene_dict(model.to_scene_dict())
    assert again.forces == model.forces


def test_units_mean_what_they_say():
    """K d^n in N and mm is K (1000 d)^n in N and m."""
    one, two = (compile_system(scene(units)).system for units in ("SI", "mm-t-s"))
    for kind in ("contacts", "joint_frictions"):
        rows, others = one.kinds[kind].rows, two.kinds[kind].rows
        for name in rows.dtype.names:
            np.testing.assert_allclose(rows[name], others[name], rtol=1e-12, err_msg=name)


def test_each_point_is_a_contact_of_its_own():
    table = compile_system(scene()).system.kinds["contacts"].rows
    assert len(table) == 3
    assert len(set(table["history"])) == 3
    np.testing.assert_array_equal(table["ri"], [0.1, 0.0, 0.0])


@pytest.mark.parametrize("e", [0.05, 0.3, 0.7, 0.95, 0.999])
def test_exact_damping_solves_its_equation(e):
    chi = damping_factor(e, "exact")
    assert chi > 0.0
    assert chi * (1 + e) == pytest.approx(np.log1p(chi) - np.log1p(-chi * e), rel=1e-6)


def test_damping_laws_agree_for_hard_impacts():
    """All three are 3/2 (1 − e) or 8/5 (1 − e) as e goes to 1."""
    e = 1 - 1e-4
    assert damping_factor(e, "exact") == pytest.approx(1.5e-4, rel=1e-3)
    assert damping_factor(e, "lankarani-nikravesh") == pytest.approx(1.5e-4, rel=1e-3)
    assert damping_factor(e, "flores") == pytest.approx(1.6e-4, rel=1e-3)


def test_damping_laws_are_the_published_ones():
    """8 (1 - e)/(5 e) (Flores et al., Multibody Syst. Dyn. 25, 2011), 3/4 (1 - e^2) (Lankarani &
    Nikravesh, J. Mech. Des. 112, 1990)."""
    assert damping_factor(0.5, "flores") == pytest.approx(1.6)
    assert damping_factor(0.5, "lankarani-nikravesh") == pytest.approx(0.5625)
    assert damping_factor(0.2, "flores") == pytest.approx(6.4)


def stiffness(surface):
    """Of a steel ball of 10 mm on a surface of steel."""
    made, steel = Model("hertz"), {"E": 200e9, "nu": 0.3, "density": 7800}
    made.add_body("ball", mass=1, inertia=[1, 1, 1],
                  position=[0, 0, 0 if surface.get("side") == "inside" else 9.0])  # fmt: skip
    made.add_force("touch", "contact", between=["ball", "ground"], materials=[steel, steel],
                   shapes=[{"type": "sphere", "radius": 0.01}, surface])  # fmt: skip
    return compile_system(made).system.kinds["contacts"].rows[0]["K"]


def test_hertz_of_a_ball_on_surfaces_of_one_curvature():
    """4/3 E* sqrt(r) on a plane, E* = E/(2 (1 - nu^2)); more in a bore, less on a shaft, and the
    same in the limit of a large one (Johnson, Contact Mechanics, 4.2)."""
    modulus = 200e9 / (2 * (1 - 0.09))
    assert plane_modulus((200e9, 0.3), (200e9, 0.3)) == pytest.approx(modulus)
    plane = stiffness({"type": "plane"})
    assert plane == pytest.approx(4 / 3 * modulus * 0.1, rel=1e-12)
    bore, shaft = ({"type": "cylinder", "radius": 0.03, "axis": "x", "side": side}
                   for side in ("inside", "outside"))  # fmt: skip
    assert stiffness(bore) > 1.05 * plane > plane > 1.05 * stiffness(shaft)
    assert stiffness({**bore, "radius": 1e4}) == pytest.approx(plane, rel=1e-6)
