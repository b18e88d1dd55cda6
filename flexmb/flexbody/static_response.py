"""The part of the full model's responses that the modes of a body lack, to judge a run by it.

Stored are the static responses of the full model to the body's own inertia loads and to loads at
mesh nodes, as quadratic forms in the magnitudes of these loads: their whole strain energy, and the
strain energy that the modes lack. Stored are also the lowest omitted modes, as oscillators that the
motion and the loads of the body drive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from flexmb.errors import Problem, ReductionError
from flexmb.flexbody.arrays import Checker, FloatArray, IntArray
from flexmb.flexbody.parts import NodeModes

SYMMETRIC_PAIRS = tuple((a, b) for a in range(3) for b in range(a, 3))
"""Axes of the six centrifugal fields: xx, xy, xz, yy, yz, zz."""


LARGEST_SHARE = 0.1
"""A response may lack this share (square root of the strain energy) without a message."""
LARGEST_SHARE_BY_CHOICE = 0.02
"""The same where the program selects the responses: growth at a point may lack half of a share,
that of a disc 3.4 % with a share of 0.089."""
LEAST_MOTION = 1e-7
"""Displacement over the body's length below which a missing response is ignored."""
# responses with less than this fraction of the largest energy about another axis are left out
_MIN_ENERGY_SHARE = 1e-3
# Kinetic energy of a field out of a plane, over all of it, below which it is in the plane; and of
# a field over the largest that is round-off.
_IN_PLANE, _ROUND_OFF = 0.01, 1e-12


@dataclass(frozen=True, eq=False)
class InertiaResponse:
    """Static responses of the full model to the body's own inertia loads, interfaces fixed.

    Parameters
    ----------
    energy : (12, 12) float
        c^T energy c is twice the strain energy of the full response [J].
    missing : (12, 12) float
        The same for the part of the response that the modes of the body lack.
    motion : (12, 12) float
        c^T motion c is the mass times the mean square displacement of that part [kg m^2].
    missing_without, motion_without : (12, 12) float, optional
        The same for the modes without residual vectors of these loads, if they have such vectors.
    """

    energy: FloatArray
    missing: FloatArray
    motion: FloatArray
    missing_without: FloatArray | None = None
    motion_without: FloatArray | None = None

    def __post_init__(self) -> None:
        check = Checker("inertia response")
        for name, form in tuple(vars(self).items()):
            if form is not None:
                object.__setattr__(self, name, check.floats(name, form, (12, 12)))
        check.raise_problems()

    def needs_residuals(self, c: FloatArray, length: float, mass: float) -> bool:
        """Whether motions c (t, 12) need static responses to inertia among the modes.

        They do if the modes without such responses lack more than `LARGEST_SHARE_BY_CHOICE` of the
        response, in displacements that are large enough to matter.
        """
        missing, motion = self.missing, self.motion
        if self.missing_without is not None and self.motion_without is not None:
            missing, motion = self.missing_without, self.motion_without
        full, lacks, moves = (
            np.einsum("ti,ij,tj->t", c, form, c) for form in (self.energy, missing, motion)
        )
        felt = moves > (LEAST_MOTION * length) ** 2 * mass
        return bool(np.where(felt, lacks, 0.0).max() > LARGEST_SHARE_BY_CHOICE**2 * full.max())

    @staticmethod
    def factors(a: FloatArray, alpha: FloatArray, omega: FloatArray) -> FloatArray:
        """(t, 12) the numbers c of motions a, alpha and omega, each (t, 3) in body axes."""
        square = np.sum(omega**2, axis=1)
        G = [omega[:, i] * omega[:, j] - (i == j) * square for i, j in SYMMETRIC_PAIRS]
        twice = [value * (2 - (i == j)) for value, (i, j) in zip(G, SYMMETRIC_PAIRS, strict=True)]
        return np.column_stack([a, alpha, *twice])

    @property
    def missing_shares(self) -> dict[str, float]:
        """Missing share of the strain energy by motion; motions that hardly strain the body are
        left out."""
        none, axes = np.zeros((3, 3)), np.eye(3)
        motions = {
            "acceleration along": self.factors(axes, none, none),
            "angular acceleration about": self.factors(none, axes, none),
            "spin about": self.factors(none, none, axes),
        }
        shares = {}
        for motion, c in motions.items():
            full, missing = (np.einsum("ti,ij,tj->t", c, A, c) for A in (self.energy, self.missing))
            for axis in np.flatnonzero(full > _MIN_ENERGY_SHARE * full.max()):
                shares[f"{motion} {'xyz'[axis]}"] = float(max(missing[axis] / full[axis], 0.0))
        return shares


