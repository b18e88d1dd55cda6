"""The registry of constraint rows: all kinds, and the number of each in `tables.ROW`."""

from __future__ import annotations

from flexmb.engine.joints import point_joint, row
from flexmb.engine.kind import RowKind

ROW_KINDS: tuple[RowKind, ...] = (
    point_joint.POINT,
    row.DOT1,
    point_joint.DOT2,
    point_joint.DISTANCE,
    row.ANGLE,
    row.TWIST,
    row.RADIAL,
    row.MOMENT,
)
"""All kinds of rows, by number."""

POINT, DOT1, DOT2, DISTANCE, ANGLE, TWIST, RADIAL, MOMENT = range(len(ROW_KINDS))
