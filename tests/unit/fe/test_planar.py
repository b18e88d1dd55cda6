"""Planar reduction: the in-plane part of the spatial one, and refused where there is none."""

from __future__ import annotations

import re

import numpy as np
import pytest
from femeshes import block, line, mirrored_block

from flexmb.errors import ReductionError
from flexmb.fe import Mesh, assemble, rectangle, reduce, resolve
from flexmb.fe.reduction.eigenmodes import antisymmetric, make_symmetry_plane, reflection
from flexmb.fe.reduction.inertia_relief import inertia_loads
from flexmb.fe.reduction.methods import reduction_key
from flexmb.flexbody.planar_body import PLANES

STEEL = resolve("steel")
ENDS = {"left": "x0", "right": "x1"}
TIPS = {"root": "root", "tip": "tip"}
BAR = {"all": rectangle(0.05, 0.03, orientation=(0, 1, 0))}


def turned(mesh, order):
    """The mesh with its axes renamed: old x, y, z become the new axes in ``order``."""
    return Mesh(mesh.points[:, np.argsort(order)], mesh.blocks, {}, mesh.element_sets)


def beam(plane=None, modes=15, sections=None, **kind):
    mesh = line(6, (0, 0, 0), (0.6, 0.3, 0))
    kind = {"interfaces": TIPS} | kind
    return reduce(
        mesh, material="steel", sections=sections or BAR, modes=modes, plane=plane, **kind
    )


@pytest.fixture(scope="module")
def box():
    mesh = mirrored_block()
    spatial = reduce(mesh, material="steel", interfaces=ENDS, modes=24)
    return mesh, spatial


def in_plane_frequencies(body, normal=2):
    """Frequencies of modes that leave all interfaces in the plane and have no odd integrals."""
    a, b = (axis for axis in range(3) if axis != normal)
    moves = [p.Phi_t[[normal]] for p in body.interfaces]
    moves += [p.Phi_r[[a, b]] for p in body.interfaces]
    leaving = np.abs(np.concatenate(moves)).max(axis=0)
    return body.frequencies[leaving < 1e-6 * leaving.max()]


@pytest.mark.parametrize("sections", [BAR, {"all": rectangle(0.04, 0.04)}], ids=["flat", "square"])
def test_a_beam_keeps_the_in_plane_part_of_the_spatial_reduction(sections):
    planar, spatial = beam("xy", 15, sections), beam(None, 30, sections)
    assert planar.m == 3 * 2 + 15 - 3
    wanted = in_plane_frequencies(spatial)
    assert len(wanted) == planar.m
    np.testing.assert_allclose(planar.frequencies, wanted, rtol=1e-8)


def test_a_box_keeps_the_in_plane_part_of_the_spatial_reduction(box):
    mesh, spatial = box
    wanted = in_plane_frequencies(spatial)
    n = len(wanted) - 3
    assert 4 < n < 20
    planar = reduce(mesh, material="steel", interfaces=ENDS, modes=n, plane="xy")
    assert planar.m == 3 * 2 + n - 3
    np.testing.assert_allclose(planar.frequencies, wanted, rtol=1e-8)
    assert float(planar.provenance["out-of-plane share"]) < 1e-12
    assert planar.provenance["plane"] == "xy"


def test_loads_and_spin_in_the_plane_move_its_interfaces_as_in_space(box):
    """Static response of the interfaces to forces on them, and to turning about the normal."""
    mesh, spatial = box
    n = len(in_plane_frequencies(spatial)) - 3
    planar = reduce(mesh, material="steel", interfaces=ENDS, modes=n, plane="xy")
    answers = []
    for body in (planar, spatial):
        rows = [np.vstack([part.Phi_t[:2], part.Phi_r[2:]]) for part in body.interfaces]
        motion = np.concatenate(rows)
        spin = body.P[0, 0] + body.P[1, 1]
        answers.append(motion @ np.linalg.solve(body.K, np.column_stack([motion.T, spin])))
    np.testing.assert_allclose(*answers, atol=1e-9 * np.abs(answers[1]).max())


