"""Error scales: what the error of each coordinate is compared with, its motion and speed so far.

`State.motion` and `State.speed` hold them, in weighted size; see `analysis.dynamics.run_settings`
for their first values.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import weighted_max, zero
from flexmb.engine.jit import kernel, unit
from flexmb.engine.method import HIGH_ORDER, SUCCESS
from flexmb.engine.state import Run

# Motion counts as this share at least of the largest one: by low order of that of the same part
# of the model, by all of any.
_LEAST_SHARE, _NOTHING_SHARE = 1e-3, 1e-12
# Share of the speed so far that still counts after a step, where only work is integrated.
_SPEED_DECAY = 0.8


@unit
def update_error_scales(run: Run) -> int:
    """Update the error scales: largest displacement from the first pose, and largest speed so far.

    The coordinates of a translation share one scale, and those of a rotation. All coordinates of a
    flexible body share that of its points, since frame and modes are not observed separately.
    """
    st, settings, w = run.state, run.settings, run.system.weights
    bodies, coordinates = run.system.parts.bodies, run.system.parts.coordinates
    q, q_first, v, memory = st.q, st.q_first, st.v, st.memory[0]
    memory["angular_velocity"] = 0.0
    for k in range(bodies.shape[0]):
        iq, iv, m = bodies[k]["iq"], bodies[k]["iv"], bodies[k]["m"]
        _follow(st, w, iq, iv, 3)
        turn = 0.0
        for i in range(3, 7):  # Euler parameters change by half the angle
            turn = max(turn, 2.0 * abs(q[iq + i] - q_first[iq + i]))
        rate = max(abs(v[iv + 3]), abs(v[iv + 4]), abs(v[iv + 5]))
        _raise(st, iv + 3, 3, turn, rate)
        memory["angular_velocity"] = max(memory["angular_velocity"], rate)
        _follow(st, w, iq + 7, iv + 6, m)
        if m > 0:
            _join(st, iv, m, _gyration(bodies[k]) * w[iv])
    for k in range(coordinates.shape[0]):
        _follow(st, w, coordinates[k]["iq"], coordinates[k]["iv"], 1)
    motion, speed = 0.0, 0.0
    for i in range(v.shape[0]):
        motion, speed = max(motion, st.motion[i]), max(speed, st.speed[i])
    memory["max_displacement"] = max(motion, settings.least_motion)
    span = settings.end - settings.start
    speed = max(speed, memory["max_displacement"] / span)
    now = weighted_max(v, w)
    memory["max_velocity"] = max(memory["max_velocity"], now)
    memory["recent_speed"] = max(_SPEED_DECAY * memory["recent_speed"], now)
    if run.method.order < HIGH_ORDER:
        _raise_to_part(run, st.motion)
        _raise_to_part(run, st.speed)
    for i in range(v.shape[0]):
        st.motion[i] = max(st.motion[i], _NOTHING_SHARE * memory["max_displacement"])
        st.speed[i] = max(st.speed[i], _NOTHING_SHARE * speed, st.motion[i] / span)
    return SUCCESS


@kernel
def _raise_to_part(run, scale):
    """Let motions or speeds be a share of the largest one of points of their part of the model."""
    bodies, coordinates = run.system.parts.bodies, run.system.parts.coordinates
    part, w, trial = run.system.part, run.system.weights, run.work.trial
    points, turns, reach = trial.spare, trial.dq, trial.res  # by part
    zero(points)
    zero(turns)
    zero(reach)
    for k in range(bodies.shape[0]):
        iv = bodies[k]["iv"]
        p, own = part[iv + 3], _gyration(bodies[k]) * w[iv]
        points[p] = max(points[p], scale[iv], own * scale[iv + 3])
        turns[p], reach[p] = max(turns[p], scale[iv + 3]), max(reach[p], own)
    for k in range(coordinates.shape[0]):
        iv = coordinates[k]["iv"]
        points[part[iv]] = max(points[part[iv]], scale[iv])
    for k in range(bodies.shape[0]):
        iv, m = bodies[k]["iv"], bodies[k]["m"]
        p = part[iv + 3]
        turn = max(turns[p], points[p] / reach[p]) if reach[p] > 0.0 else turns[p]
        for i in range(iv, iv + 6 + m):
            least = turn if iv + 3 <= i < iv + 6 else points[p]
            scale[i] = max(scale[i], _LEAST_SHARE * least)
    for k in range(coordinates.shape[0]):
        iv = coordinates[k]["iv"]
        scale[iv] = max(scale[iv], _LEAST_SHARE * max(points[part[iv]], turns[part[iv]]))


@kernel
def _follow(st, weights, iq, iv, n):
    """Motion and speed of n coordinates that count together."""
    motion, speed = 0.0, 0.0
    for i in range(n):
        motion = max(motion, weights[iv + i] * abs(st.q[iq + i] - st.q_first[iq + i]))
        speed = max(speed, weights[iv + i] * abs(st.v[iv + i]))
    _raise(st, iv, n, motion, speed)


@kernel
def _gyration(body):
    """Radius of gyration about the origin of the frame [m]."""
    S0 = body["S0"]
    return math.sqrt((S0[0, 0] + S0[1, 1] + S0[2, 2]) / body["mass"])


@kernel
def _join(st, iv, m, reach):
    """Let all coordinates of a flexible body count with the motion of its points, `reach` away."""
    motion = max(st.motion[iv], reach * st.motion[iv + 3], st.motion[iv + 6])
    speed = max(st.speed[iv], reach * st.speed[iv + 3], st.speed[iv + 6])
    _raise(st, iv, 3, motion, speed)
    _raise(st, iv + 3, 3, motion / reach, speed / reach)
    _raise(st, iv + 6, m, motion, speed)


@kernel
def _raise(st, iv, n, motion, speed):
    """Let the scales of n coordinates be these at least."""
    for i in range(iv, iv + n):
        st.motion[i], st.speed[i] = max(st.motion[i], motion), max(st.speed[i], speed)
