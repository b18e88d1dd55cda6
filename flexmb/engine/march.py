"""The time loop: chunks of steps inside compiled code.

A chunk starts by forgetting the factor and ends with the complete state in `State`, so that a run
resumed at a chunk's border repeats the uninterrupted one bit for bit. Between chunks Python shows
progress, writes to the file and honours an interruption. With fixed steps outputs fall on steps;
with error control they are interpolated inside an accepted step and put back on the constraints.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine import control, events, kinks
from flexmb.engine.integrators import explicit, generalized_alpha
from flexmb.engine.jit import entry, inlined, kernel
from flexmb.engine.kernels import energy
from flexmb.engine.kernels.algebra.interpolation import hermite, interpolate
from flexmb.engine.kernels.algebra.vector import copy, largest, store
from flexmb.engine.kernels.bodies import kinematics
from flexmb.engine.kernels.forces import contact, element, force, joint_friction, memory
from flexmb.engine.kernels.joints import constraint, coordinate, reaction, slider
from flexmb.engine.kernels.projection import accelerations
from flexmb.engine.kernels.sensors import sensor, signal
from flexmb.engine.method import (
    AGE,
    CURVE_END,
    FACTORISATIONS,
    FINE,
    GRID,
    LAST_STEP,
    NO_METHOD,
    NOT_FINITE,
    OUTPUTS,
    PART,
    STEPS,
    TOO_SMALL,
)
from flexmb.engine.tables import System
from flexmb.engine.work import sizes

# What accelerations() does to the state first.
_PROJECT_VELOCITIES, _PROJECT_ALL = 1, 2


class Output(NamedTuple):
    """Rows of one chunk, allocated once."""

    t: np.ndarray  # (rows,)
    q: np.ndarray  # (rows, nq)
    v: np.ndarray  # (rows, nv)
    vd: np.ndarray  # (rows, nv)
    lam: np.ndarray  # (rows, nc)
    reactions: np.ndarray  # (rows, 12 groups), as `layout.Layout` says
    sensors: np.ndarray  # (rows, channels)
    energy: np.ndarray  # (rows, 7): kinetic, strain, gravity, spring, and three works
    drift: np.ndarray  # (rows, 2): largest |C|, and |Cq v + C_t| before v was projected
    rows: np.ndarray  # (1,) rows written so far


def new_output(system: System, rows: int, channels: int) -> Output:
    """Room for `rows` output rows."""
    nq, nv, nc = sizes(system)
    widths = (nq, nv, nv, nc, 12 * len(system.groups), channels, 7, 2)
    tables = (np.empty((rows, w)) for w in widths)
    return Output(np.empty(rows), *tables, np.zeros(1, dtype=np.int64))


@inlined
def _accept(sys, settings, st, wk, h):
    """Add up the works of the step and make the trial state the state."""
    tr, now, before = wk.trial, wk.now, wk.trial.before
    before.t[0] = st.t[0]
    if settings.step == 0.0:
        copy(st.q, before.q)
        copy(st.v, before.v)
        copy(st.work_done, before.work_done)
        copy(st.power, before.power)
        copy(st.kept, before.kept)
    kinematics.position(sys.parts, now, tr.q)
    if settings.works == 1:
        element.position(sys.elements, sys.parts.coordinates, now, tr.q)
        kinematics.velocity(sys.parts, now, tr.v)
        signal.stage(sys.signals, sys, wk, tr.t[0], tr.q, tr.v, tr.vd, tr.lam)
        joint_friction.put_grips(sys, sys.frictions, wk, tr.lam)
        energy.powers(sys, now, wk.con.fun, tr.v, tr.lam, tr.power)
        tr.power[1] += joint_friction.power(sys.frictions, sys.parts.coordinates, now, tr.q, tr.v)
        for k in range(3):
            st.work_done[k] += 0.5 * h * (st.power[k] + tr.power[k])
            st.power[k] = tr.power[k]
    memory.keep(sys, sys.contacts, sys.frictions, now, tr.t[0], tr.q, tr.v, st.kept)
    sensor.follow_angles(sys.sensors, now.marker, st.angles)
    sensor.follow_turns(sys.further, sys.sensors, now.marker, st.angles)
    signal.remember(sys.signals, wk, st.angles)
    st.t[0] = tr.t[0]
    store(tr.q, st.q)
    store(tr.v, st.v)
    copy(st.vd, st.vd_before)
    store(tr.vd, st.vd)
    store(tr.aa, st.aa)
    if settings.step == 0.0:
        copy(st.jerk, st.jerk_before)
        copy(tr.jerk, st.jerk)
    copy(st.lam, st.lam_before)
    store(tr.lam, st.lam)
    st.count[STEPS] += 1
    if settings.step == 0.0:
        control.follow_motion(sys, st)


@inlined
def _advance(sys, method, settings, st, wk, room):
    """One accepted step of the size that works; or the status of the last one tried."""
    if settings.step == 0.0:
        code = kinks.cross(sys, sys.kinks, settings, st, wk, _filter(method.alpha, settings, st))
        if code < 0:
            return control.failure(code)
    while True:
        h = control.proposed(settings, sys.kinks, st, room)
        status = generalized_alpha.step(sys, method.alpha, settings, st, wk, h)
        if status == NO_METHOD:
            status = explicit.step(sys, method.explicit, settings, st, wk, h)
        if status == FINE and slider.beyond(sys.parts.sliders, sys.parts, wk.trial.q) >= 0:
            status = CURVE_END
        verdict = control.rejected(settings, st, wk.trial.error, status, h)
        if verdict == FINE:
            if events.missed(sys, sys.contacts, sys.frictions, sys.stops, settings, st, wk, h):
                continue
            wk.trial.t[0] = control.exact_time(settings, sys.kinks, st, h)
            _accept(sys, settings, st, wk, h)
            control.accepted(settings, st, wk.trial.error, h)
            events.accepted(sys, sys.contacts, sys.frictions, sys.stops, settings, st, wk, h)
            return FINE
        if verdict == TOO_SMALL:
            return status if status != FINE else TOO_SMALL


@kernel
def _due(settings, st):
    """Whether an output is due at or before the present time."""
    if settings.step > 0.0:
        every = int(settings.interval / settings.step + 0.5)
        return st.memory[PART] == 0.0 and st.count[GRID] == st.count[OUTPUTS] * every
    return control.next_output(settings, st) <= st.t[0] + 1e-9 * settings.interval


@kernel
def _place(sys, settings, st, wk):
    """Put the state at the next output time into the trial state; returns what to project."""
    tr = wk.trial
    before, now = tr.before, control.next_output(settings, st)
    copy(st.vd, tr.vd)
    copy(st.lam, tr.lam)
    copy(st.angles, tr.angles)
    copy(st.kept, wk.now.kept)
    if settings.step > 0.0 or now >= st.t[0] - 1e-12 * settings.interval:
        tr.t[0] = st.t[0]
        copy(st.q, tr.q)
        copy(st.v, tr.v)
        copy(st.work_done, tr.work_done)
        return _PROJECT_VELOCITIES if settings.step > 0.0 else _PROJECT_ALL
    h = st.t[0] - before.t[0]
    share = (now - before.t[0]) / h
    tr.t[0] = now
    copy(before.kept, wk.now.kept)
    interpolate(sys.parts, before, st.t[0], st.q, st.v, share, tr.q, tr.v)
    for k in range(3):
        tr.work_done[k], _ = hermite(
            share, h, before.work_done[k], st.work_done[k], before.power[k], st.power[k]
        )
    return _PROJECT_ALL


@kernel
def _report(sys, method, settings, st, wk, out):
    """Write the next output row, with projected accelerations and multipliers."""
    row, tr, now = out.rows[0], wk.trial, wk.now
    project = _place(sys, settings, st, wk)
    cp = _filter(method.alpha, settings, st)
    st.count[FACTORISATIONS] += 1
    st.memory[AGE] = -1.0
    code = accelerations(sys, wk, tr.t[0], tr.q, tr.v, tr.vd, tr.lam, cp, project)
    if code < 0:
        return control.failure(code)
    constraint.evaluate(sys.lines, sys.rows, now.marker, wk.con)
    sensor.follow_angles(sys.sensors, now.marker, tr.angles)
    sensor.follow_turns(sys.further, sys.sensors, now.marker, tr.angles)
    reaction.read(sys, now.marker, tr.lam, wk.dense.g, out.reactions[row])
    out.t[row] = tr.t[0]
    copy(tr.q, out.q[row])
    copy(tr.v, out.v[row])
    copy(tr.vd, out.vd[row])
    copy(tr.lam, out.lam[row])
    out.drift[row, 0] = largest(wk.con.C)
    out.drift[row, 1] = wk.con.drift[0]
    out.energy[row, 0] = energy.kinetic(sys.parts, now, tr.v, wk.dense.B)
    out.energy[row, 1] = energy.strain(sys.parts, tr.q)
    out.energy[row, 2] = energy.gravitational(sys.parts, now, tr.q)
    out.energy[row, 3] = force.spring_energy(sys.springs, now.marker)
    out.energy[row, 3] += coordinate.spring_energy(sys.parts.coordinates, tr.q)
    out.energy[row, 3] += contact.energy(sys.contacts, now.marker)
    out.energy[row, 3] += element.energy(sys.elements, sys.parts.coordinates, now, tr.v)
    for k in range(3):
        out.energy[row, 4 + k] = tr.work_done[k]
    # The power of friction counts what goes into its bristles too; that is not lost yet.
    bristles = contact.bristle_energy(sys.contacts, now)
    bristles += joint_friction.bristle_energy(sys.frictions, sys.parts.coordinates, now, tr.q, tr.v)
    out.energy[row, 3] += bristles
    out.energy[row, 5] += bristles
    copy(st.kept, now.kept)
    sensor.read(
        sys.further, sys, wk, tr.t[0], tr.q, tr.v, tr.vd, tr.lam, out.energy[row], tr.angles,
        out.sensors[row],
    )  # fmt: skip
    if not (np.isfinite(out.energy[row, 0]) and np.isfinite(largest(tr.lam))):
        return NOT_FINITE
    out.rows[0] += 1
    st.count[OUTPUTS] += 1
    return FINE


@kernel
def _filter(alpha, settings, st):
    """Factor cp of the matrix that reported accelerations are solved with, of order h²."""
    if alpha is not None and settings.determined == 0:
        h = settings.step if settings.step > 0.0 else st.memory[LAST_STEP]
        return alpha.beta * h * h * (1.0 - alpha.alpha_f) / (1.0 - alpha.alpha_m)
    return 0.0


@entry
def march(sys, method, settings, st, wk, out, n_steps):
    """Run n_steps, or until the end or until `out` is full; returns the status.

    Outputs that are due are written, also before the first step.
    """
    out.rows[0] = 0
    done = 0
    status = FINE
    st.memory[AGE] = -1.0
    signal.remember(sys.signals, wk, st.angles)
    copy(st.kept, wk.now.kept)
    control.begin(sys, settings, st)
    events.begin(sys, sys.contacts, sys.frictions, sys.stops, st, wk)
    while status == FINE:
        if _due(settings, st):
            status = _report(sys, method, settings, st, wk, out)
            continue
        room = out.t.shape[0] - out.rows[0]
        if done == n_steps or control.at_end(settings, st) or (done > 0 and room < 3):
            break
        status = _advance(sys, method, settings, st, wk, room)
        done += 1
    return status
