"""Frequencies of beams with all ends against the tables of Euler-Bernoulli and Timoshenko."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from femeshes import held_frequencies, line, slope
from scipy.optimize import brentq
from scipy.special import iv, jv, kv, yv

from flexmb.fe import assemble, circle, general, rectangle, resolve, tapered

REFERENCE = json.loads((Path(__file__).parents[1] / "references" / "beams.json").read_text())
STEEL = resolve({"E": 210e9, "nu": 0.3, "density": 7850})
ENDS = {
    "clamped_free": ((0, 1, 2, 3, 4, 5), ()),
    "clamped_clamped": ((0, 1, 2, 3, 4, 5), (0, 1, 2, 3, 4, 5)),
    "clamped_pinned": ((0, 1, 2, 3, 4, 5), (0, 1, 2, 3)),
    "pinned_pinned": ((0, 1, 2, 3), (1, 2, 3)),
    "free_free": ((), ()),
}


def in_plane(fe, ends, count):
    """Lowest frequencies of bending in the xy plane; displacement along x and all else held."""
    table = fe.numbering.table
    held = [table[:, (0, 2, 3, 4)].ravel()]
    for node, motions in zip((0, -1), ENDS[ends], strict=True):
        held.append(table[node, list(motions)])
    held = np.unique(np.concatenate(held))
    with np.errstate(invalid="ignore"):  # rigid motions of a free beam
        return held_frequencies(fe, held, count)


@pytest.mark.parametrize("ends", ["clamped_free", "clamped_clamped", "clamped_pinned"])
def test_euler_bernoulli_by_ends(ends):
    """Error of cubic elements (kh)^4/720; rotary inertia of h/L = 1e-4 is below 1e-6."""
    section = rectangle(1e-4, 2e-4, shear=False)
    scale = np.sqrt(STEEL.E * section.Iz / (STEEL.density * section.A))
    fe = assemble(line(40), STEEL, {"all": section})
    exact = np.array(REFERENCE["euler_bernoulli"]["values"][ends][:5])
    error = in_plane(fe, ends, 5) / scale / exact - 1
    assert np.abs(error).max() < 3 * (np.sqrt(exact[-1]) / 40) ** 4 / 720 + 1e-6


@pytest.mark.parametrize("ratio", ["0.02", "0.05", "0.1", "0.2"])
@pytest.mark.parametrize("ends", sorted(ENDS))
def test_timoshenko_by_ends_and_thickness(ends, ratio):
    """k = 5/6, nu = 0.3; the interpolation is exact for statics, so the error is O(h^2) or less."""
    h = float(ratio)
    section = rectangle(h, h, ky=5 / 6, kz=5 / 6)
    scale = np.sqrt(STEEL.E * h**2 / 12 / STEEL.density)
    exact, errors = np.array(REFERENCE["timoshenko"]["values"][ratio][ends][:3]), []
    sizes = (12, 24)
    for n in sizes:
        fe = assemble(line(n), STEEL, {"all": section})
        rigid = 2 if ends == "free_free" else 0
        errors.append(in_plane(fe, ends, 3 + rigid)[rigid:] / scale / exact - 1)
    assert np.abs(errors[-1]).max() < 4e-3
    for error in np.transpose(errors):
        assert slope(sizes, error) < -1.9


@pytest.mark.parametrize("share", ["0.1", "0.5", "1", "2", "10"])
def test_tip_mass(share):
    """The reference is rounded to 15 digits; the elements' error is 1e-6 at 20 of them."""
    section = rectangle(1e-4, 2e-4, shear=False)
    scale = np.sqrt(STEEL.E * section.Iz / (STEEL.density * section.A))
    mass = float(share) * STEEL.density * section.A
    fe = assemble(line(20), STEEL, {"all": section}, masses={"load": {"at": "tip", "mass": mass}})
    exact = np.array(REFERENCE["tip_mass"]["values"][share][:3])
    assert in_plane(fe, "clamped_free", 3) / scale == pytest.approx(exact, rel=1e-4)
    assert fe.inertia.mass == pytest.approx(mass * (1 + 1 / float(share)))


def bessel_root(order, tip):
    """First root of a cantilever cut from a wedge (order 1) or cone (order 2) at ``tip`` of its
    length: (x^(n+2) w'')'' = omega^2 x^n w has the solutions x^(-n/2) Z_n(2 sqrt(omega x)), Z_n
    any Bessel function (Kirchhoff 1879)."""

    def determinant(omega):
        root, end, n = 2 * np.sqrt(omega), 2 * np.sqrt(omega * tip), order
        return np.linalg.det(
            [
                [f(n, root) for f in (jv, yv, iv, kv)],
                [-jv(n + 1, root), -yv(n + 1, root), iv(n + 1, root), -kv(n + 1, root)],
                [f(n + 2, end) for f in (jv, yv, iv, kv)],
                [jv(n + 1, end), yv(n + 1, end), iv(n + 1, end), -kv(n + 1, end)],
            ]
        )

    grid = np.linspace(3.0, 40.0, 400) / (1 - tip) ** 0.5
    values = [determinant(w) for w in grid]
    first = next(k for k in range(len(grid) - 1) if values[k] * values[k + 1] < 0)
    return brentq(determinant, grid[first], grid[first + 1], xtol=1e-12)


def test_the_bessel_root_is_kirchhoffs_for_a_whole_wedge_and_cone():
    """5.315 and 8.719: Kirchhoff (1879), quoted by Timoshenko, Vibration Problems, section 43."""
    assert bessel_root(1, 1e-4) == pytest.approx(5.315, abs=2e-3)
    assert bessel_root(2, 1e-4) == pytest.approx(8.719, abs=2e-3)


@pytest.mark.parametrize("shape", ["cone", "wedge"])
def test_tapered_cantilevers_converge_to_the_bessel_solution(shape):
    tip, sizes, errors = 0.3, (4, 8, 16), []
    if shape == "cone":
        ends, order = [circle(r, shear=False) for r in (1e-3, 1e-3 * tip)], 2
    else:
        ends, order = [rectangle(d, 2e-3, shear=False) for d in (1e-3, 1e-3 * tip)], 1
    scale = np.sqrt(STEEL.E * ends[0].Iz / (STEEL.density * ends[0].A)) * (1 - tip) ** 2
    for n in sizes:
        fe = assemble(line(n), STEEL, {"all": tapered(*ends)})
        errors.append(in_plane(fe, "clamped_free", 1)[0] / scale / bessel_root(order, tip) - 1)
    assert abs(errors[-1]) < 1e-4
    assert slope(sizes, errors) < -1.9


def test_taper_of_values_is_linear_where_shapes_differ():
    """Mass of a linear area: rho L (A1 + A2)/2; a beam drawn the other way is the same."""
    ends = circle(0.1), general(A=0.01, Iy=1e-5, Iz=1e-5, J=1e-5)
    fe = assemble(line(5), STEEL, {"all": tapered(*ends)})
    assert fe.inertia.mass == pytest.approx(STEEL.density * (ends[0].A + ends[1].A) / 2)
    lighter = fe.center[0]
    back = assemble(line(5, (1, 0, 0), (0, 0, 0)), STEEL, {"all": tapered(*ends)})
    assert back.center[0] == pytest.approx(1 - lighter)
