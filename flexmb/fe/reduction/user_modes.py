"""User modes: displacement fields from a measurement, another program, or a model of the user.

In: fields over the degrees of freedom or over the nodes of the mesh, from Python or an .npz file.
Out: a basis of the rigid motions and these modes without their rigid part. Refused are wrong
shapes, numbers that are not finite, modes that are rigid motions, modes that depend on others, and
modes in which the nodes of a rigid interface do not move rigidly.
"""

from __future__ import annotations

import os
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import FlexmbWarning, Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface, RigidInterface
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.eigenmodes import SymmetryPlane
from flexmb.fe.reduction.inertia_relief import InertiaRelief, load_columns
from flexmb.fe.reduction.reduced_basis import ReducedBasis, directions_of
from flexmb.flexbody.arrays import FloatArray
from flexmb.progress import Progress, silent

# share of the kinetic energy without the rigid part below which a mode is a rigid motion
_RIGID_ENERGY = 1e-10
_RIGID_WARNING = 1e-6  # rigid share of the kinetic energy above which a warning is given
# independent share of the kinetic energy below which a mode depends on the others
_DEPENDENT_ENERGY = 1e-8
# relative to the largest displacement: allowed deviation of a rigid interface's nodes from rigid
# motion
_MAX_DEVIATION = 1e-6
_MAX_OUT_OF_PLANE = (
    1e-6  # largest out-of-plane share of the kinetic energy of a planar body's modes
)

UserModesLike = str | os.PathLike[str] | np.ndarray


def read_user_modes(source: UserModesLike, length: float = 1.0) -> FloatArray:
    """The array of modes: ``source`` itself, or the only array of an .npz file, or that named
    ``modes``.

    Parameters
    ----------
    source : array or path
        (n, k), (nodes, 3, k) or (nodes, 6, k).
    length : float
        Displacements are multiplied by it: the mesh's unit of length in metres.

    Raises
    ------
    ReductionError
        No such file, no single array in it, or values that are not numbers.
    """
    values = source if isinstance(source, np.ndarray) else _from_file(Path(source))
    try:
        modes = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ReductionError(f"modes: the array is not of real numbers: {error}") from error
    if modes.ndim == 3:
        modes[:, :3] *= length
    return modes


def user_modes(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...],
    modes: UserModesLike,
    progress: Progress = silent,
    mirror: SymmetryPlane | None = None,
    loads: tuple[LoadPattern, ...] = (),
    residual: str = "none",
) -> ReducedBasis:
    """A basis of the rigid motions and the user's modes.

    Parameters
    ----------
    fe, progress
        As for :func:`flexmb.fe.craig_bampton`.
    interfaces : tuple of RigidInterface or WeightedInterface
        Their points follow the modes; there may be none.
    modes : array or path
        (n, k) over the degrees of freedom [m, rad], or (nodes, 3, k) or (nodes, 6, k) over all
        nodes of the mesh in its order; scale is free.
    mirror : SymmetryPlane, optional
        Modes must be symmetric about its plane.
    loads : tuple of LoadPattern
        Loads of the body; none may have ``residual``, since residual vectors belong to the other
        methods.
    residual : str
        Must be ``"none"``.

    Raises
    ------
    ReductionError
        Everything that is wrong with the modes.
    """
    if load_columns(fe, loads).shape[1]:
        names = ", ".join(load.name for load in loads if load.residual)
        what = f"user modes take no residual vectors ({names}): say residual = false"
        raise ReductionError.from_problems([Problem("loads", what)])
    if residual != "none":
        what = f'user modes take no residual vectors: leave out "{residual}", or add them to modes'
        raise ReductionError.from_problems([Problem("residual", what)])
    V = _over_dofs(fe, read_user_modes(modes))
    directions = directions_of(mirror)
    R = fe.rigid[:, directions]
    V = _elastic(fe, InertiaRelief(fe.M, R), V)
    _check_independent(fe, V)
    _check_rigid_interfaces(fe, interfaces, V)
    if mirror is not None:
        _check_plane(fe, mirror, V)
    basis = np.concatenate([R, V], axis=1)
    K, M = basis.T @ (fe.K @ basis), basis.T @ (fe.M @ basis)
    r, k = R.shape[1], basis.shape[1]
    K[:r], K[:, :r] = 0.0, 0.0
    motion = np.zeros((len(interfaces), 6, k))
    for number, interface in enumerate(interfaces):
        motion[number, directions] = interface.motion(basis)[list(directions)]
    _warn_unmoved(interfaces, motion[:, :, r:])
    progress("modes", 1.0)
    labels = ("rigid",) * r + tuple(f"user {number + 1}" for number in range(k - r))
    kinds = ("rigid",) * r + ("user",) * (k - r)
    K, M = 0.5 * (K + K.T), 0.5 * (M + M.T)
    return ReducedBasis(
        basis, K, M, np.eye(k)[:, :r], motion, interfaces, labels, kinds, directions, loads
    )


def _from_file(path: Path) -> Any:
    try:
        stored = np.load(path, allow_pickle=False)
        if isinstance(stored, np.ndarray):
            raise ReductionError(f"modes: {path} is no .npz file: write it with numpy.savez")
        with stored:
            names = tuple(stored.files)
            name = "modes" if "modes" in names or len(names) != 1 else names[0]
            if name not in names:
                problem = Problem("modes", f'{path} has no array "modes"', names)
                raise ReductionError.from_problems([problem])
            return stored[name]
    except OSError as error:
        raise ReductionError(f"modes: {path} cannot be read: {error.strerror or error}") from error
    except (EOFError, ValueError, zipfile.BadZipFile) as error:
        raise ReductionError(f"modes: {path} is no .npz file of arrays of numbers") from error


