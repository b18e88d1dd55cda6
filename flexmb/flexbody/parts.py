"""The parts of a flexible body: interfaces, modes, surface, nodal modes, loads, stress.

All in SI and in the body frame, which is the frame of the undeformed mesh. m is the number of
modal coordinates eta; Phi_t and Phi_r are the translation [m] and rotation [rad] per unit eta.

In: stress at places of the body and section forces at the ends of its beams, linear in eta. Out:
:class:`StressModes` and :class:`SectionForceModes`, from which the stress of any motion is a sum.
The von Mises stress is no such sum: it is taken of the summed components, never summed itself.
Source: Huber (1904) and von Mises (1913), in Timoshenko, Strength of Materials, part II.

In: a :class:`FlexBody`. Out: one row per candidate mode under the headings ``MODE_COLUMNS``:
`mostly` names the candidate with the most strain energy in the mode, `interfaces` the share of
strain energy in interface motions, `x/y/z` the shares of kinetic energy along the axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

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
        _set(self, position=check.floats("position", self.position, (3,)))
        _set(self, Phi_t=check.floats("Phi_t", self.Phi_t, (3, None)))
        m = self.Phi_t.shape[1]
        _set(self, Phi_r=check.floats("Phi_r", self.Phi_r, (3, m)))
        if self.bend is not None:
            _set(self, bend=check.floats("bend", self.bend, (3, m, m)))
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
        _set(self, points=check.floats("points", self.points, (None, 3)))
        n = len(self.points)
        _set(self, faces=check.integers("faces", self.faces, (None, 3)))
        _set(self, lines=check.integers("lines", self.lines, (None, 2)))
        _set(self, modes=check.floats("modes", self.modes, (n, 3, None)))
        _set(self, node_ids=check.integers("node_ids", self.node_ids, (n,)))
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
        _set(self, ids=check.integers("ids", self.ids, (None,)))
        k = len(self.ids)
        _set(self, position=check.floats("position", self.position, (k, 3)))
        _set(self, Phi_t=check.floats("Phi_t", self.Phi_t, (k, 3, None)))
        if self.Phi_r is not None:
            _set(self, Phi_r=check.floats("Phi_r", self.Phi_r, self.Phi_t.shape))
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
        _set(self, force=check.floats("force", self.force, (3,)))
        _set(self, moment=check.floats("moment", self.moment, (3,)))
        _set(self, modal=check.floats("modal", self.modal, (None,)))
        check.raise_problems()


def _set(part: object, /, **fields: object) -> None:
    for name, value in fields.items():
        object.__setattr__(part, name, value)


STRESS = ("xx", "yy", "zz", "yz", "zx", "xy")
"""Order of stress components, body axes."""
SECTION_FORCES = ("N", "Vy", "Vz", "T", "My", "Mz")
"""Order of section forces: normal force, shear forces, torque, bending moments."""


def von_mises(stress: FloatArray) -> FloatArray:
    """(...) the von Mises stress of components (..., 6) in the order of ``STRESS``.

    >>> von_mises(np.array([100.0, 0, 0, 0, 0, 0])).item()
    100.0
    """
    xx, yy, zz, yz, zx, xy = np.moveaxis(np.asarray(stress), -1, 0)
    apart = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.asarray(np.sqrt(0.5 * apart + 3.0 * (yz**2 + zx**2 + xy**2)))


@dataclass(frozen=True, eq=False)
class StressModes:
    """Stress at places of the body per unit modal coordinate.

    A place is a mesh node, a section of the body and a layer of it: where two sections, or two
    shells at an angle, meet at a node, each has a place of its own there. Single precision, seven
    digits, is more than the stress of a mesh holds and halves the file.

    Parameters
    ----------
    ids : (k,) int
        Mesh node of each place, ascending.
    part, layer : (k,) int
        Which of ``parts`` and of ``layers`` each place belongs to.
    parts : tuple of str
        Sections, by the mesh group that gave them.
    layers : tuple of str
        Places across a section: ``"bottom"`` and ``"top"`` of shells, stress points of beams,
        and ``"solid"``.
    modes : (k, 6, m) float32
        Stress per unit modal coordinate, xx yy zz yz zx xy in body axes [Pa].
    """

    ids: IntArray
    part: IntArray
    layer: IntArray
    parts: tuple[str, ...]
    layers: tuple[str, ...]
    modes: NDArray[np.float32]

    def __post_init__(self) -> None:
        check = Checker("stress")
        _set(self, ids=check.integers("ids", self.ids, (None,)))
        k = len(self.ids)
        for name in ("part", "layer"):
            _set(self, **{name: check.integers(name, getattr(self, name), (k,))})
            names = tuple(str(text) for text in getattr(self, f"{name}s"))
            _set(self, **{f"{name}s": names})
            rows = getattr(self, name)
            if rows.size and not (rows.min() >= 0 and rows.max() < len(names)):
                check.add(name, f"points outside the {len(names)} names of {name}s")
        _set(self, modes=check.floats("modes", self.modes, (k, 6, None), np.float32))
        if (np.diff(self.ids) < 0).any():
            check.add("ids", "must be ascending")
        check.raise_problems()

    @property
    def m(self) -> int:
        """Number of modal coordinates."""
        return int(self.modes.shape[2])

    def rows(self, node: int | None = None, layer: str | None = None) -> IntArray:
        """Places at a mesh node and of a layer; None takes all. Empty if there are none."""
        selected = np.ones(len(self.ids), dtype=bool)
        if node is not None:
            selected &= self.ids == node
        if layer is not None:
            number = self.layers.index(layer) if layer in self.layers else -1
            selected &= self.layer == number
        return np.flatnonzero(selected)

    def at(self, eta: FloatArray, rows: IntArray | slice = slice(None)) -> FloatArray:
        """(..., k, 6) stress for modal coordinates (..., m) at all places, or at some rows [Pa]."""
        modes = self.modes[rows]
        flat = modes.reshape(-1, self.m).astype(np.float64)
        return np.asarray((eta @ flat.T).reshape(*np.shape(eta)[:-1], len(modes), 6))

    def combined(self, Z: FloatArray) -> StressModes:
        """The same in modes made of these by Z (m, k)."""
        return replace(self, modes=(self.modes @ Z).astype(np.float32))


@dataclass(frozen=True, eq=False)
class SectionForceModes:
    """Section forces at both ends of each beam element per unit modal coordinate.

    What the part of the beam beyond the section does to the part before it, in the order
    ``SECTION_FORCES``, along the local axes and about the centroid: a tensile N is positive, a
    positive Mz stretches the fibres at negative y, a positive My those at positive z.

    Parameters
    ----------
    elements : (b, 2) int
        Mesh nodes of the beam elements.
    axes : (b, 3, 3) float
        Local axes x (along the beam), y, z as columns, body frame.
    modes : (b, 2, 6, m) float
        N, Vy, Vz [N] and T, My, Mz [N m] at the first and at the second node.
    """

    elements: IntArray
    axes: FloatArray
    modes: FloatArray

    def __post_init__(self) -> None:
        check = Checker("section_forces")
        _set(self, elements=check.integers("elements", self.elements, (None, 2)))
        b = len(self.elements)
        _set(self, axes=check.floats("axes", self.axes, (b, 3, 3)))
        _set(self, modes=check.floats("modes", self.modes, (b, 2, 6, None)))
        check.raise_problems()

    @property
    def m(self) -> int:
        """Number of modal coordinates."""
        return int(self.modes.shape[3])

    def at(self, eta: FloatArray) -> FloatArray:
        """(..., b, 2, 6) section forces for modal coordinates (..., m) [N, N m]."""
        forces = eta @ self.modes.reshape(-1, self.m).T
        return np.asarray(forces.reshape(*np.shape(eta)[:-1], len(self.elements), 2, 6))

    def combined(self, Z: FloatArray) -> SectionForceModes:
        """The same in modes made of these by Z (m, k)."""
        return replace(self, modes=self.modes @ Z)