@dataclass(frozen=True, eq=False)
class LoadResponse:
    """Static responses of the full model to unit forces and moments at r mesh nodes.

    Interfaces are fixed. For user modes, and without interfaces, the body is free and the inertia
    of its rigid acceleration acts too. The forms are quadratic in 6 r numbers c: force [N] and
    moment [N m] at each node, body axes.

    Parameters
    ----------
    nodes : (r,) int
        The nodes.
    energy, missing, motion : (6 r, 6 r) float
        As in :class:`InertiaResponse`.
    """

    nodes: IntArray
    energy: FloatArray
    missing: FloatArray
    motion: FloatArray

    def __post_init__(self) -> None:
        check = Checker("load response")
        object.__setattr__(self, "nodes", check.integers("nodes", self.nodes, (None,)))
        n = 6 * len(self.nodes)
        for name in ("energy", "missing", "motion"):
            form = check.floats(name, getattr(self, name), (n, n))
            object.__setattr__(self, name, form)
        check.raise_problems()


@dataclass(frozen=True, eq=False)
class OmittedModes:
    """The lowest o omitted modes, minus what the modes contain of them, of unit modal mass.

    Each is an oscillator ÿ + ω² y = force. The force comes from the acceleration of the body and
    the loads at its mesh nodes. Loads at interfaces do not drive it: their static response is in
    the basis.

    Parameters
    ----------
    frequency : (o,) float
        ω/2π [Hz].
    inertia : (o, 12) float
        Force per unit of the twelve numbers of :class:`InertiaResponse`.
    modes : (o, m) float
        Force per unit acceleration of the modal coordinates.
    loads : (o, l) float
        Force per unit of the 6 r loads of :class:`LoadResponse`; l = 0 without load nodes.
    rest : (12 + m, 12 + m) float, optional
        x^T rest x is twice the strain energy of the static response to accelerations x, the twelve
        numbers and those of the modal coordinates, that neither the modes nor these o modes have.
    """

    frequency: FloatArray
    inertia: FloatArray
    modes: FloatArray
    loads: FloatArray
    rest: FloatArray | None = None

    def __post_init__(self) -> None:
        check = Checker("omitted modes")
        shapes = {"frequency": (None,), "inertia": (None, 12), "modes": (None, None)}
        for name, shape in {**shapes, "loads": (None, None)}.items():
            object.__setattr__(self, name, check.floats(name, getattr(self, name), shape))
        if self.rest is not None:
            n = 12 + self.modes.shape[1]
            object.__setattr__(self, "rest", check.floats("rest", self.rest, (n, n)))
        check.raise_problems()

    def in_coordinates(self, Z: FloatArray, rigid: FloatArray | None = None) -> OmittedModes:
        """The same for modal coordinates Z (m, k), in a frame that moves by rigid (6, k)."""
        T = np.zeros((12 + Z.shape[0], 12 + Z.shape[1]))
        T[:12, :12], T[12:, 12:] = np.eye(12), Z
        if rigid is not None:
            T[:6, 12:] = rigid
        modes = np.hstack([self.inertia, self.modes]) @ T[:, 12:]
        rest = None if self.rest is None else T.T @ self.rest @ T
        return replace(self, modes=modes, rest=rest)


