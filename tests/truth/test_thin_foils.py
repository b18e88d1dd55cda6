"""Foils that linear theory bends by many times their thickness: all that runs and parts tell them.

Truth: w + c w³/h² is proportional to the load, with c from one point of Levy's clamped square (NACA
TN 847, 1942: w = 0.471 h at q a⁴/(E h⁴) = 38.3, where linear theory has 0.523 h).
"""

from __future__ import annotations

import numpy as np
import pytest

import flexmb
from flexmb import Model

LINEAR, LEVY = 0.00126532 * 38.3 * 12 * (1 - 0.316**2), 0.471
SMALL = np.sqrt(0.01 * LEVY**3 / (LINEAR - LEVY))  # deflection over h with a change of 1 %
SQUARE = {"type": "plate", "length": 1.0, "width": 1.0, "divisions": [10, 10], "elements": "quad"}
WIND = {"type": "pressure", "group": "surface", "pressure": 1.0}
LIMITS = ("deflection", "rotation", "load_factor", "stiffening", "membrane_forces")


def sections(thickness):
    return {"surface": {"type": "shell", "thickness": thickness}}


@pytest.mark.parametrize("thickness", [1e-3, 1e-4])
def test_a_foil_in_wind_tells_up_to_which_deflection_it_is_linear(thickness):
    model = Model("foil")
    foil = flexmb.reduce(
        SQUARE, material="aluminium", sections=sections(thickness), interfaces={"rim": "edges"},
        modes=6, loads={"wind": WIND}, name="foil",
    )  # fmt: skip
    model.add_body("foil", foil)
    model.add_marker("ground.rim", position=foil.interface("rim").position)
    model.add_joint("rim", "fixed", between=["ground.rim", "foil.rim"])
    model.add_force("wind", "body-load", body="foil", load="wind", value="100*t")
    model.set_validity(**dict.fromkeys(LIMITS, "any"))
    result = flexmb.statics(model, duration=1.0, outputs=2)
    (note,) = [one for one in result.notes if "membrane forces are left out" in one]
    assert float(note.split()[-2]) == pytest.approx(SMALL * thickness, rel=0.07)


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