@pytest.mark.parametrize("plane", PLANES)
def test_each_plane_gives_the_same_body_in_other_axes(box, plane):
    order = {"xy": (0, 1, 2), "yz": (1, 2, 0), "zx": (2, 0, 1)}[plane]
    mesh = turned(box[0], order)
    body = reduce(mesh, material="steel", interfaces=ENDS, modes=6, plane=plane)
    wanted = reduce(box[0], material="steel", interfaces=ENDS, modes=6, plane="xy")
    np.testing.assert_allclose(body.frequencies, wanted.frequencies, rtol=1e-9)
    assert mesh.points.std(axis=0).argmin() == np.argmax(PLANES[plane])


@pytest.mark.parametrize("make", [lambda: beam("xy"), lambda: beam("xy", 6, interfaces={})])
def test_what_leads_out_of_the_plane_of_a_beam_is_zero(make):
    _assert_flat(make())


def test_what_leads_out_of_the_plane_of_a_box_is_zero(box):
    body = reduce(box[0], material="steel", interfaces=ENDS, modes=6, plane="xy")
    _assert_flat(body)
    raised = Mesh(box[0].points + [0, 0, 0.3], box[0].blocks, {}, box[0].element_sets)
    body = reduce(raised, material="steel", interfaces=ENDS, modes=6, plane="xy")
    _assert_flat(body)
    assert body.center[2] == pytest.approx(0.3)


def _assert_flat(body):
    size = np.abs(body.P).max()
    assert np.abs(body.p[2]).max() <= 1e-12 * np.sqrt(body.mass)
    for a in (0, 1):
        assert np.abs(body.P[2, a]).max() <= 1e-9 * size
        assert np.abs(body.P[a, 2]).max() <= 1e-9 * size
        assert np.abs(body.Mab[2, a]).max() == 0
        assert np.abs(body.Mab[a, 2]).max() == 0
    for part in body.interfaces:
        assert np.abs(part.Phi_t[2]).max() == 0
        assert np.abs(part.Phi_r[:2]).max() == 0
    np.testing.assert_allclose(body.M_eta, np.eye(body.m), atol=1e-9)


def test_an_unsymmetric_mesh_of_a_symmetric_body_is_symmetric_enough():
    """Boxes of square section: the mesh alone decides which way its bending modes point."""
    mesh = block((5, 2, 2), (1.0, 0.2, 0.2))
    planar = reduce(mesh, material="steel", interfaces=ENDS, modes=6, plane="xy")
    share = float(planar.provenance["out-of-plane share"])
    assert 1e-9 < share < 1e-2
    fine = mirrored_block((5, 2, 1), (1.0, 0.2, 0.1))
    wanted = reduce(fine, material="steel", interfaces=ENDS, modes=6, plane="xy")
    np.testing.assert_allclose(planar.frequencies[:4], wanted.frequencies[:4], rtol=0.02)


def test_an_unsymmetric_body_is_refused_with_the_share():
    skew = block((4, 1, 1), (1.0, 0.1, 0.1), affine=[[1, 0, 0], [0, 1, 0], [0.7, 0, 1]])
    with pytest.raises(ReductionError) as caught:
        reduce(skew, material="steel", interfaces=ENDS, modes=4, plane="xy", name="rod")
    told = re.match(
        r"body rod: mode \d+ \([\d.e+]+ Hz\) has (\d+) % of its energy out of the plane xy "
        r"\(\d more modes have over 1 %\): keep the scene spatial",
        str(caught.value),
    )
    assert told, caught.value
    assert 1 < int(told[1]) <= 100


def test_an_interface_on_one_side_is_refused():
    """A bore in one of two cheeks: what moves it does not move its mirror image."""
    mesh = mirrored_block((4, 1, 2), (1.0, 0.2, 0.5))
    x, z = mesh.points[:, 0], mesh.points[:, 2]
    above = np.flatnonzero((x > 0.99) & (z > 0.25))
    one_sided = Mesh(mesh.points, mesh.blocks, {"above": above}, mesh.element_sets)
    ends = {"left": "x0", "above": "above"}
    with pytest.raises(ReductionError, match="of its energy out of the plane xy"):
        reduce(one_sided, material="steel", interfaces=ends, modes=4, plane="xy")


