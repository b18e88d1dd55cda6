"""Tables of sensors and of functions over their channels, as the kernels read them.

Beside `tables`, which holds the rest of a system; units are SI.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine.kernels.functions.function import FunctionTable
from flexmb.engine.records import Integers, array_of

_I = "i8"
_F = "f8"

# One channel: `what` it is, a number in `sensor_kinds`. Of terms: `n` terms from `first` on; number
# `a` of three turning angles. WRENCH: of row `first` (`n` rows from there on) of a kind, by its
# number among those with an element wrench; force or moment (`quantity` 0, 1) on marker J or I
# (`side` 0, 1), component `a` along the axes of a marker, -1: global, -2: those of the side.
# ENERGY: number `first` of the energies. BODY_ENERGY: of body `n`. EXPRESSION: program `first` over
# channels. STATE, PLACE_RATE: velocity coordinate `first`. PLACE: position coordinate `first`.
CHANNEL = np.dtype(
    [
        ("what", _I),
        ("first", _I),
        ("n", _I),
        ("side", _I),
        ("quantity", _I),
        ("axes", _I),
        ("a", _I),
        ("kind", _I),
    ],
    align=True,
)

# One term of a channel, times a factor: a measure by its number in `sensor_kinds`, between markers
# I and J. As a row measures, or a derivative of it: kind and axes a and b of the row; a motion of J
# along axis a of I (-1: global); angle b of three, a being the code of the axes.
TERM = np.dtype(
    [
        ("measure", _I),
        ("kind", _I),  # of a row, -1
        ("I", _I),
        ("J", _I),
        ("a", _I),
        ("b", _I),
        ("channel", _I),  # that it is part of
        ("factor", _F),
    ],
    align=True,
)

# One partial derivative that forces need: of the program of a signal with respect to a channel.
PARTIAL = np.dtype([("program", _I), ("channel", _I)], align=True)
# Where a partial derivative enters the iteration matrix. What acts: component `a` of row `row` on
# its marker J or I (`on` 0, 1), of the kind `kind` among those with a unit force; or the scalar
# coordinate with velocity `iv` if kind = -1. What it depends on: `term` at its marker I or J
# (`side` 0, 1), or the state with velocity `state`. LINK of the two blocks, -1: the same.
FEEDBACK_TANGENT = np.dtype(
    [
        ("partial", _I),
        ("kind", _I),
        ("row", _I),
        ("on", _I),
        ("a", _I),
        ("iv", _I),
        ("panel", _I),  # of what acts
        ("term", _I),
        ("side", _I),
        ("state", _I),
        ("link", _I),
    ],
    align=True,
)


class Sensors(NamedTuple):
    """Channels, those of the results first, then states that only expressions read."""

    channels: array_of(CHANNEL)
    terms: array_of(TERM)
    programs: FunctionTable  # over channels by number


class Feedback(NamedTuple):
    """Functions of measured channels that act as forces or drive states."""

    programs: Integers  # (k,) programs of `System.functions`
    channels: Integers  # (n,) channels that they read
    partials: array_of(PARTIAL)
    tangents: array_of(FEEDBACK_TANGENT)
    implicit: int  # 1: some depend on accelerations or reactions
