"""What is wrong with a mesh for the body that shall be made of it, told before any assembly.

In: a mesh file, the groups of its interfaces and its sections. Out: the problems, none if the mesh
has elements of the body and all groups that are named.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from flexmb.errors import MeshError, Problem, ReductionError
from flexmb.fe.elements.select import select_elements
from flexmb.fe.interfaces.make import InterfaceLike
from flexmb.fe.interfaces.selectors import asked_nodes, checked_words
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.meshes.reader import read_mesh
from flexmb.fe.sections.read import section_from

__all__ = ["mesh_problems"]


def mesh_problems(
    mesh: str | os.PathLike[str] | Mesh,
    interfaces: Mapping[str, InterfaceLike] | None = None,
    sections: Mapping[str, Any] | None = None,
) -> list[Problem]:
    """Everything that keeps a mesh from becoming the body, as far as reading it can tell.

    Parameters
    ----------
    mesh : path or Mesh
        The mesh.
    interfaces : mapping of str to str or mapping, optional
        Mesh group by interface name, or a table of words.
    sections : mapping of str to section or mapping, optional
        By mesh group.
    """
    problems: list[Problem] = []
    try:
        read = mesh if isinstance(mesh, Mesh) else read_mesh(mesh)
        chosen = {key: section_from(s, f"sections.{key}") for key, s in (sections or {}).items()}
    except (MeshError, ReductionError) as error:
        return list(error.problems)
    try:
        select_elements(read, chosen)
    except MeshError as error:
        problems += error.problems
    for name, given in (interfaces or {}).items():
        where = f"interfaces.{name}"
        try:
            asked_nodes(read, where, checked_words(where, given))
        except MeshError as error:
            problems += error.problems
    return problems
