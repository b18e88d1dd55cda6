"""Materials: resolved from names and numbers, and warned about when units have slipped."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.errors import MaterialError
from flexmb.fe.sections.section_tables import resolve
from flexmb.materials import LIBRARY, OrthotropicMaterial, plausibility


def test_from_a_name_a_mapping_and_itself():
    steel = resolve("steel")
    assert resolve(steel) is steel
    given = resolve({"E": 1e9, "nu": 0.2, "density": 2000, "name": "mine"})
    assert (given.E, given.nu, given.density, given.name) == (1e9, 0.2, 2000.0, "mine")


def test_the_library_is_plausible():
    assert not [sentence for entry in LIBRARY.values() for sentence in plausibility(entry)]


@pytest.mark.parametrize(
    ("density", "E", "sentence"),
    [
        (7.85e-9, 210e9, r"density 7.85e-09 .* given in t/mm\^3\? Then it is 7850 kg/m\^3"),
        (7.85e-6, 210e9, r"given in kg/mm\^3\?"),
        (7.85, 210e9, r"given in g/cm\^3\?"),
        (7850, 210e3, "210000 Pa is implausible at .* given in MPa"),
        (7850, 210e6, r"MPa in place of GPa\? Then it is 2.1e\+11 Pa"),  # "210 MPa" for steel
        (2700, 70e6, "MPa in place of GPa"),
        (1130, 2900, r"given in MPa\? Then it is 2.9e\+09 Pa"),
        (7.85e15, 2.1e17, r"given in kg/m\^3\? Then it is 7850"),  # as mm-t-s takes it
        (7850, 210, "given in GPa"),
        (900, 9e11, "wave speed sqrt.E/density. = 3.162e.04 m/s"),
        (7850, 2e6, "2e.06 Pa is implausible at a density of 7850 kg/m.3$"),
    ],
)
def test_unit_slips_are_named(density, E, sentence):
    import re

    found = "\n".join(plausibility(resolve({"E": E, "nu": 0.3, "density": density})))
    assert re.search(sentence, found)


@pytest.mark.parametrize(
    ("density", "E"),
    [(1070, 69e3), (50, 1e4), (15, 5e6), (60, 6e7), (920, 1e6), (1200, 1e6), (2000, 2e7)]
    + [(150, 3e9), (1850, 287e9), (3515, 1.05e12), (11340, 16e9), (11850, 8e9), (19300, 79e9)],
)
def test_soft_light_and_heavy_materials_are_plausible(density, E):
    """Silicone, foams, rubber, soil; balsa, beryllium, diamond; lead, thallium, gold."""
    assert not plausibility(resolve({"E": E, "nu": 0.3, "density": density}))


def test_all_mistakes_at_once():
    with pytest.raises(MaterialError) as caught:
        resolve({"E": "stiff", "Nu": 0.3})
    text = str(caught.value)
    assert "material.E: must be a number" in text
    assert "material.Nu: unknown key; nearest: nu" in text
    assert "material.density: is missing" in text


@pytest.mark.parametrize(("key", "value"), [("E", -1.0), ("nu", 0.5), ("density", 0.0)])
def test_impossible_values(key, value):
    with pytest.raises(MaterialError, match=f"material.{key}"):
        resolve({"E": 1e9, "nu": 0.2, "density": 2000} | {key: value})


PLY = OrthotropicMaterial("ply", (130e9, 9e9, 7e9), (0.3, 0.4, 0.25), (5e9, 3e9, 4e9), 1600.0)


@pytest.mark.parametrize(
    ("along", "strain"),
    [
        (0, [1 / 130, -0.3 / 130, -0.25 / 130]),
        (1, [-0.3 / 130, 1 / 9, -0.4 / 9]),
        (2, [-0.25 / 130, -0.4 / 9, 1 / 7]),
    ],
)
def test_tension_of_an_orthotropic_material(along, strain):
    """Contraction along j under stress along i is nu_ij/E_i = nu_ji/E_j (Jones, Mechanics of
    Composite Materials, 2nd ed., 2.2), in space and in a plane."""
    strain = np.array([*strain, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(PLY.stiffness() @ strain, 1e9 * np.eye(6)[along], atol=1e-4)
    if along < 2:
        flat = np.array([strain[0], strain[1], 0.0])
        np.testing.assert_allclose(PLY.plane_stress() @ flat, 1e9 * np.eye(3)[along], atol=1e-4)


def test_shear_moduli_of_an_orthotropic_material():
    """In the order 23, 31, 12 in space, and 13, 23 across a layer."""
    assert np.diag(PLY.stiffness())[3:] == pytest.approx([3e9, 4e9, 5e9], rel=1e-15)
    assert PLY.transverse_shear() == pytest.approx(np.diag([4e9, 3e9]), rel=1e-15)
    assert PLY.plane_stress()[2, 2] == 5e9
