"""Rows that measure the separation of two markers, h = x_J − x_I, and joints of POINT rows alone.

    POINT     h·e_a      coincidence of two points along a global axis
    DOT2      a·h        no motion along a = column a of R_I; a stroke if its function varies
    DISTANCE  |h|        the multiplier is the force in the massless link

POINT rows are linear in the positions of their markers. A joint that has no other rows (spherical,
revolute in a plane) between markers that are fixed to the rigid part of their bodies is evaluated
here as a whole: its reaction is a force (Σ λ e) without a moment, which is added directly to the
equations of the bodies. What a row is, and what its functions do: `engine.kind.RowKind`. Source:
Haug, Computer Aided Kinematics and Dynamics, 1989, ch. 9; Hong & Liu 2011, §2.3.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import (
    axis_vector,
    column,
    cross,
    inner,
    put_part,
    times,
    turned_back,
)
from flexmb.engine.jit import Integers, kernel, unit
from flexmb.engine.joints.row import (
    add_distance,
    add_dot2,
    put_pair,
    relative_velocity,
    separation,
    subtract_square,
    vector_rates,
)
from flexmb.engine.kind import Kind, RowKind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import Point, RowWork, Run


@unit
def point_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """h·e_a."""
    return at.marker[j]["x"][a] - at.marker[i]["x"][a]  # type: ignore[no-any-return]


@unit
def point_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of h·e_a."""
    put_pair(at.g, 0, axis_vector(a))
    return SUCCESS


@unit
def point_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Zero, as h·e_a is linear in the positions."""
    return 0.0


POINT = RowKind("place {a}", point_value, point_gradient, point_curvature)


@unit
def dot2_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """a·h."""
    return inner(column(at.marker[i]["R"], a), separation(at.marker[i], at.marker[j]))  # type: ignore[no-any-return]


@unit
def dot2_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of a·h."""
    axis = column(at.marker[i]["R"], a)
    put_pair(at.g, 0, axis)
    put_part(at.g, 3, cross(axis, separation(at.marker[i], at.marker[j])))
    return SUCCESS


@unit
def dot2_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second time derivative of a·h at zero accelerations."""
    mi, mj = at.marker[i], at.marker[j]
    first, second = vector_rates(column(mi["R"], a), mi["om"])
    return inner(second, separation(mi, mj)) + 2.0 * inner(first, relative_velocity(mi, mj))  # type: ignore[no-any-return]


@unit
def dot2_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """Add f times the tangent of a·h to H."""
    mi = at.marker[i]
    add_dot2(column(mi["R"], a), separation(mi, at.marker[j]), f, at.H)
    return SUCCESS


DOT2 = RowKind("offset {a}", dot2_value, dot2_gradient, dot2_curvature, dot2_tangent)


@unit
def distance_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """|h|."""
    h = separation(at.marker[i], at.marker[j])
    return math.sqrt(inner(h, h))


@unit
def distance_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of |h|; not finite where it is zero."""
    h = separation(at.marker[i], at.marker[j])
    put_pair(at.g, 0, times(1.0 / np.sqrt(inner(h, h)), h))
    return SUCCESS


