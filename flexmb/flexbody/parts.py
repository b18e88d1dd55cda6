"""The parts of a flexible body: interfaces, modes, surface, nodal modes, loads.

All in SI and in the body frame, which is the frame of the undeformed mesh. m is the number of
modal coordinates eta; Phi_t and Phi_r are the translation [m] and rotation [rad] per unit eta.

In: a :class:`FlexBody`. Out: one row per candidate mode under the headings ``MODE_COLUMNS``:
`mostly` names the candidate with the most strain energy in the mode, `interfaces` the share of
strain energy in interface motions, `x/y/z` the shares of kinetic energy along the axes.
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
    bend : (3, m, m) float, optional
        Geometric stiffness of a unit force at the point along each body axis [1/m per m^2 of eta]:
        the point falls back by half of eta^T bend eta. None: not known, and left out.
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
            set_fields(self, bend=check.floats("bend", self.bend, (3, m, m)))
        check.raise_problems()


@dataclass(frozen=True)
class ModeInfo:
    """What one candidate mode is, and whether it became a modal coordinate.

    After orthonormalisation a coordinate has no kind of its own; the shares in its energies tell
    what it mostly is.

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
        Small rotation per unit modal coordinate [rad]; None if the body knows none.
    groups : mapping of str to (g,) int
        Nodes of the body in each named group of its mesh.
    """

    ids: IntArray
    position: FloatArray
    Phi_t: FloatArray
    Phi_r: FloatArray | None = None
    groups: Mapping[str, IntArray] = field(default_factory=dict)

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
        check.raise_problems()

    def row(self, node: int) -> int:
        """Row of the mesh node with index ``node``; -1 if the body has no such node."""
        row = int(np.searchsorted(self.ids, node))
        return row if row < len(self.ids) and self.ids[row] == node else -1


SYMMETRIC_PAIRS = tuple((a, b) for a in range(3) for b in range(a, 3))
"""Axes of the six centrifugal fields: xx, xy, xz, yy, yz, zz."""


_FELT = 1e-3  # share of the energy under the same motion about another axis: less is left out


@dataclass(frozen=True, eq=False)
class InertiaResponse:
    """Static responses of the full model to the body's own inertia loads, interfaces held.

    Forms over twelve numbers c that describe the acceleration of all its points, in body axes: of
    the centre of mass less gravity, a [m/s^2], angular, α [1/s^2], and of G = sym(ω̃²) the entries
    xx, 2 xy, 2 xz, yy, 2 yz, zz [1/s^2].

    Parameters
    ----------
    energy : (12, 12) float
        Twice the strain energy of the full response is c^T energy c [J].
    missing : (12, 12) float
        The same of what the modes of the body lack.
    motion : (12, 12) float
        c^T motion c is the mass times mean square displacement of that [kg m^2].
    """

    energy: FloatArray
    missing: FloatArray
    motion: FloatArray

    def __post_init__(self) -> None:
        check = Checker("inertia response")
        for name in ("energy", "missing", "motion"):
            set_fields(self, **{name: check.floats(name, getattr(self, name), (12, 12))})
        check.raise_problems()

    @staticmethod
    def factors(a: FloatArray, alpha: FloatArray, omega: FloatArray) -> FloatArray:
        """(t, 12) the numbers c of motions: a, alpha and omega (t, 3) in body axes."""
        square = np.sum(omega**2, axis=1)
        G = [omega[:, i] * omega[:, j] - (i == j) * square for i, j in SYMMETRIC_PAIRS]
        twice = [value * (2 - (i == j)) for value, (i, j) in zip(G, SYMMETRIC_PAIRS, strict=True)]
        return np.column_stack([a, alpha, *twice])

    @property
    def missing_shares(self) -> dict[str, float]:
        """Share of the strain energy that the modes lack, by motion; without those hardly felt."""
        none, axes = np.zeros((3, 3)), np.eye(3)
        motions = {
            "acceleration along": self.factors(axes, none, none),
            "angular acceleration about": self.factors(none, axes, none),
            "spin about": self.factors(none, none, axes),
        }
        shares = {}
        for motion, c in motions.items():
            full, missing = (np.einsum("ti,ij,tj->t", c, A, c) for A in (self.energy, self.missing))
            for axis in np.flatnonzero(full > _FELT * full.max()):
                shares[f"{motion} {'xyz'[axis]}"] = float(max(missing[axis] / full[axis], 0.0))
        return shares


@dataclass(frozen=True, eq=False)
class LoadVector:
    """A load on the undeformed body by its resultant and its work on the modes.

    Parameters
    ----------
    name : str
        Name of the load.
    force, moment : (3,) float
        Resultant [N] and moment about the origin of the body frame [N m], body axes.
    modal : (m,) float
        Generalised force on each modal coordinate: the load's work per unit eta.
    """

    name: str
    force: FloatArray
    moment: FloatArray
    modal: FloatArray

    def __post_init__(self) -> None:
        check = Checker(f"load {self.name}")
        set_fields(self, force=check.floats("force", self.force, (3,)))
        set_fields(self, moment=check.floats("moment", self.moment, (3,)))
        set_fields(self, modal=check.floats("modal", self.modal, (None,)))
        check.raise_problems()


def set_fields(part: object, /, **fields: object) -> None:
    """Set fields of a frozen part while it is made."""
    for name, value in fields.items():
        object.__setattr__(part, name, value)
