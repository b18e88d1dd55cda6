"""Reading meshes: groups of both gmsh formats, merged blocks, and files that cannot be read."""

from __future__ import annotations

import sys

import meshio
import numpy as np
import pytest
from femeshes import block

from flexmb.errors import MeshError
from flexmb.fe import read_mesh
from flexmb.fe.elements.element_blocks import FAMILIES
from flexmb.fe.meshes import mesh_file

BOX = block((2, 1, 1))
GMSH = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    """Files are read at once; that they are read in a process of their own is tested elsewhere."""
    monkeypatch.setattr(mesh_file, "check_reading", lambda *_: None)


def written(tmp_path, name="box.msh", file_format="gmsh22", tags=(7, 8, 9), named=True):
    """The box as a gmsh file with its two faces and its volume in physical groups."""
    faces = BOX.blocks["triangle6"]
    x0, x1 = (faces[BOX.element_sets[k]["triangle6"]] for k in ("x0", "x1"))
    cells = [("triangle6", x0), ("triangle6", x1), ("tetra10", BOX.blocks["tetra10"])]
    physical = [np.full(len(data), tag) for (_, data), tag in zip(cells, tags, strict=True)]
    data = {"gmsh:physical": physical, "gmsh:geometrical": physical}
    names = {"left face": [7, 2], "right": [8, 2], "solid": [9, 3]} if named else {}
    mesh = meshio.Mesh(BOX.points, cells, cell_data=data)
    mesh.field_data = {key: np.array(value) for key, value in names.items()}
    path = tmp_path / name
    meshio.write(path, mesh, file_format=file_format)
    return path


def test_named_groups_of_second_order_survive_in_gmsh_2(tmp_path):
    mesh = read_mesh(written(tmp_path))
    assert set(mesh.blocks) == {"triangle6", "tetra10"}
    np.testing.assert_array_equal(mesh.node_sets["left face"], BOX.node_sets["x0"])
    np.testing.assert_array_equal(mesh.node_sets["right"], BOX.node_sets["x1"])
    assert len(mesh.element_sets["solid"]["tetra10"]) == len(BOX.blocks["tetra10"])
    assert not [name for name in mesh.node_sets if name.startswith("gmsh:")]
    np.testing.assert_allclose(mesh.points, BOX.points, atol=1e-15)


def test_unnamed_groups_are_called_by_dimension_and_tag(tmp_path):
    mesh = read_mesh(written(tmp_path, named=False))
    assert set(mesh.node_sets) == {"2:7", "2:8", "3:9"}
    np.testing.assert_array_equal(mesh.node_sets["2:7"], BOX.node_sets["x0"])


def test_elements_repeated_for_two_groups_count_once(tmp_path):
    cells = [("tetra10", BOX.blocks["tetra10"]), ("tetra10", BOX.blocks["tetra10"][:3])]
    physical = [np.full(len(data), tag) for (_, data), tag in zip(cells, (1, 2), strict=True)]
    mesh = meshio.Mesh(BOX.points, cells, cell_data={"gmsh:physical": physical})
    mesh.field_data = {"all of it": np.array([1, 3]), "some": np.array([2, 3])}
    mesh.cell_data["gmsh:geometrical"] = physical
    path = tmp_path / "twice.msh"
    meshio.write(path, mesh, file_format="gmsh22")
    found = read_mesh(path)
    assert len(found.blocks["tetra10"]) == len(BOX.blocks["tetra10"])
    np.testing.assert_array_equal(found.element_sets["some"]["tetra10"], [0, 1, 2])
    assert len(found.element_sets["all of it"]["tetra10"]) == len(BOX.blocks["tetra10"])


def test_node_sets_of_other_formats_survive(tmp_path):
    mesh = meshio.Mesh(BOX.points, [("tetra10", BOX.blocks["tetra10"])])
    path = tmp_path / "box.inp"
    meshio.write(path, mesh)
    text = path.read_text().replace("*ELEMENT", "*NSET, NSET=corner\n1, 2\n*ELEMENT", 1)
    path.write_text(text)
    np.testing.assert_array_equal(read_mesh(path).node_sets["corner"], [0, 1])


def test_flat_points_are_put_into_space(tmp_path):
    path = tmp_path / "flat.vtu"
    meshio.write(path, meshio.Mesh(np.zeros((2, 3)) + [[0], [1]], [("line", [[0, 1]])]))
    assert read_mesh(path).points.shape == (2, 3)


