"""Kinematics of the coordinates: q ∘ exp(δ), q̇ = N(q) v, and dense output of a step.

This is the only module that depends on the representation of orientations. Dense output is a cubic
Hermite interpolation of the displacement from the start of the step, with values and rates at both
ends; for orientations it is the rotation vector ψ(s), with ψ̇ = T(ψ)⁻¹ ω' at the ends. Its error is
of order h⁴. A method that provides the next term, `Trial.dense_correction` times s² (1 − s)², has
order h⁵.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import (
    compose,
    cross,
    inner,
    part,
    plus,
    put_part,
    rotation_vector,
    tangent_coefficients,
    triple,
    zero,
)
from flexmb.engine.jit import Vector, kernel, unit
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import Run
from flexmb.engine.tables import Parts

# Corrections of this size, relative to a position or to the value of a driver, are round-off.
RELATIVE_ROUND_OFF = 1e-15
# Rotation of a body in a step that is always accepted, rad. A larger one must not exceed twice the
# rotation that the angular velocities at both ends give.
_MAX_ROTATION = 1.5


@unit
def move(parts: Parts, q: Vector, dq: Vector, out: Vector) -> int:
    """out = q ∘ exp(dq): translations and modes are added, rotations multiplied from the right."""
    bodies, coordinates = parts.bodies, parts.coordinates
    for k in range(coordinates.shape[0]):
        out[coordinates[k]["iq"]] = q[coordinates[k]["iq"]] + dq[coordinates[k]["iv"]]
    for k in range(bodies.shape[0]):
        body = bodies[k]
        i, o = body["iq"], body["iv"]
        out[i] = q[i] + dq[o]
        out[i + 1] = q[i + 1] + dq[o + 1]
        out[i + 2] = q[i + 2] + dq[o + 2]
        compose(q, i + 3, dq[o + 3], dq[o + 4], dq[o + 5], out, i + 3)
        for j in range(body["m"]):
            out[i + 7 + j] = q[i + 7 + j] + dq[o + 6 + j]
    return 0


@kernel
def position_rate(parts, q, v, out):
    """out (nq) = N(q) v; Euler parameters: ṗ = ½ p ∘ (0, ω')."""
    coordinates = parts.coordinates
    for k in range(coordinates.shape[0]):
        out[coordinates[k]["iq"]] = v[coordinates[k]["iv"]]
    for k in range(parts.bodies.shape[0]):
        body = parts.bodies[k]
        i, o = body["iq"], body["iv"]
        for a in range(3):
            out[i + a] = v[o + a]
        x, y, z = 0.5 * v[o + 3], 0.5 * v[o + 4], 0.5 * v[o + 5]
        e0, e1, e2, e3 = q[i + 3], q[i + 4], q[i + 5], q[i + 6]
        out[i + 3] = -e1 * x - e2 * y - e3 * z
        out[i + 4] = e0 * x + e2 * z - e3 * y
        out[i + 5] = e0 * y + e3 * x - e1 * z
        out[i + 6] = e0 * z + e1 * y - e2 * x
        for j in range(body["m"]):
            out[i + 7 + j] = v[o + 6 + j]


@kernel
def motion_of_rate(parts, q, rate, out):
    """out (nv): the velocities v for which N(q) v is nearest to rate (nq)."""
    coordinates = parts.coordinates
    for k in range(coordinates.shape[0]):
        out[coordinates[k]["iv"]] = rate[coordinates[k]["iq"]]
    for k in range(parts.bodies.shape[0]):
        body = parts.bodies[k]
        i, o = body["iq"], body["iv"]
        for a in range(3):
            out[o + a] = rate[i + a]
        e0, e1, e2, e3 = q[i + 3], q[i + 4], q[i + 5], q[i + 6]
        d0, d1, d2, d3 = rate[i + 3], rate[i + 4], rate[i + 5], rate[i + 6]
        out[o + 3] = 2.0 * (e0 * d1 - e1 * d0 - e2 * d3 + e3 * d2)
        out[o + 4] = 2.0 * (e0 * d2 - e2 * d0 - e3 * d1 + e1 * d3)
        out[o + 5] = 2.0 * (e0 * d3 - e3 * d0 - e1 * d2 + e2 * d1)
        for j in range(body["m"]):
            out[o + 6 + j] = rate[i + 7 + j]


@kernel
def normalise(bodies, q):
    """Scale the Euler parameters of all bodies to length one."""
    for k in range(bodies.shape[0]):
        i = bodies[k]["iq"] + 3
        s = q[i] * q[i] + q[i + 1] * q[i + 1] + q[i + 2] * q[i + 2] + q[i + 3] * q[i + 3]
        s = 1.0 / math.sqrt(s)
        for a in range(4):
            q[i + a] *= s


@unit
def put_dq_round_off(run: Run, h: float) -> int:
    """Set Trial.dq_round_off: size of a correction of each coordinate that is round-off, weighted.

    It is the largest of four: its value at the first pose (State.first_round_off); the round-off of
    the driver functions, where a driver acts; that of the displacement so far; and that of the
    present position. Of a state, a velocity whose position no force needs, it is that at the first
    pose. Under error control it is that of its value times the size h of a step, and of the terms
    that add up to its rate; if a body acts on it, at least that at the first pose.
    """
    st, tr, bodies, rows = run.state, run.work.trial, run.system.parts.bodies, run.system.rows
    coordinates = run.system.parts.coordinates
    places, first, weights, driven = tr.dq_round_off, st.first_round_off, run.system.weights, 0.0
    for r in range(rows.shape[0]):
        if rows[r]["fun"] >= 0:
            moved = abs(run.work.con.fun[rows[r]["fun"], 0])
            driven = max(driven, RELATIVE_ROUND_OFF * moved * run.system.row_weights[r])
    for i in range(places.shape[0]):
        places[i] = max(first[0, i], driven * first[1, i], RELATIVE_ROUND_OFF * st.q_scale[i])
    for k in range(bodies.shape[0]):
        i, o = bodies[k]["iq"], bodies[k]["iv"]
        far = (
            RELATIVE_ROUND_OFF * max(abs(st.q[i]), abs(st.q[i + 1]), abs(st.q[i + 2])) * weights[o]
        )
        for a in range(3):
            places[o + a] = max(places[o + a], far)
    for k in range(coordinates.shape[0]):
        o, far = coordinates[k]["iv"], RELATIVE_ROUND_OFF * abs(st.q[coordinates[k]["iq"]])
        places[o] = max(places[o], far * weights[o])
        if coordinates[k]["state"] == 1:
            alone = first[1, o] == 1.0
            size = h * max(abs(st.v[o]) * weights[o], st.v_scale[o] if alone else 0.0)
            terms = run.work.feedback.rate_terms
            size = max(size, h * h * terms[0, o] * weights[o] / (1.0 + h * terms[1, o]))
            if run.settings.step > 0.0:
                size = 1.0
            places[o] = first[0, o] * (size if alone else max(size, 1.0))
    return SUCCESS


@kernel
def put_q_round_off(parts, q, dq):
    """Set dq (nv) to the round-off of each coordinate at a pose q.

    That of a rotation is the round-off of the position of the body over the distance of its
    farthest marker, and at least `RELATIVE_ROUND_OFF`.
    """
    bodies, markers, coordinates = parts.bodies, parts.markers, parts.coordinates
    zero(dq)
    for k in range(markers.shape[0]):
        if markers[k]["body"] >= 0:
            o, arm = bodies[markers[k]["body"]]["iv"] + 3, triple(markers[k]["rho"])
            arm = plus(arm, 1.0, triple(markers[k]["arm"]))
            dq[o] = max(dq[o], math.sqrt(inner(arm, arm)))
    for k in range(bodies.shape[0]):
        i, o = bodies[k]["iq"], bodies[k]["iv"]
        far = max(abs(q[i]), abs(q[i + 1]), abs(q[i + 2]))
        turn = max(far / dq[o + 3], 1.0) if dq[o + 3] > 0.0 else 1.0
        for a in range(3):
            dq[o + a], dq[o + 3 + a] = RELATIVE_ROUND_OFF * abs(q[i + a]), RELATIVE_ROUND_OFF * turn
        for a in range(bodies[k]["m"]):
            dq[o + 6 + a] = RELATIVE_ROUND_OFF * abs(q[i + 7 + a])
    for k in range(coordinates.shape[0]):
        dq[coordinates[k]["iv"]] = RELATIVE_ROUND_OFF * abs(q[coordinates[k]["iq"]])


@kernel
def rotates_too_far(run, h):
    """Whether a step has rotated a body by far more than its velocities at both ends give.

    Joints constrain orientations by dot products of axes, which vanish for several orientations:
    Newton's method may converge to a wrong one. An angle coordinate that follows a joint may be
    wrong by full turns.
    """
    st, tr, bodies = run.state, run.work.trial, run.system.parts.bodies
    for k in range(bodies.shape[0]):
        i, o = bodies[k]["iq"] + 3, bodies[k]["iv"] + 3
        same, before, after = 0.0, part(st.v, o), part(tr.v, o)
        for a in range(4):
            same += st.q[i + a] * tr.q[i + a]
        rate = math.sqrt(max(inner(before, before), inner(after, after)))
        if abs(same) < math.cos(0.5 * max(_MAX_ROTATION, min(2.0 * rate * h, math.pi))):
            return True
    rows, coupled, coordinates = run.system.rows, run.system.coupled, run.system.parts.coordinates
    for k in range(coupled.shape[0]):
        i = coordinates[coupled[k]["coordinate"]]["iq"]
        periodic = run.rows.period[rows[coupled[k]["row"]]["kind"]] > 0.0
        most = math.pi + st.memory[0]["angular_velocity"] * h
        if periodic and abs(coupled[k]["factor"] * (tr.q[i] - st.q[i])) > most:
            return True
    return False


@kernel
def max_over_round_off(run, dq):
    """The largest ratio of dq (nv) to the round-off of its coordinate; NaN counts as largest."""
    places, weights, most = run.work.trial.dq_round_off, run.system.weights, 0.0
    for i in range(dq.shape[0]):
        s = abs(dq[i]) * weights[i]
        if not s <= most * places[i]:
            most = s / places[i] if places[i] > 0.0 else math.inf
            if s != s:
                return s
    return most


@kernel
def is_round_off(run, dq, times):
    """Whether dq (nv) is at most `times` the round-off of corrections at the first pose."""
    places, weights, within = run.state.first_round_off, run.system.weights, True
    for i in range(dq.shape[0]):
        within = within and abs(dq[i]) * weights[i] <= times * places[0, i]
    return within


@kernel
def hermite(s, h, y0, y1, d0, d1):
    """Value and rate at the share s of a step h of the cubic with values y and rates d."""
    a, b = y1 - y0, h * d0
    c2 = 3.0 * a - 2.0 * b - h * d1
    c3 = b + h * d1 - 2.0 * a
    return y0 + s * (b + s * (c2 + s * c3)), (b + s * (2.0 * c2 + 3.0 * s * c3)) / h


@kernel
def interpolate_step(run, share):
    """Put q, v and works at a fraction of the last accepted step into the trial state."""
    st, tr, before, parts = run.state, run.work.trial, run.work.trial.before, run.system.parts
    h, both = st.t[0] - before.t[0], share * (1.0 - share)
    put_motion(run, share, tr.dq, tr.v)
    for k in range(tr.dq.shape[0]):
        tr.dq[k] += tr.dense_correction[k] * both * both
        tr.v[k] += tr.dense_correction[k] * 2.0 * both * (1.0 - 2.0 * share) / h
    for b in range(parts.bodies.shape[0]):
        o = parts.bodies[b]["iv"] + 3
        put_part(tr.v, o, angular_velocity(part(tr.dq, o), part(tr.v, o)))
    move(parts, before.q, tr.dq, tr.q)
    for k in range(3):
        tr.work_done[k], _ = hermite(
            share, h, before.work_done[k], st.work_done[k], before.power[k], st.power[k]
        )
    return SUCCESS


@kernel
def put_motion(run, share, u, rate):
    """Displacement u (nv) from the start of the last accepted step, and its rate, by cubics."""
    st, before, parts = run.state, run.work.trial.before, run.system.parts
    h = st.t[0] - before.t[0]
    for k in range(parts.bodies.shape[0]):
        iq, iv = parts.bodies[k]["iq"], parts.bodies[k]["iv"]
        for i in range(3):
            _interpolate_coordinate(st, before, h, share, iq + i, iv + i, u, rate)
        turn = rotation_vector(before.q, iq + 3, st.q, iq + 3)
        first, last = part(before.v, iv + 3), rotation_rate(turn, part(st.v, iv + 3))
        for i in range(3):
            o = iv + 3 + i
            u[o], rate[o] = hermite(share, h, 0.0, turn[i], first[i], last[i])
        for i in range(parts.bodies[k]["m"]):
            _interpolate_coordinate(st, before, h, share, iq + 7 + i, iv + 6 + i, u, rate)
    for k in range(parts.coordinates.shape[0]):
        own = parts.coordinates[k]
        _interpolate_coordinate(st, before, h, share, own["iq"], own["iv"], u, rate)


@kernel
def _interpolate_coordinate(st, before, h, share, iq, iv, u, rate):
    """Displacement and rate of one coordinate that is no rotation."""
    moved = st.q[iq] - before.q[iq]
    u[iv], rate[iv] = hermite(share, h, 0.0, moved, before.v[iv], st.v[iv])


@kernel
def angular_velocity(theta, rate):
    """T(θ) θ̇ in body axes, of the orientation exp(θ̃)."""
    c1, c2, _, _ = tangent_coefficients(inner(theta, theta))
    once = cross(theta, rate)
    return plus(plus(rate, -c1, once), c2, cross(theta, once))


@kernel
def rotation_rate(theta, omega):
    """T(θ)⁻¹ ω of the orientation exp(θ̃), ω in body axes: ω + ½ θ×ω + c θ×(θ×ω)."""
    x = inner(theta, theta)
    if x < 0.1:
        c = 1.0 / 12.0 + x * (1.0 / 720.0 + x * (1.0 / 30240.0 + x / 1209600.0))
    else:
        c1, c2, _, _ = tangent_coefficients(x)
        c = (1.0 - 0.5 * (1.0 - x * c2) / c1) / x
    once = cross(theta, omega)
    return plus(plus(omega, 0.5, once), c, cross(theta, once))
