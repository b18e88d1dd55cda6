"""The parts of a flexible body: interfaces, modes, surface, nodal modes, loads.

All in SI and in the body frame, which is the frame of the undeformed mesh. m is the number of
modal coordinates eta; Phi_t and Phi_r are the translation [m] and rotation [rad] per unit eta.

The table of modes has one row per candidate mode under the headings ``MODE_COLUMNS``: `mostly`
names the candidate with the most strain energy in the mode, `interfaces` the share of strain energy
in interface motions, `x/y/z` the shares of kinetic energy along the axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from flexmb.flexbody.arrays import Checker, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Interface:
    """A named reference point with six degrees of freedom, where a body takes loads and joints.

    Parameters
    ----------
    name : str
        Name of the marker it becomes.
    position : (3,) float
        Undeformed reference point, body frame [m].
    Phi_t, Phi_r : (3, m) float
        Translation [m] and small rotation [rad] of the point per unit modal coordinate, body axes.
    bend : (6, m, m) float, optional
        Geometric stiffness of a unit force along each body axis, and of a unit moment about each.
        The second-order displacement of the point is -1/2 eta^T bend eta along these axes, and so
        is that in its rotation vector. None: not known, and left out.
    """

    name: str
    position: FloatArray
    Phi_t: FloatArray
    Phi_r: FloatArray
    bend: FloatArray | None = None

    def __post_init__(self) -> None:
        check = Checker(f"interface {self.name}")
        set_fields(self, position=check.floats("position", self.position, (3,)))
        set_fields(self, Phi_t=check.floats("Phi_t", self.Phi_t, (3, None)))
        m = self.Phi_t.shape[1]
        set_fields(self, Phi_r=check.floats("Phi_r", self.Phi_r, (3, m)))
        if self.bend is not None:
            set_fields(self, bend=check.floats("bend", self.bend, (6, m, m)))
        check.raise_problems()


@dataclass(frozen=True)
class ModeInfo:
    """What a candidate mode is, and whether it became a modal coordinate.

    After orthonormalisation a modal coordinate is a combination of candidates; its energy shares
    say what it mainly consists of.

    Parameters
    ----------
    index : int
        Number of the modal coordinate, -1 for a dropped candidate.
    kind : str
        ``"rigid"`` or ``"elastic"``, or what the maker of the body calls it.
    frequency : float
        Of the free body in this mode [Hz].
    kept : bool
        Whether it is a modal coordinate of the body.
    why : str
        Why it was kept or dropped.
    mostly : str
        The Craig-Bampton mode that holds the largest share of its strain energy.
    interface_share : float
        Share of the constraint modes (unit motions of the interfaces) in the strain energy, 0 to 1;
        NaN if unknown.
    kinetic_share : (3,) float
        Shares of the motion along the body's x, y and z in the kinetic energy; NaN if unknown.
    """

    index: int
    kind: str
    frequency: float
    kept: bool
    why: str
    mostly: str = ""
    interface_share: float = float("nan")
    kinetic_share: tuple[float, float, float] = (float("nan"),) * 3

    def __post_init__(self) -> None:
        check = Checker(f"mode {self.index}")
        object.__setattr__(self, "kinetic_share", tuple(float(v) for v in self.kinetic_share))
        if not (np.isfinite(self.frequency) and self.frequency >= 0):
            check.add("frequency", f"must be a number >= 0, given {self.frequency} Hz")
        if self.kept != (self.index >= 0):
            check.add("index", f"must be -1 for a dropped mode and >= 0 else, given {self.index}")
        check.raise_problems()


@dataclass(frozen=True, eq=False)
class Surface:
    """What is drawn of a body: points, triangles, lines, and how the modes move the points.

    Parameters
    ----------
    points : (n, 3) float
        Undeformed, body frame [m].
    faces : (t, 3) int
        Triangles as rows of indices into ``points``.
    lines : (l, 2) int
        Line segments (axes of beams) as indices into ``points``.
    modes : (n, 3, m) float
        Displacement of the points per unit modal coordinate, body axes [m].
    node_ids : (n,) int
        Mesh node of each point; the corners of a beam's section have the node that moves them.
    """

    points: FloatArray
    faces: IntArray
    lines: IntArray
    modes: FloatArray
    node_ids: IntArray

    def __post_init__(self) -> None:
        check = Checker("surface")
        set_fields(self, points=check.floats("points", self.points, (None, 3)))
        n = len(self.points)
        set_fields(self, faces=check.integers("faces", self.faces, (None, 3)))
        set_fields(self, lines=check.integers("lines", self.lines, (None, 2)))
        set_fields(self, modes=check.floats("modes", self.modes, (n, 3, None)))
        set_fields(self, node_ids=check.integers("node_ids", self.node_ids, (n,)))
        for name in ("faces", "lines"):
            rows = getattr(self, name)
            if rows.size and not (rows.min() >= 0 and rows.max() < n):
                check.add(name, f"points to entries outside the {n} points")
        check.raise_problems()


@dataclass(frozen=True, eq=False)
class NodeModes:
    """Displacement and rotation of all mesh nodes, for markers at any of them.

    Parameters
    ----------
    ids : (k,) int
        Index of each node in the mesh, ascending.
    position : (k, 3) float
        Undeformed, body frame [m].
    Phi_t : (k, 3, m) float
        Displacement per unit modal coordinate [m].
    Phi_r : (k, 3, m) float or None
        Small rotation per unit modal coordinate [rad]; None if the body has no rotations.
    groups : mapping of str to (g,) int
        Nodes of the body in each named group of its mesh.
    bend_nodes : (b,) int, optional
        Nodes whose ``bend`` is known: those of loads and sensors on a body with geometric
        stiffening.
    bend : (b, 6, m, m) float, optional
        As of :class:`Interface`.
    """

    ids: IntArray
    position: FloatArray
    Phi_t: FloatArray
    Phi_r: FloatArray | None = None
    groups: Mapping[str, IntArray] = field(default_factory=dict)
    bend_nodes: IntArray | None = None
    bend: FloatArray | None = None

    def __post_init__(self) -> None:
        check = Checker("nodes")
        set_fields(self, ids=check.integers("ids", self.ids, (None,)))
        k = len(self.ids)
        set_fields(self, position=check.floats("position", self.position, (k, 3)))
        set_fields(self, Phi_t=check.floats("Phi_t", self.Phi_t, (k, 3, None)))
        if self.Phi_r is not None:
            set_fields(self, Phi_r=check.floats("Phi_r", self.Phi_r, self.Phi_t.shape))
        if (np.diff(self.ids) <= 0).any():
            check.add("ids", "must be ascending without repetition")
        for name, nodes in self.groups.items():
            if not np.isin(nodes, self.ids).all():
                check.add("groups", f'"{name}" holds nodes that the body does not have')
        if self.bend_nodes is not None and self.bend is not None:
            set_fields(self, bend_nodes=check.integers("bend_nodes", self.bend_nodes, (None,)))
            b, m = len(self.bend_nodes), self.Phi_t.shape[2]
            set_fields(self, bend=check.floats("bend", self.bend, (b, 6, m, m)))
            if not np.isin(self.bend_nodes, self.ids).all():
                check.add("bend_nodes", "holds nodes that the body does not have")
        elif self.bend_nodes is not None or self.bend is not None:
            check.add("bend", "needs both the nodes and their bend")
        check.raise_problems()

    def row(self, node: int) -> int:
        """Row of the mesh node with index ``node``; -1 if the body has no such node."""
        row = int(np.searchsorted(self.ids, node))
        return row if row < len(self.ids) and self.ids[row] == node else -1

    def bend_at(self, row: int) -> FloatArray | None:
        """(6, m, m) bend of the node in a row; None: not known."""
        if self.bend_nodes is None or self.bend is None:
            return None
        at = np.flatnonzero(self.bend_nodes == self.ids[row])
        return np.asarray(self.bend[at[0]]) if len(at) else None

    def points_with_bend(self) -> list[Interface]:
        """The nodes whose bend is known, as points; their rotations are zero if not known."""
        if self.bend_nodes is None or self.bend is None:
            return []
        rows = np.searchsorted(self.ids, self.bend_nodes)
        turns = np.zeros_like(self.Phi_t) if self.Phi_r is None else self.Phi_r
        fields = (self.bend_nodes, self.position[rows], self.Phi_t[rows], turns[rows], self.bend)
        return [Interface(f"node {node}", *rest) for node, *rest in zip(*fields, strict=True)]


@dataclass(frozen=True, eq=False)
class LoadPoint(Interface):
    """Point of action of one component of a load, of one sign: the mean of its nodes, weighted by
    it.

    Parameters
    ----------
    wrench : (6,) float
        That component: a force [N] or a moment [N m] in body axes.
    """

    wrench: FloatArray = field(default_factory=lambda: np.zeros(6))

    def __post_init__(self) -> None:
        super().__post_init__()
        check = Checker(f"load point {self.name}")
        set_fields(self, wrench=check.floats("wrench", self.wrench, (6,)))
        check.raise_problems()


@dataclass(frozen=True, eq=False)
class LoadVector:
    """A load: its resultant, its work on the modes, and its points of action on the deformed body.

    Parameters
    ----------
    name : str
        Name of the load.
    force, moment : (3,) float
        Resultant [N] and moment about the origin of the body frame [N m], body axes.
    modal : (m,) float
        Generalised force on each modal coordinate: the load's work per unit eta.
    points : tuple of LoadPoint
        Points where the load acts during a run; without points it cannot act.
    missing_share : float
        Share of the static strain energy under the load, interfaces fixed, that the modes lack.
    """

    name: str
    force: FloatArray
    moment: FloatArray
    modal: FloatArray
    points: tuple[LoadPoint, ...] = ()
    missing_share: float = 0.0

    def __post_init__(self) -> None:
        check = Checker(f"load {self.name}")
        set_fields(self, force=check.floats("force", self.force, (3,)))
        set_fields(self, moment=check.floats("moment", self.moment, (3,)))
        set_fields(self, modal=check.floats("modal", self.modal, (None,)))
        set_fields(self, points=tuple(self.points), missing_share=float(self.missing_share))
        check.raise_problems()


def set_fields(part: object, /, **fields: object) -> None:
    """Set fields of a frozen part while it is made."""
    for name, value in fields.items():
        object.__setattr__(part, name, value)
