"""Independent coordinates y of small motions δq = Z y + g that joints leave free.

In: variational equations. Out: the coordinates, selected so that one selection is valid for many
rows; their equations M ÿ + D ẏ + K y = load, with frequencies and mode shapes.

Source: coordinate partitioning, Wehage & Haug, J. Mech. Design 104 (1982) 247; static condensation,
Guyan, AIAA J. 3 (1965) 380.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import numerical_rank
from flexmb.analysis.effects.smooth_pieces import SlowAxes
from flexmb.analysis.effects.stored_motion import blocks
from flexmb.analysis.effects.variational_equations import VariationalEquations, spin, times
from flexmb.errors import FlexmbError
from flexmb.flexbody.arrays import Array, IntArray

_WORSE = 10.0  # largest motion of a dependent coordinate per unit of an independent one
# Powers of the preferences by which coordinates are selected: each is tried if by that before the
# motion of a dependent one over what joins it, a unit of an independent one, is more than _LARGE.
# Near a pose that is singular for rigid bodies only modes as dependent coordinates move little.
_POWERS, _LARGE = (1.0, 1.0 / 3.0, 0.0), 30.0
_LEAST_ROWS, _MOST_ROWS = 8, 64  # least rows with one selection; most rows solved together
_ROWS_OF_RANK = 8  # rows, about, in which motions without inertia are counted


class IndependentCoordinates(NamedTuple):
    """Motions Z (n, nu, d) per unit of y, and g (n, nu), which satisfies the constraints.

    The y are the coordinates `free`; the others, `dependent`, follow them.
    """

    Z: Array
    g: Array
    free: IntArray
    dependent: IntArray


def choose_coordinates(of: VariationalEquations, first: int, n: int) -> IndependentCoordinates:
    """Select coordinates at row `first`, for as many of the next n rows as they are suitable.

    Modes, and bodies that rotate little, are independent if possible, so that Z changes little with
    the motion.
    """
    _, rank, nu = of.Cq.shape
    dependent, free = _select(of.Cq[first], of.prefer)
    Z, g = np.zeros((n - first, nu, nu - rank)), np.zeros((n - first, nu))
    Z[:, free] = np.eye(nu - rank)
    limit, k, some = np.inf, first, _LEAST_ROWS
    while rank and k < n:
        own, some = slice(k, min(k + some, n)), min(2 * some, _MOST_ROWS)
        both = np.concatenate([of.Cq[own][:, :, free], of.C[own, :, None]], axis=2)
        solution = -np.linalg.solve(of.Cq[own][:, :, dependent], both)
        sizes = np.abs(solution[:, :, :-1]).max(axis=(1, 2), initial=1.0)
        limit = max(_WORSE * sizes[0], _WORSE) if k == first else limit
        large = np.flatnonzero(sizes > limit)
        large = large[large >= first + _LEAST_ROWS - k]
        end = k - first + (large[0] if large.size else len(solution))
        Z[k - first : end, dependent] = solution[: end - k + first, :, :-1]
        g[k - first : end, dependent] = solution[: end - k + first, :, -1]
        if large.size:
            return IndependentCoordinates(Z[:end], g[:end], free, dependent)
        k = own.stop
    return IndependentCoordinates(Z, g, free, dependent)


def _select(Cq: Array, prefer: Array) -> tuple[IntArray, IntArray]:
    """Dependent and independent coordinates for Cq (rank, nu) of one row."""
    from scipy.linalg import qr

    rank, nu = Cq.shape
    dependent, free = np.arange(0), np.arange(nu)
    for power in _POWERS if rank else ():
        order = qr(Cq * prefer**power, mode="r", pivoting=True)[1]
        dependent, free = order[:rank], np.sort(order[rank:])
        moved = np.abs(np.linalg.solve(Cq[:, dependent], Cq[:, free])).max(axis=0, initial=0.0)
        if np.all(moved <= _LARGE * np.fmax(1.0, np.linalg.norm(Cq[:, free], axis=0))):
            break
    return dependent, free


class IndependentMotions:
    """The equations for y of δq = Z y + g: M ÿ + D ẏ + K y = load.

    The y themselves have no rates in body axes. Motions of the coordinates `turning` have some: of
    the dependent ones, and of the vectors, which turn with the bodies.
    """

    def __init__(
        self, axes: SlowAxes, of: VariationalEquations, coordinates: IndependentCoordinates
    ) -> None:
        self.axes, self.of, (self.Z, self.g, free, dependent) = axes, of, coordinates
        vectors = [dependent, *of.frames.vectors()]
        self._turning = turning = np.unique(np.concatenate(vectors))
        own, moved = axes.among(turning), self.Z[:, turning]
        Zd = own.rate(moved)
        self._V1 = Zd + spin(of, moved, turning)
        self._twice, self._V1d = Zd + self._V1, own.rate(self._V1)
        n, _, d = self.Z.shape
        self.M, self.D, self.K = (np.zeros((n, d, d)) for _ in range(3))
        self.plain = None if of.friction is None else np.zeros((2, n, d, d))
        self.project = of.projection(self.Z)
        for part in blocks(n):
            tables, lead = [X[part] for X in (of.M, of.D, of.K)], self.Z[part][:, dependent]
            M, D = (X[:, :, turning] for X in tables[:2])
            inertia, damping, springs = (X[:, :, free] + X[:, :, dependent] @ lead for X in tables)
            damping += M @ self._twice[part]
            springs += M @ self._V1d[part] + D @ self._V1[part]
            for k, X in enumerate((springs, inertia, damping)):
                table, projected = (self.K, self.M, self.D)[k], X[:, free]
                projected = projected + lead.transpose(0, 2, 1) @ X[:, dependent]
                table[part] = projected if self.plain is None else self.project[part] @ X
                if self.plain is not None and k < 2:
                    self.plain[k][part] = projected
        rate = axes.rate(self.g)
        self.a0, self.a0d, load = offset(self, self.g, rate, axes.rate(rate))
        self.load = times(self.project, load)

    def mean(self, X: Array) -> Array:
        """Mean Zᵀ X Z."""
        return np.asarray(np.tensordot(self.Z, X @ self.Z, ((0, 1), (0, 1))) / len(self.Z))

    def modes(self, least: float, further: Array | None = None) -> tuple[Array, Array]:
        """Frequencies ω (d,), raised to `least`, and mode shapes (d, d) of the mean matrices.

        Friction by reactions is left out. `further` (nu, nu) is added to the mass.
        """
        both = (self.K, self.M) if self.plain is None else self.plain
        stiffness, mass = (X.mean(axis=0) for X in both)
        return mean_modes(stiffness, mass if further is None else mass + self.mean(further), least)

    def rank(self) -> int:
        """Least number of motions that have inertia, in some of the rows."""
        some = self.M[:: max(1, len(self.M) // _ROWS_OF_RANK)]
        sizes = np.linalg.svd(some, compute_uv=False)
        return min(map(numerical_rank, sizes))

    def coordinates(self, q: Array, v: Array, stiffness: Array) -> tuple[Array, Array]:
        """y and ẏ (d,) in the first row for displacements q and velocities v (nu,).

        If these violate the constraints, the difference is least in the metric M + stiffness.
        """
        W, turned = self.of.M[0] + stiffness, v - self.a0[0]
        close = np.linalg.solve(self.Z[0].T @ W @ self.Z[0], self.Z[0].T @ W)
        y = close @ (q - self.g[0])
        turned[self._turning] -= self._V1[0] @ y
        return y, close @ turned

    def place(self, y: Array) -> Array:
        """δq (nu,) in the first row, less g, or that of each column of y."""
        return np.asarray(self.Z[0] @ y)

    def motion(self, y: Array, yd: Array, ydd: Array) -> Array:
        """δq, δv and δv̇ (3, n, nu)."""
        return np.asarray(self.moved(y, yd, ydd) + [self.g, self.a0, self.a0d])

    def moved(self, y: Array, yd: Array, ydd: Array) -> Array:
        """`motion` without what y = 0 leaves."""
        made = np.array([times(self.Z, x) for x in (y, yd, ydd)])
        made[1][:, self._turning] += times(self._V1, y)
        made[2][:, self._turning] += times(self._twice, yd) + times(self._V1d, y)
        return made


class CondensedMotions:
    """Equations after static condensation of the modes, with shapes T (d, d), that `follow`.

    These modes have no inertia: they are in equilibrium with the loads and the motions of the
    others, z: y = W z + w. The rates of that equilibrium are differences over a time `span` [s], if
    it is given, since the shapes rotate with the bodies.
    """

    def __init__(
        self, within: IndependentMotions, T: Array, follow: NDArray[np.bool_], span: float
    ) -> None:
        self._within, axes, n = within, within.axes, len(within.Z)
        self._slow, self._follow = slow, fast = T[:, ~follow], T[:, follow]
        lead = np.zeros((n, fast.shape[1], slow.shape[1]))
        still = np.zeros((n, fast.shape[1]))
        for part in blocks(n):
            K, load = fast.T @ within.K[part], within.load[part] @ fast
            others = np.concatenate([K @ slow, -load[:, :, None]], axis=2)
            solution = -np.linalg.solve(K @ fast, others)
            lead[part], still[part] = solution[:, :, :-1], solution[:, :, -1]
        self.g = within.g + times(within.Z, still @ fast.T)
        if span == 0.0:
            once, rate = axes.pieces.rate(lead), axes.rate(self.g)
            twice, second = axes.pieces.rate(once), axes.rate(rate)
        else:
            flat = axes.pieces.slow_rates(lead.reshape(n, -1), span)
            once, twice = (rate.reshape(lead.shape) for rate in flat)
            rate, second = axes.slow_rates(self.g, span)
        self._lead = lead, once, twice
        self._a0, self._a0d, load = offset(within, self.g, rate, second)
        load = times(within.project, load)
        self.load = load @ slow + times(lead.transpose(0, 2, 1), load @ fast)
        self.M, self.D, self.K = (np.zeros((n, *2 * slow.shape[1:])) for _ in range(3))
        self._mean = np.zeros((2, *2 * slow.shape[1:]))
        for part in blocks(n):
            M, D, K = within.M[part], within.D[part], within.K[part]
            W, Wd, Wdd = slow + fast @ lead[part], fast @ once[part], fast @ twice[part]
            Wt = W.transpose(0, 2, 1)
            self.M[part], self.D[part] = Wt @ (M @ W), Wt @ (D @ W + 2.0 * (M @ Wd))
            self.K[part] = Wt @ (K @ W + D @ Wd + M @ Wdd)
            both = self.K[part], self.M[part]
            if within.plain is not None:
                both = Wt @ (within.plain[0][part] @ W), Wt @ (within.plain[1][part] @ W)
            self._mean += [X.sum(axis=0) / n for X in both]

    def modes(self, least: float) -> tuple[Array, Array]:
        """As `IndependentMotions.modes`."""
        return mean_modes(self._mean[0], self._mean[1], least)

    def place(self, z: Array) -> Array:
        """As `IndependentMotions.place`."""
        return self._within.place(self._slow @ z + self._follow @ (self._lead[0][0] @ z))

    def motion(self, z: Array, zd: Array, zdd: Array) -> Array:
        """δq, δv and δv̇ (3, n, nu)."""
        lead, once, twice = self._lead
        follows = (
            times(lead, z),
            times(lead, zd) + times(once, z),
            times(lead, zdd) + 2.0 * times(once, zd) + times(twice, z),
        )
        slow = (x @ self._slow.T for x in (z, zd, zdd))
        ys = (x + y @ self._follow.T for x, y in zip(slow, follows, strict=True))
        return np.asarray(self._within.moved(*ys) + [self.g, self._a0, self._a0d])


def offset(
    motions: IndependentMotions, g: Array, rate: Array, second: Array
) -> tuple[Array, Array, Array]:
    """δv, δv̇ and load (n, nu) of δq = g with these derivatives."""
    of, axes = motions.of, motions.axes
    turned = times(of.Omega, g)
    a0, a0d = rate + turned, second + axes.rate(turned)
    return a0, a0d, -(of.F + times(of.M, a0d) + times(of.D, a0) + times(of.K, g))


def mean_modes(stiffness: Array, mass: Array, least: float) -> tuple[Array, Array]:
    """Frequencies ω (d,), raised to `least`, and mode shapes (d, d)."""
    from scipy.linalg import eigh

    try:
        squares, T = eigh(*(0.5 * (X + X.T) for X in (stiffness, mass)))
    except np.linalg.LinAlgError:
        what = "the motions about the computed one have no inertia in the mean"
        more = "the rows of the run are too far apart for them; ask for more outputs"
        raise FlexmbError(f"{what}: {more}") from None
    return np.maximum(np.sqrt(np.abs(squares)), least), T
