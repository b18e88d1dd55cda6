"""The time loop: chunks of steps inside compiled code.

A chunk starts by forgetting the factor and ends with the complete state in `State`, so that a run
resumed at a chunk's border repeats the uninterrupted one bit for bit. Between chunks Python shows
progress, writes to the file and honours an interruption.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine.integrators import explicit, generalized_alpha
from flexmb.engine.jit import entry, inlined, kernel
from flexmb.engine.kernels import constraint, energy, force, kinematics, sensor
from flexmb.engine.kernels.projection import accelerations
from flexmb.engine.kernels.vector import copy, largest, store
from flexmb.engine.method import (
    AGE,
    FACTORISATIONS,
    FINE,
    NO_METHOD,
    NOT_FINITE,
    STEPS,
    ZERO_LENGTH,
)
from flexmb.engine.tables import System
from flexmb.engine.work import sizes


class Output(NamedTuple):
    """Rows of one chunk, allocated once."""

    t: np.ndarray  # (rows,)
    q: np.ndarray  # (rows, nq)
    v: np.ndarray  # (rows, nv)
    vd: np.ndarray  # (rows, nv)
    lam: np.ndarray  # (rows, nc)
    sensors: np.ndarray  # (rows, channels)
    energy: np.ndarray  # (rows, 7): kinetic, strain, gravity, spring, and three works
    drift: np.ndarray  # (rows, 2): largest |C|, and |Cq v + C_t| before v was projected
    rows: np.ndarray  # (1,) rows written so far


def new_output(system: System, rows: int, channels: int) -> Output:
    """Room for `rows` output rows."""
    nq, nv, nc = sizes(system)
    widths = (nq, nv, nv, nc, channels, 7, 2)
    tables = (np.empty((rows, w)) for w in widths)
    return Output(np.empty(rows), *tables, np.zeros(1, dtype=np.int64))


@inlined
def _accept(sys, settings, st, wk, h):
    """Add up the works of the step and make the trial state the state."""
    tr, now = wk.trial, wk.now
    kinematics.position(sys.parts, now, tr.q)
    if settings.works == 1:
        kinematics.velocity(sys.parts, now, tr.v)
        energy.powers(sys, now, wk.con.fun, tr.v, tr.lam, tr.power)
        for k in range(3):
            st.work_done[k] += 0.5 * h * (st.power[k] + tr.power[k])
            st.power[k] = tr.power[k]
    sensor.follow_angles(sys.sensors, now.marker, st.angles)
    st.t[0] = tr.t[0]
    store(tr.q, st.q)
    store(tr.v, st.v)
    copy(st.vd, st.vd_before)
    store(tr.vd, st.vd)
    store(tr.aa, st.aa)
    copy(st.lam, st.lam_before)
    store(tr.lam, st.lam)
    st.count[STEPS] += 1


@kernel
def report(sys, method, settings, st, wk, out):
    """Write the state at st.t to the next row, with projected accelerations and multipliers."""
    row = out.rows[0]
    cp = _filter(method.alpha, settings)
    tr, now = wk.trial, wk.now
    copy(st.v, tr.v)
    copy(st.vd, tr.vd)
    copy(st.lam, tr.lam)
    st.count[FACTORISATIONS] += 1
    st.memory[AGE] = -1.0
    if accelerations(sys, wk, st.t[0], st.q, tr.v, tr.vd, tr.lam, cp, 1) < 0:
        return ZERO_LENGTH
    constraint.evaluate(sys.rows, now.marker, wk.con)
    sensor.read(sys.sensors, sys.parts, now, tr.vd, st.angles, wk.dense.J[0], out.sensors[row])
    out.t[row] = st.t[0]
    copy(st.q, out.q[row])
    copy(tr.v, out.v[row])
    copy(tr.vd, out.vd[row])
    copy(tr.lam, out.lam[row])
    out.drift[row, 0] = largest(wk.con.C)
    out.drift[row, 1] = wk.con.drift[0]
    out.energy[row, 0] = energy.kinetic(sys.parts, now, tr.v, wk.dense.B)
    out.energy[row, 1] = energy.strain(sys.parts, st.q)
    out.energy[row, 2] = energy.gravitational(sys.parts, now, st.q)
    out.energy[row, 3] = force.spring_energy(sys.springs, now.marker)
    for k in range(3):
        out.energy[row, 4 + k] = st.work_done[k]
    if not (np.isfinite(out.energy[row, 0]) and np.isfinite(largest(tr.lam))):
        return NOT_FINITE
    out.rows[0] += 1
    return FINE


@kernel
def _filter(alpha, settings):
    """Factor cp of the matrix that reported accelerations are solved with, of order h²."""
    if alpha is not None and settings.determined == 0:
        h = settings.step
        return alpha.beta * h * h * (1.0 - alpha.alpha_f) / (1.0 - alpha.alpha_m)
    return 0.0


@entry
def march(sys, method, settings, st, wk, out, n_steps):
    """Run n_steps, or none: then only report the present state; returns the status."""
    out.rows[0] = 0
    done = 0
    status = FINE
    h = settings.step
    st.memory[AGE] = -1.0
    while status == FINE:
        every = settings.output_every
        if n_steps == 0 or (done > 0 and every > 0 and st.count[STEPS] % every == 0):
            status = report(sys, method, settings, st, wk, out)
        if status != FINE or done == n_steps:
            break
        status = generalized_alpha.step(sys, method.alpha, settings, st, wk, h)
        if status == NO_METHOD:
            status = explicit.step(sys, method.explicit, settings, st, wk, h)
        if status == FINE:
            _accept(sys, settings, st, wk, h)
            done += 1
    return status
