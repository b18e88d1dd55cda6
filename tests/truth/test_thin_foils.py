"""Foils that linear theory bends by many times their thickness: all that runs and parts tell them.

Truth: w + c w³/h² is proportional to the load, with c from one point of Levy's clamped square (NACA
TN 847, 1942: w = 0.471 h at q a⁴/(E h⁴) = 38.3, where linear theory has 0.523 h).
"""

from __future__ import annotations

import numpy as np
import pytest

import flexmb
from flexmb import Model
from flexmb.fe.meshes.mesh_shapes import mesh_from

LINEAR, LEVY = 0.00126532 * 38.3 * 12 * (1 - 0.316**2), 0.471
SMALL = np.sqrt(0.01 * LEVY**3 / (LINEAR - LEVY))  # deflection over h with a change of 1 %
SQUARE = {"type": "plate", "length": 1.0, "width": 1.0, "divisions": [10, 10], "elements": "quad"}
WIND = {"type": "pressure", "group": "surface", "pressure": 1.0}
LIMITS = ("deflection", "rotation", "load_factor", "stiffening", "membrane_forces")


def sections(thickness):
    return {"surface": {"type": "shell", "thickness": thickness}}


def test_a_solid_plate_tells_up_to_which_deflection_it_is_linear():
    """As a shell does, although its modes stretch by themselves."""
    thickness = 2e-3
    mesh = {"type": "box", "size": [1, 1, thickness], "divisions": [12, 12, 1],
            "elements": "hexahedron27"}  # fmt: skip
    x, y, _ = mesh_from(mesh, "mesh").points.T
    rim = np.flatnonzero(np.isin(x, [0, 1]) | (np.abs(y) > 0.4999)).tolist()
    top = {"type": "pressure", "group": "z1", "pressure": 1.0}
    plate = flexmb.reduce(
        mesh, material="aluminium", interfaces={"rim": {"nodes": rim}}, modes=10,
        loads={"wind": top}, name="plate",
    )  # fmt: skip
    assert told(plate, 30.0) == pytest.approx(SMALL * thickness, rel=0.1)


def told(body, pressure):
    """Deflection [m] up to which the change is less than 1 %, under a pressure on the body."""
    model = Model("plate in wind")
    model.add_body("plate", body)
    model.add_marker("ground.rim", position=body.interface("rim").position)
    model.add_joint("rim", "fixed", between=["ground.rim", "plate.rim"])
    model.add_force("wind", "body-load", body="plate", load="wind", value=f"{pressure}*t")
    near = np.linalg.norm(body.nodes.position - (0.5, 0, 0), axis=1).argmin()
    model.add_marker("plate.middle", node=int(body.nodes.ids[near]))
    model.add_sensor("middle", "position", of="plate.middle")
    model.set_validity(**dict.fromkeys(LIMITS, "any"))
    result = flexmb.statics(model, duration=1.0, outputs=2)
    (note,) = [one for one in result.notes if "membrane forces are left out" in one]
    return float(note.split()[-2])


@pytest.mark.parametrize("thickness", [1e-3, 1e-4])
def test_a_foil_in_wind_tells_up_to_which_deflection_it_is_linear(thickness):
    foil = flexmb.reduce(
        SQUARE, material="aluminium", sections=sections(thickness), interfaces={"rim": "edges"},
        modes=6, loads={"wind": WIND}, name="foil",
    )  # fmt: skip
    assert told(foil, 100.0) == pytest.approx(SMALL * thickness, rel=0.07)


@pytest.mark.parametrize("thickness", [1e-4, 1e-6])
def test_a_foil_by_itself_tells_the_share_of_its_load_at_which_it_is_linear(thickness):
    result = flexmb.part(
        SQUARE, material="aluminium", sections=sections(thickness), loads={"wind": WIND},
        supports={"rim": {"group": "edges", "type": "clamped"}},
    )  # fmt: skip
    (note,) = [one for one in result.notes if "membrane forces" in one]
    deflection = np.linalg.norm(result.displacements(), axis=1).max()
    share = float(note.split("up to about ")[1].split()[0])
    assert share * deflection == pytest.approx(SMALL * thickness, rel=0.07)
    assert "e+" not in note


@pytest.mark.parametrize("tip", [0.01, 0.04])
def test_a_strip_is_linear_up_to_the_deflection_that_it_tells(tip):
    """Its cross-section, bent against the strip, becomes flat: told from 1 % on, and not before."""
    E, width, thickness = 70e9, 0.2, 1e-3
    strip = flexmb.reduce(
        {**SQUARE, "width": width, "divisions": [16, 8]}, sections=sections(thickness), modes=6,
        material={"E": E, "nu": 0.3, "density": 2700}, interfaces={"root": "x0", "tip": "x1"},
        name="strip",
    )  # fmt: skip
    model = Model("strip")
    model.add_body("strip", strip)
    model.add_marker("ground.root", position=strip.interface("root").position)
    model.add_joint("root", "fixed", between=["ground.root", "strip.root"])
    force = 3 * E * width * thickness**3 / 12 * tip
    model.add_force("pull", "force", at="strip.tip", value=[0, 0, f"{force}*t"])
    model.add_sensor("tip", "position", of="strip.tip")
    result = flexmb.statics(model, duration=1.0, outputs=2)
    notes = [one for one in result.notes if "membrane forces are left out" in one]
    assert len(notes) == (tip == 0.04)
    assert all(0.01 < float(one.split()[-2]) < 0.04 for one in notes)


@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron27"])
def test_a_solid_strip_that_bends_in_one_direction_has_no_membrane_forces(kind):
    """w = q L^4/(8 EI), 0.09 of its length, with elements five times as long as thick."""
    mesh = {"type": "box", "size": [1, 0.1, 0.01], "divisions": [20, 2, 1], "elements": kind}
    result = flexmb.part(
        mesh, material={"E": 210e9, "nu": 0.0, "density": 7850},
        supports={"root": {"group": "x0", "hold": ["ux", "uy", "uz"]}},
        loads={"wind": {"type": "pressure", "group": "z1", "pressure": 1.3e4}},
    )  # fmt: skip
    largest = np.linalg.norm(result.displacements(), axis=1).max()
    assert largest == pytest.approx(1.3e4 * 12 / (8 * 210e9 * 0.01**3), rel=0.03)
    assert not result.notes
