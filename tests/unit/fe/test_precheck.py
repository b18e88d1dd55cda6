"""Problems of a mesh found by reading it: all at once, before any assembly."""

from __future__ import annotations

import pytest
from femeshes import block

from flexmb.errors import MeshError
from flexmb.fe import Mesh, assemble, make_interfaces, mesh_problems, resolve

BOX = block((2, 1, 1))


def test_a_good_mesh_has_no_problems():
    assert mesh_problems(BOX, {"a": "x0", "b": "x1"}) == []


def test_all_problems_at_once(tmp_path):
    faces = Mesh(BOX.points, {"triangle6": BOX.blocks["triangle6"]}, {}, BOX.element_sets)
    found = [str(problem) for problem in mesh_problems(faces, {"a": "x2", "b": "y"})]
    assert len(found) == 3
    assert "has no volume elements" in found[0]
    assert found[1] == 'interfaces.a: mesh has no group "x2"; allowed: x0, x1'
    assert "interfaces.b" in found[2]
    assert "no such mesh file" in str(mesh_problems(tmp_path / "a.msh")[0])
    wrong = mesh_problems(BOX, sections={"all": {"type": "ellipse"}})
    assert "ellipse" in str(wrong[0])


def test_interfaces_told_by_tables():
    asked = {"a": {"group": "x1", "type": "rbe3"}, "b": {"center": [0, 0, 0], "radius": 0.1}}
    assert mesh_problems(BOX, asked) == []
    asked = {"a": {"group": "x2"}, "b": {"group": "x1", "type": "rbe4"}, "c": {"node": 10**6}}
    where = [problem.where for problem in mesh_problems(BOX, asked)]
    assert where == ["interfaces.a", "interfaces.b.type", "interfaces.c.node"]


def test_all_wrong_groups_of_interfaces_are_told_at_once():
    with pytest.raises(MeshError) as caught:
        make_interfaces(assemble(BOX, resolve("steel")), {"a": "x2", "b": "x1", "c": "y"})
    assert [problem.where for problem in caught.value.problems] == ["interfaces.a", "interfaces.c"]
