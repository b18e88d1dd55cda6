"""Section forces and stress of beams against statics by hand."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line

from flexmb.fe import angle_section, assemble, circle, i_section, rectangle, resolve, tapered, tube
from flexmb.fe.elements.beam_elements import LINE
from flexmb.fe.stress import section_force_modes

STEEL = resolve({"E": 210e9, "nu": 0.3, "density": 7850})
FORCE = np.array([100.0, 20.0, -30.0])
MOMENT = np.array([5.0, -7.0, 11.0])


def cantilever(section, n=4, way=(1.0, 0.0, 0.0)):
    """Clamped at the root, force and moment at the tip; the model and its displacements."""
    fe = assemble(line(n, end=way), STEEL, {"all": section})
    table, load = fe.numbering.table, np.zeros(fe.numbering.n)
    load[table[-1]] = np.concatenate([FORCE, MOMENT])
    free = np.setdiff1d(np.arange(fe.numbering.n), table[0])
    u = np.zeros(fe.numbering.n)
    u[free] = np.linalg.solve(fe.K.toarray()[np.ix_(free, free)], load[free])
    return fe, u


SHAPES = {
    "rectangle": rectangle(0.05, 0.1),
    "offset": rectangle(0.05, 0.1, offset=(0.03, -0.2)),
    "L": angle_section(0.1, 0.15, 0.01),
    "I": i_section(0.2, 0.1, 0.006, 0.01, bottom_width=0.06),
    "taper": tapered(tube(0.05, 0.04), tube(0.03, 0.02)),
}


@pytest.mark.parametrize("name", SHAPES)
def test_section_forces_of_a_cantilever(name):
    """Force at x is the tip's; moment about the centroid there; torque about the shear centre."""
    section = SHAPES[name]
    fe, u = cantilever(section)
    found = section_force_modes(fe, u)
    offset, angle = section.at(0).offset, section.at(0).angle
    c, s = np.cos(angle), np.sin(angle)
    axes = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    np.testing.assert_allclose(found.axes, np.broadcast_to(axes, (4, 3, 3)), atol=1e-12)
    stations = (0.0, 0.3, 1.0)
    values = found.at([1.0], stations)
    for element in range(4):
        for k, t in enumerate(stations):
            x = (element + t) / 4
            arm = np.array([1 - x, -offset[0], -offset[1]])  # from this centroid to the tip node
            F, M = axes.T @ FORCE, axes.T @ (MOMENT + np.cross(arm, FORCE))
            y, z = section.at(0).shear_center
            M[0] -= y * F[2] - z * F[1]
            np.testing.assert_allclose(values[element, k], [*F, *M], atol=1e-7)


def test_section_forces_of_modes_add_up():
    """The operator is linear: forces of a combination are the combination of forces."""
    fe, u = cantilever(SHAPES["L"])
    V = np.random.default_rng(0).normal(size=(fe.numbering.n, 3))
    found, amounts = section_force_modes(fe, V), np.array([0.2, -1.0, 3.0])
    one = section_force_modes(fe, V @ amounts)
    np.testing.assert_allclose(found.at(amounts), one.at([1.0]), atol=1e-3)
    assert found.groups == ("all",) * 4 and found.ends.shape == (4, 2, 6, 3)


def test_a_hinge_passes_no_moment():
    section = rectangle(0.05, 0.1, releases={"end": ["ry", "rz"]})
    fe = assemble(line(3), STEEL, {"all": section})
    V = np.random.default_rng(0).normal(size=(fe.numbering.n, 2))
    ends = section_force_modes(fe, V).ends
    last = ends[[np.argmax(section_force_modes(fe, V).nodes[:, 1])]]
    assert np.abs(last[:, 1, 4:]).max() < 1e-9 * np.abs(ends).max()


def stress_at(fe, u, node):
    """(layers, 6) stress at a node of the element that begins there."""
    for part in fe.blocks:
        for row in np.flatnonzero(part.nodes[:, 0] == node):
            rows = LINE.stress(fe.mesh.points[part.nodes], part.section)[row, 0]
            return rows @ u[fe.numbering.table[part.nodes[row]].ravel()]
    raise AssertionError(node)


def test_stress_of_a_rectangle_by_hand():
    """N/A + My z/Iy - Mz y/Iz in the corners; 3/2 V/A and torsion in the middle of the sides."""
    b, h, section = 0.05, 0.1, SHAPES["rectangle"]
    fe, u = cantilever(section)
    M = MOMENT + np.cross([1.0, 0, 0], FORCE)
    layers = LINE.stress_layers(section)
    stress = dict(zip(layers, stress_at(fe, u, 0), strict=True))
    for name, y, z in (("+y+z", b / 2, h / 2), ("-y+z", -b / 2, h / 2), ("-y-z", -b / 2, -h / 2)):
        wanted = FORCE[0] / (b * h) + M[1] * z / (b * h**3 / 12) - M[2] * y / (h * b**3 / 12)
        np.testing.assert_allclose(stress[name], [wanted, 0, 0, 0, 0, 0], rtol=1e-9, atol=1e-3)
    # Timoshenko and Goodier, section 109, h/b = 2: 0.246 and 0.795 of it
    torsion = M[0] / (0.246 * h * b**2)
    assert stress["+y"][4] == pytest.approx(torsion + 1.5 * FORCE[2] / (b * h), rel=2e-3)
    assert stress["+z"][5] == pytest.approx(-0.795 * torsion + 1.5 * FORCE[1] / (b * h), rel=2e-3)


def test_stress_turns_into_body_axes():
    """A tie along (2, 1, 2)/3 under its own tension: sigma n n^T."""
    way = np.array([2.0, 1.0, 2.0]) / 3
    fe, u = cantilever(circle(0.02), 1, tuple(way))
    u = np.zeros_like(u)
    u[fe.numbering.table[1, :3]] = 1e-3 * way
    s = 1e-3 * STEEL.E * np.outer(way, way)
    wanted = [s[0, 0], s[1, 1], s[2, 2], s[1, 2], s[2, 0], s[0, 1]]
    np.testing.assert_allclose(stress_at(fe, u, 0), np.tile(wanted, (4, 1)), rtol=1e-9)


def test_stress_of_a_cone_follows_its_local_section():
    """Bending of a tapered round bar: 32 M/(pi d^3) with the diameter at the node."""
    section = tapered(circle(0.05), circle(0.02))
    fe, u = cantilever(section, 10)
    for node in (0, 5):
        x, radius = node / 10, 0.05 - 0.03 * node / 10
        M = MOMENT + np.cross([1 - x, 0, 0], FORCE)
        stress = dict(zip(LINE.stress_layers(section), stress_at(fe, u, node), strict=True))
        wanted = 4 * M[1] / (np.pi * radius**3) + FORCE[0] / (np.pi * radius**2)
        assert stress["+z"][0] == pytest.approx(wanted, rel=1e-9)
        assert stress["+y"][4] == pytest.approx(
            2 * M[0] / (np.pi * radius**3) + 4 / 3 * FORCE[2] / (np.pi * radius**2), rel=1e-9
        )


def test_shear_stress_in_the_web_of_an_i_by_hand():
    """V Q/(I t) at the neutral axis, Q of the half above it."""
    h, b, web, flange = 0.2, 0.1, 0.006, 0.01
    section = i_section(h, b, web, flange)
    Q = b * flange * (h - flange) / 2 + web * (h / 2 - flange) ** 2 / 2
    point = next(point for point in section.points if point.name == "web +y")
    assert point.xz[2] == pytest.approx(Q / (section.Iy * web), rel=1e-12)