@unit
def distance_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second time derivative of |h| at zero accelerations."""
    h, u = separation(at.marker[i], at.marker[j]), relative_velocity(at.marker[i], at.marker[j])
    d = math.sqrt(inner(h, h))
    rate = inner(h, u) / d
    return (inner(u, u) - rate * rate) / d  # type: ignore[no-any-return]


@unit
def distance_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """Add f times the tangent of |h| to H: f (I − n nᵀ)/|h| for the relative motion, n = h/|h|."""
    h = separation(at.marker[i], at.marker[j])
    d = math.sqrt(inner(h, h))
    put_pair(at.g, 0, times(1.0 / d, h))
    subtract_square(at.g, f / d, at.H)
    add_distance(f / d, at.H)
    return SUCCESS


DISTANCE = RowKind(
    "length", distance_value, distance_gradient, distance_curvature, distance_tangent,
    is_distance=True,
)  # fmt: skip


class PointJoints(NamedTuple):
    """POINT rows, and the joints that have no other rows."""

    rows: Integers  # all POINT rows
    others: Integers  # POINT rows of joints with other rows too
    groups: Integers  # joints of POINT rows alone


@kernel
def _reaction(rows, group, lam):
    """Σ λ e of a group; the force on J is minus this."""
    x, y, z = 0.0, 0.0, 0.0
    first = group["row"]
    for r in range(first, first + group["n"]):
        a = rows[r]["a"]
        x += lam[r] if a == 0 else 0.0
        y += lam[r] if a == 1 else 0.0
        z += lam[r] if a == 2 else 0.0
    return x, y, z


@kernel
def _add_force(body, A, s, x, y, z, out):
    """out += generalised forces of the force (x, y, z) at the position s in a body."""
    o = body["iv"]
    out[o] += x
    out[o + 1] += y
    out[o + 2] += z
    x, y, z = cross(s, turned_back(A, (x, y, z)))
    out[o + 3] += x
    out[o + 4] += y
    out[o + 5] += z


@unit
def put_values(run: Run, joints: PointJoints, at: Point) -> int:
    """Put C of all POINT rows."""
    rows, markers, C, listed = run.system.rows, run.work.now.marker, run.work.con.C, joints.rows
    for n in range(listed.shape[0]):
        row = rows[listed[n]]
        a = row["a"]
        C[listed[n]] = markers[row["J"]]["x"][a] - markers[row["I"]]["x"][a]
    return SUCCESS


@unit
def put_rates(run: Run, joints: PointJoints, at: Point) -> int:
    """Put Cq v of all POINT rows."""
    rows, markers, out, listed = (
        run.system.rows,
        run.work.now.marker,
        run.work.con.rate,
        joints.rows,
    )
    for n in range(listed.shape[0]):
        row = rows[listed[n]]
        a = row["a"]
        out[listed[n]] = markers[row["J"]]["vx"][a] - markers[row["I"]]["vx"][a]
    return SUCCESS


@unit
def subtract_reactions(run: Run, joints: PointJoints, at: Point) -> int:
    """Subtract λ g of the POINT rows of other joints from the wrenches of the markers."""
    rows, markers, lam, listed = run.system.rows, run.work.now.marker, at.lam, joints.others
    for n in range(listed.shape[0]):
        row = rows[listed[n]]
        markers[row["I"]]["W"][row["a"]] += lam[listed[n]]
        markers[row["J"]]["W"][row["a"]] -= lam[listed[n]]
    return SUCCESS


@unit
def add_reactions(run: Run, joints: PointJoints, at: Point) -> int:
    """Trial.res += Cqᵀ λ of the joints of POINT rows alone."""
    parts, body_now, out, lam = run.system.parts, run.work.now.body, run.work.trial.res, at.lam
    rows, groups, markers, bodies = run.system.rows, run.system.groups, parts.markers, parts.bodies
    listed = joints.groups
    for n in range(listed.shape[0]):
        group = groups[listed[n]]
        row = rows[group["row"]]
        x, y, z = _reaction(rows, group, lam)
        mi, mj, i, j = markers[row["I"]], markers[row["J"]], group["body_I"], group["body_J"]
        if i >= 0:
            _add_force(bodies[i], body_now[i]["A"], mi["rho"], -x, -y, -z, out)
        if j >= 0:
            _add_force(bodies[j], body_now[j]["A"], mj["rho"], x, y, z, out)
    return SUCCESS


@unit
def add_tangents(run: Run, joints: PointJoints, at: Point, cv: float, cp: float) -> int:
    """Add cp ∂(Cqᵀ λ)/∂q of these joints: the moment arms of their forces turn with the bodies."""
    if cp == 0.0:
        return SUCCESS
    rows, groups, listed = run.system.rows, run.system.groups, joints.groups
    for n in range(listed.shape[0]):
        group = groups[listed[n]]
        x, y, z = _reaction(rows, group, at.lam)
        row = rows[group["row"]]
        _add_arm(run, row["I"], -cp * x, -cp * y, -cp * z)
        _add_arm(run, row["J"], cp * x, cp * y, cp * z)
    return SUCCESS


@kernel
def _add_arm(run, k, x, y, z):
    """Add s̃ f̃' = f' sᵀ − (s·f') I, of the turning arm s of the force f' = Aᵀ f, to the matrix."""
    parts, kkt, low, up = run.system.parts, run.system.kkt, run.work.factor.low, run.work.factor.up
    mk = parts.markers[k]
    if mk["body"] < 0:
        return
    body, s = parts.bodies[mk["body"]], mk["rho"]
    fx, fy, fz = turned_back(run.work.now.body[mk["body"]]["A"], (x, y, z))
    panel, column, o = kkt.panels[body["panel"]], kkt.column, body["iv"] + 3
    at, nc = panel["at"], panel["nc"]
    d = s[0] * fx + s[1] * fy + s[2] * fz
    for r in range(3):
        pr = column[o + r]
        if pr < 0:
            continue
        f = fx if r == 0 else fy if r == 1 else fz
        for c in range(3):
            pc = column[o + c]
            e = f * s[c] - (d if r == c else 0.0)
            if pr >= pc and pc >= 0:
                low[at + pr * nc + pc] += e
            if pr <= pc:
                up[at + pc * nc + pr] += e


POINT_JOINTS = Kind(
    "point_joints",
    PointJoints,
    {
        "constraint": put_values,
        "rate": put_rates,
        "wrench": subtract_reactions,
        "force": add_reactions,
        "matrix": add_tangents,
    },
)