def test_named_groups_of_second_order_survive_in_gmsh_4(project):
    """The connecting rod: two surface blocks to a bore, gmsh's own bookkeeping left out."""
    mesh = read_mesh(project / "meshes" / "connecting_rod.msh")
    assert set(mesh.node_sets) == set(mesh.element_sets) == {"bore_big", "bore_small", "rod"}
    assert set(mesh.blocks) == {"triangle6", "tetra10"}
    for name, centre, radius in (("bore_big", 0.0, 32.0), ("bore_small", 450.0, 17.0)):
        on_bore = np.abs(np.hypot(mesh.points[:, 0] - centre, mesh.points[:, 1]) - radius) < 1e-6
        np.testing.assert_array_equal(mesh.node_sets[name], np.flatnonzero(on_bore))
    assert 10_000 < 3 * len(mesh.points) < 25_000
    assert (project / "meshes" / "connecting_rod.msh").stat().st_size < 3e6


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("a.msh", None, "there is no such mesh file"),
        ("a.msh", b"hello", r"no Gmsh file: it does not begin with \$MeshFormat; export it again"),
        ("a.msh", f"{GMSH}$Nodes\n1 1 1 1\n".encode(), r"\$Nodes \(line 4\) has no end; .*5 lines"),
        ("a.msh", f"{GMSH}$Nodes\n1 1\n0 x\n$EndNodes".encode(), 'line 6 has "0 x" for numbers'),
        ("a.msh", f"{GMSH}$Nodes\n1 1 1 1\n$EndNodes".encode(), r"no section \$Elements"),
        ("a.vtu", b"\x00\x01\x02", "damaged, truncated, not the .vtu format"),
        ("a.xdmf", b"<Xdmf>\n<Domain", "its XML breaks off or is wrong at line 2"),
        ("a.xdmf", b"Xdmf", "it is no XML file"),
        ("a.med", b"no HDF5", "is no HDF5 file, which .med files are"),
        ("a.inp", b"", "the mesh file is empty; export it again"),
        ("a.inp", b"*NODE\n1, 0, 0, 0\n2, 1.3E", 'line 3 has "1.3E" for a number'),
        ("a.bdf", b"GRID,1,,0.,zero,0.", 'line 1 has "ZERO" for a number'),
        ("a.step", b"ISO-10303-21;", 'no mesh format has the suffix ".step"; allowed: .msh'),
    ],
)
def test_what_cannot_be_read(tmp_path, capfd, name, content, sentence):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(MeshError, match=sentence) as caught:
        read_mesh(path)
    assert "Error" not in str(caught.value) and "array" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_truncated_hdf5_file_says_how_much_of_it_is_there(tmp_path):
    meshio.Mesh(BOX.points, [("tetra10", BOX.blocks["tetra10"])]).write(tmp_path / "box.med")
    whole = (tmp_path / "box.med").read_bytes()
    path = tmp_path / "part.med"
    path.write_bytes(whole[:9000])
    with pytest.raises(MeshError, match=f"truncated: it has 9000 of {len(whole)} bytes"):
        read_mesh(path)


def test_coordinates_that_are_not_numbers(tmp_path):
    path = written(tmp_path, name="nan.vtu", file_format="vtu")
    mesh = meshio.read(path)
    mesh.points[3, 1] = np.nan
    mesh.cell_data = {}
    meshio.write(path, mesh, binary=False)
    with pytest.raises(MeshError, match="node 3 has a coordinate that is not a number"):
        read_mesh(path)


_GMSH = {  # number of the kind, its corners, corners whose mean the others are (gmsh manual)
    "tetra10": (11, 4, "01 12 20 30 23 13"),
    "hexahedron20": (17, 8, "01 03 04 12 15 23 26 37 45 47 56 67"),
    "hexahedron27": (
        12, 8,
        "01 03 04 12 15 23 26 37 45 47 56 67 0321 0154 0473 1265 2376 4567 01234567",
    ),
    "wedge15": (18, 6, "01 02 03 12 14 25 34 35 45"),
}  # fmt: skip


