"""Bodies made elsewhere, brought into a plane: in-plane modes, or a refusal with the share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import slidercrank
from femeshes import block, line, mirrored_block

from flexmb.errors import ReductionError
from flexmb.fe import Mesh, rectangle, reduce
from flexmb.flexbody import load, rigid_body, save
from flexmb.flexbody.planar_body import planar_body, plane_name

ENDS = {"left": "x0", "right": "x1"}
Z = (0.0, 0.0, 1.0)
_c, _s = np.cos(0.4), np.sin(0.4)
TURN = np.array([[_c, -_s, 0], [_s, _c, 0], [0, 0, 1]]) @ np.array(
    [[1, 0, 0], [0, _c, -_s], [0, _s, _c]]
)


@pytest.fixture(scope="module")
def box():
    """A box that is meshed alike on both sides of no plane, its sides all different."""
    mesh = block((5, 2, 2), (1.0, 0.25, 0.15))
    centred = Mesh(mesh.points - [0, 0, 0.075], mesh.blocks, {}, mesh.element_sets)
    return centred, reduce(centred, material="steel", interfaces=ENDS, modes=12)


@pytest.mark.parametrize("order", ["symmetric", "unsymmetric"])
def test_the_in_plane_modes_are_those_of_the_planar_reduction(box, order):
    """To round-off where mesh and its mirror image agree, else as well as they nearly do."""
    mesh, spatial, accuracy = *box, 5e-3
    if order == "symmetric":
        mesh, accuracy = mirrored_block((5, 2, 1), (1.0, 0.25, 0.075)), 1e-8
        spatial = reduce(mesh, material="steel", interfaces=ENDS, modes=12)
    flat = planar_body(spatial, Z)
    wanted = reduce(mesh, material="steel", interfaces=ENDS, modes=flat.m - 3, plane="xy")
    assert 5 < flat.m < spatial.m - 5
    np.testing.assert_allclose(flat.frequencies, wanted.frequencies, rtol=accuracy)
    np.testing.assert_allclose(flat.M_eta, np.eye(flat.m), atol=1e-9)
    assert (flat.mass, flat.provenance["plane"]) == (spatial.mass, "xy")
    assert [mode.index for mode in flat.modes if mode.kept] == list(range(flat.m))
    told = [mode.why for mode in flat.modes]
    assert told.count("out of the plane xy") == spatial.m - flat.m


def test_nothing_of_it_leads_out_of_the_plane(box):
    flat = planar_body(box[1], Z)
    assert np.abs(flat.p[2]).max() == 0
    for a in (0, 1):
        assert np.abs(flat.P[2, a]).max() <= 1e-9 * np.abs(flat.P).max()
        assert np.abs(flat.P[a, 2]).max() <= 1e-9 * np.abs(flat.P).max()
        assert np.abs(flat.Mab[2, a]).max() == np.abs(flat.Mab[a, 2]).max() == 0
    for part in flat.interfaces:
        assert np.abs(part.Phi_t[2]).max() == np.abs(part.Phi_r[:2]).max() == 0


def test_what_it_keeps_of_the_integrals_fits_its_nodes(box):
    """p, P and the interfaces follow the same combinations of modes as the nodes do."""
    flat = planar_body(box[1], Z)
    left = flat.interface("left")
    row = np.abs(flat.nodes.position - left.position).sum(axis=1).argmin()
    np.testing.assert_allclose(flat.nodes.position[row], left.position, atol=1e-9)
    np.testing.assert_allclose(
        flat.nodes.Phi_t[row, :2], left.Phi_t[:2], atol=1e-6 * np.abs(left.Phi_t).max()
    )
    np.testing.assert_allclose(flat.surface.modes, flat.nodes.Phi_t[
        np.searchsorted(flat.nodes.ids, flat.surface.node_ids)], atol=1e-12)  # fmt: skip


def test_a_plane_may_lie_anyhow_in_the_body(box):
    mesh, spatial = box
    turned = Mesh(mesh.points @ TURN.T, mesh.blocks, {}, mesh.element_sets)
    body = reduce(turned, material="steel", interfaces=ENDS, modes=12)
    flat, normal = planar_body(body, 3.0 * TURN[:, 2]), TURN[:, 2]
    np.testing.assert_allclose(flat.frequencies, planar_body(spatial, Z).frequencies, rtol=1e-6)
    assert "with normal" in flat.provenance["plane"]
    assert np.abs(normal @ flat.p).max() <= 1e-12 * np.sqrt(flat.mass)
    for part in flat.interfaces:
        assert np.abs(normal @ part.Phi_t).max() <= 1e-12 * np.abs(part.Phi_t).max()


def test_a_planar_body_stays_as_it_is(box, tmp_path):
    flat = planar_body(box[1], Z)
    again = planar_body(load(save(flat, tmp_path / "flat.flexbody.h5")), Z)
    np.testing.assert_array_equal(again.K, flat.K)
    np.testing.assert_allclose(again.P, flat.P, atol=1e-15 * np.abs(flat.P).max())


def test_an_unsymmetric_body_is_refused_with_the_share():
    skew = block((4, 1, 1), (1.0, 0.1, 0.1), affine=[[1, 0, 0], [0, 1, 0], [0.7, 0, 1]])
    body = reduce(skew, material="steel", interfaces=ENDS, modes=6, name="rod")
    with pytest.raises(ReductionError, match=r"body rod: mode \d+ .* has \d\d % of its energy out"):
        planar_body(body, Z)


def test_a_body_without_nodes_is_judged_by_its_integrals():
    bar = replace(slidercrank.bent_bar(), surface=None)
    flat = planar_body(bar, Z)
    assert flat.m == 1
    np.testing.assert_array_equal(flat.P, bar.P)
    with pytest.raises(ReductionError, match="has no modes in the plane zx"):
        planar_body(bar, (0, 1, 0))


def test_an_interface_that_leaves_the_plane_is_named():
    bar = replace(slidercrank.bent_bar(), surface=None)
    end = bar.interfaces[1]
    moved = replace(end, Phi_t=np.array([[0.0], [0.0], [0.5]]))
    with pytest.raises(ReductionError, match="mode 0 moves the interface small_end out of the pl"):
        planar_body(replace(bar, interfaces=(bar.interfaces[0], moved)), Z)


def test_rigid_bodies_lie_in_every_plane():
    body = rigid_body(1.0, inertia=[1, 2, 2])
    assert planar_body(body, Z) is body


def test_names_of_planes():
    names = [plane_name(n) for n in ((0, 0, -1), (1, 0, 0), (0, 1, 0))]
    assert names == ["xy", "yz", "zx"]


def test_the_stress_of_in_plane_modes_is_that_of_the_same_deformation(box):
    spatial, flat = box[1], planar_body(box[1], Z)
    eta = np.random.default_rng(3).normal(size=flat.m)
    wanted = (flat.nodes.Phi_t @ eta).ravel()
    same = np.linalg.lstsq(spatial.nodes.Phi_t.reshape(-1, spatial.m), wanted, rcond=None)[0]
    stress, other = flat.stress.at(eta), spatial.stress.at(same)
    np.testing.assert_allclose(stress, other, atol=1e-5 * np.abs(other).max())  # single precision


def test_geometric_stiffness_of_all_modes_is_symmetric_in_the_plane():
    """A form that is nothing but round-off in the plane was refused: it would make energy."""
    whole = reduce(
        line(16), modes=90, material={"E": 7e10, "nu": 0.3, "density": 2700},
        sections={"all": rectangle(0.02, 0.02, shear=False)},
        interfaces={"root": "root", "tip": "tip"}, geometric_stiffening="full",
    )  # fmt: skip
    forms = planar_body(whole, [0, 0, 1]).centrifugal_stiffness
    assert np.array_equal(forms, forms.swapaxes(2, 3))
    assert np.abs(forms).max() > 0.1 * np.abs(whole.centrifugal_stiffness).max()
