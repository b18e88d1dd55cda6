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
from flexmb.flexbody.arrays import Array

_WORSE = 10.0  # largest motion of a dependent coordinate per unit of an independent one
_LEAST_ROWS, _MOST_ROWS = 8, 64  # least rows with one selection; most rows solved together
_ROWS_OF_RANK = 8  # rows, about, in which motions without inertia are counted


class IndependentCoordinates(NamedTuple):
    """Motions Z (n, nu, d) per unit of y, and g (n, nu), which satisfies the constraints."""

    Z: Array
    g: Array


def choose_coordinates(of: VariationalEquations, first: int, n: int) -> IndependentCoordinates:
    """Select coordinates at row `first`, for as many of the next n rows as they are suitable.

    Modes, and bodies that rotate little, are independent if possible, so that Z changes little with
    the motion.
    """
    from scipy.linalg import qr

    _, rank, nu = of.Cq.shape
    order = qr(of.Cq[first] * of.prefer, mode="r", pivoting=True)[1] if rank else np.arange(nu)
    dependent, free = order[:rank], np.sort(order[rank:])
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
            return IndependentCoordinates(Z[:end], g[:end])
        k = own.stop
    return IndependentCoordinates(Z, g)


class IndependentMotions:
    """The equations for y of δq = Z y + g: M ÿ + D ẏ + K y = load.

    `rates` are first and second derivatives of Z, and of g, if splines are not accurate enough.
    """

    def __init__(
        self, axes: SlowAxes, of: VariationalEquations, Z: Array, g: Array,
        rates: tuple[tuple[Array, Array], tuple[Array, Array]] | None = None,
    ) -> None:  # fmt: skip
        self._axes, self._of, self.Z, self.g = axes, of, Z, g
        if rates is None:
            self.Zd, rate = axes.rate(Z), axes.rate(g)
            self.V1 = self.Zd + spin(of, Z)
            self.V1d, second = axes.rate(self.V1), axes.rate(rate)
        else:
            (self.Zd, Zdd), (rate, second) = rates
            self.V1 = self.Zd + spin(of, Z)
            self.V1d = Zdd + axes.rate_of_spin(of.Omega) @ Z + spin(of, self.Zd)
        turned = times(of.Omega, g)
        self.a0, self.a0d = rate + turned, second + axes.rate(turned)
        n, _, d = Z.shape
        self.M, self.D, self.K = (np.zeros((n, d, d)) for _ in range(3))
        project, self._mean = of.projection(Z), np.zeros((2, d, d))
        for part in blocks(n):
            Zt, M, D, V1 = project[part], of.M[part], of.D[part], self.V1[part]
            inertia, springs = M @ Z[part], M @ self.V1d[part] + D @ V1 + of.K[part] @ Z[part]
            self.M[part], self.K[part] = Zt @ inertia, Zt @ springs
            self.D[part] = Zt @ (M @ (self.Zd[part] + V1) + D @ Z[part])
            if of.friction is not None:
                Zt = Z[part].transpose(0, 2, 1)
                self._mean += [(Zt @ X).sum(axis=0) / n for X in (springs, inertia)]
        if of.friction is None:
            self._mean[:] = self.K.mean(axis=0), self.M.mean(axis=0)
        force = of.F + times(of.M, self.a0d) + times(of.D, self.a0) + times(of.K, g)
        self.load = -times(project, force)

    def mean(self, X: Array) -> Array:
        """Mean Zᵀ X Z."""
        return np.asarray(np.tensordot(self.Z, X @ self.Z, ((0, 1), (0, 1))) / len(self.Z))

    def modes(self, least: float, further: Array | None = None) -> tuple[Array, Array]:
        """Frequencies ω (d,), raised to `least`, and mode shapes (d, d) of the mean matrices.

        Friction by reactions is left out. `further` (nu, nu) is added to the mass.
        """
        from scipy.linalg import eigh

        stiffness, mass = (0.5 * (X + X.T) for X in self._mean)
        try:
            squares, T = eigh(stiffness, mass if further is None else mass + self.mean(further))
        except np.linalg.LinAlgError:
            what = "the motions about the computed one have no inertia in the mean"
            more = "the rows of the run are too far apart for them; ask for more outputs"
            raise FlexmbError(f"{what}: {more}") from None
        return np.maximum(np.sqrt(np.abs(squares)), least), T

    def rank(self) -> int:
        """Least number of motions that have inertia, in some of the rows."""
        some = self.M[:: max(1, len(self.M) // _ROWS_OF_RANK)]
        sizes = np.linalg.svd(some, compute_uv=False)
        return min(map(numerical_rank, sizes))

    def coordinates(self, q: Array, v: Array, stiffness: Array) -> tuple[Array, Array]:
        """y and ẏ (d,) in the first row for displacements q and velocities v (nu,).

        If these violate the constraints, the difference is least in the metric M + stiffness.
        """
        W = self._of.M[0] + stiffness
        close = np.linalg.solve(self.Z[0].T @ W @ self.Z[0], self.Z[0].T @ W)
        y = close @ (q - self.g[0])
        return y, close @ (v - self.V1[0] @ y - self.a0[0])

    def condensed(self, T: Array, follow: NDArray[np.bool_], span: float) -> IndependentMotions:
        """Equations after static condensation of the modes, with shapes T (d, d), that `follow`.

        These modes have no inertia: they are in equilibrium with the loads and the motions of the
        others. The rates of that equilibrium are differences over a time `span` [s], if it is
        given, since the shapes rotate with the bodies.
        """
        K, load = T.T @ self.K @ T, self.load @ T
        others = np.concatenate([K[:, follow][:, :, ~follow], -load[:, follow, None]], axis=2)
        lead = -np.linalg.solve(K[:, follow][:, :, follow], others)
        X = self.Z @ T
        g = self.g + times(X[:, :, follow], lead[:, :, -1])
        lead = lead[:, :, :-1]
        Z = X[:, :, ~follow] + X[:, :, follow] @ lead
        if span == 0.0:
            return IndependentMotions(self._axes, self._of, Z, g)
        Xd = self._axes.rate(X)
        Xdd = self._axes.rate(Xd)
        flat = self._axes.pieces.slow_rates(lead.reshape(len(lead), -1), span)
        once, twice = (rate.reshape(lead.shape) for rate in flat)
        first = Xd[:, :, ~follow] + Xd[:, :, follow] @ lead + X[:, :, follow] @ once
        second = Xdd[:, :, ~follow] + Xdd[:, :, follow] @ lead + X[:, :, follow] @ twice
        second += 2.0 * Xd[:, :, follow] @ once
        rates = (first, second), self._axes.slow_rates(g, span)
        return IndependentMotions(self._axes, self._of, Z, g, rates)

    def motion(self, y: Array, yd: Array, ydd: Array) -> Array:
        """δq, δv and δv̇ (3, n, nu)."""
        dvd = times(self.Z, ydd) + times(self.Zd + self.V1, yd) + times(self.V1d, y) + self.a0d
        dv = times(self.Z, yd) + times(self.V1, y) + self.a0
        return np.array([times(self.Z, y) + self.g, dv, dvd])