@pytest.mark.parametrize("kind", _GMSH)
def test_nodes_of_second_order_solids_come_in_the_order_of_the_elements(kind, tmp_path):
    from flexmb.fe.elements.element_blocks import FAMILIES

    reference = FAMILIES[kind].reference
    number, corners, middles = _GMSH[kind]
    x = reference.nodes[:corners]
    x = np.vstack([x, *(x[[int(c) for c in some]].mean(axis=0) for some in middles.split())])
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(x))]
    lines += [f"{n} {a} {b} {c}" for n, (a, b, c) in enumerate(x, start=1)]
    nodes = " ".join(str(n) for n in range(1, len(x) + 1))
    lines += ["$EndNodes", "$Elements", "1", f"1 {number} 2 1 1 {nodes}", "$EndElements", ""]
    path = tmp_path / "one.msh"
    path.write_text("\n".join(lines))
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points[mesh.blocks[kind][0]], reference.nodes)


DECK = """*NODE, NSET=lower
1, 0, 0, 0
2, 1, 0
3, 1, 1, 0
4, 0, 1, 0
*NODE
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
*Element, type=c3d8, elset=Solid
1, 1, 2, 3, 4,
 5, 6, 7, 8
*NODE
9, 0, 0, 2
10, 1, 0, 2
11, 1, 1, 2
12, 0, 1, 2
*Element, type=C3D8, elset=SOLID
7, 5, 6, 7, 8, 9, 10, 11, 12
*Nset, nset=upper, generate
9, 11, 2
*NSET, NSET=upper
12
*NSET, NSET=both
Upper, 1
*ELSET, ELSET=second
7
*MASS, ELSET=m
1.0
"""


def test_blocks_and_sets_of_an_abaqus_deck_add_up(tmp_path):
    """Three blocks of nodes, two of one element set, sets within sets: Abaqus Keywords, *NSET."""
    path = tmp_path / "deck.inp"
    path.write_text(DECK)
    mesh = read_mesh(path)
    assert mesh.blocks["hexahedron"].tolist() == [[*range(8)], [*range(4, 12)]]
    assert mesh.points[[1, 10]].tolist() == [[1, 0, 0], [1, 1, 2]]
    groups = {name: mesh.group_nodes(name).tolist() for name in ("lower", "upper", "both")}
    assert groups == {"lower": [0, 1, 2, 3], "upper": [8, 10, 11], "both": [0, 8, 10, 11]}
    assert mesh.group_elements("Solid")["hexahedron"].tolist() == [0, 1]
    assert mesh.group_elements("second")["hexahedron"].tolist() == [1]
    assert mesh.note == "the mesh file also has 1 MASS, not read: the body takes its own masses"
    path.write_text(f"{DECK}\n*NSET, NSET=of second, ELSET=second\n")
    assert read_mesh(path).group_nodes("of second").tolist() == [*range(4, 12)]


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ("*NSET, NSET=a\nuper", '"a" has the member "uper", which is neither'),
        ("*NGEN\n1, 9, 2", "NGEN is not read"),
        ("*ELEMENT, ELSET=rib\n9, 1, 2, 3, 4", "ELEMENT has no TYPE"),
    ],
)
def test_what_an_abaqus_deck_says_elsewhere_is_refused(tmp_path, more, sentence):
    path = tmp_path / "deck.inp"
    path.write_text(DECK + more + "\n")
    with pytest.raises(MeshError, match=sentence):
        read_mesh(path)


def test_properties_of_nastran_are_groups_and_systems_must_be_there(tmp_path):
    path = tmp_path / "deck.bdf"
    grids = "".join(f"GRID,{k},{{}},{x},{y},0.\n" for k, (x, y) in enumerate(np.ndindex(2, 2), 1))
    deck = f"BEGIN BULK\n{grids}CQUAD4,1,7,1,3,4,2\nCBAR,2,9,1,3,0.,0.,1.\nENDDATA\n"
    path.write_text(deck.format(*[""] * 4))
    mesh = read_mesh(path)
    assert {k: sorted(v) for k, v in mesh.element_sets.items()} == {
        "2:7": ["quad"],
        "1:9": ["line"],
    }
    path.write_text(deck.format("", 5, "", ""))
    with pytest.raises(MeshError, match="names the coordinate system 5, which the deck does not"):
        read_mesh(path)
    path.write_text(deck.format(*[""] * 4).replace("BULK\n", "BULK\nGRDSET,,3\n"))
    with pytest.raises(MeshError, match="the coordinate system 3, which"):
        read_mesh(path)


COLUMN = [*np.ndindex(3, 2, 2)]  # two cubes; node k has the number 101 + 10 k
CUBES = [[4 * i + k for k in (0, 4, 6, 2, 1, 5, 7, 3)] for i in (0, 1)]


