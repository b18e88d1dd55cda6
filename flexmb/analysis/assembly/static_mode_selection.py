"""Which bodies with quasi-static modes may be kinetostatic (`engine.bodies.static_modes`).

Kinetostatic modes are fixed within a step. Bodies stay kinetostatic only if the joints do not need
their compliance: with their modes fixed, the Jacobian must have the same rank. Else drivers could
lock the mechanism, and reactions that elasticity decides would be arbitrary. They do not if other
modes exist as well, which closing a joint would strain, nor if attached springs or bushings are not
much softer than they are: loads and deformation would not converge.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace

import numpy as np

from flexmb.analysis.assembly.jacobian import (
    MAX_COORDINATES,
    DenseJacobian,
    WeightedJacobian,
    n_free,
    numerical_rank,
    one_blas_thread,
)
from flexmb.analysis.assembly.mechanism_modes import MechanismModes
from flexmb.engine.allocation import new_state, new_work
from flexmb.engine.bodies.static_modes import (
    STATIC_MODES,
    free_static_modes,
    static_bodies,
    static_coordinates,
)
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import row_evaluator
from flexmb.errors import AssemblyError
from flexmb.flexbody.arrays import Array, IntArray

# Largest loop gain of deformations and the loads that depend on them, with which the iteration of
# both converges well.
_MAX_LOOP_GAIN = 0.5


def is_determinate(compiled: Compiled, rank: int | None) -> bool:
    """Whether constraints of this rank fix the motion, apart from kinetostatic modes."""
    return rank == n_free(compiled) - len(static_coordinates(compiled.system, kinetostatic=True))


@one_blas_thread()
def choose_static_modes(compiled: Compiled, q: Array) -> Compiled:
    """The model without kinetostatic bodies if joints or forces at the pose q (nq,) forbid them."""
    modes = static_coordinates(compiled.system, kinetostatic=True)
    if not len(modes):
        return compiled
    if n_free(compiled) > MAX_COORDINATES:
        return _with_windows(compiled, q)
    if sum(body.m for body in compiled.layout.bodies) > len(modes):
        return replace(compiled, system=free_static_modes(compiled.system))
    state, work = new_state(compiled.system), new_work(compiled.system)
    state.q[:] = q
    row_evaluator(compiled.system, state, work)()
    rows = WeightedJacobian.of(compiled, DenseJacobian(compiled).of(work))
    ranks = [
        numerical_rank(np.asarray(np.linalg.svd(A, compute_uv=False)), 1.0)
        for A in (rows.A, rows.A[:, ~np.isin(rows.columns, modes)])
    ]
    if ranks[0] == ranks[1] and _loop_gain(compiled, q, modes) < _MAX_LOOP_GAIN:
        return _with_windows(compiled, q)
    return replace(compiled, system=free_static_modes(compiled.system))


# Least interval h of the past of kinetostatic modes, as ω h with the slowest vibration ω of the
# masses on them. Then errors of second differences by the tolerance of the equilibrium are at most
# 1e-8 of k times the size of the part. The error of the cubic for a motion of frequency Ω is
# (Ω/ω)⁴/500 of the forces, less than the omitted vibrations.
_MIN_INTERVAL = 0.05


def _with_windows(compiled: Compiled, q: Array) -> Compiled:
    """The model with `window` of kinetostatic bodies set by the periods of their slowest modes."""
    rows, kinetostatic = static_bodies(compiled.system)
    everything, one_by_one = range(len(compiled.layout.bodies)), n_free(compiled) > MAX_COORDINATES
    scene, periods = None, np.zeros(len(rows))
    for n, k in enumerate(rows):
        if k in kinetostatic:
            if scene is None or one_by_one:
                scene = MechanismModes(compiled, q, [k] if one_by_one else list(everything))
            with suppress(AssemblyError):  # without inertia there is no slow vibration
                periods[n] = 1.0 / scene.vibrations(k).omega.min(initial=math.inf)
    kinds = compiled.system.kinds
    static = kinds[STATIC_MODES.name]._replace(window=_MIN_INTERVAL * periods)
    return replace(
        compiled, system=compiled.system._replace(kinds={**kinds, STATIC_MODES.name: static})
    )


def _loop_gain(compiled: Compiled, q: Array, modes: IntArray) -> float:
    """Loop gain: deformation by the loads that a unit deformation of these modes causes.

    The deformation moves bodies so that joints stay closed, with the least kinetic energy. This
    changes forces, and thereby accelerations and reactions, which load the modes. Returns the
    largest absolute eigenvalue of the resulting deformation.
    """
    from flexmb.analysis.linear.state_equations import StateEquations  # it needs machine code

    state, nv = new_state(compiled.system, len(compiled.layout.channels)), compiled.layout.nv
    state.q[:] = q
    M, _, K, Cq, _ = StateEquations(compiled, state).tangents()
    own, others = np.zeros((nv, nv)), np.setdiff1d(np.arange(nv), modes)
    for body in compiled.layout.bodies:
        at = slice(body.iv + 6, body.iv + 6 + body.m)
        own[at, at] = compiled.flexbodies[body.name].K if body.m else 0.0
    moved = np.zeros((nv, len(modes)))
    moved[modes] = np.eye(len(modes))
    rows, none = Cq[:, others], np.zeros((len(others), len(modes)))
    both = np.block([[M[np.ix_(others, others)], rows.T], [rows, np.zeros((len(Cq),) * 2)]])
    closed = np.linalg.lstsq(both, np.concatenate([none, -Cq[:, modes]]), rcond=None)[0]
    moved[others] = closed[: len(others)]
    force = (K - own) @ moved
    pushed = np.concatenate([-force[others], np.zeros((len(Cq), len(modes)))])
    accelerated = np.linalg.lstsq(both, pushed, rcond=None)[0]
    force = force[modes] + np.hstack([M[np.ix_(modes, others)], Cq[:, modes].T]) @ accelerated
    follows = np.linalg.solve(own[np.ix_(modes, modes)], force)
    return float(np.abs(np.linalg.eigvals(follows)).max(initial=0.0))
