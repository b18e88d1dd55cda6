"""The lowest vibration modes of a factorised model, unique in direction, symmetric about a plane.

Shift-invert Lanczos (ARPACK) with shift zero, which needs no guess of the frequency range. The
start vector is fixed, so a second run gives the same numbers. Blocks of vectors were tried: at 92
000 unknowns blocks of four took 128 solutions and 7.7 s, single vectors 82 and 9.3 s. Within a
cluster of equal frequencies each mode is chosen as the one with the largest product with a fixed
displacement field, with its sign such that this product is positive. The fields depend on position
alone, so symmetric bodies get the same modes in every run, on every machine, in every unit system
and for any order of the nodes.

For planar scenes :class:`SymmetryPlane` has the reflection S at a coordinate plane: S u is the
displacement at the mirror image of each node, by the elements' own interpolation, with the
component along the normal reversed and rotations treated as axial vectors; exact for symmetric
meshes, for others as good as the interpolation. The symmetric subspace is computed from all modes
at once, so that pairs of equal or nearly equal frequencies, which an eigensolver mixes, separate
into in-plane and out-of-plane modes.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
import scipy  # scipy.spatial is loaded where it is used
from scipy.linalg import cholesky, eigh, qr, solve_triangular
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from flexmb.errors import FlexmbWarning, Problem, ReductionError, nearest
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.numbering import Numbering
from flexmb.fe.multifrontal import blas_threads
from flexmb.flexbody.arrays import FloatArray, IntArray, is_nonzero
from flexmb.flexbody.planar_body import PLANES, fit_weights
from flexmb.progress import Progress, silent

_TOLERANCE = 1e-10  # relative, of 1 / omega^2; the error is near rounding
# Largest |omega^2 K^-1 M v - v| of a mode v, in the norm of M with |v| = 1. Rounding leaves 1e-9 in
# a strip of solids 200 times as long as thick, and 1e-6 at 1000 times, where frequencies still have
# a relative error of 2e-5 only.
_MAX_RESIDUAL = 1e-5
_WARNING_RESIDUAL = 1e-7  # residual above which a warning says that digits are lost


def lowest_modes(
    M: csr_array,
    solve: Callable[[FloatArray], FloatArray],
    count: int,
    progress: Progress = silent,
    start: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Lowest modes of K x = omega^2 M x by the inverse of K.

    Parameters
    ----------
    M : (n, n) sparse
        Mass.
    solve : callable
        K^-1 b for b (n,) or (n, k); a pseudo-inverse excludes the motions it maps to zero.
    count : int
        How many, fewer than n.
    progress : Progress
        Called with the phase ``"modes"``.
    start : (n,) float, optional
        Start vector; if ``solve`` is a pseudo-inverse, it must lie in its range.

    Returns
    -------
    omega2 : (count,) float
        Squared circular frequencies, ascending [1/s^2].
    V : (n, count) float
        Modes with V^T M V = I.

    Raises
    ------
    ReductionError
        The computed modes do not satisfy K x = omega^2 M x to `_MAX_RESIDUAL`.
    """
    n = M.shape[0]
    if count == 0:
        return np.zeros(0), np.zeros((n, 0))
    expected, done = 4 * count + 20, 0

    def counted(b: FloatArray) -> FloatArray:
        nonlocal done
        done += 1
        progress("modes", min(0.99, done / expected), f"{done} solves")
        return scale * solve(np.ravel(b))

    inverse = LinearOperator((n, n), matvec=counted, dtype=float)
    v0 = start_vector(n) if start is None else start
    first = solve(M @ v0)  # ARPACK compares 1/omega^2 with a number of its own: make it about 1
    scale = np.exp2(np.round(0.5 * np.log2((v0 @ (M @ v0)) / (first @ (M @ first)))))
    try:
        with blas_threads():
            omega2, V = eigsh(M, k=count, M=M, sigma=0.0, OPinv=inverse, v0=v0, tol=_TOLERANCE)
    except ArpackError as error:
        raise ReductionError(f"modes: the lowest {count} were not found ({error})") from error
    order = np.argsort(omega2)
    omega2, V = scale * omega2[order], V[:, order]
    _check(M, solve, omega2, V)
    return omega2, V


def _check(
    M: csr_array, solve: Callable[[FloatArray], FloatArray], omega2: FloatArray, V: FloatArray
) -> None:
    wrong = omega2 * solve(M @ V) - V
    residual = np.sqrt(np.sum(wrong * (M @ wrong), axis=0))
    worst = int(residual.argmax())
    if not residual[worst] <= _MAX_RESIDUAL:
        raise ReductionError(
            f"modes: mode {worst + 1} fulfils the equation of vibration only to "
            f"{residual[worst]:.1e}; stiffnesses or masses of the model may differ too much"
        )
    if residual[worst] > _WARNING_RESIDUAL:
        warnings.warn(
            f"rounding leaves mode {worst + 1} wrong by {residual[worst]:.0e} of itself: the body "
            "is very slender for solids (take beams or shells), or its stiffnesses differ too much",
            FlexmbWarning,
            stacklevel=2,
        )


