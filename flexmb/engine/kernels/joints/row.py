"""Constraint rows of any kind: calls of their units, rates, values within a period."""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.jit import call_row, call_row_tangent, call_row_value, kernel

_TURN = 2.0 * math.pi


@kernel
def wrapped(angle):
    """Angle within ±π."""
    return angle - _TURN * np.floor(angle / _TURN + 0.5)


# `row` below is a row of constraints, or a term of a sensor that measures as one does.


@kernel
def row_value(run, row):
    """What a row measures."""
    unit = run.rows.value[row["kind"]]
    return call_row_value(unit, run.work.row, row["a"], row["b"], row["I"], row["J"])


@kernel
def put_row_gradient(run, row):
    """Gradient of a row to RowWork.g."""
    unit = run.rows.gradient[row["kind"]]
    call_row(unit, run.work.row, row["a"], row["b"], row["I"], row["J"])


@kernel
def row_curvature(run, row):
    """Second time derivative of what a row measures at zero accelerations of both markers."""
    unit = run.rows.curvature[row["kind"]]
    return call_row_value(unit, run.work.row, row["a"], row["b"], row["I"], row["J"])


@kernel
def add_row_tangent(run, row, f):
    """Add f times the tangent of a row to RowWork.H; returns whether it has one."""
    kind = row["kind"]
    if run.rows.curved[kind] == 0:
        return 0
    unit = run.rows.tangent[kind]
    call_row_tangent(unit, run.work.row, row["a"], row["b"], row["I"], row["J"], f)
    return 1


@kernel
def rate(g, mi, mj):
    """g times the velocities of the two markers."""
    r = 0.0
    for k in range(3):
        r += g[k] * mi["vx"][k] + g[3 + k] * mi["om"][k]
        r += g[6 + k] * mj["vx"][k] + g[9 + k] * mj["om"][k]
    return r