def _over_dofs(fe: FEMatrices, modes: FloatArray) -> FloatArray:
    """(n, k) from modes over the degrees of freedom or over the nodes."""
    n, nodes = fe.numbering.n, len(fe.mesh.points)
    table = fe.numbering.table
    rotating = bool(len(fe.numbering.rotating))
    if modes.ndim == 2 and modes.shape[0] == n:
        V = modes
    elif modes.ndim == 3 and modes.shape[0] == nodes and modes.shape[1] in (3, 6):
        if modes.shape[1] == 3 and rotating:
            what = f"(nodes, 3, k) has no rotations, but beams or shells do: give ({nodes}, 6, k)"
            raise ReductionError.from_problems([Problem("modes", what)])
        V = np.zeros((n, modes.shape[2]))
        for c in range(modes.shape[1]):
            there = np.flatnonzero((table[:, c] >= 0) & (table[:, c] < n))
            V[table[there, c]] = modes[there, c]
    else:
        allowed = (f"({n}, k)", f"({nodes}, 3, k)", f"({nodes}, 6, k)")
        problem = Problem("modes", f"have the shape {modes.shape}", allowed)
        raise ReductionError.from_problems([problem])
    if not np.isfinite(V).all():
        bad = np.flatnonzero(~np.isfinite(V).all(axis=0))
        what = f"mode {bad[0] + 1} has entries that are not finite ({len(bad)} such modes)"
        raise ReductionError.from_problems([Problem("modes", what)])
    if not V.shape[1]:
        raise ReductionError.from_problems([Problem("modes", "there are none")])
    return V


def _elastic(fe: FEMatrices, relief: InertiaRelief, V: FloatArray) -> FloatArray:
    """The modes without their rigid motion, scaled to unit modal mass."""
    energy = np.sum(V * (fe.M @ V), axis=0)
    left = relief.fields(V)
    left = relief.fields(left)
    rest = np.sum(left * (fe.M @ left), axis=0)
    rigid = np.flatnonzero(rest <= _RIGID_ENERGY * energy)
    if len(rigid):
        which = ", ".join(str(number + 1) for number in rigid)
        what = f"mode {which} is a rigid motion of the body and nothing else: leave it out"
        raise ReductionError.from_problems([Problem("modes", what)])
    share = 1.0 - rest / energy
    if share.max() > _RIGID_WARNING:
        worst = int(np.argmax(share))
        count, content = int((share > _RIGID_WARNING).sum()), f"{share[worst]:.3g}"
        warnings.warn(
            f"{count} of the given modes have rigid content, mode {worst + 1} {content} of its "
            "kinetic energy; it is taken out, the body's frame has it",
            FlexmbWarning,
            stacklevel=3,
        )
    return left / np.sqrt(rest)


def _check_independent(fe: FEMatrices, V: FloatArray) -> None:
    gram = V.T @ (fe.M @ V)
    values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    if values[0] > _DEPENDENT_ENERGY:
        return
    involved = np.flatnonzero(np.abs(vectors[:, 0]) > 0.1 * np.abs(vectors[:, 0]).max())
    which = ", ".join(str(number + 1) for number in involved)
    what = f"modes {which} depend on each other: leave one of them out"
    raise ReductionError.from_problems([Problem("modes", what)])


def _check_rigid_interfaces(
    fe: FEMatrices, interfaces: tuple[ModelInterface, ...], V: FloatArray
) -> None:
    problems = []
    for part in interfaces:
        if not isinstance(part, RigidInterface):
            continue
        moved = V[part.dofs]
        gap = np.abs(moved - part.T @ part.motion(V)).max(axis=0)
        worst = int(np.argmax(gap / np.abs(V).max(axis=0)))
        if gap[worst] > _MAX_DEVIATION * np.abs(V[:, worst]).max():
            what = f"its nodes do not move rigidly in mode {worst + 1}, as an rbe2 says; "
            problems.append(Problem(f"interfaces.{part.name}", what + 'take type = "rbe3"'))
    if problems:
        raise ReductionError.from_problems(problems)


def _check_plane(fe: FEMatrices, mirror: SymmetryPlane, V: FloatArray) -> None:
    share = mirror.shares(fe, V)
    worst = int(np.argmax(share))
    if share[worst] > _MAX_OUT_OF_PLANE:
        what = f"mode {worst + 1} moves out of the plane {mirror.plane}"
        what += f" with {share[worst]:.3g} of its kinetic energy"
        raise ReductionError.from_problems([Problem("modes", what)])


def _warn_unmoved(interfaces: tuple[ModelInterface, ...], motion: FloatArray) -> None:
    """Interfaces that no given mode lets move against the body: their markers are rigid."""
    for part, rows in zip(interfaces, motion, strict=True):
        if not np.linalg.norm(rows[:3]) > 1e-12 * np.linalg.norm(motion):
            what = f'the interface "{part.name}" moves in none of the given modes'
            warnings.warn(f"{what}: loads there deform nothing", FlexmbWarning, stacklevel=3)
