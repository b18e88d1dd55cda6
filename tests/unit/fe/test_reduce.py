"""The whole reduction: the connecting rod, units, recovery, provenance, and refused input."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from femeshes import block, line

from flexmb.errors import FlexmbError, FlexmbWarning, MeshError, ReductionError
from flexmb.fe import Mesh, rectangle, reduce
from flexmb.fe.reduction.methods import reduction_key
from flexmb.flexbody.body import mode_table

ENDS = {"left": "x0", "right": "x1"}
ROD = {
    "units": "mm-t-s",
    "material": "steel",
    "interfaces": {"big_end": "bore_big", "small_end": "bore_small"},
}


@pytest.fixture(scope="module")
def rod(project):
    return reduce(project / "meshes" / "connecting_rod.msh", **ROD)


@pytest.mark.slow
def test_the_connecting_rod(rod):
    assert rod.name == "connecting_rod"
    assert rod.m == 2 * 6 + 20 - 6
    assert 2.5 < rod.mass < 4.0
    assert 200 < rod.frequencies[0] < 500
    np.testing.assert_allclose(rod.interface("small_end").position, [0.45, 0, 0], atol=1e-14)
    np.testing.assert_allclose(rod.M_eta, np.eye(rod.m), atol=1e-12)
    assert np.abs(rod.D).max() == 0


@pytest.mark.seconds
def test_its_mode_table(rod):
    rows = mode_table(rod)
    assert len(rows) == 6 + rod.m
    assert all(row[0] == "-" and row[-1].startswith("dropped: rigid motion") for row in rows[:6])
    assert [row[0] for row in rows[6:]] == [str(k) for k in range(rod.m)]
    shares = np.array([mode.kinetic_share for mode in rod.modes if mode.kept])
    np.testing.assert_allclose(shares.sum(axis=1), 1, atol=1e-10)
    assert max(mode.frequency for mode in rod.modes[:6]) < 1e-4 * rod.frequencies[0]


def test_its_surface_is_closed_and_faces_outwards(rod):
    surface = rod.surface
    a, b, c = (surface.points[surface.faces[:, k]] for k in range(3))
    volume = np.einsum("fi,fi->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(rod.mass / 7850, rel=5e-3)
    edges = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_its_mass_is_that_of_the_volume_its_curved_faces_enclose(rod, project):
    """Divergence theorem over the six-node faces: V = 1/3 of the flux of the position."""
    from skfem import ElementTriP2
    from skfem.quadrature import get_quadrature

    from flexmb.fe import read_mesh
    from flexmb.fe.elements.element_blocks import outer_faces, select_elements

    mesh = read_mesh(project / "meshes" / "connecting_rod.msh").scaled(1e-3)
    (skin,) = outer_faces(select_elements(mesh, None), mesh.points)
    faces = mesh.points[skin]
    element = ElementTriP2()
    points, weights = get_quadrature(element.refdom, 6)
    shapes = [element.lbasis(points, k) for k in range(6)]
    x = np.einsum("kq,fkc->fqc", [shape[0] for shape in shapes], faces)
    along = np.einsum("kdq,fkc->dfqc", [shape[1] for shape in shapes], faces)
    volume = np.einsum("q,fqc,fqc->", weights, x, np.cross(*along)) / 3
    assert rod.mass == pytest.approx(7850 * volume, rel=1e-12)


def test_nodes_of_an_interface_move_with_it(rod, project):
    from flexmb.fe import read_mesh

    nodes = read_mesh(project / "meshes" / "connecting_rod.msh").node_sets["bore_small"]
    end = rod.interface("small_end")
    rows = np.array([rod.nodes.row(node) for node in nodes])
    arm = rod.nodes.position[rows] - end.position
    wanted = end.Phi_t + np.cross(end.Phi_r.T[None], arm[:, None]).transpose(0, 2, 1)
    np.testing.assert_allclose(rod.nodes.Phi_t[rows], wanted, atol=1e-10 * np.abs(wanted).max())
    np.testing.assert_allclose(rod.nodes.Phi_r[rows], end.Phi_r[None] + 0 * wanted, atol=1e-12)


def test_rotation_of_solid_nodes_is_half_the_curl():
    """A slender block: the nodal rotation about z is the slope of the bending mode."""
    body = reduce(block((12, 2, 2), (1, 0.05, 0.08)), material="steel", modes=4)
    x, y, z = body.nodes.position.T
    axis = (np.abs(y - 0.025) < 1e-9) & (np.abs(z - 0.04) < 1e-9)
    order = np.argsort(x[axis])
    v = body.nodes.Phi_t[axis][order][:, 1, 0]
    slope = np.gradient(v, x[axis][order], edge_order=2)
    turn = body.nodes.Phi_r[axis][order][:, 2, 0]
    np.testing.assert_allclose(turn[2:-2], slope[2:-2], atol=0.05 * np.abs(slope).max())


def test_millimetres_and_metres_give_the_same_body():
    box = block((4, 2, 1), (0.4, 0.1, 0.07), distort=0.2)
    metres = reduce(box, material="steel", interfaces=ENDS, modes=6)
    millimetres = reduce(
        box.scaled(1e3), units="mm-t-s", material="steel", interfaces=ENDS, modes=6
    )
    np.testing.assert_allclose(millimetres.frequencies, metres.frequencies, rtol=1e-9)
    for name in ("S1", "S0", "K", "P", "Mab"):
        one, two = getattr(metres, name), getattr(millimetres, name)
        np.testing.assert_allclose(two, one, atol=1e-7 * np.abs(one).max())
    np.testing.assert_allclose(
        millimetres.nodes.Phi_t, metres.nodes.Phi_t, atol=1e-7 * np.abs(metres.nodes.Phi_t).max()
    )


def test_a_beam_body_with_damping():
    body = reduce(
        line(10, end=(1, 1, 0)),
        material="aluminium",
        interfaces={"root": "root", "tip": "tip"},
        sections={"all": {"type": "rectangle", "y": 0.02, "z": 0.03}},
        modes=4,
        damping=0.02,
        name="arm",
    )
    assert (body.name, body.m) == ("arm", 10)
    assert (body.damping.ratio, body.damping.of) == (0.02, "joined")
    assert not body.D.any()  # it follows from the joints of a scene
    assert body.surface.lines.shape == (10, 2)
    assert len(body.surface.faces) > 10  # its section extruded
    tip = body.nodes.row(10)
    np.testing.assert_allclose(body.nodes.Phi_r[tip], body.interface("tip").Phi_r, atol=1e-12)


def test_progress_names_the_phases():
    phases = {}
    reduce(
        block((2, 1, 1)),
        material="steel",
        interfaces=ENDS,
        modes=2,
        progress=lambda phase, fraction, detail="": phases.__setitem__(phase, fraction),
    )
    assert list(phases) == [
        "read",
        "assemble",
        "factor",
        "modes",
        "integrals",
        "recovery",
        "stress",
    ]
    assert set(phases.values()) == {1.0}


def test_the_key_follows_mesh_material_and_options(project, tmp_path, rod):
    mesh = project / "meshes" / "connecting_rod.msh"
    key = reduction_key(mesh, **ROD)
    assert rod.provenance["key"] == key
    steel = {"E": 210e9, "nu": 0.3, "density": 7850}
    named = steel | {"name": "S355", "source": "a data sheet"}
    assert reduction_key(mesh, **ROD | {"material": steel}) == key
    assert reduction_key(mesh, **ROD | {"material": named}) == key
    copy = tmp_path / "connecting_rod.msh"
    copy.write_bytes(mesh.read_bytes())
    assert reduction_key(copy, **ROD) == key
    copy.write_bytes(mesh.read_bytes() + b"\n")
    others = [
        reduction_key(copy, **ROD),
        reduction_key(mesh, **ROD | {"material": steel | {"E": 200e9}}),
        reduction_key(mesh, **ROD | {"units": "SI"}),
        reduction_key(mesh, **ROD, modes=19),
        reduction_key(mesh, **ROD, damping=0.01),
        reduction_key(mesh, **ROD, name="rod"),
    ]
    assert len({key, *others}) == 7


def test_unit_slips_are_warned_about():
    with pytest.warns(FlexmbWarning, match="density 7.85e-09|wave speed"):
        reduce(
            block((2, 1, 1)),
            material={"E": 210e9, "nu": 0.3, "density": 7.85e-9},
            interfaces=ENDS,
            modes=1,
        )
    with pytest.warns(FlexmbWarning, match="extends over 2000 m"):
        reduce(block((2, 1, 1), (2000, 100, 100)), material="steel", interfaces=ENDS, modes=1)


def two_boxes():
    one = block((1, 1, 1))
    tets = one.blocks["tetra10"]
    points = np.vstack([one.points, one.points + [5, 0, 0]])
    both = np.vstack([tets, tets + len(one.points)])
    return Mesh(points, {"tetra10": both}, {"x0": one.node_sets["x0"]})


@pytest.mark.parametrize(
    ("options", "kind", "sentence"),
    [
        ({"modes": -1}, ReductionError, "modes: must be a whole number >= 0, given -1"),
        ({"modes": 2.5}, ReductionError, "modes: must be a whole number >= 0, given 2.5"),
        ({"damping": 1.5}, ReductionError, "damping: must lie between 0 and 1"),
        ({"units": "mm-t"}, FlexmbError, 'unknown unit system "mm-t"; nearest: mm-t-s'),
        ({"material": "stel"}, FlexmbError, 'unknown material "stel"; nearest: steel'),
        ({"interfaces": {"a": "x3"}}, MeshError, 'interfaces.a: .* no group "x3"; allowed: x0, x1'),
        ({"mesh": two_boxes(), "interfaces": {"a": "x0"}}, MeshError, "falls into 2 parts"),
    ],
)
def test_refused(options, kind, sentence):
    given = {"mesh": block((2, 1, 1)), "material": "steel", "interfaces": ENDS, "modes": 1}
    given |= options
    with warnings.catch_warnings(), pytest.raises(kind, match=sentence):
        reduce(given.pop("mesh"), **given)


def test_a_hinge_inside_the_mesh_is_refused():
    """Two boxes that share one edge only turn about it without stiffness."""
    one = block((1, 1, 1))
    points = np.vstack([one.points, one.points * [-1, -1, 1]])
    _, first, same = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    tets = np.vstack([one.blocks["tetra10"], one.blocks["tetra10"] + len(one.points)])
    mesh = Mesh(points[first], {"tetra10": same.ravel()[tets]})
    with pytest.raises(ReductionError, match="too few nodes"):
        reduce(mesh, material="steel", modes=2)


def test_beams_through_python_sections():
    mesh = line(4)
    body = reduce(
        mesh, material="steel", sections={"all": rectangle(0.1, 0.1)}, interfaces={"a": "root"}
    )
    assert body.m == 20


STIFFENED = {
    "mesh": {"type": "plate", "length": 1.0, "width": 0.5, "divisions": [6, 3]},
    "material": "steel", "sections": {"all": {"type": "shell", "thickness": 0.01, "offset": 0.002}},
    "interfaces": {"edge": "x0"}, "modes": 4, "geometric_stiffening": "full",
    "masses": {"ball": {"at": 20, "mass": 3.0, "offset": [0.0, 0.0, 0.1]}},
    "ties": {"rim": {"type": "rbe2", "reference": 27, "nodes": "x1"}},
}  # fmt: skip


def test_tables_of_shells_do_not_count_the_loads_that_stiffen(monkeypatch):
    """Forty more loads must not make the fields of the elements forty more times."""
    from flexmb.fe.elements import shell_elements

    counts, make = [], shell_elements.make_fields
    for nodes in ([], list(range(8, 18))):
        made = []
        monkeypatch.setattr(
            shell_elements, "make_fields", lambda *of, made=made: made.append(1) or make(*of)
        )
        reduce(**STIFFENED, load_points=nodes)
        counts.append(len(made))
    assert counts[0] == counts[1]


def test_forms_of_many_loads_are_those_of_the_geometric_stiffness():
    """With offsets, a tie and a mass on an arm, whose loads turn."""
    from flexmb.fe.assembly.assemble import geometric_forms, geometric_stiffness

    seen = []
    reduce(**STIFFENED, inspect=lambda fe, *_: seen.append(fe))
    rng, fe = np.random.default_rng(2), seen[0]
    n = fe.numbering.n
    U, Phi, fields = rng.normal(size=(n, 3)), rng.normal(size=(n, 4)), rng.normal(size=(3, 3, 4))
    for form, u, field in zip(geometric_forms(fe, Phi, U, fields), U.T, fields, strict=True):
        whole = Phi.T @ (geometric_stiffness(fe, u, field) @ Phi)
        np.testing.assert_allclose(form, whole, atol=1e-12 * np.abs(whole).max())
