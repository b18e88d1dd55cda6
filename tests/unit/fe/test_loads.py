"""Loads on bodies: resultants, work-equivalent nodal forces, residual vectors, refused input."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from femeshes import block, line

from flexmb.errors import FlexmbWarning, ReductionError
from flexmb.fe import (
    Mesh,
    assemble,
    craig_bampton,
    free_interface,
    make_interfaces,
    make_loads,
    orthonormalise,
    rectangle,
    reduce,
    resolve,
)
from flexmb.fe.meshes.mesh_shapes import plate
from flexmb.fe.reduction.free_body import free_modes
from flexmb.fe.sections.shell_section import shell

STEEL = resolve("steel")


@pytest.fixture(scope="module")
def box():
    return assemble(block((2, 1, 1), (2, 0.5, 0.4), distort=0.1), STEEL)


@pytest.fixture(scope="module")
def bar():
    return assemble(line(6), STEEL, {"all": rectangle(0.02, 0.03)})


def half_turned_plate():
    """A plate of which every other element has its normal on the other side."""
    mesh = plate(1.0, 0.5, (4, 2))
    cells = mesh.blocks["quad"].copy()
    cells[::2] = cells[::2, ::-1]
    return Mesh(mesh.points, {"quad": cells}, {}, {"surface": {"quad": np.arange(8)}})


def test_a_pressure_on_shells_with_opposite_normals_is_named():
    fe = assemble(half_turned_plate(), STEEL, {"all": shell(0.01)})
    with pytest.warns(FlexmbWarning, match="loads.push: the normals .* at 4 edges"):
        one(fe, type="pressure", group="surface", pressure=1.0)


@pytest.mark.parametrize(("offset", "count"), [(0.01, 1), (0.0, 0)])
def test_shells_with_an_offset_and_opposite_normals_are_named(offset, count):
    sections = {"all": shell(0.01, offset=offset)}
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        reduce(half_turned_plate(), material=STEEL, sections=sections, modes=2,
               interfaces={"a": {"node": 0}})  # fmt: skip
    assert sum("opposite sides at 4 edges" in str(one.message) for one in issued) == count


def test_a_line_load_bends_one_beam_as_it_should():
    """Deflection q L^4/8 EI and slope q L^3/6 EI of a clamped beam of one element."""
    mesh = line(1, end=(2.0, 0, 0))
    mesh = Mesh(mesh.points, mesh.blocks, {}, {"all": {"line": np.array([0])}})
    fe = assemble(mesh, STEEL, {"all": rectangle(0.02, 0.03, shear=False)})
    f = one(fe, type="line", group="all", force=[0, 0, 7.0]).f
    tip = fe.numbering.table[1]
    u = np.linalg.solve(fe.K.toarray()[np.ix_(tip, tip)], f[tip])
    EI = STEEL.E * 0.02 * 0.03**3 / 12
    assert u[[2, 4]] == pytest.approx([7 * 2**4 / (8 * EI), -7 * 2**3 / (6 * EI)], rel=1e-9)


def one(fe, **words):
    return make_loads(fe, {"push": words})[0]


def test_pressure_pushes_into_the_solid_with_its_area(box):
    """On x = 2 of 0.5 x 0.4: force -p A along x, at the centroid of the face."""
    load = one(box, type="pressure", group="x1", pressure=3e5)
    np.testing.assert_allclose(load.force, [-6e4, 0, 0], atol=1e-8)
    np.testing.assert_allclose(load.moment, np.cross([2, 0.25, 0.2], load.force), atol=1e-8)
    back = one(box, type="pressure", group="x0", pressure=3e5)
    np.testing.assert_allclose(back.force, [6e4, 0, 0], atol=1e-8)


def test_pressure_does_not_ask_which_way_the_facets_are_numbered(box):
    mesh = box.mesh
    cells = {**mesh.blocks, "triangle6": mesh.blocks["triangle6"][:, [0, 2, 1, 5, 4, 3]]}
    other = assemble(Mesh(mesh.points, cells, {}, mesh.element_sets), STEEL)
    words = {"type": "pressure", "group": "x1", "pressure": 1e5}
    np.testing.assert_allclose(one(other, **words).f, one(box, **words).f, atol=1e-10)


def test_uniaxial_pressure_gives_uniform_strain(box):
    """Both ends pressed: u_x = -p x/E, u_y = nu p y/E, u_z = nu p z/E everywhere, exactly."""
    loads = make_loads(
        box, {n: {"type": "pressure", "group": n, "pressure": 1e6} for n in ("x0", "x1")}
    )
    s = box.mesh.points
    strain = 1e6 / STEEL.E * np.array([-1, STEEL.nu, STEEL.nu])
    u = np.zeros(box.numbering.n)
    u[box.numbering.table[:, :3]] = s * strain
    np.testing.assert_allclose(box.K @ u, loads[0].f + loads[1].f, atol=1e-6 * 1e6)


def test_pressure_on_shells_acts_along_their_normal():
    """A plate in the xy plane, 1 x 0.5: p A along z, at its centre; its edge as a line load."""
    fe = assemble(plate(1.0, 0.5, divisions=(4, 3)), STEEL, {"all": shell(0.01)})
    load = one(fe, type="pressure", group="surface", pressure=200.0)
    np.testing.assert_allclose(load.force, [0, 0, 100], atol=1e-10)
    np.testing.assert_allclose(load.moment, [0, -50, 0], atol=1e-10)
    load = one(fe, type="line", group="x1", force=[0, 0, 6])
    np.testing.assert_allclose(load.force, [0, 0, 3], atol=1e-12)


def test_traction_and_line_loads(box, bar):
    load = one(box, type="traction", group="x1", traction=[1, 2, 3])
    np.testing.assert_allclose(load.force, np.array([1, 2, 3]) * 0.2, rtol=1e-12)
    rows = {"span": {"line": np.arange(6)}}
    mesh = Mesh(bar.mesh.points, bar.mesh.blocks, {}, rows)
    fe = assemble(mesh, STEEL, {"span": rectangle(0.02, 0.03)})
    load = one(fe, type="line", group="span", force=[0, 0, 5])
    np.testing.assert_allclose(load.force, [0, 0, 5], atol=1e-12)
    np.testing.assert_allclose(load.moment, [0, -2.5, 0], atol=1e-12)


def test_a_force_and_moment_on_a_surface_and_on_a_node(box, bar):
    words = {"force": [10, 20, 30], "moment": [1, 2, 3]}
    for fe, where, at in ((box, {"group": "x1"}, [2, 0.25, 0.2]), (bar, {"node": 3}, [0.5, 0, 0])):
        load = one(fe, type="force", **where, **words)
        np.testing.assert_allclose(load.force, [10, 20, 30], rtol=1e-10)
        moment = np.cross(at, [10, 20, 30]) + [1, 2, 3]
        np.testing.assert_allclose(load.moment, moment, rtol=1e-10)


def test_a_force_on_one_solid_node_needs_no_rotation(box):
    load = one(box, type="force", node=7, force=[1, 2, 3])
    np.testing.assert_array_equal(load.f[box.numbering.table[7, :3]], [1, 2, 3])
    assert np.count_nonzero(load.f) == 3


def test_weight_is_mass_times_gravity_and_deforms_no_free_body(box):
    load = one(box, type="gravity", acceleration=[0, 0, -9.81])
    np.testing.assert_allclose(load.force, [0, 0, -9.81 * box.inertia.mass], atol=1e-9)
    assert not load.residual
    elastic = orthonormalise(box, free_modes(box, (), 6))
    size = np.linalg.norm(elastic.Phi, axis=0) * np.linalg.norm(load.f)
    assert np.abs(elastic.Phi.T @ load.f / size).max() < 1e-9


def test_loads_on_nodes_that_follow_a_tie_go_to_the_reference():
    """A beam end welded to the face: pressing on the face moves the reference."""
    solid, beam = block((2, 1, 1), (1, 0.1, 0.2)), line(2, (1, 0.05, 0.1), (2, 0.05, 0.1))
    n = len(solid.points)
    cells = {**solid.blocks, "line": beam.blocks["line"] + n}
    sets = {name: nodes + n for name, nodes in beam.node_sets.items()}
    mesh = Mesh(np.vstack([solid.points, beam.points]), cells, sets, solid.element_sets)
    seat = {"seat": {"type": "rbe2", "reference": "root", "nodes": "x1"}}
    fe = assemble(mesh, STEEL, {"all": rectangle(0.1, 0.2)}, ties=seat)
    load = one(fe, type="pressure", group="x1", pressure=1e6)
    np.testing.assert_allclose(load.force, [-2e4, 0, 0], atol=1e-6)
    rows = fe.numbering.table[mesh.group_nodes("root")[0]]
    np.testing.assert_allclose(load.f[rows[:3]], [-2e4, 0, 0], atol=1e-6)


LOADS = {
    "press": {"type": "pressure", "group": "x1", "pressure": 1e5},
    "poke": {"type": "force", "node": 20, "force": [0, 3, 1]},
}


@pytest.mark.parametrize("method", [craig_bampton, free_interface, free_modes])
def test_residual_vectors_make_the_static_response_to_a_load_exact(box, method):
    """Against the relieved response of the full model by a pseudo-inverse, all of its field."""
    interfaces = () if method is free_modes else make_interfaces(box, {"a": {
        "group": "x0", "type": "rbe3"}})  # fmt: skip
    loads = make_loads(box, LOADS)
    found = orthonormalise(box, method(box, interfaces, 3, loads=loads))
    without = orthonormalise(box, method(box, interfaces, 3))
    R, M = box.rigid, box.M
    P = np.eye(len(R)) - M @ (R @ np.linalg.solve(R.T @ (M @ R), R.T))
    inverse = np.linalg.pinv(box.K.toarray(), rcond=1e-12, hermitian=True)
    for load in loads:
        wanted = P.T @ (inverse @ (P @ load.f))
        got = found.Phi @ ((found.Phi.T @ load.f) / found.omega2)
        np.testing.assert_allclose(got, wanted, atol=1e-8 * np.abs(wanted).max())
        rough = without.Phi @ ((without.Phi.T @ load.f) / without.omega2)
        assert np.abs(rough - wanted).max() > 1e-2 * np.abs(wanted).max()


def test_residual_vectors_hold_what_reactions_at_an_interface_balance(box):
    """Held at its interface the body gives way to the load as the full one does: K_ii^-1 f."""
    interfaces = make_interfaces(box, {"wall": "x0"})
    loads = make_loads(box, LOADS)
    found = craig_bampton(box, interfaces, 2, loads=loads)
    free = np.setdiff1d(np.arange(box.numbering.n), interfaces[0].dofs)
    for load in loads:
        wanted = np.linalg.solve(box.K[free][:, free].toarray(), load.f[free])
        inner = found.basis[free, 6:]
        got = inner @ np.linalg.solve(found.K[6:, 6:], inner.T @ load.f[free])
        np.testing.assert_allclose(got, wanted, atol=1e-9 * np.abs(wanted).max())


def test_a_load_without_resultant_moves_nothing_and_takes_one_vector(box):
    mesh = box.mesh
    rows = np.concatenate([mesh.element_sets[name]["triangle6"] for name in ("x0", "x1")])
    both = Mesh(mesh.points, mesh.blocks, {}, {**mesh.element_sets, "both": {"triangle6": rows}})
    fe = assemble(both, STEEL)
    loads = make_loads(fe, {"squeeze": {"type": "pressure", "group": "both", "pressure": 1e6}})
    assert not loads[0].force.any()
    assert not loads[0].moment.any()
    interfaces = make_interfaces(fe, {"a": {"center": [1, 0.2, 0.2], "radius": 0.3}})
    assert craig_bampton(fe, interfaces, 2, loads=loads).kinds.count("load") == 1


def test_a_load_the_basis_holds_already_adds_nothing(box):
    interfaces = make_interfaces(box, {"a": "x0", "b": {"group": "x1", "type": "rbe3"}})
    at_b = {"force": [1, 2, 3], "moment": [0.1, 0.2, 0.3]}
    loads = make_loads(box, {"on b": {"type": "force", "group": "x1", **at_b}})
    plain, more = (free_interface(box, interfaces, 4, loads=given) for given in ((), loads))
    assert more.basis.shape == plain.basis.shape
    # held at b the load does nothing; let go, the inertia it causes is a load like any other
    held = craig_bampton(box, interfaces, 4, loads=loads)
    assert held.kinds.count("load") == 1
    bends = orthonormalise(box, held)
    assert bends.omega2[-1] < 1e4 * bends.omega2[-2]
    told = {**LOADS["press"], "residual": False}
    unasked = make_loads(box, {"press": told})
    assert craig_bampton(box, interfaces, 4, loads=unasked).basis.shape[1] == 16


def test_weight_adds_nothing_to_free_bodies_and_the_sag_to_held_ones(box):
    """Asked for: after relief nothing is left; held at an interface the body sags by K_ii^-1 M g,
    which is the response to its acceleration too: one vector."""
    hang = {"type": "gravity", "acceleration": [0, 0, -9.81], "residual": True}
    loads = make_loads(box, {"hang": hang})
    interfaces = make_interfaces(box, {"wall": "x0"})
    assert "load" not in free_modes(box, (), 3, loads=loads).kinds
    assert free_interface(box, interfaces, 3, loads=loads).kinds.count("attachment") == 6
    found = craig_bampton(box, interfaces, 1, loads=loads)
    assert found.kinds.count("load") == 1
    free = np.setdiff1d(np.arange(box.numbering.n), interfaces[0].dofs)
    wanted = np.linalg.solve(box.K[free][:, free].toarray(), loads[0].f[free])
    inner = found.basis[free, 6:]
    got = inner @ np.linalg.solve(found.K[6:, 6:], inner.T @ loads[0].f[free])
    np.testing.assert_allclose(got, wanted, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"type": "presure", "group": "x1"}, 'unknown type "presure"; nearest: pressure'),
        ({}, "loads.push.type: is missing; allowed: pressure"),
        ({"type": "pressure", "group": "x1"}, "loads.push.pressure: is missing"),
        ({"type": "pressure", "group": "x1", "pressure": "high"}, "must be a number"),
        ({"type": "pressure", "group": "x2", "pressure": 1.0}, 'no group "x2"'),
        ({"type": "pressure", "group": "x1", "pressure": 1.0, "resid": 1}, "nearest: residual"),
        ({"type": "pressure", "group": "x1", "pressure": 1.0, "residual": 1}, "true or false"),
        ({"type": "line", "group": "x1", "force": [1, 0, 0]}, "has no line elements"),
        ({"type": "gravity", "acceleration": [0, 1]}, "must be three finite numbers"),
        ({"type": "force", "node": 3}, 'give "force", "moment" or both'),
        ({"type": "force", "node": 3, "moment": [1, 0, 0]}, "cannot hold a rotation"),
        ({"type": "force", "node": 3, "force": [1, 0, float("inf")]}, "three finite numbers"),
    ],
)
def test_loads_that_cannot_be(box, words, sentence):
    with pytest.raises(ReductionError, match=sentence):
        make_loads(box, {"push": words})


def test_pressure_on_facets_of_nothing_is_refused():
    box = block((1, 1, 1))
    points = np.vstack([box.points, box.points[:3] + 5])
    cells = {**box.blocks, "triangle": np.array([[27, 28, 29]])}
    sets = {"far": {"triangle": np.array([0])}}
    fe = assemble(Mesh(points, cells, {}, sets), STEEL)
    with pytest.raises(ReductionError, match="1 facets of the group .* neither bound a solid"):
        one(fe, type="pressure", group="far", pressure=1.0)