def test_the_reflection_turns_rigid_motions_as_a_mirror_does():
    meshes = [(block((3, 2, 2), distort=0.2), None), (line(5, (0, 0, 0), (1, 0.3, 0)), BAR)]
    for mesh, sections in meshes:
        fe = assemble(mesh, STEEL, sections)
        S = reflection(fe, 2)
        inside, outside = fe.rigid[:, [0, 1, 5]], fe.rigid[:, [2, 3, 4]]
        np.testing.assert_allclose(S @ inside, inside, atol=1e-9)
        np.testing.assert_allclose(S @ outside, -outside, atol=1e-9)
        odd, whole = antisymmetric(fe.M, S, np.hstack([inside, outside]))
        shares = np.diag(odd) / np.diag(whole)
        np.testing.assert_allclose(shares, [0, 0, 0, 1, 1, 1], atol=1e-12)


def test_the_reflection_interpolates_quadratic_fields_exactly():
    """Second-order tetrahedra with straight sides hold them, wherever the mirror image lies."""
    fe = assemble(block((3, 2, 2), distort=0.2), STEEL)
    x, y, z = (fe.mesh.points[fe.numbering.nodes] - fe.center).T
    u, image = np.zeros((2, fe.numbering.n))
    for c, (value, there) in enumerate(((x * z + y, -x * z + y), (z * z - x, z * z - x),
                                        (y * z, y * z))):  # fmt: skip
        u[fe.numbering.table[fe.numbering.nodes, c]] = value
        image[fe.numbering.table[fe.numbering.nodes, c]] = there
    np.testing.assert_allclose(reflection(fe, 2) @ u, image, atol=1e-12)


def test_inertia_in_the_plane_is_its_own_mirror_image():
    """Loads of the motions in the plane are those of space, of the others there are none."""
    fe = assemble(mirrored_block(), STEEL)
    mirror = make_symmetry_plane(fe, "xy")
    found, whole = inertia_loads(fe, mirror), inertia_loads(fe)
    inside = [0, 1, 5, 6, 7, 9, 11]  # along x, y; about z; xx, xy, yy, zz
    np.testing.assert_allclose(found[:, inside], whole[:, inside], atol=1e-9 * np.abs(whole).max())
    assert not np.delete(found, inside, axis=1).any()


def test_twice_reflected_is_the_same():
    fe = assemble(mirrored_block(), STEEL)
    S = reflection(fe, 2)
    assert abs(S @ S - np.eye(fe.numbering.n)).max() == 0


def test_the_plane_is_part_of_the_fingerprint(project):
    mesh = project / "meshes" / "connecting_rod.msh"
    keys = {reduction_key(mesh, material="steel", plane=plane) for plane in (None, *PLANES)}
    assert len(keys) == 4
    assert reduction_key(mesh, material="steel", plane=None) == reduction_key(
        mesh, material="steel"
    )


def test_wrong_planes_and_too_many_modes():
    with pytest.raises(ReductionError, match='unknown plane "yx"; allowed: xy, yz, zx'):
        beam("yx")
    with pytest.raises(ReductionError, match="16 requested, .* 15 fixed-interface modes in"):
        beam("xy", 16)


def test_free_modes_in_a_plane():
    planar = beam("xy", 4, interfaces={})
    spatial = beam(None, 12, interfaces={})
    sideways = np.einsum("jj->j", spatial.Mab[2, 2])
    twisting = np.abs(spatial.nodes.Phi_r[:, :2]).max(axis=(0, 1))
    inside = (sideways < 1e-9) & (twisting < 1e-6 * twisting.max())
    np.testing.assert_allclose(planar.frequencies, spatial.frequencies[inside][:4], rtol=1e-8)
