"""A model with all its interfaces held: the one factorisation that every method shares.

In: a finite-element model and its interfaces. Out: :class:`Held`, which answers with the static
response to loads on the held body, the constraint modes (unit motion of one interface, the others
held), the lowest fixed-interface modes, and the static response of the free body to loads without
resultant. Degrees of freedom of rigid interfaces are eliminated, the means of weighted ones are
bordered, so rigid and weighted interfaces mix. With Psi the constraint modes and H the response of
the held body, the free body's is Psi q + H f with Psi^T K Psi q = Psi^T f, one interface at rest.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve, eigh, null_space
from scipy.sparse import csr_array

from flexmb.errors import ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.interfaces.make import ModelInterface
from flexmb.fe.interfaces.rigid import RigidInterface
from flexmb.fe.interfaces.weighted import WeightedInterface
from flexmb.fe.reduction.bordered import Bordered
from flexmb.fe.reduction.eigen import lowest_modes, start_vector
from flexmb.fe.reduction.loose import loose_part
from flexmb.fe.reduction.mass import held_mass_solve
from flexmb.fe.solver.singular import SingularMatrix
from flexmb.flexbody.arrays import FloatArray
from flexmb.progress import Progress, silent

__all__ = ["Held"]

_MASSLESS = 1e-12  # relative; 1 / omega^2 of a motion without mass is rounding
_DENSE = 300  # below this many interior degrees of freedom full matrices are faster


class Held:
    """A model with its interfaces held.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    interfaces : tuple of RigidInterface or WeightedInterface
        At least one.
    directions : tuple of int
        Motions of an interface that exist, of six; the others are held for good.
    progress : Progress
        Told the phases ``"order"`` and ``"factor"``.

    Raises
    ------
    ReductionError
        No interface, or a part of the mesh that can move freely with all interfaces held.
    """

    def __init__(
        self,
        fe: FEMatrices,
        interfaces: tuple[ModelInterface, ...],
        directions: tuple[int, ...],
        progress: Progress = silent,
    ) -> None:
        if not interfaces:
            raise ReductionError("interfaces: at least one is needed to hold the body")
        self.fe, self.interfaces, self.directions = fe, interfaces, directions
        rigid = [part for part in interfaces if isinstance(part, RigidInterface)]
        self._b = np.concatenate([np.zeros(0, int), *(part.dofs for part in rigid)])
        self.dofs = np.setdiff1d(np.arange(fe.numbering.n), self._b)
        self.M = self._inner(fe.M)
        self._W = self._means()
        R = np.zeros((len(self.dofs), 0)) if rigid else fe.rigid
        points = fe.dof_points[self.dofs]
        try:
            self._bordered = Bordered(self._inner(fe.K), self._W, R, points, progress)
        except SingularMatrix as error:
            raise ReductionError(loose_part(fe, self.dofs[error.dofs])) from error
        self._motion = self._interface_motion()
        self.modes = self._constraint_modes()
        K = self.modes.T @ (fe.K @ self.modes)
        self.K_modes = 0.5 * (K + K.T)

    @property
    def count(self) -> int:
        """How many fixed-interface modes there are."""
        return len(self.dofs) - self._W.shape[0]

    def solve(self, f: FloatArray) -> FloatArray:
        """(n, ...) response of the held body to loads f (n, ...)."""
        u = np.zeros_like(f)
        u[self.dofs] = self._bordered.solve(f[self.dofs])
        return u

    def free(self, f: FloatArray) -> FloatArray:
        """(n, ...) response of the free body to loads f (n, ...) that have no resultant.

        The first interface stays where it is: take the rigid motion out, or leave it.
        """
        d = len(self.directions)
        q = np.zeros((self.modes.shape[1], *f.shape[1:]))
        if len(q) > d:
            scale = 1.0 / np.sqrt(np.diag(self.K_modes)[d:])
            small = cho_factor(scale[:, None] * self.K_modes[d:, d:] * scale)
            across = scale if f.ndim == 1 else scale[:, None]
            q[d:] = across * cho_solve(small, across * (self.modes.T @ f)[d:])
        return self.modes @ q + self.solve(f)

    def loads(self) -> FloatArray:
        """(n, c) unit forces and moments on the motions of all interfaces."""
        F = np.zeros((self.fe.numbering.n, self.modes.shape[1]))
        d = len(self.directions)
        for k, interface in enumerate(self.interfaces):
            dofs, values = interface.loads()
            F[dofs, d * k : d * (k + 1)] = values[:, self.directions]
        return F

    def lowest(self, count: int, progress: Progress = silent) -> tuple[FloatArray, FloatArray]:
        """The lowest fixed-interface modes over the held body's own degrees of freedom."""
        if len(self.dofs) <= _DENSE or 2 * count >= self.count:
            return self._dense(count)
        start = self._bordered.solve(start_vector(len(self.dofs)))
        return lowest_modes(self.M, self._bordered.solve, count, progress, start)

    def mass_solve(self, B: FloatArray) -> FloatArray:
        """(k, ...) inverse of the held body's mass times B (k, ...), the means held too."""
        return held_mass_solve(self.M, self._W, B)

    def fields(self) -> FloatArray:
        """(n, x) all independent fields of the tied model, full: for small models alone."""
        inner = np.zeros((self.fe.numbering.n, self.count))
        N = null_space(self._W.toarray()) if self._W.shape[0] else np.eye(len(self.dofs))
        inner[self.dofs] = N
        return np.concatenate([self.modes, inner], axis=1)

    def _dense(self, count: int) -> tuple[FloatArray, FloatArray]:
        """The same from full matrices, fewer where motions have no mass; the means are at rest."""
        if count == 0:
            return np.zeros(0), np.zeros((len(self.dofs), 0))
        K, M = self._inner(self.fe.K).toarray(), self.M.toarray()
        N = null_space(self._W.toarray()) if self._W.shape[0] else np.eye(len(K))
        K, M = N.T @ K @ N, N.T @ M @ N
        try:
            omega2, V = eigh(K, M, subset_by_index=[0, count - 1])
        except np.linalg.LinAlgError:  # some motions have no mass: by 1 / omega^2
            sigma, V = eigh(M, K, subset_by_index=[len(K) - count, len(K) - 1])
            massive = sigma > _MASSLESS * sigma[-1]
            sigma, V = sigma[massive], V[:, massive]
            omega2, V = 1.0 / sigma[::-1], (V / np.sqrt(sigma))[:, ::-1]
        return omega2, N @ V

    def _means(self) -> csr_array:
        rows = [part for part in self.interfaces if isinstance(part, WeightedInterface)]
        values = np.concatenate([np.zeros(0), *(part.W.ravel() for part in rows)])
        dofs = np.concatenate([np.zeros(0, int), *(np.tile(part.dofs, 6) for part in rows)])
        at = [np.repeat(6 * k + np.arange(6), len(part.dofs)) for k, part in enumerate(rows)]
        numbers = np.concatenate([np.zeros(0, int), *at])
        columns = np.searchsorted(self.dofs, dofs)
        return csr_array((values, (numbers, columns)), shape=(6 * len(rows), len(self.dofs)))

    def _interface_motion(self) -> tuple[FloatArray, FloatArray]:
        """Motion of the eliminated degrees of freedom and of the means per interface motion."""
        chosen, d = list(self.directions), len(self.directions)
        rigid, means = [], []
        for part in self.interfaces:
            held = isinstance(part, RigidInterface)
            rigid.append(part.T[:, chosen] if held else np.zeros((0, d)))
            means.append(np.zeros((0, d)) if held else np.eye(6)[:, chosen])
        return block_diag(*rigid), block_diag(*means)

    def _inner(self, matrix: csr_array) -> csr_array:
        """The part of a matrix (n, n) over the held body's own degrees of freedom."""
        if not len(self._b):
            return matrix
        return csr_array(matrix[self.dofs][:, self.dofs])

    def _constraint_modes(self) -> FloatArray:
        K_ib = self.fe.K[self._b][:, self.dofs].T
        T, g = self._motion
        modes = np.zeros((self.fe.numbering.n, T.shape[1]))
        modes[self._b] = T
        modes[self.dofs] = self._bordered.solve(-(K_ib @ T), g)
        return modes
