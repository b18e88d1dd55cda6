"""Beams against published and closed solutions: NAFEMS frames, spinning blades, buckling."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from femeshes import held_frequencies, line
from scipy.linalg import eigh

from flexmb.fe import Mesh, assemble, circle, rectangle, resolve
from flexmb.fe.assembly.assemble import geometric_stiffness

REFERENCE = json.loads((Path(__file__).parents[1] / "references" / "beams.json").read_text())
STEEL = resolve({"E": 210e9, "nu": 0.3, "density": 7850})
NAFEMS = resolve({"E": 200e9, "nu": 0.3, "density": 8000})


def test_nafems_fv2_double_cross():
    """Eight arms from one node, their outer ends pinned, in-plane.

    The closed roots are those of thin arms that do not stretch. Rotary inertia of arms with h/L =
    0.025 lowers a root by (beta L)^2 (h/L)^2/24, at most 1.3e-3; stretching arms let the middle
    move in two modes of each cluster, which lowers these by up to 0.7 %.
    """
    n, arms = 8, 8
    points, cells = [[0.0, 0.0, 0.0]], []
    for k in range(arms):
        way = np.array([np.cos(np.pi * k / 4), np.sin(np.pi * k / 4), 0.0])
        chain = [0, *range(len(points), len(points) + n)]
        points += [5.0 * (i + 1) / n * way for i in range(n)]
        cells += list(zip(chain[:-1], chain[1:], strict=True))
    mesh = Mesh(np.array(points), {"line": np.array(cells)})
    fe = assemble(mesh, NAFEMS, {"all": rectangle(0.125, 0.125, shear=False)})
    table = fe.numbering.table
    outer = np.arange(n, len(points), n)
    held = np.union1d(table[:, 2:5].ravel(), table[outer, :2].ravel())
    target = REFERENCE["nafems_fv2"]["target"]
    found = held_frequencies(fe, held, 16) / (2 * np.pi)
    assert found == pytest.approx(target, rel=7e-3)
    found = held_frequencies(fe, np.union1d(held, table[0, :2]), 16) / (2 * np.pi)
    assert found == pytest.approx(target, rel=1.5e-3)


def test_nafems_fv4_cantilever_with_masses_off_its_tip():
    """Rayleigh beam by a determinant: 20 elements without shear are within 1e-4 of it."""
    section = circle(0.25, shear=False)
    fe = assemble(
        line(20, end=(10.0, 0.0, 0.0)),
        NAFEMS,
        {"all": section},
        masses={
            "one": {"at": "tip", "mass": 1e4, "offset": [0.0, 2.0, 0.0]},
            "other": {"at": "tip", "mass": 1e3, "offset": [0.0, -2.0, 0.0]},
        },
    )
    found = held_frequencies(fe, fe.numbering.table[0], 6) / (2 * np.pi)
    assert found == pytest.approx(REFERENCE["nafems_fv4"]["rayleigh"], rel=1e-4)
    assert found == pytest.approx(REFERENCE["nafems_fv4"]["target"], rel=3e-4)


def spun(n, speed):
    """Lowest flap and lag of a spinning cantilever, in sqrt(E I/(rho A L^4)) of each plane."""
    section = rectangle(1e-4, 1e-4, shear=False)
    fe = assemble(line(n), STEEL, {"all": section})
    scale = np.sqrt(STEEL.E * section.Iz / (STEEL.density * section.A))
    spin2 = (speed * scale) ** 2
    field = spin2 * np.diag([1.0, 1.0, 0.0, 0.0])[:3]  # force per mass about the z axis
    force = spin2 * (fe.inertia.P[0, 0] + fe.inertia.P[1, 1])
    free = np.setdiff1d(np.arange(fe.numbering.n), fe.numbering.table[0])
    inner = np.ix_(free, free)
    K, M = fe.K.toarray(), fe.M.toarray()
    u = np.zeros(fe.numbering.n)
    u[free] = np.linalg.solve(K[inner], force[free])
    Mab = fe.reduced_mass(np.eye(fe.numbering.n))
    K += geometric_stiffness(fe, u, field).toarray() - spin2 * (Mab[0, 0] + Mab[1, 1])
    found = []
    for others in ((0, 1, 3, 5), (0, 2, 3, 4)):
        rows = np.setdiff1d(free, fe.numbering.table[:, others])
        part = np.ix_(rows, rows)
        found.append(np.sqrt(eigh(K[part], M[part], eigvals_only=True)[0]) / scale)
    return found


@pytest.mark.parametrize(("speed", "n"), [(2, 20), (6, 20), (12, 40)])
def test_spinning_cantilever(speed, n):
    """Published to four decimals; lag^2 = flap^2 - speed^2 exactly."""
    flap, lag = spun(n, speed)
    exact = REFERENCE["rotating"]["values"][str(speed)]
    assert flap == pytest.approx(exact, abs=5e-5 + 1e-5 * exact)
    assert lag**2 == pytest.approx(flap**2 - speed**2, rel=1e-6)
    if speed == 12:
        assert lag == pytest.approx(5.4271, abs=5e-5 + 1e-5 * 5.4271)


def test_spinning_cantilever_converges_at_order_four():
    """With the field of force; without it the axial force has steps and the order is two."""
    flaps = [spun(n, 12)[0] for n in (5, 10, 20, 40)]
    changes = np.abs(np.diff(flaps))
    assert changes[0] / changes[1] > 12 and changes[1] / changes[2] > 12


def buckling_load(fe, force, held):
    """Least factor of a load at which the stiffness under its stress is singular."""
    free = np.setdiff1d(np.arange(fe.numbering.n), held)
    inner = np.ix_(free, free)
    K, u = fe.K.toarray(), np.zeros(fe.numbering.n)
    u[free] = np.linalg.solve(K[inner], force[free])
    K_g = geometric_stiffness(fe, u).toarray()
    values = eigh(-K_g[inner], K[inner], eigvals_only=True)
    return 1 / values[-1]


def test_euler_column_with_hinges():
    """P L^2/(E I) = pi^2; ten cubic elements are 1e-5 above it."""
    section = rectangle(1e-3, 2e-3, shear=False)
    fe = assemble(line(10), STEEL, {"all": section})
    table, force = fe.numbering.table, np.zeros(fe.numbering.n)
    force[table[-1, 0]] = -1.0
    held = np.append(table[0, :4], table[-1, 1:3])
    found = buckling_load(fe, force, held) / (STEEL.E * section.Iz)
    assert found == pytest.approx(np.pi**2, rel=2e-5)


@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (2 / 3, 1 / 3, 2 / 3)])
def test_euler_cantilever(way):
    """P L^2/(E I) = pi^2/4, the same for a beam that lies askew."""
    section = rectangle(0.01, 0.02, shear=False)
    fe = assemble(line(10, end=way), STEEL, {"all": section})
    table, force = fe.numbering.table, np.zeros(fe.numbering.n)
    force[table[-1, :3]] = -np.array(way)
    found = buckling_load(fe, force, table[0]) / (STEEL.E * section.Iz)
    assert found == pytest.approx(np.pi**2 / 4, rel=2e-5)


def test_column_with_shear():
    """Engesser: P = P_E/(1 + P_E/(k G A)) where shear follows the slope of the axis."""
    section = rectangle(0.1, 0.2).with_material(STEEL)
    fe = assemble(line(20), STEEL, {"all": section})
    table, force = fe.numbering.table, np.zeros(fe.numbering.n)
    force[table[-1, 0]] = -1.0
    euler = np.pi**2 / 4 * STEEL.E * section.Iz
    found = buckling_load(fe, force, table[0])
    wanted = euler / (1 + euler / (section.ky * STEEL.G * section.A))
    # the term N I/A B'^2 of the section's own rotation adds P/(E A), here 2e-3
    assert found == pytest.approx(wanted, rel=3e-3)
    assert found < 0.995 * euler


STRIP, FLAT = rectangle(0.002, 0.05, shear=False), rectangle(0.05, 0.002, shear=False)
TWIST = np.sqrt(STEEL.E * STRIP.Iz * STEEL.G * STRIP.J)


@pytest.mark.parametrize(("section", "about"), [(STRIP, 4), (FLAT, 5)])
def test_lateral_buckling_under_a_uniform_moment(section, about):
    """M L = pi sqrt(E I G J) between forks: Timoshenko and Gere, Elastic Stability, 6.3."""
    fe = assemble(line(20), STEEL, {"all": section})
    table, force = fe.numbering.table, np.zeros(fe.numbering.n)
    force[table[0, about]], force[table[-1, about]] = -1.0, 1.0
    held = np.append(table[0, :4], table[-1, 1:4])
    assert buckling_load(fe, force, held) == pytest.approx(np.pi * TWIST, rel=2e-3)


@pytest.mark.parametrize(("section", "along"), [(STRIP, 2), (FLAT, 1)])
def test_lateral_buckling_of_a_cantilever_under_a_tip_force(section, along):
    """P L^2 = 4.013 sqrt(E I G J): Timoshenko and Gere, Elastic Stability, 6.4."""
    fe = assemble(line(20), STEEL, {"all": section})
    table, force = fe.numbering.table, np.zeros(fe.numbering.n)
    force[table[-1, along]] = -1.0
    assert buckling_load(fe, force, table[0]) == pytest.approx(4.013 * TWIST, rel=3e-3)


def test_buckling_of_a_shaft_under_torque():
    """Built-in ends: T L/(2 E I) = 4.4934, the first root of tan x = x (Greenhill 1883)."""
    section = circle(0.002, shear=False)
    fe = assemble(line(20), STEEL, {"all": section})
    table, force = fe.numbering.table, np.zeros(fe.numbering.n)
    force[table[-1, 3]] = 1.0
    held = np.append(table[0], table[-1, [1, 2, 4, 5]])
    found = buckling_load(fe, force, held) / (2 * STEEL.E * section.Iz)
    assert found == pytest.approx(4.493409, rel=1e-4)


def right_angle_frame(n=8):
    """Legs of 240 mm of a strip of 30 x 0.6 mm in their plane (Argyris et al. 1979)."""
    matter = resolve({"E": 71.24e9, "nu": 0.31, "density": 2700.0})
    t = 0.24 * np.arange(n + 1) / n
    points = np.array([[x, 0, 0] for x in t] + [[0.24, -y, 0] for y in t[1:]])
    lines = np.stack([np.arange(2 * n), np.arange(1, 2 * n + 1)], axis=1)
    strip = rectangle(30e-3, 0.6e-3, shear=False, orientation=(0.3, 1.0, 0.0))
    return assemble(Mesh(points, {"line": lines}), matter, {"all": strip})


def test_a_right_angle_frame_under_a_force_at_its_tip():
    """1.088 N one way, 0.680 N the other (Simo & Vu-Quoc, Comput. Methods Appl. Mech. Eng. 58,
    1986, after Argyris et al. 1979): moments turn with the corner."""
    fe = right_angle_frame()
    table, force = fe.numbering.table, np.zeros(fe.numbering.n)
    for sign, wanted in ((1.0, 1.088), (-1.0, 0.680)):
        force[table[-1, 0]] = sign
        assert buckling_load(fe, force, table[0]) == pytest.approx(wanted, rel=5e-3)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_right_angle_frame_under_end_moments(sign):
    """622.2 N mm either way (Argyris et al., Comput. Methods Appl. Mech. Eng. 20, 1979)."""
    fe = right_angle_frame()
    table, force = fe.numbering.table, np.zeros(fe.numbering.n)
    force[table[0, 5]], force[table[-1, 5]] = sign, -sign
    held = np.concatenate([table[0, 1:5], table[-1, [0, 2, 3, 4]]])
    assert buckling_load(fe, force, held) == pytest.approx(0.6222, rel=5e-3)


def test_a_torsion_spring_of_tension():
    """Tension stiffens twist by N I_p/A: a thin strip under N = G A/100 (Wagner)."""
    fe = assemble(line(4), STEEL, {"all": STRIP})
    table, force = fe.numbering.table, np.zeros(fe.numbering.n)
    force[table[-1, 0]] = 0.01 * STEEL.G * STRIP.A
    free = np.setdiff1d(np.arange(fe.numbering.n), table[0])
    u = np.zeros(fe.numbering.n)
    K = fe.K.toarray()
    u[free] = np.linalg.solve(K[np.ix_(free, free)], force[free])
    K += geometric_stiffness(fe, u).toarray()
    torque = np.zeros(len(free))
    torque[np.searchsorted(free, table[-1, 3])] = 1.0
    twist = np.linalg.solve(K[np.ix_(free, free)], torque) @ torque
    polar = STRIP.Iy + STRIP.Iz
    assert 1 / twist == pytest.approx(STEEL.G * (STRIP.J + 0.01 * polar), rel=1e-9)


def test_two_masses_on_a_spring():
    """Two bars held together by a soft spring: omega^2 = k (1/m1 + 1/m2)."""
    points = np.array([[0, 0, 0], [0.1, 0, 0], [0.3, 0, 0], [0.5, 0, 0]], dtype=float)
    mesh = Mesh(points, {"line": np.array([[0, 1], [2, 3]])})
    section = circle(0.02)
    joint = {"joint": {"between": [1, 2], "stiffness": [1e3, 1e9, 1e9, 1e9, 1e9, 1e9]}}
    fe = assemble(mesh, STEEL, {"all": section}, springs=joint)
    masses = STEEL.density * section.A * np.array([0.1, 0.2])
    values = eigh(fe.K.toarray(), fe.M.toarray(), eigvals_only=True)
    assert np.abs(values[:6]).max() < 1e-4 * values[6]
    assert values[6] == pytest.approx(1e3 * (1 / masses).sum(), rel=1e-5)
