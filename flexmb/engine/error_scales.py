"""Error scales: largest displacement and velocity of each coordinate so far.

Local errors are divided by them. They are `State.q_scale` and `State.v_scale`, weighted, i.e. over
the size of the model; `analysis.dynamics.run_settings` has their first values.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import weighted_max, zero
from flexmb.engine.bodies.motion import RELATIVE_ROUND_OFF
from flexmb.engine.jit import call_value, kernel, unit
from flexmb.engine.method import HIGH_ORDER, SUCCESS
from flexmb.engine.state import Run
from flexmb.engine.step_control import rate_of_driven

# Lower bounds of a scale: this share of the largest one of the same part of the model (methods of
# low order), and this share of the largest one of the model (all methods).
_MIN_PART_SHARE, _MIN_MODEL_SHARE = 1e-3, 1e-12
# Allowed extrapolation error of kinetostatic modes in a step over the accuracy, and its order. In
# steps shorter than the last share of the run it is a jump that no step size reduces: not counted.
_STATIC_ERROR_SHARE, _STATIC_ERROR_ORDER, _JUMP_STEP_SHARE = 0.3, 4.0, 1e-6
# Factor per step by which the recent speed decays; it limits steps that integrate only works. So
# does the rate of driven coordinates, which falls by this share while a phase at it changes by one.
_SPEED_DECAY, _RATE_DECAY = 0.8, 0.1


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
        _update_scales(st, w, iq, iv, 3)
        turn = 0.0
        for i in range(3, 7):  # Euler parameters change by half the angle
            turn = max(turn, 2.0 * abs(q[iq + i] - q_first[iq + i]))
        rate = max(abs(v[iv + 3]), abs(v[iv + 4]), abs(v[iv + 5]))
        _raise_scales(st, iv + 3, 3, turn, rate)
        memory["angular_velocity"] = max(memory["angular_velocity"], rate)
        _update_scales(st, w, iq + 7, iv + 6, m)
        if m > 0:
            _unify_flexible_body(st, iv, m, _gyration(bodies[k]) * w[iv])
    for k in range(coordinates.shape[0]):
        if coordinates[k]["state"] == 1:
            _update_scales_of_state(run, coordinates[k]["iq"], coordinates[k]["iv"])
        else:
            _update_scales(st, w, coordinates[k]["iq"], coordinates[k]["iv"], 1)
    motion, speed = 0.0, 0.0
    for i in range(v.shape[0]):
        motion, speed = max(motion, st.q_scale[i]), max(speed, st.v_scale[i])
    memory["max_displacement"] = max(motion, settings.least_motion)
    span = settings.end - settings.start
    speed = max(speed, memory["max_displacement"] / span)
    now = weighted_max(v, w)
    memory["max_velocity"] = max(memory["max_velocity"], now)
    memory["recent_speed"] = max(_SPEED_DECAY * memory["recent_speed"], now)
    if run.method.order < HIGH_ORDER:
        _raise_to_part_share(run, st.q_scale)
        _raise_to_part_share(run, st.v_scale)
    for i in range(v.shape[0]):
        st.q_scale[i] = max(st.q_scale[i], _MIN_MODEL_SHARE * memory["max_displacement"])
        st.v_scale[i] = max(st.v_scale[i], _MIN_MODEL_SHARE * speed, st.q_scale[i] / span)
    rate = rate_of_driven(run.system, st, st.vd)
    past = memory["driven_rate"]
    memory["driven_rate"] = max(past / (1.0 + _RATE_DECAY * memory["last_step"] * past), rate)
    return SUCCESS


@kernel
def _raise_to_part_share(run, scale):
    """Raise displacements or velocities to a share of the largest of points of their part."""
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
            scale[i] = max(scale[i], _MIN_PART_SHARE * least)
    for k in range(coordinates.shape[0]):
        iv = coordinates[k]["iv"]
        scale[iv] = max(scale[iv], _MIN_PART_SHARE * max(points[part[iv]], turns[part[iv]]))


@kernel
def _update_scales(st, weights, iq, iv, n):
    """Update the scales of n coordinates that share one, by their displacement and velocity."""
    motion, speed = 0.0, 0.0
    for i in range(n):
        motion = max(motion, weights[iv + i] * abs(st.q[iq + i] - st.q_first[iq + i]))
        speed = max(speed, weights[iv + i] * abs(st.v[iv + i]))
    _raise_scales(st, iv, n, motion, speed)


@kernel
def _update_scales_of_state(run, iq, iv):
    """Update the scales of a state, by its change so far as sensors see it, and of its integral.

    A temperature near 300 K that changes by 1 mK has the steps of one near 0 K that does. Only
    round-off of its value counts besides: its scale has at least that over the tolerance.
    """
    st, settings, first = run.state, run.settings, run.state.v_first[iv]
    least = RELATIVE_ROUND_OFF / settings.tolerance * abs(st.v[iv])
    speed = max(abs(st.v[iv] - first), least)
    way = abs(st.q[iq] - st.q_first[iq] - first * (st.t[0] - settings.start))
    way = max(way, least * (settings.end - settings.start))
    _raise_scales(st, iv, 1, way * run.system.weights[iv], speed * run.system.weights[iv])


@kernel
def _gyration(body):
    """Radius of gyration about the origin of the body frame [m]."""
    S0 = body["S0"]
    return math.sqrt((S0[0, 0] + S0[1, 1] + S0[2, 2]) / body["mass"])


@kernel
def _unify_flexible_body(st, iv, m, reach):
    """Give all coordinates of a flexible body one scale, that of points `reach` from its frame."""
    motion = max(st.q_scale[iv], reach * st.q_scale[iv + 3], st.q_scale[iv + 6])
    speed = max(st.v_scale[iv], reach * st.v_scale[iv + 3], st.v_scale[iv + 6])
    _raise_scales(st, iv, 3, motion, speed)
    _raise_scales(st, iv + 3, 3, motion / reach, speed / reach)
    _raise_scales(st, iv + 6, m, motion, speed)


@kernel
def _raise_scales(st, iv, n, motion, speed):
    """Raise the scales of n coordinates to at least these values."""
    for i in range(iv, iv + n):
        st.q_scale[i], st.v_scale[i] = (max(st.q_scale[i], motion), max(st.v_scale[i], speed))


@kernel
def add_static_error(run, h, order):
    """Raise the position error to that of kinetostatic modes extrapolated by h Trial.dq.

    Its ratio to its own tolerance is raised to a power, so that it has the order of the estimate.
    """
    settings, lag = run.settings, 0.0
    if h <= _JUMP_STEP_SHARE * (settings.end - settings.start):
        return
    units, tables = run.stages.static_lag.units, run.stages.static_lag.tables
    for k in range(len(units)):
        lag = max(lag, call_value(units[k], run, tables[k], run.trial_point))
    part = lag / (
        _STATIC_ERROR_SHARE * settings.accuracy * settings.max_rotation**_STATIC_ERROR_ORDER
    )
    allowed = settings.tolerance * settings.rejection_factor
    run.work.trial.error[0] = max(
        run.work.trial.error[0], allowed * part ** (order / _STATIC_ERROR_ORDER)
    )


@kernel
def add_static_error_of_path(run, h, order):
    """The same of kinetostatic modes with the rates and accelerations of the step's start."""
    st, dq = run.state, run.work.trial.dq
    for k in range(dq.shape[0]):
        dq[k] = st.v[k] + 0.5 * h * st.vd[k]
    add_static_error(run, h, order)
