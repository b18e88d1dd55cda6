"""Motions that end releases leave without any stiffness.

In: a model and its interfaces. Out: an error that names the nodes. A release is a hinge only if
something else at its node holds the motion: another element, a tie, or an interface of several
nodes. An interface of that node alone would get a coordinate without mass or stiffness.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.sections.binding import BoundBeam
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["require_hinges_held"]

_LOOSE = 1e-12  # smallest over largest stiffness of what moves without any


def require_hinges_held(fe: FEMatrices, interfaces: Sequence[IntArray]) -> None:
    """Refuse a model in which a released motion of a node meets no stiffness at all.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    interfaces : sequence of (k,) int
        Their nodes.

    Raises
    ------
    MeshError
        With all such nodes, and about or along what they move.
    """
    ends = [
        block.nodes.ravel()
        for block in fe.blocks
        if isinstance(block.section, BoundBeam) and block.section.released
    ]
    held = [nodes for nodes in interfaces if len(nodes) > 1]
    held_nodes = np.concatenate([fe.numbering.tied, *held])
    problems = []
    for node in np.setdiff1d(np.concatenate(ends) if ends else [], held_nodes).astype(int):
        for first, what in ((0, "moves along"), (3, "turns about")):
            dofs = fe.numbering.table[node, first : first + 3]
            values, axes = np.linalg.eigh(fe.K[dofs][:, dofs].toarray())
            if values[0] <= _LOOSE * values[-1]:
                problems.append(_loose(fe.mesh.source, int(node), what, axes[:, 0]))
    if problems:
        raise MeshError.from_problems(problems)


def _loose(source: str, node: int, what: str, axis: FloatArray) -> Problem:
    place = ", ".join(f"{value:.3g}" for value in axis * np.sign(axis[np.argmax(np.abs(axis))]))
    sentence = f"node {node} {what} ({place}) without any stiffness: only released ends meet there"
    return Problem(
        source, f"{sentence}; release one less; between bodies a joint of the scene turns freely"
    )
