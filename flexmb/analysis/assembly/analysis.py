"""Consistent first state: positions, velocities, accelerations and multipliers.

Positions by Gauss–Newton with least change of the placed pose, velocities by projection of what
the user asked for, then, if wanted, elastic equilibrium with the rigid accelerations (quasi-static
start), at last v̇ and λ from [[M, Cqᵀ], [Cq, 0]] (v̇; λ) = (Q; γ).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.closing import Closer, body_weights, close_positions, mass_closer
from flexmb.analysis.assembly.gaps import Moved
from flexmb.analysis.assembly.metric import slowest_period, stiff_system, weighted_system
from flexmb.analysis.assembly.velocities import AskedVelocities
from flexmb.analysis.dynamics.stops import stop_notes
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import (
    ACCELERATIONS,
    BEGIN,
    REMEMBER,
    RESIDUAL,
    VELOCITIES,
    solve_level,
)
from flexmb.engine.method import FINE, NO_LOOP, SELF_LOCKING
from flexmb.engine.state import State, Work
from flexmb.engine.tables import System
from flexmb.engine.work import new_state, new_work
from flexmb.errors import AssemblyError
from flexmb.model.model import Model

_RIGID = 1e8  # how much stiffer than slow inertia the modes are while gaps close
_SLOW = 1e3  # b of the quasi-static solve over 1/ω² of the softest mode
_EQUILIBRIUM_ROUNDS = 40
_EQUILIBRIUM = 1e-12  # change of the deformation relative to the model size


@dataclass(frozen=True)
class Assembled:
    """The first state, the scratch it was computed with, and what the user should know."""

    state: State
    work: Work
    notes: tuple[str, ...]


class Begin(NamedTuple):
    """Where to begin instead of the placed pose."""

    q: NDArray[np.float64]  # (nq,)
    v: NDArray[np.float64]  # (nv,), NaN where the scene's own velocities hold


def assemble(
    compiled: Compiled, model: Model, *, start: str = "undeformed", begin: Begin | None = None
) -> Assembled:
    """Consistent first state of a compiled model.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    model : Model
        The model, for velocities asked for.
    start : {"undeformed", "quasi-static"}
        Whether flexible bodies start without deformation as far as the joints allow, or in elastic
        equilibrium with weight, loads and the inertia forces of the first motion.
    begin : Begin, optional
        Positions and velocities to begin from, changed no more than joints and drivers need; then
        `start` has no say.

    Raises
    ------
    AssemblyError
        Positions that cannot be closed (worst joints and gaps), a joint on its wrong branch, no
        elastic equilibrium, or accelerations that are not finite.
    """
    system = compiled.system
    state = new_state(system, channels=len(compiled.layout.channels))
    work = new_work(system)
    state.q[:] = compiled.placed if begin is None else begin.q
    period = slowest_period(system)
    stiff = stiff_system(system, _RIGID * period)
    asked = AskedVelocities(compiled, model, stiff)

    def close(guess: bool = False) -> None:
        _close(compiled, model, state, work, period, guess=guess)
        asked.start(state)
        if begin is not None:
            state.v[:] = np.where(np.isnan(begin.v), state.v, begin.v)
            solve_level(stiff, state, work, VELOCITIES)
        _start_states(compiled, state, work, begin)

    close(begin is None)
    notes = asked.notes(state) if begin is None else []
    solve_level(system, state, work, REMEMBER)
    if start == "quasi-static" and begin is None and period > 0.0:
        _equilibrate(compiled, _SLOW * period, state, work, close)
    solve_level(system, state, work, REMEMBER)
    _solve_accelerations(system, state, work)
    solve_level(system, state, work, BEGIN)
    notes = [*notes, *stop_notes(compiled, model, state, work)]
    return Assembled(state, work, tuple(notes))


def _start_states(compiled: Compiled, state: State, work: Work, begin: Begin | None) -> None:
    """Set the states: values, then what starts as a function has then, which may need others."""
    free = [s for s in compiled.starts if begin is None or np.isnan(begin.v[s.iv])]
    for start in free:
        state.v[start.iv] = start.value
    follow = [start for start in free if start.program >= 0]
    for _ in follow:
        solve_level(compiled.system, state, work, RESIDUAL)
        for start in follow:
            state.v[start.iv] = work.con.fun[start.program, 0]


def _close(
    compiled: Compiled, model: Model, state: State, work: Work, period: float, *, guess: bool
) -> tuple[Moved, ...]:
    """Close the positions with least change in masses times weights, hardly straining bodies."""
    weights = body_weights(model)

    def make(of: Compiled, at: State) -> Closer:
        held = weighted_system(stiff_system(of.system, _RIGID * period), weights)
        return mass_closer(held, at, work if at is state else None)

    return close_positions(compiled, model, state, make, guess)


def _equilibrate(
    compiled: Compiled, b: float, state: State, work: Work, close: Callable[[], None]
) -> None:
    """Elastic equilibrium of all modes with the accelerations of a motion without vibration.

    With the modal mass M + b K the accelerations η̈ give the way δη = b η̈ to equilibrium, and
    reactions that rigid bodies would leave open are shared by stiffness; b is long against all
    periods, so the error shrinks by 1/(b ω²) per round, and at the end η̈ = 0.
    """
    slow = stiff_system(compiled.system, b)
    for _ in range(_EQUILIBRIUM_ROUNDS):
        _solve_accelerations(slow, state, work)
        change = 0.0
        for body in compiled.layout.bodies:
            at = slice(body.iv + 6, body.iv + 6 + body.m)
            step = b * state.vd[at]
            state.q[body.iq + 7 : body.iq + 7 + body.m] += step
            change = max(change, float(np.abs(step * compiled.system.weights[at]).max(initial=0.0)))
        if not change < 1.0:
            break
        close()
        if change <= _EQUILIBRIUM:
            return
    raise AssemblyError(
        "the flexible bodies find no elastic equilibrium with the first motion: it is too fast or "
        'the body too soft for dynamics.start = "quasi-static"; use "undeformed", or begin slower'
    )


def _solve_accelerations(system: System, state: State, work: Work) -> None:
    code = solve_level(system, state, work, ACCELERATIONS)
    if code == NO_LOOP:
        what = (
            "forces that depend on accelerations or reactions find none that fit them: the loop "
            "amplifies; lower its gain, or let a state or a filter stand between"
        )
        raise AssemblyError(what)
    if code == SELF_LOCKING:
        what = (
            "friction in the joints and the reactions that cause it do not settle: a joint locks "
        )
        raise AssemblyError(what + "itself; lower its coefficients, or make its bearing longer")
    if code != FINE:
        what = "a spring-damper has no length in the first pose; move its markers apart"
        raise AssemblyError(what)
    if not (np.all(np.isfinite(state.vd)) and np.all(np.isfinite(state.lam))):
        raise AssemblyError(
            "the first accelerations are not finite; check functions of time at t = 0"
        )
    state.aa[:] = state.vd
    state.vd_before[:] = state.vd
    state.lam_before[:] = state.lam
