"""Quasi-static modes: modal coordinates η_s in static equilibrium, K_ss η_s = Q_s − Cq_sᵀ λ.

Their bodies have no modal mass of them (`flexbody.effects.without_modal_inertia`): next to dynamic
modes they act as a residual flexibility (MacNeal, Computers & Structures 1, 1971, 581). Implicit
methods solve for η_s together with all other unknowns; the iteration matrix then holds b K_ss.

Kinetostatic bodies (deformation "quasi-static"; all such bodies in explicit methods) have
prescribed accelerations of η_s within a step, by a large artificial mass τ² K_ss. After the step
η_s is moved to equilibrium with the loads, with the λ of a motion at constant η_s, and positions
are projected with the deformed body: the slow solution, without vibrations on this compliance. In
this iteration η̇_s = 0 from the start: with other rates the loads change, and projecting velocities
at another pose would change the motion by the same amount in each step, however short.

Rates and accelerations of η_s for the next step: `static_mode_rates`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from flexmb.engine.algebra.anderson import accelerate
from flexmb.engine.algebra.vector import larger
from flexmb.engine.bodies.static_mode_rates import (
    clear_history,
    extrapolation_error,
    put_mode_forces,
    put_rates,
    put_stage_accelerations,
    record_point_ahead,
    update_history,
)
from flexmb.engine.bodies.static_mode_tables import StaticModes, new_scratch
from flexmb.engine.jit import Integers, kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import Point, Run
from flexmb.engine.tables import System

if TYPE_CHECKING:
    from numpy.typing import NDArray


# The modes are in equilibrium with their loads if they change by less than this, as a displacement
# over the size of their part of the model.
STATIC_TOLERANCE = 1e-11
# Ratio of successive changes above which the iteration is accelerated (Anderson).
_MAX_CONTRACTION = 0.3
# Negative stiffness of modes with their loads, over the elastic one, that means instability.
_UNSTABLE_SHARE = 0.05


@unit
def add_static_mass(run: Run, of: StaticModes, at: Point, cv: float, cp: float) -> int:
    """Add τ² K_ss to the matrix: of kinetostatic bodies, and of all bodies in single solves."""
    parts, kkt, fac = run.system.parts, run.system.kkt, run.work.factor
    for n in range(of.rows.shape[0]):
        if of.kinetostatic[n] == 0 and (cv != 0.0 or cp != 0.0):
            continue
        body = parts.bodies[of.rows[n]]
        panel, m, o = kkt.panels[body["panel"]], body["m"], body["iv"] + 6
        K = body["flex"] + 12 * m + m * m
        for i in range(of.first[n], of.first[n + 1]):
            r = kkt.column[o + of.modes[i]]
            for j in range(of.first[n], of.first[n + 1]):
                c = kkt.column[o + of.modes[j]]
                x = of.mass_factor[n] * parts.pool[K + of.modes[i] * m + of.modes[j]]
                if r >= c:
                    fac.low[panel["at"] + r * panel["nc"] + c] += x
                if r <= c:
                    fac.up[panel["at"] + c * panel["nc"] + r] += x
    return SUCCESS


@unit
def zero_residual(run: Run, of: StaticModes, at: Point) -> int:
    """Set the residual of the modes of kinetostatic bodies to zero: Newton's method keeps them."""
    for n in range(of.rows.shape[0]):
        if of.kinetostatic[n] == 1:
            iv = run.system.parts.bodies[of.rows[n]]["iv"] + 6
            for k in range(of.first[n], of.first[n + 1]):
                run.work.trial.res[iv + of.modes[k]] = 0.0
    return SUCCESS


