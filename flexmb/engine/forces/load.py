"""Loads: forces and torques on markers, with components that are functions of time or channels.

A load case of a flexible body becomes several loads, in the axes of the body frame: forces and
torques at points that move like the mean of the loaded nodes (`flexbody.parts.LoadPoint`).

The components are in global axes or those of any marker. The opposite load may act on another body:
the reaction to a force F at marker J acts on the body of marker I at the same point, with the
wrench (−F, −h × F) about I, h = x_J − x_I, so that force and reaction have no resultant moment. The
reaction to a torque is the opposite torque.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.algebra.ldl import add_body_block, add_coupling
from flexmb.engine.algebra.vector import add_skew, clear, cross, turned, zero
from flexmb.engine.bodies.wrench import (
    add_generalized_force,
    add_moment_arms,
    add_pair_tangent,
    marker_jacobian,
    put_product_block,
)
from flexmb.engine.jit import array_of, kernel, unit
from flexmb.engine.joints.row import separation
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import LOAD_POWER, Point, Run

if TYPE_CHECKING:
    from flexmb.engine.lowering import Forces, Lowering
    from flexmb.model.forces.load import BodyLoadSpec

# Force or torque at `marker` (J) with components in the axes of the marker `axes` (-1: global
# ones), and with its opposite on the body of `other` (I) at the same point (-1: none).
LOAD = np.dtype(
    [
        ("marker", "i8"),
        ("other", "i8"),
        ("axes", "i8"),
        ("torque", "i8"),
        ("fun", "i8", (3,)),
        ("factor", "f8", (3,)),  # component = factor · value of the function
        ("couple", "i8"),  # LINK (block of the matrix) between the bodies of other and marker
        ("couple_marker", "i8"),  # LINK between the bodies of marker and axes
        ("couple_other", "i8"),  # LINK between the bodies of other and axes
    ],
    align=True,
)


class Loads(NamedTuple):
    """Forces and torques on markers."""

    rows: array_of(LOAD)


def lower_loads(lowering: Lowering, forces: Forces) -> Loads:
    """LOAD rows of all loads; their links are filled in later."""
    rows: list[tuple[object, ...]] = []
    for name, spec in forces:
        if spec.type == "body-load":
            rows += _body_load_rows(lowering, name, spec, len(rows))
            continue
        k, axes_marker = len(rows), spec.at if spec.axes == "body" else spec.axes_marker
        marker, other, axes = (
            -1 if reference is None else lowering.marker(reference)
            for reference in (spec.at, spec.reaction, axes_marker)
        )
        programs = tuple(lowering.functions.add(f.expression) for f in spec.value)
        rows.append((marker, other, axes, spec.type == "torque", programs, (1.0,) * 3, -1, -1, -1))
        lowering.add_element(name, "loads", k)
        for a, program in enumerate(programs):
            for on, end in enumerate((marker, other)):
                if end >= 0:
                    lowering.add_action(program, "loads", k, on, a, end)
    return Loads(np.array(rows, LOAD))


def _body_load_rows(
    lowering: Lowering, name: str, spec: BodyLoadSpec, first: int
) -> Iterator[tuple[object, ...]]:
    """LOAD rows of a load case of a flexible body: one for each of its points."""
    frame, points = lowering.geometry.load_points(spec)
    axes, program = lowering.markers.add(frame), lowering.functions.add(spec.value.expression)
    lowering.add_element(name, "loads", first, len(points))
    for k, (point, wrench) in enumerate(points, first):
        torque, marker = bool(wrench[3:].any()), lowering.markers.add(point)
        factor = wrench[3:] if torque else wrench[:3]
        for a in np.flatnonzero(factor):
            lowering.add_action(program, "loads", k, 0, int(a), marker)
        yield marker, -1, axes, torque, (program,) * 3, tuple(factor), -1, -1, -1


@unit
def pull_back_unit_force(run: Run, k: int, first: int) -> int:
    """feedback.left = Jᵀ w for marker k and the wrench w, dense.g[1, first : first + 6].

    feedback.block gets the index of the first velocity coordinate of its body and their number.
    """
    parts, work = run.system.parts, run.work
    left, block = work.feedback.left, work.feedback.block
    body = parts.bodies[parts.markers[k]["body"]]
    n = 6 + body["m"]
    for c in range(n):
        left[c] = 0.0
    add_generalized_force(parts, work.now, k, work.dense.g[1], first, 1.0, left, 0)
    block[0], block[1] = body["iv"], n
    return SUCCESS


@kernel
def _vector(load, markers, fun):
    """Force or torque of a load, global axes."""
    f, u = load["fun"], load["factor"]
    x, y, z = u[0] * fun[f[0], 0], u[1] * fun[f[1], 0], u[2] * fun[f[2], 0]
    if load["axes"] >= 0:
        return turned(markers[load["axes"]]["R"], (x, y, z))
    return x, y, z


@kernel
def _add_vector(load, markers, x, y, z, wi, wj):
    """Add the wrenches of a force or torque (x, y, z) to wj of its marker and wi of the other."""
    o = 3 * load["torque"]
    wj[o] += x
    wj[o + 1] += y
    wj[o + 2] += z
    if load["other"] < 0:
        return
    if load["torque"] == 0:
        wi[0] -= x
        wi[1] -= y
        wi[2] -= z
        hx, hy, hz = separation(markers[load["other"]], markers[load["marker"]])
        x, y, z = cross((hx, hy, hz), (x, y, z))
    wi[3] -= x
    wi[4] -= y
    wi[5] -= z


@kernel
def _put_pair(load, markers, x, y, z, w):
    """w (12) = the wrench pair of a force or torque (x, y, z)."""
    zero(w)
    _add_vector(load, markers, x, y, z, w[0:6], w[6:12])


@unit
def add_wrenches(run: Run, loads: Loads, at: Point) -> int:
    """Add forces and torques to the wrenches of their markers, and reactions to the others."""
    rows, markers, fun = loads.rows, run.work.now.marker, run.work.con.fun
    for k in range(rows.shape[0]):
        wj = markers[rows[k]["marker"]]["W"]
        wi = markers[rows[k]["other"]]["W"] if rows[k]["other"] >= 0 else wj
        x, y, z = _vector(rows[k], markers, fun)
        _add_vector(rows[k], markers, x, y, z, wi, wj)
    return SUCCESS


@unit
def add_powers(run: Run, loads: Loads, at: Point) -> int:
    """Power of all forces, torques and their reactions."""
    rows, markers, fun, out = loads.rows, run.work.now.marker, run.work.con.fun, run.work.powers
    for k in range(rows.shape[0]):
        load, mj = rows[k], markers[rows[k]["marker"]]
        x, y, z = _vector(load, markers, fun)
        u = mj["om"] if load["torque"] == 1 else mj["vx"]
        out[LOAD_POWER] += x * u[0] + y * u[1] + z * u[2]
        if load["other"] >= 0:
            mi = markers[load["other"]]
            if load["torque"] == 0:
                u = mi["vx"]
                out[LOAD_POWER] -= x * u[0] + y * u[1] + z * u[2]
                hx, hy, hz = separation(mi, mj)
                x, y, z = cross((hx, hy, hz), (x, y, z))
            u = mi["om"]
            out[LOAD_POWER] -= x * u[0] + y * u[1] + z * u[2]
    return SUCCESS


@unit
def put_wrench(run: Run, loads: Loads, at: Point, c: int) -> float:
    """Wrench pair of the load that channel c reads; without a reaction both markers are its own."""
    row, d = loads.rows[run.system.sensors.channels[c]["first"]], run.work.dense
    x, y, z = _vector(row, run.work.now.marker, run.work.con.fun)
    _put_pair(row, run.work.now.marker, x, y, z, d.g[1])
    pair = d.pair
    pair[0], pair[1] = row["other"] if row["other"] >= 0 else row["marker"], row["marker"]
    return 0.0


@unit
def put_unit_force(run: Run, loads: Loads, at: Point, part: int) -> float:
    """Generalised force on the body of one marker per unit of one function, for feedback.

    part = 6 row + 3 on + a: component a of a load, on its marker (on = 0) or the other (on = 1).
    """
    row, on, a = loads.rows[part // 6], part // 3 % 2, part % 3
    markers = run.work.now.marker
    f = row["factor"]
    x, y, z = f[0] * (a == 0), f[1] * (a == 1), f[2] * (a == 2)
    if row["axes"] >= 0:
        x, y, z = turned(markers[row["axes"]]["R"], (x, y, z))
    _put_pair(row, markers, x, y, z, run.work.dense.g[1])
    if on == 0:
        pull_back_unit_force(run, row["marker"], 6)
    else:
        pull_back_unit_force(run, row["other"], 0)
    return 0.0


@unit
def add_tangents(run: Run, loads: Loads, at: Point, cv: float, cp: float) -> int:
    """−cp ∂Q/∂q of all loads, Q their generalised forces.

    Q changes with h (the moment of a reaction), with the moment arms of the markers in their
    bodies, and with the rotation of the axes of the components.
    """
    if cv == 0.0 and cp == 0.0:
        return SUCCESS
    rows, markers, fun, d = loads.rows, run.work.now.marker, run.work.con.fun, run.work.dense
    H, w = d.H, d.g[1]
    for k in range(rows.shape[0]):
        load = rows[k]
        i, j, axes = load["other"], load["marker"], load["axes"]
        x, y, z = _vector(load, markers, fun)
        _put_pair(load, markers, -x, -y, -z, w)
        if i >= 0:
            clear(H, 12, 12)
            if load["torque"] == 0:  # the wrench on I changes with h
                add_skew(H, 3, 6, -1.0, (x, y, z))
                add_skew(H, 3, 0, 1.0, (x, y, z))
            add_pair_tangent(run, i, j, load["couple"], cp)
            add_moment_arms(run, i, j, cp)
        else:
            for c in range(6):
                w[c] = w[6 + c]
            add_moment_arms(run, j, -1, cp)
        if axes >= 0:
            clear(H, 12, 12)
            add_skew(H, 3 * load["torque"], 9, 1.0, (x, y, z))
            _add_block(run, j, axes, load["couple_marker"], cp)
        if axes >= 0 and i >= 0:
            clear(H, 12, 12)
            _add_axes_tangent_of_other(load, markers, x, y, z, H)
            _add_block(run, i, axes, load["couple_other"], cp)
    return SUCCESS


@kernel
def _add_axes_tangent_of_other(load, markers, x, y, z, H):
    """Add −∂(wrench on I)/∂(rotation of `axes`) to rows 0 to 5 and columns 9 to 11 of H."""
    add_skew(H, 3 * load["torque"], 9, -1.0, (x, y, z))
    if load["torque"] == 0:
        hx, hy, hz = separation(markers[load["other"]], markers[load["marker"]])
        # −h̃ F̃ = (h·F) I − F hᵀ
        dot = hx * x + hy * y + hz * z
        for k in range(3):
            h = hx if k == 0 else hy if k == 1 else hz
            H[3 + k, 9 + k] += dot
            H[3, 9 + k] -= x * h
            H[4, 9 + k] -= y * h
            H[5, 9 + k] -= z * h


@unit
def _add_block(run: Run, i: int, j: int, link: int, f: float) -> int:
    """Add the block f J_iᵀ H[:6, 6:] J_j to the matrix; both markers may be on one body."""
    parts, now, d = run.system.parts, run.work.now, run.work.dense
    a, b = parts.markers[i]["body"], parts.markers[j]["body"]
    if a < 0 or b < 0:
        return SUCCESS
    B, J, n, m = d.B, d.J, 6 + parts.bodies[a]["m"], 6 + parts.bodies[b]["m"]
    marker_jacobian(parts, now, i, J[0])
    marker_jacobian(parts, now, j, J[1])
    put_product_block(d.H, 0, 1, J[0], n, J[1], m, f, d.T, B)
    if a == b:
        add_body_block(run, a, B)
    else:
        add_coupling(run, a, b, link, 0, B)
    return SUCCESS


def _is_stiff(loads: Loads) -> bool:
    """Whether any load has the axes of another marker or a reaction on another body."""
    rows = loads.rows
    foreign = (rows["axes"] >= 0) & (rows["axes"] != rows["marker"])
    return bool((foreign | (rows["other"] >= 0)).any())


LOADS = Kind(
    "loads",
    Loads,
    {
        "wrench": add_wrenches,
        "matrix": add_tangents,
        "power": add_powers,
        "wrenches": put_wrench,
        "unit_force": put_unit_force,
    },
    lower=lower_loads,
    types=("force", "torque", "body-load"),
    couples=(
        ("couple", "other", "marker"),
        ("couple_marker", "marker", "axes"),
        ("couple_other", "other", "axes"),
    ),
    does_work=True,
    stiff=_is_stiff,
)
