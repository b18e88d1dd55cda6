"""Meshes: read from files or made of simple shapes, with their groups."""

from __future__ import annotations

from flexmb.fe.meshes.disk import disk
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.meshes.reader import read_mesh
from flexmb.fe.meshes.shapes import beam, box, plate, tube
from flexmb.fe.meshes.table import mesh_from

__all__ = ["Mesh", "beam", "box", "disk", "mesh_from", "plate", "read_mesh", "tube"]
