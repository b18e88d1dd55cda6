"""The reduction methods by name, with one signature.

In: a finite-element model, its interfaces, a method and its modes. Out: a :class:`ReducedBasis`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from flexmb.errors import Problem, ReductionError, nearest
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.craig_bampton import craig_bampton, guyan
from flexmb.fe.reduction.fixed_interface import read_modes
from flexmb.fe.reduction.free_interface import free_interface, free_modes
from flexmb.fe.reduction.reduced_basis import ReducedBasis
from flexmb.fe.reduction.symmetry_plane import SymmetryPlane
from flexmb.fe.reduction.user_modes import user_modes
from flexmb.progress import Progress, silent


class Method(Protocol):
    """A reduction method."""

    def __call__(
        self,
        fe: FEMatrices,
        interfaces: tuple[ModelInterface, ...],
        modes: Any,
        progress: Progress = silent,
        mirror: SymmetryPlane | None = None,
        loads: tuple[LoadPattern, ...] = (),
    ) -> ReducedBasis: ...


METHODS: dict[str, Method] = {
    "craig-bampton": craig_bampton,
    "free-interface": free_interface,
    "guyan": guyan,
    "user": user_modes,
}
"""Methods by name."""

_DEFAULT_MODES = {"craig-bampton": 20, "free-interface": 20, "guyan": 0}


def requested_modes(method: str, modes: Any) -> Any:
    """The modes of a method, or its default.

    Raises
    ------
    ReductionError
        An unknown method, a choice that cannot be, or user modes that are not given.
    """
    if method not in METHODS:
        names = tuple(METHODS)
        problem = Problem("reduction", f'unknown "{method}"', names, nearest(str(method), names))
        raise ReductionError.from_problems([problem])
    if method == "user":
        if modes is None or isinstance(modes, int | float | Mapping):
            what = 'reduction = "user" takes modes = an array, or the path of an .npz file'
            raise ReductionError.from_problems([Problem("modes", f"{what}, given {modes!r}")])
        return modes
    return read_modes(_DEFAULT_MODES[method] if modes is None else modes)


def reduce_model(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...],
    method: str = "craig-bampton",
    modes: Any = None,
    *,
    progress: Progress = silent,
    mirror: SymmetryPlane | None = None,
    loads: tuple[LoadPattern, ...] = (),
) -> ReducedBasis:
    """Reduce a model by a method.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    interfaces : tuple of RigidInterface or WeightedInterface
        Without any, ``"craig-bampton"`` and ``"free-interface"`` both take free modes.
    method : str
        ``"craig-bampton"``, ``"free-interface"``, ``"guyan"`` (static) or ``"user"``.
    modes
        What the method takes: a number, ``{"frequency": ...}``, ``{"effective_mass": ...}``, and
        for ``"user"`` an array or the path of an .npz file. By default 20, and none for
        ``"guyan"``.
    progress, mirror, loads
        As for :func:`flexmb.fe.craig_bampton`.

    Raises
    ------
    ReductionError
        An unknown method, a static reduction without interfaces, user modes that are not given,
        or what the method refuses.
    """
    modes = requested_modes(method, modes)
    if interfaces or method == "user":
        return METHODS[method](fe, interfaces, modes, progress, mirror, loads)
    if method == "guyan":
        what = "a static reduction needs interfaces: without them the body is rigid"
        raise ReductionError.from_problems([Problem("reduction", what)])
    return free_modes(fe, (), modes, progress, mirror, loads)
