"""Beam frequencies converge to the exact ones at the expected rates."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from femeshes import held_frequencies, line, slope

from flexmb.fe import assemble, circle, rectangle, resolve

REFERENCE = json.loads((Path(__file__).parents[1] / "references" / "beams.json").read_text())
STEEL = resolve({"E": 210e9, "nu": 0.3, "density": 7850})
SKEW = np.array([2.0, 1.0, 2.0]) / 3.0


def cantilever(n, section, count):
    fe = assemble(line(n, (0.1, 0.2, 0.3), (0.1, 0.2, 0.3) + SKEW), STEEL, {"all": section})
    return held_frequencies(fe, fe.numbering.table[0], count)


def test_euler_bernoulli_roots_at_order_four():
    """A thin beam (h/L = 5e-4, so that rotary inertia shifts these by 2e-7) in both planes."""
    b, h = 5e-4, 4e-4
    exact = np.array([pair[1] for pair in REFERENCE["euler_bernoulli_clamped_free"]["values"]])
    scale = [np.sqrt(STEEL.E * size**2 / 12 / STEEL.density) for size in (h, b)]
    wanted = np.sort(np.concatenate([exact * s for s in scale]))[:4]
    sizes, errors = (3, 6, 9), []
    for n in sizes:
        errors.append(cantilever(n, rectangle(b, h, shear=False), 4) / wanted - 1)
    assert np.abs(errors[-1]).max() < 1.5e-4
    for error in np.transpose(errors):
        assert slope(sizes, error) == pytest.approx(-4, abs=0.3)


def test_timoshenko_reference_by_refinement():
    values = REFERENCE["timoshenko"]["values"]["0.1"]["clamped_free"][:3]
    h = 0.1
    scale = np.sqrt(STEEL.E * h**2 / 12 / STEEL.density)
    sizes, errors = (8, 16, 32), []
    for n in sizes:
        found = cantilever(n, rectangle(h, 2 * h, ky=5 / 6, kz=5 / 6), 12) / scale
        near = [found[np.argmin(np.abs(found - value))] for value in values]
        errors.append(np.array(near) / values - 1)
    assert np.abs(errors[-1]).max() < 1e-3
    for error in np.transpose(errors):
        assert slope(sizes, error) < -1.9


def test_axial_and_torsional_roots_at_order_two():
    """Clamped-free: omega = pi/2 c/L with c the bar or the torsion wave speed."""
    section = circle(0.01, shear=False)
    speeds = np.sqrt([STEEL.E / STEEL.density, STEEL.E / 2.6 / STEEL.density])
    sizes, errors = (4, 8, 16), []
    for n in sizes:
        fe = assemble(line(n), STEEL, {"all": section})
        table = fe.numbering.table
        error = []
        for direction, speed in zip((0, 3), speeds, strict=True):
            others = np.delete(table, direction, axis=1).ravel()
            held = np.append(others, table[0, direction])
            error.append(held_frequencies(fe, held, 1)[0] / (np.pi / 2 * speed) - 1)
        errors.append(error)
    for error in np.transpose(errors):
        assert slope(sizes, error) == pytest.approx(-2, abs=0.05)


def test_static_tip_deflection_of_a_timoshenko_beam_is_exact():
    """P L^3/(3 E I) + P L/(k G A) with one element."""
    section = rectangle(0.1, 0.2).with_material(STEEL)
    fe = assemble(line(1), STEEL, {"all": section})
    tip, G = fe.numbering.table[1], STEEL.E / 2.6
    u = np.linalg.solve(fe.K.toarray()[np.ix_(tip, tip)], np.eye(6))
    assert u[1, 1] == pytest.approx(
        1 / (3 * STEEL.E * section.Iz) + 1 / (section.ky * G * section.A)
    )
    assert u[2, 2] == pytest.approx(
        1 / (3 * STEEL.E * section.Iy) + 1 / (section.kz * G * section.A)
    )
    assert u[4, 2] == pytest.approx(-1 / (2 * STEEL.E * section.Iy))
    assert u[3, 3] == pytest.approx(1 / (G * section.J))
