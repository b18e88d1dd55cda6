"""The registry of constraint rows: their kinds, and the number of each in `tables.ROW`."""

from __future__ import annotations

from flexmb.engine.joints import point_joint, row
from flexmb.engine.kind import RowKind

ROW_KINDS: list[RowKind] = []
"""All kinds of rows, by number."""


def _number(kind: RowKind) -> int:
    """The number of one more kind."""
    ROW_KINDS.append(kind)
    return len(ROW_KINDS) - 1


POINT = _number(point_joint.POINT)
DOT1 = _number(row.DOT1)
DOT2 = _number(point_joint.DOT2)
DISTANCE = _number(point_joint.DISTANCE)
ANGLE = _number(row.ANGLE)
TWIST = _number(row.TWIST)
RADIAL = _number(row.RADIAL)
MOMENT = _number(row.MOMENT)