def nastran_column(way):
    """The same two cubes in the formats of the Quick Reference Guide."""
    grids = [[101 + 10 * k, "", *map(float, x)] for k, x in enumerate(COLUMN)]
    solids = [[e, 7, *(101 + 10 * k for k in cube)] for e, cube in enumerate(CUBES, 1)]
    if way == "large":
        lines = [f"GRID*   {n:<16}{'':16}{x:<16}{y:<16}*A\n*A      {z}" for n, _, x, y, z in grids]
        for row in solids:
            cells = [f"{x:<16}" for x in row]
            parts = ["".join(cells[k : k + 4]) for k in (0, 4, 8)]
            lines.append("*\n*       ".join([f"CHEXA*  {parts[0]}", *parts[1:]]))
    elif way == "small":  # automatic continuation, exponents without a letter
        lines = [
            "GRID    " + "".join(f"{x:<8}" for x in (n, "", *(f"{x:g}.0+0" for x in place)))
            for n, _, *place in grids
        ]
        for row in solids:
            cells = [f"{x:<8}" for x in row]
            lines.append(f"CHEXA   {''.join(cells[:8]).rstrip()}\n        {''.join(cells[8:])}")
    else:  # free, with blanks for zeros and a remark behind
        lines = [
            f"GRID,{n},,{','.join(str(x) if x else '' for x in place)} $ remark"
            for n, _, *place in grids
        ]
        mark = "+B" if way == "marked" else ""
        for row in solids:
            first, last = ",".join(map(str, row[:8])), ",".join(map(str, row[8:]))
            lines.append(f"CHEXA,{first},{mark}\n{mark},{last}")
    deck = "\n".join(lines) + "\n"
    return deck.lower() if way == "lower" else f"SOL 103\nCEND\nBEGIN BULK\n{deck}ENDDATA\n"


@pytest.mark.parametrize("way", ["large", "small", "marked", "lower"])
def test_a_nastran_deck_is_read_in_every_format(way, tmp_path):
    path = tmp_path / "deck.bdf"
    path.write_text(nastran_column(way))
    mesh = read_mesh(path)
    assert mesh.points.tolist() == [list(map(float, x)) for x in COLUMN]
    assert mesh.blocks["hexahedron"].tolist() == CUBES
    assert mesh.numbers.tolist() == [101 + 10 * k for k in range(12)]


def test_what_stands_behind_the_nodes_of_nastran_elements_is_no_node(tmp_path):
    """Angles, offsets and vectors; springs are named; a deck may include another."""
    (tmp_path / "grids.bdf").write_text(nastran_column("lower").partition("chexa")[0])
    path = tmp_path / "deck.bdf"
    path.write_text(
        "BEGIN BULK\nINCLUDE 'grids.bdf'\nCQUAD4,1,7,101,141,161,121,30.,.5\n"
        "CTRIA3,2,7,141,181,161,0\nCBAR,3,8,101,141,0.,1.,0.\nCELAS1,4,5,101,1,111,1\n"
        "CBUSH,5,5,101,,,,,0\nENDDATA\n"
    )
    mesh = read_mesh(path)
    assert {kind: cells.tolist() for kind, cells in mesh.blocks.items()} == {
        "quad": [[0, 4, 6, 2]],
        "triangle": [[4, 8, 6]],
        "line": [[0, 4]],
    }
    assert "1 CELAS1, 1 CBUSH, not read: the body takes its own sections, springs" in mesh.note
    assert "has 1 offsets, 1 material angles, " in mesh.note
    bar = "CBAR,3,8,101,141,0.,1.,0.,GGG\n"
    path.write_text(f"BEGIN BULK\nINCLUDE 'grids.bdf'\n{bar},,5,0.,0.,-.5,0.,0.E0,0.\nENDDATA\n")
    assert "1 offsets, 1 pin flags, not read: the body takes its own sec" in read_mesh(path).note
    path.write_text(f"BEGIN BULK\nINCLUDE 'grids.bdf'\n{bar},,,0.,0.,-0.,0.,0.E0,0.\nENDDATA\n")
    assert not read_mesh(path).note


