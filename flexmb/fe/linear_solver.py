"""Solving with a sparse symmetric positive definite matrix, behind one small interface.

:func:`factor` returns a :class:`Factor` that solves for one or many right sides. SuperLU takes
models of a few thousand unknowns; larger ones go to the multifrontal Cholesky factorisation, or to
PARDISO if pypardiso is installed (``pip install flexmb[mkl]``; at 92 000 unknowns on one core 8.9 s
against 7 s of the multifrontal factorisation, faster on many cores). A stiffness matrix with a free
motion (zero stiffness) is refused, and the error names the part that moves. The softest motion is
found by inverse iteration on the matrix scaled to a unit diagonal, and its stiffness is computed
with the unfactorised matrix: for a free motion rounding leaves 1e-16, while a cantilever of 2000
beam elements still has 3e-14. Elimination without pivoting is stable for positive definite
matrices: residuals are at rounding level of abs(K) abs(x), so refinement would add nothing.

:func:`require_memory` refuses work that cannot fit before it starts. The free memory is what psutil
reports as available, or what the control groups of the process leave (Linux; psutil does not know
them), whichever is less. The environment variable FLEXMB_MEMORY ("6 GB") lowers the limit.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array, csr_matrix, diags_array, triu
from scipy.sparse.linalg import splu

from flexmb.errors import Problem, ReductionError
from flexmb.fe.dissection import dissect, matrix_graph
from flexmb.fe.multifrontal import Fronts, Multifrontal, NotPositive, fronts
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.progress import Progress, silent
from flexmb.units import say_place

# added to the unit diagonal of a matrix without factors, so that its free motions can be found
SHIFT = 1e-10
_SINGULAR = 2e-15  # a motion whose stiffness relative to the diagonal is below this is free
# an unknown takes part in a free motion from this fraction of its largest entry on
_MOVING_SHARE = 1e-4


class SingularMatrix(ReductionError):
    """A part of the model is not supported; ``dofs`` are its unknowns (rows of the matrix)."""

    dofs: IntArray = np.zeros(0, dtype=int)


def stiffness_scale(K: csr_array) -> FloatArray:
    """(n,) factors that give the matrix a unit diagonal.

    Raises
    ------
    SingularMatrix
        An entry of the diagonal is not positive; ``dofs`` are these rows.
    """
    diagonal = K.diagonal()
    bad = np.flatnonzero(~(diagonal > 0))
    if len(bad):
        what = f"{len(bad)} degrees of freedom without stiffness, the first is number {bad[0]}"
        raise _error(f"the stiffness matrix has {what}", bad)
    return 1.0 / np.sqrt(diagonal)


def softest(
    K: csr_array, solve: Callable[[FloatArray], FloatArray], steps: int = 2
) -> tuple[float, FloatArray]:
    """The smallest stiffness relative to the diagonal, and the motion (n,) with it, approximately.

    Parameters
    ----------
    K : (n, n) sparse
        Stiffness.
    solve : callable
        Solution with K, or with K and a small shift.
    steps : int
        Inverse iterations.
    """
    scale = stiffness_scale(K)
    z = np.cos(np.arange(len(scale)))
    for _ in range(steps):
        z = solve(z / scale) / scale
        z /= np.abs(z).max()
    x = scale * z
    return float(x @ (K @ x) / (z @ z)), x


def require_stiff(
    K: csr_array, solve: Callable[[FloatArray], FloatArray], points: FloatArray | None = None
) -> None:
    """Refuse a matrix with a free motion; ``points`` (n, 3) are the positions of its unknowns.

    Raises
    ------
    SingularMatrix
        Names the part that moves.
    """
    quotient, x = softest(K, solve)
    if not quotient > _SINGULAR:
        raise free_part_error(K, x, points)


def free_part_error(
    K: csr_array, motion: FloatArray, points: FloatArray | None = None
) -> SingularMatrix:
    """The error that names the nodes that move in a motion without stiffness.

    Parameters
    ----------
    K : (n, n) sparse
        Stiffness.
    motion : (n,) float
        A vector that K takes to zero, such as that of :func:`softest`.
    points : (n, 3) float, optional
        Position of each unknown [m].
    """
    size = np.abs(motion / stiffness_scale(K))
    dofs = np.flatnonzero(size > _MOVING_SHARE * size.max())
    if points is None:
        part = f"{len(dofs)} of {len(size)} unknowns move, the first is number {dofs[0]}"
    else:
        nodes = np.unique(points[dofs], axis=0)
        ends = nodes.min(axis=0), nodes.max(axis=0)
        low, high = map(say_place, ends)
        part = f"its {len(nodes)} nodes lie between {low} and {high}"
    return _error(
        "the stiffness matrix with all interfaces held is singular: a part moves freely "
        f"({part}); hold it by an interface, connect it to the rest by more nodes, or make it less "
        "stiff relative to its support: a ratio beyond 1e12 is lost in rounding",
        dofs,
    )


def _error(text: str, dofs: IntArray) -> SingularMatrix:
    error = SingularMatrix(text)
    error.dofs = dofs
    return error


class SuperLU:
    """The factors L and U of the scaled matrix.

    Raises
    ------
    NotPositive
        The matrix is not positive definite.
    """

    def __init__(self, K: csr_array, scale: FloatArray) -> None:
        scaled = K.multiply(scale[:, None]).multiply(scale[None, :]).tocsc()
        try:
            self._lu = splu(scaled, permc_spec="COLAMD", diag_pivot_thresh=0.0)
        except RuntimeError as error:  # a pivot is exactly zero
            raise NotPositive(-1) from error
        pivots = self._lu.U.diagonal()
        worst = int(pivots.argmin())
        if not pivots[worst] > 0:
            raise NotPositive(int(np.flatnonzero(self._lu.perm_c == worst)[0]))
        self._scale = scale
        self.nnz = int(self._lu.nnz)

    def solve(self, b: FloatArray) -> FloatArray:
        """Solution for ``b`` of shape (n,) or (n, k)."""
        scale = self._scale if b.ndim == 1 else self._scale[:, None]
        return scale * self._lu.solve(np.ascontiguousarray(scale * b))


try:
    import pypardiso
except ImportError:
    pypardiso = None


PARDISO_INSTALLED = pypardiso is not None
"""Whether pypardiso is installed."""

# PARDISO's matrix type "symmetric positive definite"; it reads the upper triangle
_POSITIVE_DEFINITE = 2
_ANALYSE, _FACTOR, _SOLVE = 11, 22, 33  # PARDISO's numbers of its phases
_REFINEMENT, _PERMANENT, _WORK, _NNZ = 8, 16, 17, 18  # indices of PARDISO's parameters, from 1
_NOT_POSITIVE = "-4"


class Pardiso:
    """The factors of a matrix, kept by MKL.

    Parameters
    ----------
    K : (n, n) sparse
        Symmetric positive definite; both triangles are stored.
    progress : Progress
        Called with the phases ``"order"`` and ``"factor"``.

    Raises
    ------
    NotPositive
        The matrix is not positive definite.
    ReductionError
        The factors do not fit into memory.
    """

    def __init__(self, K: csr_array, progress: Progress = silent) -> None:
        self._matrix = csr_matrix(triu(K, format="csr"))
        self._solver = pypardiso.PyPardisoSolver(mtype=_POSITIVE_DEFINITE)
        self._solver.set_iparm(_REFINEMENT, 0)
        nothing = np.zeros((K.shape[0], 1), order="F")
        progress("order", 0.0, f"{K.shape[0]} unknowns")
        self._call(_ANALYSE, nothing)
        progress("order", 1.0)
        self.nnz = int(self._solver.get_iparm(_NNZ))
        kilobytes = self._solver.get_iparm(_PERMANENT) + self._solver.get_iparm(_WORK)
        what = f"the factorisation of {K.shape[0]} unknowns ({self.nnz:.2g} entries)"
        require_memory(1024.0 * kilobytes, what)
        progress("factor", 0.0, f"{K.shape[0]} unknowns, {self.nnz:.3g} entries")
        self._call(_FACTOR, nothing)

    def __del__(self) -> None:
        solver = getattr(self, "_solver", None)
        if solver is not None:
            solver.free_memory(everything=True)

    def solve(self, b: FloatArray) -> FloatArray:
        """Solution for ``b`` of shape (n,) or (n, k)."""
        return self._call(_SOLVE, np.asfortranarray(b.reshape(len(b), -1))).reshape(b.shape)

    def _call(self, phase: int, b: FloatArray) -> FloatArray:
        self._solver.set_phase(phase)
        try:
            return self._solver._call_pardiso(self._matrix, b)
        except pypardiso.pardiso_wrapper.PyPardisoError as error:
            if str(error.value) == _NOT_POSITIVE:
                raise NotPositive(-1) from error
            raise


# up to this number of unknowns SuperLU is as fast as the multifrontal factorisation
_MAX_SUPERLU = 5000


class Factor(Protocol):
    """A factorised matrix."""

    nnz: int  # entries of the factors

    def solve(self, b: FloatArray) -> FloatArray:
        """Solution for ``b`` of shape (n,) or (n, k)."""
        ...


Compute = Callable[[csr_array], Factor]


def factor(K: csr_array, points: FloatArray | None = None, progress: Progress = silent) -> Factor:
    """Factorise a sparse symmetric positive definite matrix.

    Parameters
    ----------
    K : (n, n) sparse
        Stiffness, both triangles.
    points : (n, 3) float, optional
        Position of the node of each unknown: a better order of elimination, and errors that say
        where.
    progress : Progress
        Called with the phases ``"order"`` and ``"factor"``.

    Raises
    ------
    SingularMatrix
        A part of the model moves freely: it is held neither by elements nor by an interface.
    ReductionError
        The matrix is not positive definite, or its factors do not fit into memory.
    """
    K = _canonical(K)
    scale = stiffness_scale(K)
    compute: Compute
    if K.shape[0] <= _MAX_SUPERLU:
        compute = partial(SuperLU, scale=scale)
    elif PARDISO_INSTALLED:
        compute = partial(Pardiso, progress=progress)
    else:
        compute = _large(K, points, progress)
    factors = None
    # the exception is dropped at once, with the memory that its traceback refers to
    with suppress(NotPositive):
        factors = compute(K)
    if factors is None:
        raise _why(K, compute, points)
    require_stiff(K, factors.solve, points)
    progress("factor", 1.0)
    return factors


def _canonical(K: csr_array) -> csr_array:
    """The matrix with one stored entry for each position."""
    K = csr_array(K)
    if not K.has_canonical_format:
        K = K.copy()
        K.sum_duplicates()
    return K


def _large(K: csr_array, points: FloatArray | None, progress: Progress) -> Compute:
    plan = _plan(K, points, progress)
    return lambda matrix: Multifrontal(matrix, plan, progress)


def _plan(K: csr_array, points: FloatArray | None, progress: Progress) -> Fronts:
    progress("order", 0.0, f"{K.shape[0]} unknowns")
    graph = matrix_graph(K, points)
    progress("order", 0.4)
    plan = fronts(graph, dissect(graph))
    progress("order", 1.0)
    what = f"the factorisation of {K.shape[0]} unknowns ({plan.nnz:.2g} entries)"
    require_memory(plan.memory, what)
    return plan


def _why(K: csr_array, compute: Compute, points: FloatArray | None) -> ReductionError:
    """The error for a matrix without factors: names the free part, or the negative stiffness.

    A small stiffness added to the diagonal makes the matrix definite if it only has free motions.
    """
    try:
        shifted = compute(K + SHIFT * diags_array(K.diagonal()))
    except NotPositive as worse:
        return ReductionError(f"the stiffness matrix is not positive definite{_at(worse, points)}")
    return free_part_error(K, softest(K, shifted.solve, 4)[1], points)


def _at(error: NotPositive, points: FloatArray | None) -> str:
    if error.index < 0:
        return ""
    what = f": degree of freedom {error.index}"
    if points is not None:
        what += f" at {say_place(points[error.index])}"
    return f"{what} has a negative stiffness"


_VARIABLE = "FLEXMB_MEMORY"
_UNITS = {"": 1.0, "KB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}


_COARSER = (
    "take a coarser mesh (half the nodes of a solid need about 40 % of it), shells or beams where "
    "the body is thin, or a machine with more memory"
)


def require_memory(needed: float, what: str, cure: str = _COARSER) -> None:
    """Refuse work that takes more memory than there is.

    Parameters
    ----------
    needed : float
        Bytes.
    what : str
        Name of the work, as subject of the sentence.
    cure : str
        What to do, end of the sentence.

    Raises
    ------
    ReductionError
        Both figures, and what to do.
    """
    free, limit = available_memory(), _own_limit()
    least = free if limit is None else min(free, limit)
    if needed <= least:
        return
    source = f"{_VARIABLE} allows" if least == limit else "this machine has free"
    raise ReductionError(
        f"memory: {what} needs about {_text(needed)}, {source} {_text(least)}; {cure}"
    )


def available_memory() -> float:
    """Bytes that this process may still allocate: limits of the machine and of its control
    groups."""
    import psutil

    limits = [float(psutil.virtual_memory().available)]
    if sys.platform == "linux":
        limits += _cgroups(Path("/proc/self/cgroup"), Path("/sys/fs/cgroup"))
    return min(limits)


def _own_limit() -> float | None:
    text = os.environ.get(_VARIABLE, "").strip()
    if not text:
        return None
    match = re.fullmatch(r"([0-9.]+(?:e[0-9]+)?) *([KMGT]B|)", text, re.IGNORECASE)
    try:
        assert match is not None
        return float(match[1]) * _UNITS[match[2].upper()]
    except (AssertionError, ValueError):
        what = f'must be a size such as "6 GB", given "{text}"'
        raise ReductionError.from_problems([Problem(_VARIABLE, what)]) from None


def _cgroups(path: Path, root: Path) -> list[float]:
    """Free bytes of each control group that this process belongs to, of versions 2 and 1.

    ``path`` lists the groups of the process, ``root`` is where they are mounted.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
    limits: list[float] = []
    for line in lines:
        _, controllers, group = line.split(":", 2)
        if not controllers:
            limits += _left(root, group, "memory.max", "memory.current", "inactive_file")
        elif "memory" in controllers.split(","):
            names = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
            limits += _left(root / "memory", group, *names)
    return limits


def _left(root: Path, path: str, limit: str, usage: str, cache: str) -> list[float]:
    """Limit less usage of a control group and of all above it [bytes]; file cache counts as
    free."""
    here = root / path.strip("/")
    limits: list[float] = []
    for folder in (here, *here.parents):
        if not folder.is_relative_to(root):
            break
        try:
            # a group without a limit has the text "max", which is no number
            most = float((folder / limit).read_text(encoding="utf-8"))
            used = float((folder / usage).read_text(encoding="utf-8"))
            rows = (folder / "memory.stat").read_text(encoding="utf-8").splitlines()
            cached = next((float(row.split()[1]) for row in rows if row.startswith(cache)), 0.0)
        except (OSError, ValueError):
            continue
        limits.append(most - used + cached)
    return limits


def _text(size: float) -> str:
    for unit in ("TB", "GB"):
        if size >= 0.1 * _UNITS[unit]:
            return f"{size / _UNITS[unit]:.2g} {unit}"
    return f"{size / 1e6:.2g} MB"
