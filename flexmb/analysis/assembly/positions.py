"""Closing the positions of a model with least change of its placed pose.

Gauss–Newton corrections of q towards C = 0, least in a metric: the masses of the bodies (compiled),
or lengths and angles (`length_corrector`, in numpy, with nothing compiled), times what the scene
says of each body. With a guess of joint coordinates the placed pose is first brought near it: the
guesses stand as additional rows that need not close (least squares), then the joints and drivers
alone close from there, on that branch.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.gaps import (
    Offset,
    check_branches,
    gap_problems,
    joint_gaps,
    moved_bodies,
    open_by,
)
from flexmb.analysis.assembly.jacobian import (
    ConstraintPose,
    ConstraintRows,
    column_scales,
    null_space,
)
from flexmb.engine.allocation import new_state, new_work
from flexmb.engine.compile import Compiled, compile_system
from flexmb.engine.compiled_calls import stage_solver
from flexmb.engine.initial_conditions import POSITIONS, RESIDUAL
from flexmb.engine.joints.constraint_groups import forces_on_joints, joint_coordinate
from flexmb.engine.joints.coordinate import coupled_rows, screw_rows
from flexmb.engine.state import State, Work
from flexmb.engine.tables import System
from flexmb.errors import AssemblyError, FlexmbWarning, Problem
from flexmb.model.model import Model
from flexmb.model.reading import ReadContext
from flexmb.model.scenes.sections import read_named

FIXED_WEIGHT = 1e10
"""Weight of a fixed body."""

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_MAX_CORRECTIONS = 60
_MAX_GAP = 1e-10  # largest gap of an assembled joint, over the size of the model or in radians
_CORRECTION_TOLERANCE = 1e-13  # correction over the size of the model that is round-off
_GUESS_TOLERANCE = 1e-6  # correction at which the least squares for a guess have converged
# A pose is refused if bodies were moved by more than this and joints had gaps of more than this,
# over the size of the model.
_MAX_DISPLACEMENT, _MIN_REPORTED_GAP = 0.01, 1e-3
_MAX_SHOWN = 3
_FIXED_TOLERANCE = 1e-6  # motion of a fixed body, over the model size or in radians

# Closing in numpy: gaps over the model size, or radians.
_CLOSED_ROWS = 1e-11
_ROUND_OFF = 1e-14
_MAX_CORRECTION = 0.3  # in one round, over the model size or in radians
_MODAL_SCALE = 1e-3  # scale of modes over that of bodies: modes move only if bodies cannot
_ZERO_SINGULAR_VALUE = 1e-9  # singular value over the largest one that counts as zero
_NEARBY = 0.05  # distance of a nearby pose, over the size of the model or in radians
_MAX_TRIALS = 4


@dataclass(frozen=True)
class Corrector:
    """The engine at one state: corrections of its positions, and C and markers at them."""

    work: Work
    correct: Callable[[], float]  # one correction; its weighted size
    evaluate: Callable[[], object]


MakeCorrector = Callable[[Compiled, State], Corrector]
"""Function that makes a corrector for a compiled system and a state."""


def mass_corrector(system: System, state: State, work: Work | None = None) -> Corrector:
    """Corrector with least changes in the metric of the mass matrix."""
    scratch = work if work is not None else new_work(system)
    solve = stage_solver(system, state, scratch)
    return Corrector(scratch, lambda: solve(POSITIONS), lambda: solve(RESIDUAL))


def length_corrector(compiled: Compiled, state: State, weights: Array) -> Corrector:
    """Corrector with least changes over the size of the model or in radians, times body weights."""
    constraints, scales = ConstraintRows(compiled), _closing_scales(compiled, weights)
    all_rows = np.ones(compiled.layout.nc, bool)

    def correct() -> float:
        pose = constraints.evaluate(state.q, float(state.t[0]))
        if np.abs(pose.C * compiled.system.row_weights).max(initial=0.0) <= _ROUND_OFF:
            return 0.0
        step = _correction(pose, all_rows, scales)
        if step is None:
            return float("nan")
        state.q[:] = constraints.move(state.q, scales * step)
        return float(np.abs(step).max(initial=0.0))

    def evaluate() -> object:
        return constraints.evaluate(state.q, float(state.t[0]))

    return Corrector(constraints.work, correct, evaluate)


def assembly_weights(model: Model) -> Array:
    """(bodies,) weights of `[assembly] weights`, `FIXED_WEIGHT` for fixed bodies."""
    weights = {} if model.assembly is None else model.assembly.weights
    values = (weights.get(name, 1.0) for name in model.bodies)
    return np.array([FIXED_WEIGHT if w == "fixed" else float(w) for w in values])


def close_positions(
    compiled: Compiled, model: Model, state: State, make: MakeCorrector, guess: bool = True
) -> tuple[Offset, ...]:
    """Bring the positions of a state onto the constraints; returns how far bodies were moved.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The compiled model, and the model for its guesses and fixed bodies.
    state : State
        The pose to begin from; its q is replaced by the closed one.
    make : callable
        Makes the corrector; its metric defines the least change.
    guess : bool
        Whether to begin near the joint coordinates that the scene guesses.

    Raises
    ------
    AssemblyError
        Gaps that stay open (the largest ones), a joint on its wrong branch, or a fixed body that
        had to move.
    """
    start = state.q.copy()
    if not compiled.layout.nc:
        return ()
    take_turns_of_drivers(compiled, model, state)
    if guess and model.assembly is not None and model.assembly.guess:
        _approach_guess(model, compiled, state, make)
    corrector = make(compiled, state)
    corrector.evaluate()
    initial_axes = corrector.work.now.marker["R"].copy()
    _iterate(corrector, _CORRECTION_TOLERANCE)
    corrector.evaluate()
    moved = moved_bodies(compiled, start, state.q)
    if not np.abs(corrector.work.con.C * compiled.system.row_weights).max() <= _MAX_GAP:
        raise AssemblyError.from_problems(gap_problems(compiled, model, corrector.work, moved))
    check_branches(compiled, model, state, corrector.work, initial_axes)
    _check_fixed(compiled, model, moved)
    if guess and model.assembly is None:
        _check_placement(compiled, model, state, start, corrector, moved)
    return moved


def _check_placement(
    compiled: Compiled,
    model: Model,
    state: State,
    start: Array,
    corrector: Corrector,
    moved: tuple[Offset, ...],
) -> None:
    """Refuse a pose that is far from the one of the scene.

    Points of joints were moved by 1 % of the size of the model, or axes of joints are not parallel
    in the scene.
    """
    if not moved:
        return
    owner, markers = compiled.system.parts.markers["body"], corrector.work.now.marker
    closed, there = state.q.copy(), markers["x"].copy()
    state.q[:] = start
    corrector.evaluate()
    gaps = [gap for gap in joint_gaps(compiled, corrector.work) if gap.name.startswith("joints.")]
    shift, askew = (
        np.linalg.norm(there - markers["x"], axis=1),
        any(g.angle > _MAX_DISPLACEMENT for g in gaps),
    )
    state.q[:] = closed
    corrector.evaluate()
    number = {body.name: k for k, body in enumerate(compiled.layout.bodies)}
    far = [
        body
        for body in moved
        if max(body.distance, *shift[owner == number[body.name]])
        > _MAX_DISPLACEMENT * compiled.length
        or (askew and body.angle > _MAX_DISPLACEMENT)
    ]
    if (
        far and gaps and gaps[0].size(compiled.length) > _MIN_REPORTED_GAP
    ):  # otherwise drivers move them
        raise AssemblyError.from_problems(
            Problem(
                f"bodies.{body.name}",
                f"would have to move by {body.text(model.units)} to close the joints: as placed "
                f"{gap.name} is {open_by(model, gap)}; place it where its joints close, "
                f"{_turn(gap)}or accept what they do by an empty section [assembly]",
            )
            for body, gap in ((one, _gap_of(model, gaps, one.name)) for one in far[:_MAX_SHOWN])
        )


def _turn(gap: Offset) -> str:
    """The cure for axes that are askew, or ""."""
    askew = gap.angle > _MAX_DISPLACEMENT
    return "turn a marker of the joint by its orientation, " if askew else ""


def is_misplaced(compiled: Compiled, model: Model) -> bool:
    """Whether gaps in the pose of the scene are so large that a run refuses it."""
    state = new_state(compiled.system, channels=len(compiled.layout.channels))
    state.q[:] = compiled.initial_q
    corrector = length_corrector(compiled, state, assembly_weights(model))
    corrector.evaluate()
    gaps = (gap for gap in joint_gaps(compiled, corrector.work) if gap.name.startswith("joints."))
    worst = max((gap.size(compiled.length) for gap in gaps), default=0.0)
    return model.assembly is None and worst > _MAX_DISPLACEMENT


def _gap_of(model: Model, gaps: list[Offset], body: str) -> Offset:
    """The largest gap of the joints of a body, or of all joints if its own are closed."""
    own = (
        gap
        for gap in gaps
        if gap.size(1.0) > 0.0
        and any(
            marker.partition(".")[0] == body
            for marker in model.joints[gap.name.partition(".")[2]].between
        )
    )
    return next(own, gaps[0])


def _iterate(corrector: Corrector, tolerance: float) -> None:
    for _ in range(_MAX_CORRECTIONS):
        size = corrector.correct()
        if not np.isfinite(size) or size <= tolerance:
            return  # closed, or at a minimum of the gaps


def _approach_guess(model: Model, compiled: Compiled, state: State, make: MakeCorrector) -> None:
    """Bring the state as near to the guessed coordinates as joints and drivers allow."""
    assert model.assembly is not None
    extended = copy.copy(model)
    extended.assembly, extended.drivers = None, dict(model.drivers)
    for joint, guess in model.assembly.guess.items():
        for coordinate, value in guess.coordinates.items():
            entry = {"joint": joint, coordinate: value}
            spec, problems = read_named("drivers", f"{joint}_{coordinate}", entry, ReadContext())
            assert not problems  # the guess was checked with the model
            extended.drivers[f"guess_of_{joint}_{coordinate}"] = spec  # type: ignore[assignment]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlexmbWarning)  # the model itself has shown them
        with_guesses = compile_system(extended, compiled.flexbodies)
    near = new_state(with_guesses.system, len(with_guesses.layout.channels))
    near.q[:] = state.q
    _iterate(make(with_guesses, near), _GUESS_TOLERANCE)
    if np.all(np.isfinite(near.q)):
        state.q[:] = near.q


def _check_fixed(compiled: Compiled, model: Model, moved: tuple[Offset, ...]) -> None:
    """Refuse a pose for which a fixed body had to move."""
    fixed = dict(zip(model.bodies, assembly_weights(model) >= FIXED_WEIGHT, strict=True))
    problems = []
    for body in moved:
        far = body.distance > _FIXED_TOLERANCE * compiled.length or body.angle > _FIXED_TOLERANCE
        if fixed[body.name] and far:
            what = (
                f"is fixed, but the gaps close only if it moves by {body.text(model.units)}: "
                "free it, or place it where its joints close"
            )
            problems.append(Problem(f"assembly.weights.{body.name}", what))
    if problems:
        raise AssemblyError.from_problems(problems)


def close_rows(
    constraints: ConstraintRows, q: Array, rows: Mask | None = None, t: float = 0.0
) -> ConstraintPose | None:
    """The pose near q (nq,) where `rows` (nc,), all by default, are zero at time t [s], or None.

    The change of bodies is least over the size of the model and in radians; modes hardly move.
    """
    compiled = constraints.compiled
    which = np.ones(compiled.layout.nc, bool) if rows is None else rows
    weights = compiled.system.row_weights
    scales = _closing_scales(compiled, np.ones(len(compiled.layout.bodies)))
    gap, best = np.inf, 0
    pose = constraints.evaluate(q, t)
    for n in range(_MAX_CORRECTIONS):
        size = float(np.abs(pose.C * weights)[which].max(initial=0.0))
        converged = size <= _ROUND_OFF or (size <= _CLOSED_ROWS and size > 0.5 * gap)
        if converged or not np.isfinite(size):
            break
        if size < 0.5 * gap:
            gap, best = size, n
        if n > best + _MAX_CORRECTIONS // 4:
            break
        step = _correction(pose, which, scales)
        if step is None:
            break
        pose = constraints.evaluate(constraints.move(pose.q, scales * step), t)
    left = np.abs(pose.C * weights)[which].max(initial=0.0)
    return pose if left <= _CLOSED_ROWS else None


def _closing_scales(compiled: Compiled, weights: Array) -> Array:
    """(nv,) scales as of `column_scales`, with weights of bodies; small for modes."""
    scales = column_scales(compiled)
    for body, weight in zip(compiled.layout.bodies, weights, strict=True):
        scales[body.iv : body.iv + 6 + body.m] /= np.sqrt(weight)
        scales[body.iv + 6 : body.iv + 6 + body.m] *= _MODAL_SCALE
    return scales


def _correction(pose: ConstraintPose, which: Mask, scales: Array) -> Array | None:
    """(nv,) Gauss–Newton correction over the scales, of limited length.

    None if a row has no gradient, such as a distance of zero.
    """
    weights = pose.compiled.system.row_weights
    A = (weights[:, None] * pose.Cq * scales)[which]
    if not np.all(np.isfinite(A)):
        return None
    step: Array = np.linalg.lstsq(A, -(pose.C * weights)[which], rcond=_ZERO_SINGULAR_VALUE)[0]
    longest = float(np.abs(step).max(initial=0.0))
    return step * min(1.0, _MAX_CORRECTION / longest) if longest > 0 else step


def nearby_poses(
    constraints: ConstraintRows, start: ConstraintPose, rows: Mask, seed: int = 0
) -> list[ConstraintPose]:
    """Up to two poses of the same assembly, a small distance along its free motions.

    Only `rows`, such as those of the joints, are zero there. Empty if the free motions do not lead
    to closed poses.
    """
    rng, compiled = np.random.default_rng(seed), constraints.compiled
    scales, jacobian = column_scales(compiled), start.jacobian
    free = null_space(jacobian.A[rows])
    motions = np.zeros((len(scales), free.shape[1]))
    motions[jacobian.columns] = free
    poses: list[ConstraintPose] = []
    for _ in range(_MAX_TRIALS if free.shape[1] else 0):
        step = motions @ rng.standard_normal(motions.shape[1])
        step *= _NEARBY / np.abs(step).max()
        pose = close_rows(constraints, constraints.move(start.q, scales * step), rows)
        poses += [] if pose is None else [pose]
        if len(poses) == 2:
            break
    return poses


def take_turns_of_drivers(compiled: Compiled, model: Model, state: State) -> None:
    """Give coordinates that count turns those of the drivers at the state's time.

    The rows of angles are closed by any number of turns: a screw that is driven to 30 rad would
    have moved by a third of its pitch, and a coil spring would have been wound by less than half a
    turn. Couplers pass turns on from joint to joint.
    """
    names, angles = compiled.layout.coordinates, {}
    first_rows = zip(compiled.layout.reactions, compiled.system.groups["row"], strict=True)
    for path, row in first_rows:
        spec = model.drivers.get(path.removeprefix("drivers.")) if "drivers." in path else None
        if spec is not None and spec.joint is not None and spec.coordinate != "stroke":
            function = compiled.functions[int(compiled.system.rows[row]["fun"])]
            angles[spec.joint, spec.coordinate] = function.value(float(state.t[0]))[0]
    if not angles:
        return
    counts: dict[str, float] = {}
    rows = [row for row in coupled_rows(model, compiled.flexbodies) if row.coordinate != "stroke"]
    rows += [screw_rows(model, name)[0] for name in model.joints if screw_rows(model, name)]
    for _ in rows:
        for row in rows:
            key, open_factors = (row.joint, row.coordinate), []
            rest = row.offset
            for name, factor in row.factors:
                if name in counts:
                    rest += factor * counts[name]
                else:
                    open_factors.append((name, factor))
            if not open_factors:
                angles.setdefault(key, rest)
            elif len(open_factors) == 1 and key in angles:
                counts[open_factors[0][0]] = (angles[key] - rest) / open_factors[0][1]
    for name, force in forces_on_joints(model).items():
        key = force.joint, joint_coordinate(model, force)
        if key in angles:
            counts[f"forces.{name}"] = angles[key]
    for name, value in counts.items():
        state.q[names.index(name) - len(names)] = value
