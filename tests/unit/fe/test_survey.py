"""Problems of a mesh found by reading it: all at once, before any assembly."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import block

from flexmb.errors import MeshError
from flexmb.fe import Mesh, assemble, make_interfaces, reduce, resolve, survey
from flexmb.fe.meshes.mesh_shapes import mesh_from

BOX = block((2, 1, 1))


def test_a_good_mesh_has_no_problems():
    assert survey(BOX, interfaces={"a": "x0", "b": "x1"}).problems == []


def test_all_problems_at_once(tmp_path):
    faces = Mesh(BOX.points, {"triangle6": BOX.blocks["triangle6"]}, {}, BOX.element_sets)
    found = [str(problem) for problem in survey(faces, interfaces={"a": "x2", "b": "y"}).problems]
    assert len(found) == 3
    assert "has no volume elements" in found[0]
    assert found[1] == 'interfaces.a: mesh has no group "x2"; allowed: x0, x1'
    assert "interfaces.b" in found[2]
    assert "no such mesh file" in str(survey(tmp_path / "a.msh").problems[0])
    wrong = survey(BOX, sections={"all": {"type": "ellipse"}}).problems
    assert "ellipse" in str(wrong[0])


def test_interfaces_told_by_tables():
    asked = {"a": {"group": "x1", "type": "rbe3"}, "b": {"center": [0, 0, 0], "radius": 0.6}}
    assert survey(BOX, interfaces=asked).problems == []
    asked = {"a": {"group": "x2"}, "b": {"group": "x1", "type": "rbe4"}, "c": {"node": 10**6}}
    where = [problem.where for problem in survey(BOX, interfaces=asked).problems]
    assert where == ["interfaces.a", "interfaces.b.type", "interfaces.c.node"]


def test_all_wrong_groups_of_interfaces_are_told_at_once():
    with pytest.raises(MeshError) as caught:
        make_interfaces(assemble(BOX, resolve("steel")), {"a": "x2", "b": "x1", "c": "y"})
    assert [problem.where for problem in caught.value.problems] == ["interfaces.a", "interfaces.c"]


PLATE = {"type": "plate", "length": 0.4, "width": 0.1, "divisions": [4, 2]}
SHELL = {"all": {"type": "shell", "thickness": 0.01}}
ENDS = {"a": "x0", "b": {"group": "x1", "type": "rbe3"}}


def told(mesh=PLATE, **options):
    words = {"material": "steel", "sections": SHELL, "interfaces": ENDS, "modes": 4}
    return survey(mesh, **(words | options))


@pytest.mark.parametrize(
    ("mesh", "section"),
    [
        (PLATE, {"type": "shell", "thickness": 0.01}),
        ({"type": "beam", "length": 1.0}, {"type": "circle", "radius": 0.01}),
        ({"type": "box", "size": [1.0, 0.1, 0.1]}, {"type": "solid"}),
    ],
)
def test_a_slip_of_units_in_the_material_of_a_section_is_named(mesh, section):
    slip = {"all": section | {"material": {"E": 210e3, "nu": 0.3, "density": 7800.0}}}
    (finding,) = told(mesh, sections=slip, interfaces={}).findings
    assert finding.level == "warning"
    assert finding.sentence.startswith('section "all": Young\'s modulus 210000 Pa is implausible')
    assert told(mesh, sections={"all": section}, interfaces={}).findings == []


def test_it_says_what_a_reduction_will_keep():
    found = told(masses={"m": {"at": "x1y1", "mass": 2.0}})
    assert found.problems == []
    assert found.elements == {"quad": 8}
    assert found.dofs == 15 * 6
    assert found.mass == pytest.approx(0.4 * 0.1 * 0.01 * 7850 + 2.0)


@pytest.mark.parametrize(
    ("options", "coordinates"),
    [
        ({}, 10),
        ({"reduction": "guyan"}, 6),
        ({"reduction": "free-interface"}, 16),
        ({"interfaces": {}}, 4),
        ({"modes": {"count": 7}}, 13),
        ({"plane": "zx"}, 7),
    ],
    ids=["craig-bampton", "guyan", "free-interface", "free modes", "table", "in a plane"],
)
def test_coordinates_are_those_of_the_body(options, coordinates):
    found = told(**options)
    assert found.problems == []
    assert str(coordinates) in found.coordinates.replace("up to ", "").split(" ")[0]
    words = {"material": "steel", "sections": SHELL, "interfaces": ENDS, "modes": 4} | options
    if options.get("reduction") == "guyan":
        words["modes"] = None
    assert reduce(PLATE, **words).m == coordinates


def test_loads_add_residual_vectors_up_to_what_is_told():
    loads = {
        "blow": {"type": "pressure", "group": "surface", "pressure": 1.0},
        "weight": {"type": "gravity", "acceleration": [0, 0, -9.81]},
    }
    words = {"material": "steel", "sections": SHELL, "interfaces": ENDS, "modes": 4}
    found = told(loads=loads).coordinates
    assert found == "10 to 12 = 6*2 interfaces + 4 modes - 6 + up to 2 for loads"
    assert 10 < reduce(PLATE, **words, loads=loads).m <= 12
    words |= {"reduction": "free-interface", "interfaces": {}}
    assert told(loads=loads, **words).coordinates == "4 free modes + up to 1 for loads"
    assert reduce(PLATE, **words, loads=loads).m == 5


def test_modes_by_frequency_are_not_counted():
    assert told(modes={"frequency": 1e3}).coordinates == (
        "12 of 2 interfaces + modes by frequency - 6"
    )


LINES = {"type": "beam", "length": 1.0, "divisions": 4}
SOLID = {"type": "box", "size": [1.0, 0.1, 0.1], "divisions": [4, 1, 1]}


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        ({"sections": {}}, "plate: has no volume elements, and no lines or surfaces with a"),
        ({"mesh": LINES, "sections": {}}, "beam: has no volume elements, and no lines or surfaces"),
        (
            {"sections": {"all": {"type": "shell", "thickness": -1}}},
            "sections.all.thickness: must be positive, given -1 m",
        ),
        (
            {"sections": {"all": {"type": "shell"}}},
            "sections.all.thickness: is missing",
        ),
        (
            {"sections": {"all": {"type": "circle", "radius": 0.1}}, "mesh": SOLID},
            "sections.all: the group has no line elements in box",
        ),
        (
            {"sections": {"surfase": SHELL["all"]}},
            'sections.surfase: plate has no group "surfase"; nearest: surface',
        ),
        (
            {"mesh": LINES, "sections": {"all": {"type": "general", "A": -1.0, "Iy": 1, "Iz": 1,
             "J": 1}}, "interfaces": {"a": "start"}},
            "sections.all.A: must be positive, given -1 m^2",
        ),
        (
            {"mesh": LINES, "interfaces": {"a": "start"}, "sections": {"all": {"type": "circle",
             "radius": 0.1, "releases": {"start": ["rw"]}}}},
            'sections.all.releases.start: unknown "rw"',
        ),
        ({"interfaces": {"a": "x2"}}, 'interfaces.a: plate has no group "x2"'),
        (
            {"interfaces": {"a": {"center": [9, 9, 9], "radius": 0.1}}},
            "interfaces.a: there are no nodes of the body's elements among those within 0.1 m",
        ),
        (
            {"mesh": SOLID, "sections": {}, "interfaces": {"a": {"nodes": [0, 1]}}},
            "interfaces.a: the 2 nodes given (0, 1) lie on a line or a point",
        ),
        ({"interfaces": {"a": "x0", "b": "x0y0"}}, "interfaces.b: shares 1 nodes (0) with"),
        ({"modes": 500}, "modes: 500 requested, but the model has only"),
        ({"modes": {"cuont": 5}}, "modes.cuont: unknown key; nearest: count"),
        (
            {"ties": {"t": {"type": "rbe2", "reference": "x9", "nodes": "x0"}}},
            'ties.t.reference: plate has no group "x9"',
        ),
        ({"masses": {"m": {"at": "x9", "mass": 1.0}}}, 'masses.m.at: plate has no group "x9"'),
        (
            {"springs": {"s": {"between": ["x0y0", "x0y0"], "stiffness": 1.0}}},
            "springs.s.between: both ends are node 0",
        ),
        (
            {"loads": {"p": {"type": "pressure", "group": "top", "pressure": 1.0}}},
            'loads.p.group: plate has no group "top"',
        ),
        (
            {"loads": {"p": {"type": "force", "node": 99, "force": [1.0, 0, 0]}}},
            "loads.p.node: 99 is no node",
        ),
        ({"material": "stel"}, 'material: unknown material "stel"; nearest: steel'),
        ({"mesh": {"type": "plate", "length": 1}}, "mesh.width: is missing"),
    ],
)  # fmt: skip
def test_what_cannot_be_reduced_is_told_before(options, wanted):
    mesh = options.pop("mesh", PLATE)
    text = "\n".join(str(problem) for problem in told(mesh, **options).problems)
    assert wanted in text


def test_mistakes_of_all_options_come_at_once():
    found = told(
        sections={"all": {"type": "shell", "thickness": 0}, "x0": {"type": "circl"}},
        interfaces={"a": "x2"},
        material={"E": -1, "nu": 0.3, "density": 1},
        springs={"s": {"between": ["x9", 1], "stiffness": 1.0}},
        loads={"p": {"type": "pressure", "group": "top", "pressure": 1.0}},
    )
    assert [problem.where for problem in found.problems] == [
        "sections.all.thickness",
        "sections.x0.type",
        "material.E",
        "springs.s.between[0]",
        "interfaces.a",
        "loads.p.group",
    ]


def test_two_parts_are_a_problem_unless_a_tie_joins_them():
    one = mesh_from(PLATE | {"elements": "quad"})
    n = len(one.points)
    points = np.vstack([one.points, one.points + [0.5, 0, 0]])
    quads = np.vstack([one.blocks["quad"], one.blocks["quad"] + n])
    sets = {
        "x0": one.node_sets["x0"],
        "tie": np.append(one.node_sets["x1"], one.node_sets["x0"] + n),
    }
    mesh = Mesh(points, {"quad": quads}, sets | {"far": np.array([2 * n - 1])})
    apart = told(mesh, interfaces={"a": "x0"})
    assert [str(p) for p in apart.problems] == [
        "mesh: the mesh falls into 2 parts that share no nodes and no interface; the smallest has "
        "15 nodes, one of them node 0 at (0, -0.05, 0) m: merge coincident nodes, or make the "
        "parts conform"
    ]
    tie = {"t": {"type": "rbe2", "reference": int(sets["tie"][0]), "nodes": "tie"}}
    assert told(mesh, interfaces={"a": "x0"}, ties=tie).problems == []


def test_suspicious_sizes_and_materials_are_warnings():
    big = {"type": "plate", "length": 400.0, "width": 100.0, "divisions": [4, 2]}
    heavy = {"E": 210e9, "nu": 0.3, "density": 7.85e-9}
    found = told(big, material=heavy)
    assert [finding.level for finding in found.findings] == ["warning"] * 2
    text = " ".join(finding.sentence for finding in found.findings)
    assert "extends over 400 m" in text
    assert "given in t/mm^3? Then it is 7850 kg/m^3" in text


def test_elements_that_are_too_stiff_are_told():
    soft = {"type": "box", "size": [1.0, 0.1, 0.1], "elements": "tetra", "divisions": [8, 2, 2]}
    (finding,) = told(soft, sections={}).findings
    assert finding.level == "warning"
    assert '192 elements of kind "tetra"' in finding.sentence


def test_elements_without_a_section_beside_others_are_told():
    """A forgotten rib; the lines of a shell mesh, often borders, are none of its kind."""
    plate = mesh_from({"type": "plate", "length": 1, "width": 1, "divisions": [4, 2]})
    sets = {"skin": {"quad": np.arange(6)}, "rib": {"quad": np.arange(6, 8)}}
    mesh = Mesh(plate.points, plate.blocks, {}, sets)
    thin = {"type": "shell", "thickness": 0.01}
    notes = {}
    for names in (["skin"], ["skin", "rib"], ["all"]):
        surveyed = survey(mesh, material="steel", sections=dict.fromkeys(names, thin))
        notes[len(names), names[0]] = [tuple(one) for one in surveyed.findings]
    sentence = "2 of 8 quad elements have no section and are left out: rib"
    assert ("warning", sentence) in notes.pop((1, "skin"))
    assert not any("section" in text for texts in notes.values() for _, text in texts)


def test_triangles_without_a_section_beside_quadrilaterals_are_told():
    """A part of a body of shells is missing. Of a body of solids, they are faces for loads."""
    points = [*BOX.points, (5.0, 0.0, 0.0), (6.0, 0.0, 0.0), (6.0, 1.0, 0.0), (5.0, 1.0, 0.0)]
    n = len(BOX.points)
    corners = np.arange(n, n + 4)[None]
    shells = {"quad": corners, "triangle": np.array([[n, n + 1, 0]])}
    sets = {"skin": {"quad": np.array([0])}, "flap": {"triangle": np.array([0])}}
    thin = {"skin": {"type": "shell", "thickness": 0.01}}
    told = ("warning", "1 of 1 triangle elements have no section and are left out: flap")
    given = {"material": "steel", "sections": thin, "modes": 2}
    found = survey(Mesh(np.array(points), shells, {}, sets), **given)
    assert told in [tuple(one) for one in found.findings]
    solid = Mesh(np.array(points), {**shells, "tetra10": BOX.blocks["tetra10"]}, {}, sets)
    found = survey(solid, **given, ties={"t": {"reference": 0, "nodes": "skin"}})
    assert not found.problems and not any("no section" in one.sentence for one in found.findings)


def test_a_line_without_a_section_beside_shells_is_noted():
    plate = mesh_from({"type": "plate", "length": 1, "width": 1, "divisions": [4, 2]})
    rod = {"type": "circle", "radius": 0.01}
    sections = {"all": {"type": "shell", "thickness": 0.01}, "x0": rod}
    found = survey(plate, material="steel", sections=sections).findings
    (level,) = [one.level for one in found if "line elements have no section" in one.sentence]
    assert level == "note"


def test_places_are_told_in_the_unit_of_the_mesh(tmp_path):
    """As its preprocessor shows them."""
    points = np.vstack([BOX.points, BOX.points + [40.0, 0.0, 0.0]])
    cells = np.vstack([BOX.blocks["tetra10"], BOX.blocks["tetra10"] + len(BOX.points)])
    apart = Mesh(points, {"tetra10": cells})
    x, y, z = (f"{value:.4g}" for value in points[0] + 0.0)
    for units, unit in (("mm-t-s", "mm"), ("SI", "m"), ("in-lbf-s", "in"), ("um-kg-s", "µm")):
        (problem,) = survey(apart, units=units, material="steel").problems
        assert f"node 0 at ({x}, {y}, {z}) {unit}: merge" in str(problem)
