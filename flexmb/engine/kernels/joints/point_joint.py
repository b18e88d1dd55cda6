"""Rows of coincidence, and joints that have no other: spherical, and revolute in a plane.

These rows are linear in the places of their markers, whatever the joint. A joint of nothing else
holds two points of rigid places together: its reaction is a force (Σ λ e) without a moment, so it
goes straight to the coordinates of the two bodies (`bodies.marker`).
"""

from __future__ import annotations

from typing import NamedTuple

from flexmb.engine.algebra.rotation import cross, transform_back
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.records import Integers
from flexmb.engine.state import Point, Run


class PointJoints(NamedTuple):
    """Rows of coincidence, and joints of points."""

    rows: Integers  # all of these rows
    others: Integers  # those of other joints
    groups: Integers  # joints of points


@kernel
def _force(rows, group, lam):
    """Σ λ e of a group: minus the force on J."""
    x, y, z = 0.0, 0.0, 0.0
    first = group["row"]
    for r in range(first, first + group["n"]):
        a = rows[r]["a"]
        x += lam[r] if a == 0 else 0.0
        y += lam[r] if a == 1 else 0.0
        z += lam[r] if a == 2 else 0.0
    return x, y, z


@kernel
def _add(body, A, s, x, y, z, out):
    """out += generalised forces of (x, y, z) at the place s of a body."""
    o = body["iv"]
    out[o] += x
    out[o + 1] += y
    out[o + 2] += z
    x, y, z = transform_back(A, x, y, z)
    x, y, z = cross(s[0], s[1], s[2], x, y, z)
    out[o + 3] += x
    out[o + 4] += y
    out[o + 5] += z


@unit
def put_values(run: Run, joints: PointJoints, at: Point) -> int:
    """C of all rows of coincidence: along global axes."""
    rows, markers, C, listed = run.system.rows, run.work.now.marker, run.work.con.C, joints.rows
    for n in range(listed.shape[0]):
        row = rows[listed[n]]
        a = row["a"]
        C[listed[n]] = markers[row["J"]]["x"][a] - markers[row["I"]]["x"][a]
    return FINE


@unit
def put_rates(run: Run, joints: PointJoints, at: Point) -> int:
    """Cq v of all rows of coincidence."""
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
    return FINE


@unit
def subtract_reactions(run: Run, joints: PointJoints, at: Point) -> int:
    """Wrenches of the markers −= λ g of the rows of other joints."""
    rows, markers, lam, listed = run.system.rows, run.work.now.marker, at.lam, joints.others
    for n in range(listed.shape[0]):
        row = rows[listed[n]]
        markers[row["I"]]["W"][row["a"]] += lam[listed[n]]
        markers[row["J"]]["W"][row["a"]] -= lam[listed[n]]
    return FINE


@unit
def add_reactions(run: Run, joints: PointJoints, at: Point) -> int:
    """Trial.res += Cqᵀ λ of the joints."""
    parts, body_now, out, lam = run.system.parts, run.work.now.body, run.work.trial.res, at.lam
    rows, groups, markers, bodies = run.system.rows, run.system.groups, parts.markers, parts.bodies
    listed = joints.groups
    for n in range(listed.shape[0]):
        group = groups[listed[n]]
        row = rows[group["row"]]
        x, y, z = _force(rows, group, lam)
        mi, mj, i, j = markers[row["I"]], markers[row["J"]], group["body_I"], group["body_J"]
        if i >= 0:
            _add(bodies[i], body_now[i]["A"], mi["rho"], -x, -y, -z, out)
        if j >= 0:
            _add(bodies[j], body_now[j]["A"], mj["rho"], x, y, z, out)
    return FINE


@unit
def add_tangents(run: Run, joints: PointJoints, at: Point, cv: float, cp: float) -> int:
    """cp ∂(Cqᵀ λ)/∂q of the joints: the arms of their forces turn."""
    if cp == 0.0:
        return FINE
    rows, groups, listed = run.system.rows, run.system.groups, joints.groups
    for n in range(listed.shape[0]):
        group = groups[listed[n]]
        x, y, z = _force(rows, group, at.lam)
        row = rows[group["row"]]
        _add_arm(run, row["I"], -cp * x, -cp * y, -cp * z)
        _add_arm(run, row["J"], cp * x, cp * y, cp * z)
    return FINE


@kernel
def _add_arm(run, k, x, y, z):
    """What the turning arm of a force at a rigid place adds: s̃ f̃' = f' sᵀ − (s·f') I."""
    parts, kkt, low, up = run.system.parts, run.system.kkt, run.work.factor.low, run.work.factor.up
    mk = parts.markers[k]
    if mk["body"] < 0:
        return
    body, s = parts.bodies[mk["body"]], mk["rho"]
    fx, fy, fz = transform_back(run.work.now.body[mk["body"]]["A"], x, y, z)
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
