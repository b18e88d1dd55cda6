"""Flat shells with three or four corners as families: plates in bending, membranes, both.

In: corners (ne, k, 3) [m], a :class:`~flexmb.fe.sections.shell.ShellSection`. Out: the matrices of
:mod:`flexmb.fe.elements.family`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexmb.fe.elements import shell_axes, shell_mass, shell_matrices
from flexmb.fe.elements.family import ComponentMass
from flexmb.fe.elements.shell_reference import EDGES
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["ADVICE", "QUAD", "TRIANGLE", "Shell"]

ADVICE = dict.fromkeys(
    ("triangle6", "quad8", "quad9"),
    "shells have three or four corners and no mid-sides: mesh with first-order elements",
)
"""What to do about surface elements that cannot be used with a shell section."""


class Shell:
    """Flat shells with k corners as a family."""

    dimension = 2
    rotations = True
    warning = ""

    def __init__(self, kind: str, about: str) -> None:
        self.kind, self.about = kind, about
        self.edges = EDGES[kind]
        self.faces = (tuple(range(len(self.edges))),)

    def measure(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne,) areas [m^2], of the projections on the mean planes."""
        s = x - x[:, :1]
        return 0.5 * np.linalg.norm(np.cross(s, np.roll(s, -1, axis=1)).sum(axis=1), axis=1)

    def defects(self, x: FloatArray) -> IntArray:
        """Elements that are flat, folded or concave."""
        return shell_axes.crooked(x)

    def stiffness(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne, d, d)."""
        return shell_matrices.stiffness(self.kind, x, section)

    def mass(self, x: FloatArray, section: Any) -> ComponentMass:
        """Consistent mass."""
        return shell_mass.mass(self.kind, x, section)

    def geometric_stiffness(self, x: FloatArray, section: Any, u: FloatArray) -> FloatArray:
        """(ne, d, d) of the membrane forces that displacements ``u`` (ne, d) cause."""
        return shell_matrices.geometric_stiffness(self.kind, x, section, u)

    def stress_layers(self, section: Any) -> tuple[str, ...]:
        """The outer faces; the element normal points from bottom to top."""
        return ("bottom", "top")

    def stress(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne, k, 2, 6, d) stress at the corners of both faces, body axes."""
        return shell_matrices.stress(self.kind, x, section)

    def rotation(self, x: FloatArray) -> FloatArray:
        """(ne, k, 3, d) the nodes' own rotations."""
        ne, k, _ = x.shape
        out = np.zeros((k, 3, k, 6))
        for node in range(k):
            out[node, :, node, 3:] = np.eye(3)
        return np.broadcast_to(out.reshape(k, 3, 6 * k), (ne, k, 3, 6 * k))


QUAD = Shell(
    "quad",
    "shell: flat quadrilateral, four nodes with six motions each, thin or thick, layered "
    "(DKMQ bending, Allman membrane); needs a section",
)
TRIANGLE = Shell(
    "triangle",
    "shell: flat triangle, three nodes with six motions each, thin or thick, layered "
    "(DKMT bending, Allman membrane); needs a section; too stiff where thin shells are twisted: "
    "quadrilaterals are better there",
)
