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
# Artificial mass τ² K_ss of the softest mode over the inertia of its part of the model.
_MASS_RATIO = 1e8

LOOP = np.dtype([
    ("change", "f8"),  # last change of the modes, weighted
    ("grows", "i8"),  # 1: the plain iteration does not converge
    ("noted", "i8"),  # points recorded ahead of the state
])  # fmt: skip


class Scratch(NamedTuple):
    """Scratch of the iteration of the modes with their loads."""

    iterates: Iterates
    residual: Vector  # of the last iterate, of each mode
    move: Vector  # change of each mode to the last iterate
    ahead: Matrix  # (PAST_POINTS, modes) values at the state and at points ahead of it
    loop: array_of(LOOP)  # (1,)


class StaticModes(NamedTuple):
    """Quasi-static modes, body after body."""

    rows: Integers  # (b,) rows of the bodies that have some
    first: Integers  # (b + 1,) number of the first mode of each body
    modes: Integers  # numbers of the modes in their bodies
    kinetostatic: Integers  # (b,) 1: prescribed within a step by implicit methods as well
    mass_factor: Vector  # (b,) τ² [s²]
    compliance: Vector  # K_ss⁻¹ of the bodies, row by row
    history: Integers  # (b,) place of its past in State.history: PAST_POINTS times [s], η_s at each
    window: Vector  # (b,) least interval of the points of its past [s]
    reach: Vector  # largest displacement per unit of each mode, over the size of its model part
    scratch: Scratch = None  # of one run


def new_scratch(of: StaticModes) -> Scratch:
    n = len(of.modes)
    ahead = np.zeros((PAST_POINTS, n))
    return Scratch(new_iterates(n), np.zeros(n), np.zeros(n), ahead, np.zeros(1, LOOP))


def tabulate_static_modes(
    bodies: Sequence[tuple[int, FlexBody, NDArray[np.int64], bool]],
    add_history: Callable[[int], int],
) -> StaticModes:
    """Tables of the quasi-static modes of bodies: (row, body, modes, whether kinetostatic) each.

    `add_history` reserves numbers in the history of a run and returns the place of the first one.
    """
    mass_factor, compliance = [], []
    for _, body, modes, _ in bodies:
        square = np.diag(body.K)[modes] / np.diag(body.M_eta)[modes]
        mass_factor.append(_MASS_RATIO / square.min())
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
