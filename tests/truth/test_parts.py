"""Parts by themselves against NAFEMS' tests of free vibration and exact solutions of plates.

Values: tests/references of NAFEMS FV13, FV15, FV16, FV21, FV22 (Altair OptiStruct verification
manual OS-V 0410 to 0435, Abaqus Benchmarks R0016), Navier and Mindlin as given there.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import flexmb

STEEL = {"E": 200e9, "nu": 0.3, "density": 8000}


def plate(thickness, supports, count, n=24, skew=0.0):
    mesh = {"type": "plate", "length": 10, "width": 10, "divisions": [n, n], "skew": skew}
    sections = {"surface": {"type": "shell", "thickness": thickness}}
    return flexmb.part(
        mesh, material=STEEL, sections=sections, supports=supports, frequencies=count
    ).frequencies


IN_PLANE = {"sheet": {"group": "surface", "hold": ["ux", "uy", "rz"]}}
SIMPLE = {"edges": {"group": "edges", "hold": ["uz"]}, **IN_PLANE}
HARD = {  # edges that do not turn about their normal
    "x": {"group": "x0", "hold": ["uz", "rx"]}, "xx": {"group": "x1", "hold": ["uz", "rx"]},
    "y": {"group": "y0", "hold": ["uz", "ry"]}, "yy": {"group": "y1", "hold": ["uz", "ry"]},
    **IN_PLANE,
}  # fmt: skip
CLAMPED = {"edges": {"group": "edges", "type": "clamped"}, **IN_PLANE}


@pytest.mark.slow
@pytest.mark.parametrize(
    "thickness, supports, skew, target, within",
    [
        pytest.param(0.05, SIMPLE, 0.0, [2.377, 5.942, 5.942, 9.507], 6e-3, id="FV13"),
        pytest.param(
            0.05, {"root": {"group": "x0", "type": "clamped"}, **IN_PLANE}, 0.0,
            [0.417928, 1.0242, 2.56272, 3.27489, 3.72708, 6.52405], 5e-3, id="FV16, Kirchhoff",
        ),
        pytest.param(
            1.0, HARD, 0.0, [45.9108, 109.528, 109.528, 168.073], 8e-3, id="FV21, Mindlin"
        ),
        pytest.param(
            1.0, CLAMPED, np.pi / 4, [133.95, 201.41, 265.81, 283.68], 2e-2, id="FV22"
        ),
    ],
)  # fmt: skip
def test_plates_of_nafems_vibrate_as_published(thickness, supports, skew, target, within):
    found = plate(thickness, supports, len(target), skew=skew)
    np.testing.assert_allclose(found, target, rtol=within)


@pytest.mark.slow
def test_a_thin_rhombic_plate_converges_to_fv15():
    """The obtuse corners make it slow, from below; two meshes tell the limit."""
    coarse, fine = (plate(0.05, CLAMPED, 4, n=n, skew=np.pi / 4) for n in (16, 32))
    limit = fine + (fine - coarse) / 3
    np.testing.assert_allclose(limit, [7.938, 12.835, 17.941, 19.133], rtol=1.5e-2)


def test_a_cup_that_spins_is_in_balance():
    """Its rim is pulled outwards all around: loads and reactions have no resultants but round-off,
    which is none of the rounding that a very slender part has."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cup = flexmb.part(
            {"type": "tube", "length": 0.15, "radius": 0.1, "elements": "quad",
             "divisions": [32, 10]},
            material="steel", sections={"all": {"type": "shell", "thickness": 0.0012}},
            supports={"base": {"group": "start", "type": "clamped"}},
            loads={"turn": {"type": "spin", "angular_velocity": [500, 0, 0]}},
        )  # fmt: skip
    assert cup.imbalance == 0.0
    np.testing.assert_array_equal(cup.reactions["base"].force, 0.0)
    hoop = 7850.0 * (500.0 * 0.1) ** 2  # away from the base
    assert cup.von_mises().max() == pytest.approx(hoop, rel=0.15)
