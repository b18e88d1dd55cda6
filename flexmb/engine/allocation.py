"""State and scratch memory of a run, allocated once; scratch is filled with NaN."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexmb.engine.bodies.motion import RELATIVE_ROUND_OFF
from flexmb.engine.kinematics_point import PATH_COUNTERS, PATH_MEMORY, Path
from flexmb.engine.method import COUNTERS, INTEGRATOR_MEMORY, Method, Settings
from flexmb.engine.stage_tables import kinds_of, row_units, sensor_units, stages_of
from flexmb.engine.state import (
    BODY_NOW,
    CURVE_MARKER_NOW,
    EVENT_FUNCTION,
    MARKER_NOW,
    Alternation,
    Before,
    Collocation,
    ComplexFactor,
    Constraints,
    Dense,
    Events,
    Factor,
    FeedbackWork,
    Now,
    Output,
    Partition,
    Plan,
    Point,
    RowWork,
    Run,
    State,
    Trial,
    Work,
)
from flexmb.engine.tables import Parts, System, aligned, deformation_room, whole_vectors

_NO_METHOD = Method((), (), (), 2, 3, 0, 0.0, 1, 0, 1.0)
_NO_FACTOR = Factor(
    *(np.zeros(0) for _ in range(9)), np.ones(1, dtype=np.int64), np.zeros(1, dtype=np.int64),
    *(np.zeros(0) for _ in range(3)),
)  # fmt: skip
_EVENT_STATES = 9  # states after events stored per chunk; of more events every third is kept
_SINGULAR_POSES = 8  # largest number of singular poses with time and positions stored
_NO_SETTINGS = Settings(0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1, 0, 0, 0, 0)


def sizes(system: System) -> tuple[int, int, int]:
    """nq, nv, nc."""
    m, n = system.parts.bodies["m"], len(system.parts.coordinates)
    return int((7 + m).sum()) + n, int((6 + m).sum()) + n, len(system.rows)


def new_state(system: System, channels: int = 0) -> State:
    """State at rest at the origin: unit orientation, everything else zero."""
    nq, nv, nc = sizes(system)
    q = np.zeros(nq)
    q[system.parts.bodies["iq"] + 3] = 1.0
    memory = np.zeros(1, INTEGRATOR_MEMORY)
    memory["contraction"], memory["factor_age"] = 1.0, -1.0
    unsymmetric = any(kind.is_unsymmetric(system.kinds[kind.name]) for kind in kinds_of(system))
    memory["symmetric"] = 0.0 if unsymmetric else 1.0
    return State(
        np.zeros(1), q, *(np.zeros(nv) for _ in range(6)), np.zeros(nc), np.zeros(nc),
        np.zeros(3), np.zeros(3), _nan(2, 3), np.zeros(channels), q.copy(), np.zeros(nv),
        np.tile([[2.0 * RELATIVE_ROUND_OFF], [1.0]], nv), np.zeros(nv), np.zeros(nv), memory,
        np.zeros(1, COUNTERS), np.zeros(system.history),
    )  # fmt: skip


def _bending_shape(parts: Parts) -> tuple[int, int]:
    """Shape of Now.Phi."""
    bends, m = bool((parts.markers["bend"] >= 0).any()), int(parts.bodies["m"].max(initial=0))
    return (len(parts.markers), 2 * whole_vectors(6 * m)) if bends else (0, 0)


def _nan(*shape: int) -> np.ndarray:
    values = np.empty(shape)
    values.fill(np.nan)  # half the time of numpy.full
    return values


def _nan_records(n: int, dtype: np.dtype) -> np.ndarray:
    return np.full(n * dtype.itemsize // 8, np.nan).view(dtype)


def new_work(system: System, channels: int = 0, method: Method = _NO_METHOD) -> Work:
    """Scratch for one run of `system` with a method."""
    stages = method.stages
    nq, nv, nc = sizes(system)
    m, history = system.parts.bodies["m"], system.history
    nfun = len(system.functions.start) - 1
    nfun += int(np.sum(system.coupled["first"]))
    depth = max(system.functions.depth, system.sensors.programs.depth, system.program_depth)
    now = Now(
        _nan_records(len(m), BODY_NOW),
        _nan_records(len(system.parts.markers), MARKER_NOW),
        aligned(_nan(int(deformation_room(system.parts.bodies).sum()))),
        aligned(_nan(*_bending_shape(system.parts))),
        _nan_records(len(system.parts.curve_markers), CURVE_MARKER_NOW),
        _nan(history),
        _nan(1),
        _nan(1),
    )
    trial = Trial(
        t=_nan(1), q=_nan(nq), v=_nan(nv), vd=_nan(nv), aa=_nan(nv), aa_start=_nan(nv),
        lam=_nan(nc), dq=_nan(nv), res=_nan(nv), spare=_nan(nv), mode_force=np.zeros(nv),
        dense_correction=np.zeros(nv), power=_nan(3), work_done=_nan(3), angles=_nan(channels),
        before=Before(_nan(1), _nan(nq), _nan(nv), _nan(3), _nan(3), _nan(history)),
        stages=_nan(stages, nq + nv + 3), work=_nan(3), rate=_nan(nq), shares=_nan(stages),
        dense_ready=np.zeros(1, dtype=np.int64), dq_round_off=_nan(nv), vd_round_off=np.zeros(nv),
        error=_nan(2), jerk=_nan(nv), stack=_nan(depth, 3),
        variables=_nan(max(1, len(system.sensors.channels)), 3),
    )  # fmt: skip
    con = Constraints(_nan(nc), _nan(nc), _nan(1), _nan(1), _nan(nc), _nan(max(1, nfun), 3))
    dense = _new_dense(system)
    row = RowWork(now.marker, dense.g[0], dense.H)
    return Work(
        now, con, dense, row, _new_factor(system), _new_collocation(system, method.collocation),
        _new_partition(system, method.partitions), trial, _new_feedback(system),
        _new_events(system, channels, method),
        _new_alternation(system, method), _nan(5), _nan(3),
        np.zeros(1, dtype=np.int64), _scratch_of_kinds(system),
    )  # fmt: skip


def _scratch_of_kinds(system: System) -> dict[str, Any]:
    tables = system.kinds
    own = [kind for kind in kinds_of(system) if kind.scratch is not None]
    return {kind.name: kind.scratch(tables[kind.name]) for kind in own}


def _new_events(system: System, channels: int, method: Method) -> Events:
    nq, nv, nc = sizes(system)
    room = _EVENT_STATES if method.stages == 0 and system.events else 0
    width = 2 + nq + 3 * nv + nc + system.history + channels
    both = (_nan_records(system.events, EVENT_FUNCTION) for _ in range(2))
    return Events(*both, _nan(room, width), np.array([0, 0, 1, 0]))


def _new_alternation(system: System, method: Method) -> Alternation:
    """Scratch to detect multipliers that alternate from step to step.

    It is empty for all methods but those with constant steps and no collocation
    (generalized-alpha).
    """
    nc = sizes(system)[2] if method.prefers_constant_step == 1 and method.collocation == 0 else 0
    bounds = np.full(nc, np.inf), np.full(nc, -np.inf)
    tables = _nan(nc), _nan(nc), *bounds, np.zeros(nc), np.zeros(nc)
    return Alternation(*tables, np.zeros(2, dtype=np.int64))


def _new_feedback(system: System) -> FeedbackWork:
    n = 6 + int(system.parts.bodies["m"].max(initial=0))
    feedback = system.kinds.get("feedback")
    partials = 0 if feedback is None else len(feedback.partials)
    channels = len(system.sensors.channels)
    block = np.zeros(4, dtype=np.int64)
    return FeedbackWork(
        _nan(1), _nan(channels), _nan(partials), np.zeros((2, sizes(system)[1])), _nan(4, 12),
        _nan(n), _nan(n), block,
    )  # fmt: skip


def _new_dense(system: System) -> Dense:
    n = 6 + int(system.parts.bodies["m"].max(initial=0))
    jac = max(_jac_end(system, "I", "jac_I"), _jac_end(system, "J", "jac_J"), 1)
    return Dense(
        _nan(n, n), _nan(2, 6, n), _nan(24, n), _nan(12, 12), _nan(2, 12), _nan(6, 12),
        _nan(6, 12), _nan(jac),
        np.zeros(2, dtype=np.int64),
    )  # fmt: skip


def _new_factor(system: System) -> Factor:
    panels = system.kkt.panels
    length = int(panels["at"][-1] + (panels["nc"][-1] + panels["nr"][-1]) * panels["nc"][-1])
    largest = int(((panels["nc"] + panels["nr"]) * panels["nc"]).max())
    n = int(panels["nc"].sum()) + 1
    factor = Factor(
        *(_nan(length) for _ in range(4)), _nan(largest), _nan(largest), _nan(n), np.zeros(n),
        _nan(n), np.ones(1, dtype=np.int64), np.zeros(1, dtype=np.int64), _nan(n), _nan(n), _nan(n),
    )  # fmt: skip
    factor.d[-1], factor.diagonal[-1] = 1.0, np.inf
    return factor


def _new_collocation(system: System, stages: int) -> Collocation:
    _, nv, nc = sizes(system) if stages else (0, 0, 0)
    factor = _new_factor(system) if stages else _NO_FACTOR
    pair = ComplexFactor(
        *(array.astype(np.complex128) for array in (
            factor.low, factor.up, factor.Wl, factor.Wu, factor.d, factor.sol)),
        np.ones(1, dtype=np.int64),
    )  # fmt: skip
    return Collocation(
        *(_nan(stages, n) for n in (nv, nv, nv, nc, nv, nc, nv, nc, nv, 3, stages)),
        np.full(1, -1.0), np.zeros(2), factor, pair,
    )  # fmt: skip


def _new_partition(system: System, partitions: int) -> Partition:
    _, nv, nc = sizes(system) if partitions else (0, 0, 0)
    return Partition(
        *(_nan(nv) for _ in range(3)), _nan(nc, nv), np.full(1, -1.0), np.zeros(2),
        np.zeros(1, dtype=np.int64),
    )  # fmt: skip


def _jac_end(system: System, side: str, field: str) -> int:
    """One past the last entry of the Jacobian rows on one side."""
    rows = system.rows
    used = rows[field] >= 0
    if not used.any():
        return 0
    body = system.parts.markers["body"][rows[side][used]]
    return int((rows[field][used] + 6 + system.parts.bodies["m"][body]).max())


def new_output(system: System, rows: int, channels: int) -> Output:
    """Arrays for `rows` output rows."""
    nq, nv, nc = sizes(system)
    widths = (nq, nv, nv, nc, 12 * len(system.groups), channels, 7, 2)
    tables = (np.empty((rows, w)) for w in widths)
    count, extent = np.zeros(1, dtype=np.int64), np.full((3, 7), np.nan)
    return Output(np.empty(rows), *tables, count, extent)


def new_plan(steps: int) -> Plan:
    """A plan of this many steps."""
    return Plan(np.zeros(steps + 1 if steps else 0), np.zeros(1, dtype=np.int64))


def new_run(
    system: System,
    state: State,
    work: Work,
    method: Method = _NO_METHOD,
    settings: Settings = _NO_SETTINGS,
    plan: Plan | None = None,
    output: Output | None = None,
    times: np.ndarray | None = None,
) -> Run:
    """The record of one run, which units receive; arrays are shared, not copied.

    Without `times`, outputs are `settings.interval` apart.
    """
    trial = work.trial
    return Run(
        system, state, work,
        Point(state.t, state.q, state.v, state.vd, state.lam),
        Point(trial.t, trial.q, trial.v, trial.vd, trial.lam),
        stages_of(system, work.kinds), row_units(system), sensor_units(system), method, settings,
        new_plan(0) if plan is None else plan,
        equal_times(settings) if times is None else times,
        new_output(system, 0, len(state.angles)) if output is None else output,
    )  # fmt: skip


def equal_times(settings: Settings) -> np.ndarray:
    """Times of outputs at equal intervals [s]."""
    n = round((settings.end - settings.start) / settings.interval)
    return settings.start + np.arange(n + 1) * settings.interval


def output_run(run: Run) -> Run:
    """The same run with a second factor, for the evaluation of outputs."""
    return run._replace(work=run.work._replace(factor=_new_factor(run.system)))


def new_path(system: System) -> Path:
    """Memory for one kinematic analysis; the metric W is diagonal, the squared weights."""
    nq, nv, nc = sizes(system)
    weights = np.where(system.weights > 0.0, system.weights, 1.0)
    signs = np.where(np.random.default_rng(1).random(nc) < 0.5, -1.0, 1.0)
    sizes_of_rows = np.linspace(0.7, 1.3, nc)  # unequal, so that no symmetry hides a singular pose
    n_functions = max(1, len(system.functions.start) - 1)
    return Path(
        weights**2, signs * sizes_of_rows / system.row_weights,
        *(np.zeros(nv) for _ in range(4)), np.zeros((n_functions, 3)), np.zeros((4, 3)),
        np.array([(np.inf, -1.0, 0.0)], PATH_MEMORY), np.zeros((_SINGULAR_POSES, 2)),
        np.zeros((_SINGULAR_POSES, nq)), np.zeros(1, PATH_COUNTERS),
    )  # fmt: skip
