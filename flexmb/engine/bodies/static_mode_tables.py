"""Tables of quasi-static modes, and the scratch memory of the iteration with their loads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.algebra.anderson import Iterates, new_iterates
from flexmb.engine.jit import Integers, Matrix, Vector, array_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexmb.flexbody import FlexBody

# Points of the past that are stored; the last of them may be the present.
PAST_POINTS = 4
_SLOW = 1e8  # τ² K_ss over the inertia of its part of the model in the softest of them

LOOP = np.dtype([
    ("change", "f8"),  # the last one, weighted
    ("grows", "i8"),  # 1: it does not settle of itself
    ("noted", "i8"),  # points ahead of the state
])  # fmt: skip


class Scratch(NamedTuple):
    """Of the iteration in which modes and their loads settle."""

    iterates: Iterates
    residual: Vector  # of the last iterate, of each mode
    move: Vector  # from the one before to it
    ahead: Matrix  # (PAST_POINTS, modes) at the state and ahead of it
    loop: array_of(LOOP)  # (1,)


class StaticModes(NamedTuple):
    """Quasi-static modes, body after body."""

    rows: Integers  # (b,) bodies that have some
    first: Integers  # (b + 1,) where those of a body begin
    modes: Integers  # numbers of the modes in their bodies
    kinetostatic: Integers  # (b,) 1: held by implicit methods too
    mass_factor: Vector  # (b,) τ² [s²]
    compliance: Vector  # K_ss⁻¹ of the bodies, row by row
    history: Integers  # (b,) where a body has its past: PAST_POINTS times [s], and η_s at each
    window: Vector  # (b,) least interval of the points of its past [s]
    reach: Vector  # most that one unit of each mode moves, over the size of its part of the model
    scratch: Scratch = None  # of one run


def new_scratch(of: StaticModes) -> Scratch:
    n = len(of.modes)
    ahead = np.zeros((PAST_POINTS, n))
    return Scratch(new_iterates(n), np.zeros(n), np.zeros(n), ahead, np.zeros(1, LOOP))


def tabulate_static_modes(
    bodies: Sequence[tuple[int, FlexBody, NDArray[np.int64], bool]],
    add_history: Callable[[int], int],
) -> StaticModes:
    """Tables of the quasi-static modes of bodies by row, kinetostatic or not, each by itself."""
    mass_factor, compliance = [], []
    for _, body, modes, _ in bodies:
        square = np.diag(body.K)[modes] / np.diag(body.M_eta)[modes]
        mass_factor.append(_SLOW / square.min())
        compliance.append(np.linalg.inv(body.K[np.ix_(modes, modes)]).ravel())
    rows, _, modes, kinetostatic = zip(*bodies, strict=True)
    return StaticModes(
        np.array(rows, np.int64),
        np.cumsum([0, *map(len, modes)]),
        np.concatenate(modes),
        np.array(kinetostatic, np.int64),
        np.array(mass_factor),
        np.concatenate(compliance),
        np.array([add_history(PAST_POINTS * (1 + len(some))) for some in modes], np.int64),
        np.zeros(len(rows)),
        np.zeros(sum(map(len, modes))),
    )
