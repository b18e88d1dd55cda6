"""A mesh from a table of words: ``{type = "box", size = [1, 0.1, 0.1], divisions = [10, 2, 2]}``.

In: the table, sizes in metres. Out: a :class:`Mesh`. The words are the parameters of the functions
of the shapes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

from flexmb.errors import MeshError
from flexmb.fe.meshes.disk import disk
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.meshes.reader import read_mesh
from flexmb.fe.meshes.shapes import beam, box, plate, tube
from flexmb.fe.tables import make

__all__ = ["MeshLike", "SHAPES", "mesh_from"]

MeshLike = str | os.PathLike[str] | Mapping[str, Any] | Mesh

SHAPES: dict[str, Callable[..., Mesh]] = {
    "beam": beam,
    "plate": plate,
    "box": box,
    "tube": tube,
    "disk": disk,
}
"""What makes the mesh of each type."""


def mesh_from(given: MeshLike, where: str = "mesh") -> Mesh:
    """The mesh that was meant: itself, a file, or the table of a simple shape.

    Raises
    ------
    MeshError
        A file that cannot be read, or what is wrong with the table, all at once.
    """
    if isinstance(given, Mesh):
        return given
    if isinstance(given, Mapping):
        return make("shape of a mesh", SHAPES, given, where, MeshError)
    return read_mesh(given)
