"""Files of Gmsh 4.1 and 4.0 as Gmsh writes them: entities without groups or in several, parametric
nodes, partitions, immense numbers, text and binary."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from flexmb.errors import MeshError
from flexmb.fe import read_mesh
from flexmb.fe.meshes import mesh_file

# two tetrahedra with a common face, each an entity of its own, and a face of the first
FAR = 9 * 10**15  # a node's number
NODES = {10: (0, 0, 0), 3: (1, 0, 0), 40: (0, 1, 0), FAR: (0, 0, 1), 5: (1, 1, 1)}
SOLIDS = {1: [[10, 3, 40, FAR]], 2: [[3, 40, FAR, 5]]}
FACE = [[10, 40, 3]]
TETRA, TRIANGLE = 4, 2


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    monkeypatch.setattr(mesh_file, "check_reading", lambda *_: None)


class Writer:
    """The numbers of a section, as text or bytes."""

    def __init__(self, binary):
        self.binary, self.data = binary, b""

    def put(self, kind, *values):
        text = " ".join(map(str, values)).encode() + b"\n"
        self.data += struct.pack(f"<{len(values)}{kind}", *values) if self.binary else text


def written(
    tmp_path, groups, names="", *, binary=False, parametric=0, partitioned=False, old=False
):
    """The file; ``groups`` are physical tags by dimension and tag of an entity."""
    entities, nodes, elements = Writer(binary), Writer(binary), Writer(binary)
    if partitioned:
        entities.put("Q", 2)
        entities.put("Q", 1)
        entities.put("i", 1, 9)
    entities.put("Q", 0, 0, 1, 2)
    for dim, tag in ((2, 1), (3, 1), (3, 2)):
        entities.put("i", tag)
        if partitioned:
            entities.put("i", dim, tag)
            entities.put("Q", 1)
            entities.put("i", 1)
        entities.put("d", *range(6))
        own = groups.get((dim, tag), ())
        entities.put("Q", len(own))
        if own:
            entities.put("i", *own)
        entities.put("Q", 1)
        entities.put("i", 4)
    small = {tag: tag % 1000 if old else tag for tag in NODES}  # 4.0 has tags of 4 bytes
    nodes.put("Q", 1, len(NODES), *[1, 1][: 2 - 2 * old])
    nodes.put("i", *([1, 2] if old else [2, 1]), parametric)
    nodes.put("Q", len(NODES))
    if not old:
        nodes.put("Q", *NODES)
    for tag, place in NODES.items():
        if old:
            nodes.put("i", small[tag])
        nodes.put("d", *place, *[0.5] * (2 * parametric))
    blocks = [(2, 1, TRIANGLE, FACE), *((3, tag, TETRA, rows) for tag, rows in SOLIDS.items())]
    elements.put("Q", len(blocks), len(blocks), *[1, 1][: 2 - 2 * old])
    for number, (dim, tag, kind, rows) in enumerate(blocks, 1):
        elements.put("i", *([tag, dim] if old else [dim, tag]), kind)
        elements.put("Q", len(rows))
        for row in rows:
            elements.put("i" if old else "Q", number, *(small[node] for node in row))
    parts = {"Partitioned" * partitioned + "Entities": entities, "Nodes": nodes}
    parts["Elements"] = elements
    mark = struct.pack("<i", 1) + b"\n" if binary else b""
    data = b"$MeshFormat\n4.%d %d 8\n" % (not old, binary) + mark + b"$EndMeshFormat\n"
    if names:
        data += f"$PhysicalNames\n{len(names.splitlines())}\n{names}$EndPhysicalNames\n".encode()
    for name, part in parts.items():
        data += b"$" + name.encode() + b"\n" + part.data + b"\n$End" + name.encode() + b"\n"
    path = tmp_path / "two.msh"
    path.write_bytes(data)
    return path


def expect_the_two(mesh):
    np.testing.assert_array_equal(mesh.points, list(NODES.values()))
    np.testing.assert_array_equal(mesh.blocks["tetra"], [[0, 1, 2, 3], [1, 2, 3, 4]])
    np.testing.assert_array_equal(mesh.blocks["triangle"], [[0, 2, 1]])


@pytest.mark.parametrize("binary", [False, True])
def test_elements_without_a_group_do_not_make_a_file_unreadable(tmp_path, binary):
    """Gmsh writes such files with Mesh.SaveAll."""
    path = written(tmp_path, {(3, 1): [7]}, '3 7 "der Körper"\n', binary=binary)
    mesh = read_mesh(path)
    expect_the_two(mesh)
    assert set(mesh.node_sets) == {"der Körper"}
    np.testing.assert_array_equal(mesh.element_sets["der Körper"]["tetra"], [0])


@pytest.mark.parametrize("parametric", [0, 1])
@pytest.mark.parametrize("binary", [False, True])
def test_files_of_format_4_0_have_the_same(tmp_path, binary, parametric):
    """Gmsh 4.0 and 4.1 wrote it, and Gmsh writes it with Mesh.MshFileVersion = 4."""
    options = {"binary": binary, "parametric": parametric, "old": True}
    mesh = read_mesh(written(tmp_path, {(3, 1): [7, 8], (2, 1): [8]}, '3 7 "body"\n', **options))
    expect_the_two(mesh)
    assert set(mesh.node_sets) == {"body", "2:8", "3:8"}
    np.testing.assert_array_equal(mesh.element_sets["body"]["tetra"], [0])


@pytest.mark.parametrize("binary", [False, True])
def test_an_entity_is_in_all_its_groups(tmp_path, binary):
    mesh = read_mesh(written(tmp_path, {(3, 1): [7, 8], (3, 2): [8], (2, 1): [8]}, binary=binary))
    assert list(mesh.node_sets) == ["2:8", "3:7", "3:8"]
    np.testing.assert_array_equal(mesh.element_sets["3:7"]["tetra"], [0])
    np.testing.assert_array_equal(mesh.element_sets["3:8"]["tetra"], [0, 1])
    np.testing.assert_array_equal(mesh.node_sets["2:8"], [0, 1, 2])


@pytest.mark.parametrize("binary", [False, True])
def test_parametric_nodes(tmp_path, binary):
    expect_the_two(read_mesh(written(tmp_path, {}, binary=binary, parametric=1)))


@pytest.mark.parametrize("binary", [False, True])
def test_partitions(tmp_path, binary):
    mesh = read_mesh(written(tmp_path, {(3, 2): [4]}, binary=binary, partitioned=True))
    expect_the_two(mesh)
    np.testing.assert_array_equal(mesh.element_sets["3:4"]["tetra"], [1])


def test_one_name_of_two_dimensions_is_that_of_the_higher(tmp_path):
    path = written(tmp_path, {(3, 1): [1], (2, 1): [2]}, '3 1 "part"\n2 2 "part"\n')
    mesh = read_mesh(path)
    assert set(mesh.node_sets) == {"part", "2:2"}
    np.testing.assert_array_equal(mesh.node_sets["part"], [0, 1, 2, 3])


def test_a_face_that_names_an_absent_node_is_refused(tmp_path):
    path = written(tmp_path, {})
    path.write_bytes(path.read_bytes().replace(b"1 10 40 3\n", b"1 10 41 3\n"))
    with pytest.raises(MeshError, match=r"two\.msh: the mesh file is damaged"):
        read_mesh(path)


@pytest.mark.parametrize("count", [b"2 1.5 3\n", b"99 1 1 1\n", b"-1 1 1 1\n"])
def test_counts_that_do_not_fit_are_refused(tmp_path, count):
    path = written(tmp_path, {})
    path.write_bytes(path.read_bytes().replace(b"3 3 1 1\n", count))
    with pytest.raises(MeshError, match=r"two\.msh: the mesh file is damaged"):
        read_mesh(path)