@pytest.mark.parametrize(
    ("word", "edges"),  # of the nodes behind the corners, Quick Reference Guide
    [
        ("CHEXA", "12 23 34 41 15 26 37 48 56 67 78 85"),
        ("CPENTA", "12 23 31 14 25 36 45 56 64"),
        ("CTETRA", "12 23 31 14 24 34"),
    ],
)
def test_middle_nodes_of_nastran_solids_lie_on_their_edges(word, edges, tmp_path):
    kind = {"CHEXA": "hexahedron20", "CPENTA": "wedge15", "CTETRA": "tetra10"}[word]
    corners = {
        "CHEXA": [*np.ndindex(2, 2, 2)],
        "CPENTA": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
        "CTETRA": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    }[word]
    if word == "CHEXA":
        corners = [corners[k] for k in (0, 4, 6, 2, 1, 5, 7, 3)]
    x = np.array(corners, dtype=float)
    x = np.concatenate([x, [(x[int(a) - 1] + x[int(b) - 1]) / 2 for a, b in edges.split()]])
    lines = [f"GRID,{k},,{p[0]},{p[1]},{p[2]}" for k, p in enumerate(x, 1)]
    fields = [word, "1", "1", *map(str, range(1, len(x) + 1))]
    lines.append(",".join(fields[:9]))
    lines += ["," + ",".join(fields[k : k + 8]) for k in range(9, len(fields), 8)]
    (tmp_path / "deck.nas").write_text("BEGIN BULK\n" + "\n".join(lines) + "\nENDDATA\n")
    mesh = read_mesh(tmp_path / "deck.nas")
    at, known = mesh.points[mesh.blocks[kind][0]], FAMILIES[kind].edges
    middle = [(at[a] + at[b]) / 2 for a, b in known]
    np.testing.assert_allclose(at[len(corners) :], middle)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ((" 5, 6, 7, 8\n", " 5, 6, 7, 77\n"), "element 1 names node 77, which"),
        (("type=C3D8,", "type=SC8R,"), "elements of type SC8R are not read"),
        (("*ELSET, ", "*NODE\n1, 9., 9., 9.\n*ELSET, "), "node 1 is given twice, at different"),
        (("*ELSET, ", "*NSET, NSET=far\n99\n*ELSET, "), '"far" names node 99, which is absent'),
    ],
)
def test_an_abaqus_deck_that_contradicts_itself_is_refused(change, sentence, tmp_path):
    assert change[0] in DECK
    path = tmp_path / "deck.inp"
    path.write_text(DECK.replace(*change, 1))
    with pytest.raises(MeshError, match=sentence):
        read_mesh(path)


def test_elements_that_are_no_part_of_a_mesh_do_not_keep_an_abaqus_deck_from_being_read(tmp_path):
    path = tmp_path / "deck.inp"
    others = "*ELEMENT, TYPE=SPRINGA, ELSET=s\n91, 1, 2\n*SPRING, ELSET=s\n\n1.D5\n"
    others += "*ELEMENT, TYPE=R3D4\n92, 1, 2, 3, 4\n*SURFACE, NAME=face\nlower, S1\n"
    path.write_text(DECK + others + "*NSET, NSET=own\nPART-1.3\n")
    mesh = read_mesh(path)
    assert list(mesh.blocks) == ["hexahedron"]
    assert mesh.group_nodes("own").tolist() == [2]
    for words in ("1 SURFACE", "1 SPRING", "1 R3D4", "its own interfaces, masses, springs, ties"):
        assert words in mesh.note


def test_a_format_whose_package_is_not_installed_is_told(tmp_path, monkeypatch):
    """Exodus is read by netCDF4, which flexmb does not require."""
    monkeypatch.setitem(sys.modules, "netCDF4", None)
    (tmp_path / "a.exo").write_bytes(b"CDF\x02 whatever")
    with pytest.raises(
        MeshError, match=r"a\.exo: \.exo files need the package netCDF4, which is not"
    ):
        read_mesh(tmp_path / "a.exo")


@pytest.mark.parametrize("word", ["CBEAM3", "CQUAD", "CQUADX4", "CTRIAX6", "CPLSTN3", "CIFHEX"])
def test_elements_of_nastran_that_are_not_read_are_refused(tmp_path, word):
    """They were left out without a word, a hole in the body."""
    grids = "".join(f"GRID,{k},,{x},{y},0.\n" for k, (x, y) in enumerate(np.ndindex(2, 2), 1))
    deck = f"BEGIN BULK\n{grids}CQUAD4,1,7,1,3,4,2\n{word},2,7,1,3,4\nENDDATA\n"
    (tmp_path / "a.bdf").write_text(deck)
    with pytest.raises(MeshError, match=f"elements of type {word} are not read; write CTETRA"):
        read_mesh(tmp_path / "a.bdf")
