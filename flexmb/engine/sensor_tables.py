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

# One channel: `what` it is (SUM, ...). SUM: `n` terms from `first` on. WRENCH: of row `first` (`n`
# rows from there on) of a kind, by its number among those with an element wrench; force or moment
# (`quantity` 0, 1) on marker J or I (`side` 0, 1), component `a` along the axes of a marker, -1:
# global, -2: those of the side.
# ENERGY: number `first` of the energies, of body `n` or -1. EXPRESSION: program `first` over
# channels. STATE: velocity coordinate `first`. PLACE of a curve marker: position coordinate
# `first`, or with `n` = 1 velocity coordinate `first`.
CHANNEL = np.dtype(
    [
        ("what", _I),
        ("first", _I),
        ("n", _I),
        ("turns", _I),  # 1: an angle that counts turns, 2: number `a` of three angles of one term
        ("side", _I),
        ("quantity", _I),
        ("axes", _I),
        ("a", _I),
        ("kind", _I),
    ],
    align=True,
)

# One term of a channel, times a factor: a kind of row between markers I and J with axes a and b,
# or its rate (`level` 1) or second derivative (2); or a motion of marker J along axis a of marker I
# (-1: global); or angle b of three, a being the code of the axes.
TERM = np.dtype(
    [("kind", _I), ("I", _I), ("J", _I), ("a", _I), ("b", _I), ("level", _I), ("factor", _F)],
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


# What channels are.
SUM, WRENCH, ENERGY, EXPRESSION, STATE, PLACE = range(6)
# Kinds of terms beside the rows: three angles; motions along axes (x, velocity, acceleration,
# angular velocity and acceleration, what turning axes add to the latter).
TURNING = 90
ALONG = 100
ALONG_X, ALONG_V, ALONG_A, ALONG_OM, ALONG_OMD, SEEN_OMD = range(ALONG, ALONG + 6)
ANGLE_TURNS, ANGLES_TURN = 1, 2