def dense_modes(K: FloatArray, M: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """`lowest_modes` from full matrices, for many or all modes of a small model.

    It solves for 1/omega^2, so that degrees of freedom with little mass do not degrade the lowest
    modes. Motions without mass are left out: there may be fewer than ``count``.
    """
    if count == 0:
        return np.zeros(0), np.zeros((len(K), 0))
    sigma, V = eigh(M, K, subset_by_index=[len(K) - count, len(K) - 1])
    massive = is_nonzero(sigma)  # for the others 1 / omega^2 is round-off
    sigma, V = sigma[massive][::-1], V[:, massive][:, ::-1]
    return 1.0 / sigma, solve_triangular(cholesky(V.T @ M @ V, lower=True), V.T, lower=True).T


def start_vector(n: int) -> FloatArray:
    """(n,) the fixed start vector: pseudo-random, so not orthogonal to modes of a symmetric
    mesh."""
    return np.random.default_rng(1).standard_normal(n)


# relative gap of omega^2 below which frequencies are equal, so that mode directions are arbitrary
_EQUAL_FREQUENCIES = 1e-6
_MAX_DEGREE = 3
_WAVES = np.array(  # wave vectors without symmetry: they distinguish modes that no polynomial does
    [[1.7, 2.3, 3.1], [4.3, -2.9, 1.3], [-2.1, 5.3, 3.7], [7.1, 3.3, -4.7]]
)
_WAVE_WEIGHT = 0.01  # weight of the waves relative to the polynomials


def polynomial_fields(fe: FEMatrices) -> FloatArray:
    """(n, f) fields that fix sign and direction of modes: monomials and waves for each motion.

    Their weights decrease, so that the first of two fields that match a mode equally decides.
    Rotations are scaled by 1 / (size of the body).
    """
    table, nodes = fe.numbering.table, fe.numbering.nodes
    s = fe.mesh.points[nodes] - fe.center
    size = np.abs(s).max()
    shapes = _scalar_fields(s / size)
    motions = range(6 if len(fe.numbering.rotating) else 3)
    fields = np.zeros((fe.numbering.n_all, len(motions) * len(shapes)))
    for k, shape in enumerate(shapes):
        for c in motions:
            column = len(motions) * k + c
            there = table[nodes, c] >= 0
            scale = 1.0 if c < 3 else 1.0 / size
            fields[table[nodes[there], c], column] = scale * shape[there] / (1 + 0.05 * column)
    return fields[: fe.numbering.n]


def _scalar_fields(s: FloatArray) -> list[FloatArray]:
    """Monomials of the position (k, 3), of degree one first, then waves."""
    monomials = [
        np.prod(s[:, powers], axis=1)
        for degree in range(1, _MAX_DEGREE + 1)
        for powers in combinations_with_replacement(range(3), degree)
    ]
    return monomials + [_WAVE_WEIGHT * np.cos(s @ wave + k) for k, wave in enumerate(_WAVES)]


def mode_signs(omega2: FloatArray, products: FloatArray) -> FloatArray:
    """(k, k) orthogonal matrix Q such that the modes V Q are unique.

    Parameters
    ----------
    omega2 : (k,) float
        Squared frequencies, ascending.
    products : (f, k) float
        Mass products of the polynomial fields with the modes.
    """
    k = len(omega2)
    rotation = np.zeros((k, k))
    gaps = np.diff(omega2) > _EQUAL_FREQUENCIES * omega2[1:]
    for cluster in np.split(np.arange(k), np.flatnonzero(gaps) + 1):
        if not len(cluster):
            continue
        Q, R, _ = qr(products[:, cluster].T, pivoting=True)
        signs = np.where(np.diag(R) < 0, -1.0, 1.0)
        rotation[np.ix_(cluster, cluster)] = Q * signs
    return rotation


# a node this close to a mirror image is the mirror image; fraction of the extent
_EQUAL_POINTS = 1e-6
_CANDIDATES = 32  # number of elements, nearest by centroid, searched for the one around a point
_BATCH = 2000
_NEIGHBOURS = 24  # nodes used for a quadratic fit of ten coefficients
# corners of the mid-side nodes of a tetrahedron
_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


def reflection(fe: FEMatrices, normal: int) -> csr_array:
    """(n, n) reflection at the plane through the centre of mass normal to axis ``normal`` (0 to
    2)."""
    nodes = fe.numbering.nodes
    points = fe.mesh.points[nodes]
    images = points.copy()
    images[:, normal] = 2 * fe.center[normal] - images[:, normal]
    distance, twin = scipy.spatial.cKDTree(points).query(images)
    exact = distance <= _EQUAL_POINTS * np.ptp(points, axis=0).max()
    rows, columns, weights = [nodes[exact]], [nodes[twin[exact]]], [np.ones(exact.sum())]
    for start in range(0, (~exact).sum(), _BATCH):
        part = np.flatnonzero(~exact)[start : start + _BATCH]
        donors, shares = _interpolation(fe, images[part])
        rows.append(np.repeat(nodes[part], donors.shape[1]))
        columns.append(donors.ravel())
        weights.append(shares.ravel())
    S = _over_dofs(
        fe.numbering, normal, np.concatenate(rows), np.concatenate(columns), np.concatenate(weights)
    )
    n = fe.numbering.n
    return S if fe.follow is None else csr_array(S[:n, :n] + S[:n, n:] @ fe.follow)


def antisymmetric(M: csr_array, S: csr_array, V: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Quadratic forms of the kinetic energy: of the antisymmetric parts of fields, and of the
    fields.

    Parameters
    ----------
    M, S : (n, n) sparse
        Mass and reflection.
    V : (n, m) float
        The fields.

    Returns
    -------
    odd, whole : (m, m) float
        Quadratic forms over the fields; whole is the sum for both parts, V^T M V where the mesh is
        symmetric.
    """
    image = S @ V
    odd, even = 0.5 * (V - image), 0.5 * (V + image)
    lost = odd.T @ (M @ odd)
    return lost, lost + even.T @ (M @ even)


def _over_dofs(
    numbering: Numbering, normal: int, rows: IntArray, columns: IntArray, weights: FloatArray
) -> csr_array:
    """Expand weights between nodes to weights between degrees of freedom, with the signs of
    reflection."""
    entries = []
    for c in range(6):
        sign = -1.0 if (c == normal or (c >= 3 and c - 3 != normal)) else 1.0
        i, j = numbering.table[rows, c], numbering.table[columns, c]
        there = (i >= 0) & (j >= 0)
        entries.append((i[there], j[there], sign * weights[there]))
    i, j, values = (np.concatenate(part) for part in zip(*entries, strict=True))
    return csr_array(coo_array((values, (i, j)), shape=(numbering.n_all,) * 2))


def _interpolation(fe: FEMatrices, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """Nodes (r, k) and weights that interpolate a field at positions (r, 3).

    By the element around the position if it is a tetrahedron or a beam, else by a quadratic fit
    through the nearest nodes.
    """
    nodes = np.full((len(at), _NEIGHBOURS), fe.numbering.nodes[0])
    weights = np.zeros((len(at), _NEIGHBOURS))
    best = np.full(len(at), np.inf)
    others = False
    for block in fe.blocks:
        shapes = _SHAPES.get(block.kind)
        if shapes is None:
            others = True
            continue
        element, N, distance = shapes(fe.mesh.points, block.nodes, at)
        closer, width = distance < best, block.nodes.shape[1]
        nodes[closer], weights[closer] = fe.numbering.nodes[0], 0.0
        nodes[closer, :width], weights[closer, :width] = block.nodes[element[closer]], N[closer]
        best = np.minimum(best, distance)
    if others:
        extent = np.ptp(fe.mesh.points, axis=0).max()
        outside = np.flatnonzero(best > _EQUAL_POINTS * extent)
        nodes[outside], weights[outside] = _fit_nodes(fe, at[outside])
    return nodes, weights


def _fit_nodes(fe: FEMatrices, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """The nearest nodes (r, k) of places (r, 3), and their weights in a quadratic fit."""
    carrying = fe.numbering.nodes
    points = fe.mesh.points[carrying]
    count = min(_NEIGHBOURS, len(points))
    near = scipy.spatial.cKDTree(points).query(at, count)[1].reshape(len(at), count)
    nodes = np.full((len(at), _NEIGHBOURS), carrying[0])
    weights = np.zeros((len(at), _NEIGHBOURS))
    nodes[:, :count], weights[:, :count] = carrying[near], fit_weights(points[near], at)
    return nodes, weights


def _in_tets(
    points: FloatArray, tets: IntArray, at: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """For each position the tetrahedron around it, its ten shape functions there, and its
    distance."""
    corners = points[tets[:, :4]]
    count = min(_CANDIDATES, len(tets))
    near = scipy.spatial.cKDTree(corners.mean(axis=1)).query(at, count)[1].reshape(len(at), count)
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    arms = at[:, None] - corners[near, 0]
    local = np.linalg.solve(edges[near], arms[..., None])[..., 0]
    L = np.concatenate([1 - local.sum(axis=2, keepdims=True), local], axis=2)
    best = L.min(axis=2).argmax(axis=1)
    row = np.arange(len(at))
    # a position behind a curved side is outside of the straight-sided tetrahedron
    L = np.clip(L[row, best], 0.0, None)
    L /= L.sum(axis=1, keepdims=True)
    element = near[row, best]
    place = np.einsum("rk,rkc->rc", L, corners[element])
    N = [L[:, k] * (2 * L[:, k] - 1) for k in range(4)] + [4 * L[:, a] * L[:, b] for a, b in _EDGES]
    return element, np.stack(N, axis=1), np.linalg.norm(place - at, axis=1)


def _on_lines(
    points: FloatArray, lines: IntArray, at: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """For each position the nearest line element, its two linear shape functions, and its
    distance."""
    ends = points[lines]
    count = min(_CANDIDATES, len(lines))
    near = scipy.spatial.cKDTree(ends.mean(axis=1)).query(at, count)[1].reshape(len(at), count)
    start, along = ends[near, 0], ends[near, 1] - ends[near, 0]
    share = np.sum((at[:, None] - start) * along, axis=2) / np.sum(along**2, axis=2)
    share = np.clip(share, 0.0, 1.0)
    gap = np.linalg.norm(at[:, None] - start - share[..., None] * along, axis=2)
    row, best = np.arange(len(at)), gap.argmin(axis=1)
    x = share[row, best]
    return near[row, best], np.stack([1 - x, x], axis=1), gap[row, best]


_SHAPES = {"tetra10": _in_tets, "line": _on_lines}


# modes computed beyond those requested, since the last ones may lack their partners
_EXTRA_MODES = 2
# antisymmetric share of the kinetic energy above which a mode counts as out of plane
_MAX_ANTISYMMETRIC = 0.5

Modes = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class SymmetryPlane:
    """A plane of symmetry of a model, through its centre of mass.

    Parameters
    ----------
    plane : str
        ``"xy"``, ``"yz"`` or ``"zx"``.
    S : (n, n) sparse
        Reflection of displacement fields.
    """

    plane: str
    S: csr_array

    @property
    def normal(self) -> int:
        """Axis normal to the plane, 0 to 2."""
        return int(np.argmax(PLANES[self.plane]))

    @property
    def directions(self) -> tuple[int, ...]:
        """In-plane motions of an interface: two of Tx, Ty, Tz and one of Rx, Ry, Rz (0 to 5)."""
        slides = [axis for axis in range(3) if axis != self.normal]
        return (*slides, 3 + self.normal)

    def on(self, dofs: IntArray) -> csr_array:
        """The reflection restricted to fields that live on some degrees of freedom."""
        return self.S[dofs][:, dofs]

    def shares(self, fe: FEMatrices, V: FloatArray) -> FloatArray:
        """(m,) antisymmetric share of the kinetic energy of each field, 0 to 1."""
        odd, whole = antisymmetric(fe.M, self.S, V)
        return np.diag(odd) / np.diag(whole)


def make_symmetry_plane(fe: FEMatrices, plane: str) -> SymmetryPlane:
    """The mirror of a plane.

    Raises
    ------
    ReductionError
        The plane is none of "xy", "yz", "zx".
    """
    if plane not in PLANES:
        names = tuple(PLANES)
        what = f'unknown plane "{plane}"'
        raise ReductionError.from_problems([Problem("plane", what, names, nearest(plane, names))])
    return SymmetryPlane(plane, reflection(fe, int(np.argmax(PLANES[plane]))))


def symmetric_modes(
    S: csr_array, M: csr_array, lowest: Callable[[int], Modes], modes: int, limit: int
) -> Modes:
    """The lowest modes of the symmetric subspace.

    Parameters
    ----------
    S, M : (n, n) sparse
        Reflection and mass.
    lowest : callable
        Squared frequencies and mass-normalised modes of the model, so many.
    modes : int
        How many symmetric ones are wanted; a few more are returned, or all there are.
    limit : int
        How many modes the model has in all.
    """
    if modes == 0:
        return lowest(0)
    count = min(int(2.5 * modes) + 2 * _EXTRA_MODES, limit)
    while True:
        omega2, V = lowest(count)
        share, Q = eigh(*antisymmetric(M, S, V))
        even = Q[:, share < _MAX_ANTISYMMETRIC]
        if even.shape[1] >= modes + _EXTRA_MODES or count == limit:
            break
        missing = (modes + _EXTRA_MODES) / max(even.shape[1], 1)
        count = min(count + 2 * _EXTRA_MODES + int(min(1.2 * missing - 1, 1.5) * count), limit)
    symmetric, W = eigh(even.T @ (omega2[:, None] * even), even.T @ even)
    return symmetric, V @ (even @ W)
