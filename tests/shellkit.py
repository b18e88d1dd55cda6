"""Meshes of plates and shells made in memory, their supports, and plain static solutions."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from femeshes import held_frequencies
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from flexmb.fe import Mesh, assemble
from flexmb.fe.sections.shell_section import Layer, layered, shell
from flexmb.materials import Material, OrthotropicMaterial

KINDS = ("quad", "triangle")
REFERENCE = json.loads((Path(__file__).parent / "references" / "shells.json").read_text())

STEEL = Material("steel", 210e9, 0.3, 7850.0)
PLY = OrthotropicMaterial("ply", (140e9, 10e9, 10e9), (0.3, 0.4, 0.3), (5e9, 3e9, 5e9), 1600.0)
LAYUP = (Layer(1e-3, PLY, 0.3), Layer(2e-3, STEEL), Layer(0.5e-3, PLY, -1.1))
SKEW = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()
CORNERS = np.array([[0.0, 0, 0], [1, 0.1, 0], [1.2, 0.9, 0], [-0.1, 1.1, 0]])
SECTIONS = {
    "thin": shell(1e-3, material=STEEL),
    "thick": shell(0.2, material=STEEL),
    "offset": shell(0.02, material=STEEL, offset=0.03, nonstructural=40.0),
    "layered": layered(LAYUP, offset=-2e-3, orientation=(1.0, 2.0, 0.5)),
    "unsheared": shell(0.02, material=STEEL, shear=False),
}


def sheet(divisions, kind="quad", distort=0.0, shape=None):
    """Unit square of quadrilaterals or triangles with the node groups x0, x1, y0, y1.

    ``distort`` moves inner nodes at random by that share of an element, ``shape`` maps the square's
    coordinates (n, 2) to points (n, 3). Diagonals of triangles alternate at random.
    """
    nx, ny = divisions
    i, j = (index.ravel() for index in np.indices((nx + 1, ny + 1)))
    rng = np.random.default_rng(7)
    inner = (i > 0) & (i < nx) & (j > 0) & (j < ny)
    noise = rng.uniform(-1, 1, (len(i), 2)) * distort * inner[:, None]
    st = (np.stack([i, j], axis=1) + noise) / [nx, ny]
    number = np.arange(len(i)).reshape(nx + 1, ny + 1)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=2)
    cells = quads.reshape(-1, 4)
    if kind == "triangle":
        turn = rng.integers(0, 2, len(cells)) * bool(distort)
        cells = np.take_along_axis(cells, (np.arange(4) + turn[:, None]) % 4, axis=1)
        cells = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    sets = {"x0": i == 0, "x1": i == nx, "y0": j == 0, "y1": j == ny}
    sets = {name: np.flatnonzero(mask) for name, mask in sets.items()}
    points = np.pad(st, ((0, 0), (0, 1))) if shape is None else shape(st)
    return Mesh(points, {kind: cells}, sets)


def rectangle(a, b):
    """A shape for :func:`sheet`: a by b in the xy plane."""
    return lambda st: np.pad(st * [a, b], ((0, 0), (0, 1)))


def model(mesh, section, material):
    """The model of a mesh whose surfaces all have one section."""
    return assemble(mesh, material, {"all": section})


def held(fe, supports):
    """Degrees of freedom of {group: motions}, motions 0 to 5 in body axes."""
    table, sets = fe.numbering.table, fe.mesh.node_sets
    parts = [table[sets[name]][:, list(motions)].ravel() for name, motions in supports.items()]
    return np.unique(np.concatenate(parts)) if parts else np.zeros(0, dtype=int)


def static(fe, loads, dofs):
    """(nodes, 6) displacements under loads (n,) with these degrees of freedom held."""
    free = np.setdiff1d(np.arange(fe.numbering.n), dofs)
    u = np.zeros(fe.numbering.n)
    u[free] = spsolve(fe.K[free][:, free].tocsc(), loads[free])
    return u[fe.numbering.table]


def bending_frequencies(fe, supports, count):
    """Circular frequencies of out-of-plane motion of a plate in the xy plane."""
    plane = fe.numbering.table[:, [0, 1, 5]].ravel()
    return held_frequencies(fe, np.union1d(held(fe, supports), plane), count)


def node_at(mesh, point):
    """The node nearest to a point."""
    return int(np.argmin(np.linalg.norm(mesh.points - point, axis=1)))


SIMPLE = {"x0": (0, 1, 2, 3), "x1": (2, 3), "y0": (1, 2, 4), "y1": (2, 4)}
"""Hard simple support of a plate in the xy plane, in-plane rigid motion held too."""
CLAMPED = {name: range(6) for name in ("x0", "x1", "y0", "y1")}


def rigid_motions(x):
    """(6 k, 6) unit translations and rotations about the origin of nodes (k, 3) with rotations."""
    out = np.zeros((len(x), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = np.eye(3)
    out[:, :3, 3:] = np.cross(np.eye(3), x[:, None]).transpose(0, 2, 1)
    return out.reshape(-1, 6)


def corners(kind, warped=0.0):
    """One element in skew orientation away from the origin."""
    x = CORNERS[: 4 if kind == "quad" else 3].copy()
    x[1, 2] += warped
    return (x @ SKEW.T + [1.0, 2.0, 3.0])[None]
