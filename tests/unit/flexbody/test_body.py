"""The flexible body: what it derives, and arrays it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from femeshes import line

from flexmb.errors import ReductionError
from flexmb.fe import rectangle, reduce
from flexmb.flexbody import FlexBody, Interface, ModeInfo, NodeModes, Surface, rigid_body
from flexmb.flexbody.arrays import is_nonzero
from flexmb.flexbody.natural_modes import natural_modes


@pytest.fixture(scope="module")
def beam():
    return reduce(
        line(6, (0, 0, 0), (0.5, 0.2, 0.1)),
        material="steel",
        interfaces={"root": "root", "tip": "tip"},
        sections={"all": rectangle(0.02, 0.03)},
        modes=3,
    )


def two_mass():
    """Two unit point masses on the x axis at -1 and 1, moving apart by a mode: all by hand."""
    Mab = np.zeros((3, 3, 1, 1))
    Mab[0, 0] = 1.0  # each moves by 1/sqrt(2)
    P = np.zeros((3, 3, 1))
    P[0, 0] = np.sqrt(2)
    S0 = np.diag([2.0, 0.0, 0.0])
    end = Interface("right", [1, 0, 0], [[np.sqrt(0.5)], [0], [0]], np.zeros((3, 1)))
    return FlexBody("pair", 2.0, np.zeros(3), S0, np.zeros((3, 1)), P, Mab, [[4.0]], None, (end,))


def test_a_body_is_shown_in_a_line(beam):
    """In a notebook and by print; all its arrays are no answer."""
    assert repr(beam) == '<FlexBody "mesh": 2.58 kg, 9 modes, root, tip>'


def test_built_from_arrays_without_finite_elements():
    body = two_mass()
    assert body.m == 1
    np.testing.assert_allclose(body.frequencies, [2 / (2 * np.pi)])
    np.testing.assert_allclose(body.inertia_about_center, np.diag([0, 2, 2]))
    np.testing.assert_array_equal(body.D, [[0.0]])
    assert body.characteristic_length == pytest.approx(np.sqrt(12))
    assert body.interface("right").position[0] == 1


def test_points_on_a_line_have_natural_modes():
    """One of the masses held: the other moves by √2 of the coordinate, ω² = 4/2."""
    modes = natural_modes(two_mass(), ["right"])
    np.testing.assert_allclose(modes.frequencies, [np.sqrt(2) / (2 * np.pi)])


def test_arrays_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        two_mass().K[0, 0] = 0


def test_rigid_body():
    J = np.array([[2.0, 0.1, 0], [0.1, 1.5, 0], [0, 0, 1.0]])
    body = rigid_body(3.0, (1, 2, 3), J)
    assert body.m == 0
    assert body.M_eta.shape == (0, 0)
    assert body.frequencies.shape == (0,)
    np.testing.assert_allclose(body.center, [1, 2, 3])
    np.testing.assert_allclose(body.inertia_about_center, J, atol=1e-13)
    np.testing.assert_allclose(rigid_body(1.0, inertia=0.4).inertia_about_center, 0.4 * np.eye(3))


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"mass": -1}, "body rigid.mass: must be positive, is -1 kg"),
        ({"mass": 1, "inertia": (1, 1, 5)}, "of 1, 1, 5 kg m.2 the largest exceeds"),
        ({"mass": 1, "inertia": -1.0}, "negative principal moment -1"),
        ({"mass": 1, "inertia": [[1, 2, 0], [0, 1, 0], [0, 0, 1]]}, "inertia: is not symmetric"),
        ({"mass": 1, "center": (0, 0)}, r"center: must have shape \(3\), has \(2\)"),
    ],
)
def test_impossible_rigid_bodies(values, sentence):
    with pytest.raises(ReductionError, match=sentence):
        rigid_body(**values)


def test_unknown_interface_names_the_nearest(beam):
    with pytest.raises(ReductionError, match='no interface "tipp"; nearest: tip; allowed: root, t'):
        beam.interface("tipp")


def spoiled(array, value):
    copy = np.array(array)
    copy.flat[1] = value
    return copy


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda b: {"mass": 0.0}, "mass: must be positive"),
        (lambda b: {"p": b.p[:, :2]}, r"p: must have shape \(3, 9\), has \(3, 2\)"),
        (lambda b: {"S1": spoiled(b.S1, np.nan)}, "S1: has entries that are not finite"),
        (lambda b: {"S0": -b.S0}, "S0: is impossible"),
        (lambda b: {"S0": spoiled(b.S0, 1.0)}, "S0: is not symmetric"),
        (lambda b: {"K": -b.K}, "K: has a negative eigenvalue"),
        (lambda b: {"D": spoiled(b.D, 1.0)}, "D: is not symmetric"),
        (lambda b: {"Mab": spoiled(b.Mab, 9.0)}, "Mab: is not symmetric"),
        (lambda b: {"Mab": -b.Mab}, "modal mass that is not positive definite"),
        (lambda b: {"interfaces": b.interfaces[:1] * 2}, 'the name "root" is used twice'),
        (lambda b: {"modes": b.modes[:-1]}, "must number the kept modes 0 to 8"),
    ],
)
def test_refused_bodies(beam, change, sentence):
    with pytest.raises(ReductionError, match=sentence):
        replace(beam, **change(beam))


def point_masses(places, modes, mass):
    """The body of point masses (n,) at places (n, 3) with modes (n, 3, m)."""
    s, Phi, rho = np.asarray(places, float), np.asarray(modes, float), np.asarray(mass, float)
    m = Phi.shape[2]
    return FlexBody(
        "cloud",
        rho.sum(),
        rho @ s,
        np.einsum("n,na,nb->ab", rho, s, s),
        np.einsum("n,nbi->bi", rho, Phi),
        np.einsum("n,na,nbi->abi", rho, s, Phi),
        np.einsum("n,nai,nbj->abij", rho, Phi, Phi),
        np.eye(m),
    )


@pytest.mark.parametrize("origin", [(0, 0, 0), (30, -20, 5)])
@pytest.mark.parametrize("line", [False, True])
@pytest.mark.parametrize("motion", ["none", "shift", "turn", "hidden"])
def test_modes_that_contain_rigid_motion(origin, line, motion):
    rng = np.random.default_rng(4)
    s = np.outer(rng.normal(size=9), (1, 2, 3)) if line else rng.normal(size=(9, 3))
    modes = rng.normal(size=(9, 3, 3)) * (1.0, 1e-2, 30.0)
    turn = np.cross((0.3, -0.1, 0.8), s)
    if motion == "shift":
        modes[:, :, 1] = (0, 2e-2, 1e-2)
    elif motion == "turn":
        modes[:, :, 2] = turn
    elif motion == "hidden":  # no mode alone, the sum of two
        modes[:, :, 2] = turn - modes[:, :, 0]
    if motion == "none":
        assert point_masses(s + origin, modes, np.ones(9)).m == 3
        return
    with pytest.raises(ReductionError, match="body cloud.modes: contain rigid motion"):
        point_masses(s + origin, modes, np.ones(9))


def test_clamped_modes_are_no_rigid_motion():
    x = np.linspace(0, 1, 200)
    modes = np.zeros((200, 3, 6))
    modes[:, 1] = np.stack([x ** (k + 2) for k in range(6)], axis=1)
    assert point_masses(np.outer(x, (1, 0, 0)), modes, np.full(200, 5e-3)).m == 6


def test_parts_with_another_number_of_modes_are_refused(beam):
    with pytest.raises(ReductionError, match="interface right: has 1 modes where the body has 9"):
        replace(beam, interfaces=two_mass().interfaces)


def test_all_mistakes_at_once(beam):
    with pytest.raises(ReductionError) as caught:
        replace(beam, S1=[1, 2], P=np.zeros(3), K=spoiled(beam.K, np.inf))
    assert len(caught.value.problems) == 3


def test_refused_parts():
    flat = np.zeros((2, 3, 1))
    with pytest.raises(ReductionError, match="outside the 2 points"):
        Surface(np.zeros((2, 3)), [[0, 1, 2]], np.zeros((0, 2), int), flat, [0, 1])
    with pytest.raises(ReductionError, match="whole numbers"):
        Surface(np.zeros((2, 3)), [[0.5, 1, 1]], np.zeros((0, 2), int), flat, [0, 1])
    with pytest.raises(ReductionError, match="ids: must be ascending"):
        NodeModes([1, 0], np.zeros((2, 3)), flat)
    with pytest.raises(ReductionError, match="frequency: must be a number >= 0"):
        ModeInfo(0, "elastic", -1.0, True, "")
    with pytest.raises(ReductionError, match="index: must be -1"):
        ModeInfo(3, "elastic", 1.0, False, "")


def test_rows_of_nodes():
    nodes = NodeModes([2, 5], np.zeros((2, 3)), np.zeros((2, 3, 1)))
    assert [nodes.row(k) for k in (2, 5, 4, 9)] == [0, 1, -1, -1]


def test_one_tolerance_says_which_eigenvalues_are_zero():
    assert is_nonzero(np.array([0.0, 1e-13, 1e-11, 1.0])).tolist() == [False, False, True, True]
    assert is_nonzero(np.array([1e-7, 2.0]), 1e-6).tolist() == [False, True]
    assert not is_nonzero(np.zeros(3)).any()
    assert is_nonzero(np.zeros(0)).size == 0
