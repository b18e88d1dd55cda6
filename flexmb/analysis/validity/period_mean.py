"""Mean of the forces along a slender body over a vibration period, from the rows of a run.

Waves along a bar neither buckle nor stiffen it: the mean counts. It is exponential, of eight rows
or more, and so lags where rows are rare. Then the force of a row counts itself, if it is slow: the
ends of the bar move apart between two rows by what the mean of both rates says. In a vibration that
is faster than the rows they do not.
"""

from __future__ import annotations

import numpy as np

from flexmb.engine.tables import BodyColumns
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array
from flexmb.results.output_block import OutputBlock

_MAX_ROW_WEIGHT = 0.125  # largest weight of one row in the mean
_RARE_ROWS = 0.25  # share of a period between two rows from which on these are rare
# What rates do not explain, over the change of the distance of the ends, from which on it is none
# of a slow motion.
_FAST = 0.3


def stretch(body: FlexBody, axis: Array) -> Array:
    """(m,) by which the ends of a body move apart along an axis, per unit eta."""
    points, moved = (
        [one.position for one in body.interfaces],
        [one.Phi_t for one in body.interfaces],
    )
    if body.nodes is not None:
        points, moved = list(body.nodes.position), list(body.nodes.Phi_t)
    if not points:
        return np.zeros(body.m)
    places = np.array(points) @ axis
    return np.asarray(axis @ (moved[int(places.argmax())] - moved[int(places.argmin())]))


def slow_shares(
    columns: BodyColumns, along: Array, rows: OutputBlock, last: Array
) -> tuple[Array, Array]:
    """(t,) from 0 for vibrations faster than the rows to 1 for slow motions; the last row.

    `last` (3,) are the time, the stretch and its rate at the row before; NaN: none.
    """
    first, rate = columns.iq + 7, columns.iv + 6
    table = np.column_stack(
        [
            rows.t,
            rows.q[:, first : first + columns.m] @ along,
            rows.v[:, rate : rate + columns.m] @ along,
        ]
    )
    t, moved, rates = np.vstack([last, table]).T
    change = np.diff(moved)
    apart = np.abs(change - 0.5 * np.diff(t) * (rates[1:] + rates[:-1]))
    moves = np.abs(change) > 0.0
    share = np.divide(apart, np.abs(change), out=np.ones_like(apart), where=moves)
    return np.nan_to_num((1.0 - share / _FAST).clip(0.0)), table[-1]


def period_mean(
    mean: Array, passed: Array | float, values: Array, slow: Array | float
) -> tuple[Array, Array]:
    """The mean after the next row, and the force that counts there.

    Parameters
    ----------
    mean : (n,) array
        Mean up to the last row; NaN: none yet.
    passed : (n,) array or float
        Time since the last row, in periods; NaN: separate rows.
    values : (n,) array
        Forces of this row.
    slow : (n,) array or float
        As of `slow_shares`.
    """
    begins = np.isnan(passed) | np.isnan(mean)
    weight = np.where(begins, 1.0, np.minimum(passed, _MAX_ROW_WEIGHT))
    mean = np.where(begins, values, mean + weight * (values - mean))
    counts = np.where(passed > _RARE_ROWS, slow, 0.0)
    return mean, mean + counts * (values - mean)