@dataclass(frozen=True, eq=False)
class OmittedStiffening:
    """Geometric stiffness of r fields that the modes leave out, as far as loads need them.

    The fields have unit strain energy (1/2 J), are orthogonal to each other and to the modes in
    stiffness, and leave all interfaces at rest. The k loads are, each of size one: the six
    centrifugal ones, the six of each interface, those of the body, and the six of each node with a
    bend.

    Parameters
    ----------
    turns : (k, r, 3) float
        With rotations of the whole body.
    modes : (k, r, m) float
        With the modes.
    own : (k, r, r) float
        With each other.
    mass : (3, 3, r, 6 + m + r) float
        ∫ρ u_a v_b of the fields u with translations and rotations about the centre of mass, with
        the modes and with each other.
    """

    turns: FloatArray
    modes: FloatArray
    own: FloatArray
    mass: FloatArray

    def __post_init__(self) -> None:
        check, r = Checker("omitted stiffening"), np.shape(self.own)[-1]
        for name, columns in (("turns", 3), ("modes", None), ("own", r)):
            form = check.floats(name, getattr(self, name), (len(self.own), r, columns))
            object.__setattr__(self, name, form)
        width = 6 + self.modes.shape[-1] + r
        mass = check.floats("mass", self.mass, (3, 3, r, width))
        object.__setattr__(self, "mass", mass)
        own = np.einsum("aaij->ij", mass[..., width - r :]) if not check.problems else np.eye(r)
        least = np.linalg.eigvalsh(own).min(initial=1.0)
        if np.diag(own).min(initial=1.0) <= 0.0 or least < -_ROUND_OFF * np.trace(own):
            check.add("mass", "must give every field a positive kinetic energy")
        check.raise_problems()

    def in_coordinates(self, Z: FloatArray) -> OmittedStiffening:
        """The same for modal coordinates Z (m, k)."""
        rigid, modes, own = np.split(self.mass, [6, 6 + len(Z)], axis=3)
        mass = np.concatenate([rigid, modes @ Z, own], axis=3)
        return replace(self, modes=self.modes @ Z, mass=mass)

    def in_plane(self, normal: FloatArray) -> OmittedStiffening | None:
        """With those fields alone that move in a plane with this normal; None: there are none."""
        others, own = np.split(self.mass, [-len(self.mass[0, 0])], axis=3)
        across = np.einsum("a,b,abij->ij", normal, normal, own)
        sizes = np.sqrt(np.einsum("aaii->i", own))
        both = np.outer(sizes, sizes)
        whole = np.einsum("aaij->ij", own) / both + _ROUND_OFF * np.eye(len(sizes))
        shares, X = eigh(across / both, whole)
        inside = shares < _IN_PLANE
        if not inside.any():
            return None
        Q, _ = np.linalg.qr(X[:, inside] / sizes[:, None])
        parts = (Q.T @ self.turns, Q.T @ self.modes, Q.T @ self.own @ Q)
        return OmittedStiffening(*parts, Q.T @ np.concatenate([others, own @ Q], axis=3))


def load_nodes(modes: NodeModes | None, points: Sequence[int | Sequence[float]]) -> list[int]:
    """The mesh nodes given by number, or nearest to given positions.

    Raises
    ------
    ReductionError
        A node that is not of the body.
    """
    if modes is None:
        return []
    nodes: list[int] = []
    for point in points:
        if isinstance(point, int | np.integer):
            node = int(point)
            if modes.row(node) < 0:
                what = f"the body has no node {node}"
                raise ReductionError.from_problems([Problem("load_points", what)])
        else:
            away = np.sum((modes.position - np.array(point)) ** 2, axis=1)
            node = int(modes.ids[np.argmin(away)])
        if node not in nodes:
            nodes.append(node)
    return nodes
