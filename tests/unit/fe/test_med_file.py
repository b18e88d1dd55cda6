"""Files of MED as Salome and Gmsh write them: families in several groups, names in UTF-8."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from femeshes import block

from flexmb.errors import MeshError
from flexmb.fe import read_mesh
from flexmb.fe.meshes import mesh_file

BOX = block((2, 1, 1))


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    monkeypatch.setattr(mesh_file, "check_reading", lambda *_: None)


def add_family(folder, number, *names, encoding="utf-8"):
    family = folder.create_group(f"FAM_{number}")
    family.attrs["NUM"] = number
    rows = [name.encode(encoding).ljust(80, b"\0") for name in names]
    groups = family.create_group("GRO")
    groups.attrs["NBR"] = len(rows)
    groups["NOM"] = np.frombuffer(b"".join(rows), np.int8).reshape(-1, 80)


def written(tmp_path, *, meshes=("box",), kind="T10", step=True, encoding="utf-8"):
    """The box, its face x0 in two groups, some nodes in one; solids have no family."""
    path = tmp_path / "box.med"
    faces = BOX.blocks["triangle6"]
    family = np.zeros(len(faces), int)
    family[BOX.element_sets["x0"]["triangle6"]] = -3
    family[BOX.element_sets["x1"]["triangle6"]] = -4
    with h5py.File(path, "w") as file:
        for name in meshes:
            mesh = file.create_group(f"ENS_MAA/{name}")
            mesh.attrs["ESP"] = 3
            if step:
                mesh = mesh.create_group("-0000000000000000001-0000000000000000001")
            mesh["NOE/COO"] = BOX.points.T.ravel()
            mesh["NOE/FAM"] = np.where(np.arange(len(BOX.points)) < 2, 1, 0)
            for word, rows in ((kind, BOX.blocks["tetra10"]), ("TR6", faces)):
                mesh[f"MAI/{word}/NOD"] = rows.T.ravel() + 1
                mesh[f"MAI/{word}/NOD"].attrs["NBR"] = len(rows)
            mesh["MAI/TR6/FAM"] = family
            of = file.create_group(f"FAS/{name}")
            of.create_group("FAMILLE_ZERO").attrs["NUM"] = 0
            add_family(of.create_group("ELEME"), -3, "Größe links", "both", encoding=encoding)
            add_family(of["ELEME"], -4, "both", encoding=encoding)
            add_family(of.create_group("NOEUD"), 1, "two nodes")
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
@pytest.mark.parametrize("step", [True, False])
def test_groups_of_med(tmp_path, step, encoding):
    mesh = read_mesh(written(tmp_path, step=step, encoding=encoding))
    np.testing.assert_array_equal(mesh.points, BOX.points)
    np.testing.assert_array_equal(mesh.blocks["tetra10"], BOX.blocks["tetra10"])
    assert set(mesh.node_sets) == {"Größe links", "both", "two nodes"}
    np.testing.assert_array_equal(mesh.node_sets["Größe links"], BOX.node_sets["x0"])
    ends = np.union1d(BOX.node_sets["x0"], BOX.node_sets["x1"])
    np.testing.assert_array_equal(mesh.node_sets["both"], ends)
    np.testing.assert_array_equal(mesh.node_sets["two nodes"], [0, 1])


def test_several_meshes_in_one_file_are_refused(tmp_path):
    with pytest.raises(MeshError, match=r"has 2 meshes: write one into a file"):
        read_mesh(written(tmp_path, meshes=("a", "b")))


def test_polyhedra_are_refused_by_name(tmp_path):
    with pytest.raises(MeshError, match=r"elements of type POE of MED are not read"):
        read_mesh(written(tmp_path, kind="POE"))


def test_a_group_of_nodes_and_one_of_faces_may_have_one_name(tmp_path):
    path = written(tmp_path)
    with h5py.File(path, "a") as file:
        nodes = file["ENS_MAA/box/-0000000000000000001-0000000000000000001/NOE/FAM"]
        nodes[3:6] = 2
        add_family(file["FAS/box/NOEUD"], 2, "both")
    mesh = read_mesh(path)
    assert mesh.group_nodes("both").tolist() == [3, 4, 5]
    count = sum(len(BOX.element_sets[name]["triangle6"]) for name in ("x0", "x1"))
    assert len(mesh.group_elements("both")["triangle6"]) == count
