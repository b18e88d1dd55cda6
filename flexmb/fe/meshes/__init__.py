"""Meshes: read from files or made of simple shapes, with their groups."""

from __future__ import annotations

from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.meshes.mesh_file import read_mesh
from flexmb.fe.meshes.mesh_shapes import beam, box, disk, mesh_from, plate, tube

__all__ = ["Mesh", "beam", "box", "disk", "mesh_from", "plate", "read_mesh", "tube"]