@unit
def follow_loads(run: Run, of: StaticModes, at: Point) -> float:
    """Move the modes towards equilibrium with Trial.res, with zero rates; the largest change.

    A zero residual starts a new iteration. If loads change more than the modes do, as the force in
    a rod beyond its buckling load, the iteration diverges; it is then accelerated (`anderson`). The
    change is infinite if the stiffness with the loads is negative, as beyond a critical speed: no
    equilibrium is stable.
    """
    bodies, weights, res = run.system.parts.bodies, of.reach, run.work.trial.res
    iterates, loop = of.scratch.iterates, of.scratch.loop[0]
    change, stiffness, elastic, place = 0.0, 0.0, 0.0, 0
    for n in range(of.rows.shape[0]):
        body, begin, end = bodies[of.rows[n]], of.first[n], of.first[n + 1]
        if of.kinetostatic[n] == 0 and run.method.stages == 0:
            place += (end - begin) ** 2
            continue
        iq, iv = body["iq"] + 7, body["iv"] + 6
        for i in range(begin, end):
            step, weight = 0.0, weights[i]
            for j in range(begin, end):
                step -= of.compliance[place] * res[iv + of.modes[j]]
                place += 1
            iterates.now[i], iterates.step[i] = weight * at.q[iq + of.modes[i]], weight * step
            change = larger(change, abs(iterates.step[i]))
            move = of.scratch.move
            move[i] = (iterates.now[i] - iterates.last[i]) / weight
            stiffness += move[i] * (res[iv + of.modes[i]] - of.scratch.residual[i])
            of.scratch.residual[i] = res[iv + of.modes[i]]
        elastic += _elastic(run, of, n)
    if change == 0.0:
        iterates.count[0], loop["grows"] = 0, 0
    elif math.isfinite(change):
        if iterates.count[0] > 0 and change > _MAX_CONTRACTION * loop["change"]:
            loop["grows"] = 1
        later = iterates.count[0] > 1  # the first reactions are of the previous factor
        if loop["grows"] == 1 and later and stiffness < -_UNSTABLE_SHARE * elastic:
            return math.inf
        accelerate(iterates, loop["grows"] == 1)
    loop["change"] = change
    for n in range(of.rows.shape[0]):
        iq, iv = bodies[of.rows[n]]["iq"] + 7, bodies[of.rows[n]]["iv"] + 6
        if of.kinetostatic[n] == 1 or run.method.stages > 0:
            for i in range(of.first[n], of.first[n + 1]):
                at.q[iq + of.modes[i]] += iterates.step[i] / weights[i]
                at.v[iv + of.modes[i]] = 0.0
                at.vd[iv + of.modes[i]] = 0.0
    return change


@kernel
def _elastic(run, of, n):
    """Twice the elastic energy of the last change of the modes of body n [J]."""
    pool, body, twice = run.system.parts.pool, run.system.parts.bodies[of.rows[n]], 0.0
    m = body["m"]
    K = body["flex"] + 12 * m + m * m
    for i in range(of.first[n], of.first[n + 1]):
        for j in range(of.first[n], of.first[n + 1]):
            stiffness = pool[K + of.modes[i] * m + of.modes[j]]
            twice += of.scratch.move[i] * stiffness * of.scratch.move[j]
    return twice


STATIC_MODES = Kind("static_modes", StaticModes, {
    "matrix": add_static_mass, "static": follow_loads, "static_hold": zero_residual,
    "static_rates": put_rates, "static_force": put_mode_forces,
    "static_path": put_stage_accelerations, "static_lag": extrapolation_error,
    "static_ahead": record_point_ahead, "static_begin": clear_history, "begin": clear_history,
    "update_history": update_history,
}, scratch=new_scratch)  # fmt: skip


def of_their_parts(system: System, length: float, size: NDArray[np.float64]) -> System:
    """The system with artificial mass and reach of quasi-static modes scaled to their part.

    `length` is the size of the model, `size` (nv,) that of the part of each coordinate [m].
    """
    static: StaticModes | None = system.kinds.get(STATIC_MODES.name)
    if static is None:
        return system
    bodies, places = system.parts.bodies, static_coordinates(system)
    part, own = system.part[bodies["iv"]], np.maximum(bodies["mass"], np.finfo(float).tiny)
    gyration, size = np.sqrt(np.trace(bodies["S0"], axis1=1, axis2=2) / own), size.copy()
    for k, iv in enumerate(bodies["iv"]):  # a part with few markers is larger than they show
        size[system.part == system.part[iv]] = np.maximum(size[iv], gyration[k])
    mass = np.bincount(part, bodies["mass"])[part]
    static = static._replace(
        mass_factor=static.mass_factor * (mass / own)[static.rows],
        reach=system.weights[places] * length / size[places],
    )
    return system._replace(kinds={**system.kinds, STATIC_MODES.name: static})


def static_bodies(system: System) -> tuple[list[int], list[int]]:
    """Numbers of all bodies with quasi-static modes, and of those that are kinetostatic."""
    static = system.kinds.get(STATIC_MODES.name)
    if static is None:
        return [], []
    return static.rows.tolist(), static.rows[static.kinetostatic == 1].tolist()


def static_coordinates(system: System, *, kinetostatic: bool = False) -> Integers:
    """(k,) indices in v of the quasi-static modes: of all bodies, or of kinetostatic ones."""
    static = system.kinds.get(STATIC_MODES.name)
    if static is None:
        return np.zeros(0, np.int64)
    begins = system.parts.bodies["iv"] + 6
    count = np.diff(static.first)
    places = np.asarray(np.repeat(begins[static.rows], count) + static.modes, np.int64)
    return places[np.repeat(static.kinetostatic == 1, count)] if kinetostatic else places


def free_static_modes(system: System) -> System:
    """The system with no kinetostatic body: quasi-static modes are solved for within the step."""
    static: StaticModes | None = system.kinds.get(STATIC_MODES.name)
    if static is None or not static.kinetostatic.any():
        return system
    free = static._replace(kinetostatic=np.zeros_like(static.kinetostatic))
    return system._replace(kinds={**system.kinds, STATIC_MODES.name: free})
