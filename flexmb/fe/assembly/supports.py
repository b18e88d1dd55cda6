"""Supports of a part: which motions of its nodes and interfaces are held, and at what value.

The nodes of a rigid interface move with its six motions q; at a node or interface whose held
directions are oblique, coordinates z along them replace the displacements. All motions are u = G z,
of which some z are held at a value; means of weighted interfaces are held by rows W z = g. Of
supports that meet at a node those directions count that the earlier ones do not hold.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array

from flexmb.errors import FlexmbWarning, MeshError, Problem, nearest
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import (
    ModelInterface,
    RigidInterface,
    check_tied_nodes,
    listed,
    select_interface,
)
from flexmb.flexbody.arrays import FloatArray, IntArray, skew, unit_vector
from flexmb.flexbody.part_options import MOTIONS, SupportOptions
from flexmb.units import say_length

_PLANE = 1e-6  # of the extent of nodes by which they may leave their plane
_PARALLEL = 1e-9  # what is left of a unit vector that others span already
_AGREE = 1e-9  # relative: displacements that two supports impose on one node
_RANK = 1e-9  # of the largest singular value: a motion that supports hold by less is free
_AXES = "xyz"


@dataclass(frozen=True, eq=False)
class Supports:
    """How a model is supported.

    Parameters
    ----------
    names : tuple of str
        Names of the supports.
    positions : (s, 3) float
        Their reference points [m].
    G : (n, k) sparse
        Motions of the model per coordinate z.
    fixed : (h,) int
        The coordinates that are held.
    shares : (s, h) float
        What each support bears of them: those that hold the same motion bear equal shares.
    value : (h,) float
        What they are held at [m, rad].
    W : (w, k) sparse
        Rows of held means.
    mean : (w,) float
        Their values.
    mean_shares : (s, w) float
        As `shares`.
    rigid : (k, 6) float
        Rigid motions about the centre of mass as coordinates.
    points : (k, 3) float
        Place of each coordinate [m].
    references : mapping of str to (6,) int
        Coordinates of the motions of each rigid interface.
    """

    names: tuple[str, ...]
    positions: FloatArray
    G: csr_array
    fixed: IntArray
    shares: FloatArray
    value: FloatArray
    W: csr_array
    mean: FloatArray
    mean_shares: FloatArray
    rigid: FloatArray
    points: FloatArray
    references: Mapping[str, IntArray]

    @property
    def free(self) -> IntArray:
        """Coordinates that are not held."""
        return np.setdiff1d(np.arange(self.G.shape[1]), self.fixed)

    def free_motions(self, size: float, means: bool = True) -> FloatArray:
        """(6, r) rigid motions about the centre of mass that the supports leave; ``size`` [m]."""
        scale = np.array([1.0] * 3 + [1.0 / size] * 3)
        rows = [self.rigid[self.fixed], self.W @ self.rigid if means else np.zeros((0, 6))]
        _, sigma, V = np.linalg.svd(np.concatenate([*rows, np.zeros((6, 6))]) * scale)
        return scale[:, None] * V[sigma <= _RANK * max(sigma[0], 1e-300)].T


class Site(NamedTuple):
    """The three translations or rotations of a node or interface."""

    interface: int  # -1 at a node
    node: int
    turns: bool


class _Hold(NamedTuple):
    """Directions (c, 3) that a support holds at sites, and their values (sites, c)."""

    support: int
    sites: list[Site]
    directions: FloatArray
    values: FloatArray


def make_supports(
    fe: FEMatrices, interfaces: Sequence[ModelInterface], options: Mapping[str, SupportOptions]
) -> Supports:
    """The coordinates of a supported model.

    Raises
    ------
    MeshError
        Unknown groups and interfaces, planes and displacements that cannot be, nodes of a rigid
        interface, supports that contradict each other; all at once.
    """
    problems: list[Problem] = []
    holds: list[_Hold] = []
    positions = np.zeros((len(options), 3))
    for k, (name, words) in enumerate(options.items()):
        try:
            positions[k], made = _make_support(fe, interfaces, k, f"supports.{name}", words)
            holds += made
        except MeshError as error:
            problems += error.problems
    if problems:
        raise MeshError.from_problems(problems)
    return _Builder(fe, interfaces, tuple(options), positions).build(holds)


def complement(directions: FloatArray) -> FloatArray:
    """(3 - c, 3) unit vectors across orthonormal ones (c, 3), axes of the mesh where these fit."""
    basis = [*directions]
    for axis in np.eye(3)[np.argsort([np.abs(directions[:, i]).sum() for i in range(3)])]:
        rest = axis - sum((axis @ d) * d for d in basis)
        rest = rest - sum((rest @ d) * d for d in basis)
        if np.linalg.norm(rest) > 0.1 and len(basis) < 3:
            basis.append(rest / np.linalg.norm(rest))
    return np.array(basis[len(directions) :]).reshape(-1, 3)


def _make_support(
    fe: FEMatrices,
    interfaces: Sequence[ModelInterface],
    number: int,
    where: str,
    words: SupportOptions,
) -> tuple[FloatArray, list[_Hold]]:
    if words.interface is not None:
        names = tuple(part.name for part in interfaces)
        if words.interface not in names:
            what, near = (
                f'there is no interface "{words.interface}"',
                nearest(words.interface, names),
            )
            raise MeshError.from_problems([Problem(f"{where}.interface", what, names, near)])
        k = names.index(words.interface)
        position, places = interfaces[k].position, interfaces[k].position[None]
        nodes = interfaces[k].nodes
        slides, turns = [Site(k, -1, False)], [Site(k, -1, True)]
    else:
        selection = select_interface(fe, where, words)
        check_tied_nodes(fe, selection)
        position, nodes = selection.position, selection.nodes
        for part in interfaces:
            shared = np.intersect1d(nodes, part.nodes)
            if len(shared) and isinstance(part, RigidInterface):
                what = f"{len(shared)} of its nodes ({listed(shared)}) move rigidly with the "
                what += f'interface "{part.name}": support the interface'
                raise MeshError.from_problems([Problem(where, what)])
        places = fe.mesh.points[nodes]
        slides = [Site(-1, int(node), False) for node in nodes]
        rotating = np.isin(nodes, fe.numbering.rotating)
        turns = [Site(-1, int(node), True) for node in nodes[rotating]]
    along, about = _directions(where, words, fe.mesh.points[nodes])
    if not len(along) and not turns:
        what = "holds rotations alone, and its nodes have none: they belong to solids"
        raise MeshError.from_problems([Problem(f"{where}.hold", what)])
    if words.type == "hinged" and not turns and _is_stiff(places, complement(about)):
        what = (
            f"{where}: its nodes belong to solids and do not lie on one axis: held one by one they "
        )
        what += "do not turn, as if they were clamped; an interface of them turns as a whole"
        warnings.warn(what, FlexmbWarning, stacklevel=2)
    shift, turn = (np.array(v or (0.0,) * 3) for v in (words.displacement, words.rotation))
    _check_imposed(where, shift, turn, along, about if turns else along)
    fields = (shift + np.cross(turn, places - position)) @ along.T
    holds = [_Hold(number, slides, along, fields)]
    holds.append(_Hold(number, turns, about, np.tile(turn @ about.T, (len(turns), 1))))
    return position, [hold for hold in holds if len(hold.sites) and len(hold.directions)]


def _is_stiff(places: FloatArray, axes: FloatArray) -> bool:
    """Whether points (k, 3) that are held leave no rotation about any of these directions."""
    sizes, V = np.linalg.svd(places - places.mean(axis=0), full_matrices=True)[1:]
    across = np.append(sizes, 0.0)[1] > _PLANE * sizes[0]
    return bool(sizes[0] > 0.0 and (across or np.linalg.norm(axes @ V[0]) < 1.0 - _PLANE))


def _check_imposed(
    where: str, shift: FloatArray, turn: FloatArray, along: FloatArray, about: FloatArray
) -> None:
    """What is imposed must be held."""
    problems = []
    for name, vector, fixed in (("displacement", shift, along), ("rotation", turn, about)):
        rest = vector - fixed.T @ (fixed @ vector)
        if np.abs(rest).max(initial=0.0) > _PARALLEL * np.abs(vector).max(initial=0.0):
            axis = _AXES[int(np.abs(rest).argmax())]
            what = f"has a component about {axis}" if name == "rotation" else f"moves along {axis}"
            problems.append(Problem(f"{where}.{name}", f"{what}, which the support leaves free"))
    if problems:
        raise MeshError.from_problems(problems)


def _directions(
    where: str, words: SupportOptions, places: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Directions (c, 3) along which, and about which, a support holds."""
    every, none = np.eye(3), np.zeros((0, 3))
    if words.hold is not None:
        fixed = [MOTIONS.index(motion) for motion in dict.fromkeys(words.hold)]
        slides, turns = ([k % 3 for k in sorted(fixed) if k // 3 == half] for half in (0, 1))
        return every[slides], every[turns]
    if words.type == "clamped":
        return every, every
    if words.type == "hinged":
        axis = None if words.axis is None else unit_vector(words.axis, f"{where}.axis")
        return every, none if axis is None else complement(axis[None])
    normal = _normal(where, words, places)[None]
    across = complement(normal)
    if words.type == "sliding":
        return normal, none
    return (normal, across) if words.type == "symmetric" else (across, normal)


def _normal(where: str, words: SupportOptions, places: FloatArray) -> FloatArray:
    """The normal of a plane: as given, else that of the plane in which the nodes lie."""
    if words.normal is not None:
        normal = unit_vector(words.normal, f"{where}.normal")
        gap = np.ptp(places @ normal)
        if words.type != "sliding" and gap > _PLANE * max(np.ptp(places, axis=0).max(), 1e-300):
            what = (
                f"the nodes do not lie in one plane across it: they are {say_length(gap, 3)} apart "
            )
            what += "along it, and a plane of symmetry has no thickness"
            raise MeshError.from_problems([Problem(f"{where}.normal", what)])
        return normal
    sizes, V = np.linalg.svd(places - places.mean(axis=0))[1:]
    sizes = np.append(sizes, np.zeros(3))[:3]
    if len(places) < 3 or sizes[1] <= _PLANE * sizes[0]:
        what = f"is missing: the {len(places)} nodes lie on a line or a point, not in one plane"
        raise MeshError.from_problems([Problem(f"{where}.normal", what)])
    if sizes[2] > _PLANE * sizes[0]:
        what = "is missing: the nodes do not lie in one plane"
        raise MeshError.from_problems([Problem(f"{where}.normal", what)])
    normal = V[2] * np.sign(V[2][np.abs(V[2]).argmax()])
    normal[np.abs(normal) < 1e-9] = 0.0  # an axis of the mesh, but for rounding
    return np.asarray(normal / np.linalg.norm(normal))


class _Builder:
    """Numbers the coordinates and fills G, the held values and the rows of means."""

    def __init__(
        self,
        fe: FEMatrices,
        interfaces: Sequence[ModelInterface],
        names: tuple[str, ...],
        positions: FloatArray,
    ) -> None:
        self.fe, self.interfaces, self.names, self.positions = fe, interfaces, names, positions
        n = fe.numbering.n
        rigid = [k for k, part in enumerate(interfaces) if isinstance(part, RigidInterface)]
        tied = np.concatenate([np.zeros(0, int), *(interfaces[k].dofs for k in rigid)])
        rest = np.setdiff1d(np.arange(n), tied)
        self.number = np.full(n, -1)
        self.number[rest] = np.arange(len(rest))
        self.references = {k: len(rest) + 6 * i + np.arange(6) for i, k in enumerate(rigid)}
        self.count = len(rest) + 6 * len(rigid)
        rows, columns, values = [rest], [np.arange(len(rest))], [np.ones(len(rest))]
        arms = np.zeros((self.count, 6))
        arms[: len(rest)] = fe.rigid[rest]
        points = np.zeros((self.count, 3))
        points[: len(rest)] = fe.dof_points[rest]
        for k, numbers in self.references.items():
            part = interfaces[k]
            assert isinstance(part, RigidInterface)
            rows.append(np.repeat(part.dofs, 6))
            columns.append(np.tile(numbers, len(part.dofs)))
            values.append(part.T.ravel())
            arms[numbers] = np.eye(6)
            arms[numbers[:3], 3:] = -skew(part.position - fe.center)
            points[numbers] = part.position
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        self.G = csr_array(coo_array(entries, shape=(n, self.count)))
        self.rigid, self.points = arms, points

    def build(self, holds: Sequence[_Hold]) -> Supports:
        """Choose the coordinates; raises what contradicts."""
        at: dict[Site, list[tuple[_Hold, int]]] = {}
        for hold in holds:
            for row, site in enumerate(hold.sites):
                at.setdefault(site, []).append((hold, row))
        turned: list[tuple[IntArray, FloatArray]] = []
        fixed: list[tuple[int, float, list[int]]] = []
        means: list[tuple[FloatArray, IntArray, float, list[int]]] = []
        problems: dict[str, Problem] = {}
        for site, parts in at.items():
            basis, values, owners = self._independent(site, parts, problems)
            numbers = self._numbers(site)
            if numbers is None:
                part = self.interfaces[site.interface]
                W = part.W[3:] if site.turns else part.W[:3]  # type: ignore[union-attr]
                rows = zip(basis, values, owners, strict=True)
                means += [(d @ W, self.number[part.dofs], v, s) for d, v, s in rows]
                continue
            turned.append((numbers, np.concatenate([basis, complement(basis)])))
            fixed += zip(numbers, values, owners, strict=False)
        if problems:
            raise MeshError.from_problems(problems.values())
        Q = self._rotation(turned)
        fixed.sort()
        W_rows = [np.full(len(row), k) for k, (row, *_) in enumerate(means)]
        empty = np.zeros(0)
        W = coo_array(
            (
                np.concatenate([empty, *(row for row, *_ in means)]),
                (
                    np.concatenate([empty.astype(int), *W_rows]),
                    np.concatenate([empty.astype(int), *(numbers for _, numbers, *_ in means)]),
                ),
            ),
            shape=(len(means), self.count),
        )
        return Supports(
            self.names,
            self.positions,
            csr_array(self.G @ Q),
            np.array([k for k, *_ in fixed], dtype=int),
            self._shares([s for *_, s in fixed]),
            np.array([v for _, v, _ in fixed], dtype=float),
            csr_array(csr_array(W) @ Q),
            np.array([v for *_, v, _ in means], dtype=float),
            self._shares([s for *_, s in means]),
            Q.T @ self.rigid,
            self.points,
            {self.interfaces[k].name: numbers for k, numbers in self.references.items()},
        )

    def _shares(self, owners: Sequence[Sequence[int]]) -> FloatArray:
        """(supports, n) equal shares of the supports of each motion."""
        shares = np.zeros((len(self.names), len(owners)))
        for k, supports in enumerate(owners):
            shares[[*supports], k] = 1.0 / len(supports)
        return shares

    def _numbers(self, site: Site) -> IntArray | None:
        """The three coordinates of a site; None for a weighted interface."""
        part = slice(3, 6) if site.turns else slice(0, 3)
        if site.interface < 0:
            return self.number[self.fe.numbering.table[site.node, part]]
        numbers = self.references.get(site.interface)
        return None if numbers is None else numbers[part]

    def _independent(
        self, site: Site, parts: Sequence[tuple[_Hold, int]], problems: dict[str, Problem]
    ) -> tuple[FloatArray, list[float], list[list[int]]]:
        """Orthonormal directions, their values and supports; notes values that contradict."""
        basis: list[FloatArray] = []
        values: list[float] = []
        owners: list[list[int]] = []
        for hold, row in parts:
            for d, v in zip(hold.directions, hold.values[row], strict=True):
                shares = [float(d @ b) for b in basis]
                rest = d - sum((c * b for c, b in zip(shares, basis, strict=True)), np.zeros(3))
                expected = sum(c * x for c, x in zip(shares, values, strict=True))
                size = float(np.linalg.norm(rest))
                if size > _PARALLEL:
                    basis.append(rest / size)
                    values.append((v - expected) / size)
                    owners.append([hold.support])
                    continue
                if abs(v - expected) > _AGREE * max(abs(v), abs(expected)):
                    name = self.names[hold.support]
                    place = f"node {site.node}" if site.interface < 0 else "the interface"
                    other = ", ".join(sorted({f'"{self.names[s]}"' for one in owners for s in one}))
                    what = f"moves {place} by {v:.6g}, the support {other} by {expected:.6g}"
                    problems.setdefault(name, Problem(f"supports.{name}", what))
                    continue
                same = int(np.argmax(np.abs(shares)))
                if abs(shares[same]) > 1.0 - _PARALLEL and hold.support not in owners[same]:
                    owners[same].append(hold.support)
        return np.array(basis).reshape(-1, 3), values, owners

    def _rotation(self, turned: Sequence[tuple[IntArray, FloatArray]]) -> csr_array:
        """(k, k) the coordinates before per coordinate along the directions of each site."""
        plain = np.ones(self.count)
        rows, columns, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
        for numbers, basis in turned:
            plain[numbers] = 0.0
            rows.append(np.repeat(numbers, 3))
            columns.append(np.tile(numbers, 3))
            values.append(basis.T.ravel())
        rows.append(np.arange(self.count))
        columns.append(np.arange(self.count))
        values.append(plain)
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        Q = csr_array(coo_array(entries, shape=(self.count, self.count)))
        Q.eliminate_zeros()
        return Q
