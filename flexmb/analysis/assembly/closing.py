"""Closing the positions of a model with least change of its placed pose.

Gauss–Newton corrections of q towards C = 0, least in a metric: the masses of the bodies, or the
weights of a kinematic analysis, times what the scene says of each body. With a guess of joint
coordinates the placed pose is first brought near it: the guesses stand as further rows that need
not close (least squares), then the joints and drivers alone close from there, on that branch.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.gaps import Moved, check_branches, gap_problems, moved_bodies
from flexmb.engine.compile import Compiled, compile_system
from flexmb.engine.entries import POSITIONS, RESIDUAL, solve_level
from flexmb.engine.state import State, Work
from flexmb.engine.tables import System
from flexmb.engine.work import new_state, new_work
from flexmb.errors import AssemblyError, FlexmbWarning, Problem
from flexmb.model.model import Model
from flexmb.model.scenes.sections import read_named
from flexmb.model.values.reading import Terms

__all__ = ["HEAVY", "Closer", "MakeCloser", "body_weights", "close_positions", "mass_closer"]

HEAVY = 1e10
"""Weight of a fixed body."""

_ROUNDS = 60
_OPEN = 1e-10  # gap relative to the model size, or radians
_CLOSED = 1e-13  # correction of a position relative to the model size: round-off
_NEAR = 1e-6  # correction at which the least squares of a guess are found
_KEPT = 1e-6  # a fixed body may move by this share of the model size, or this angle


@dataclass(frozen=True)
class Closer:
    """The engine at one state: corrections of its positions, and C and markers at them."""

    work: Work
    correct: Callable[[], float]  # one correction; its weighted size
    evaluate: Callable[[], object]


MakeCloser = Callable[[Compiled, State], Closer]
"""What makes a closer for a compiled system and a state."""


def mass_closer(system: System, state: State, work: Work | None = None) -> Closer:
    """Corrections that are least in the mass matrix of a system."""
    used = work if work is not None else new_work(system)
    return Closer(
        used,
        lambda: float(solve_level(system, state, used, POSITIONS)),
        lambda: solve_level(system, state, used, RESIDUAL),
    )


def body_weights(model: Model) -> NDArray[np.float64]:
    """(bodies,) factors of `[assembly] weights`, `HEAVY` for fixed bodies."""
    told = {} if model.assembly is None else model.assembly.weights
    given = (told.get(name, 1.0) for name in model.bodies)
    return np.array([HEAVY if w == "fixed" else float(w) for w in given])


def close_positions(
    compiled: Compiled, model: Model, state: State, make: MakeCloser, guess: bool = True
) -> tuple[Moved, ...]:
    """Close the positions of a state; returns how far the bodies were moved.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The compiled model, and the model for its guesses and fixed bodies.
    state : State
        The pose to begin from; its q becomes the closed one.
    make : callable
        Makes the closer, whose metric says what little change is.
    guess : bool
        Whether to begin near the coordinates that the scene guesses.

    Raises
    ------
    AssemblyError
        Gaps that stay open (the worst joints), a joint on its wrong branch, or a fixed body that
        had to move.
    """
    start = state.q.copy()
    if not compiled.layout.nc:
        return ()
    if guess and model.assembly is not None and model.assembly.guess:
        _go_near(model, compiled, state, make)
    closer = make(compiled, state)
    _rounds(closer, _CLOSED)
    closer.evaluate()
    moved = moved_bodies(compiled, start, state.q)
    if not np.abs(closer.work.con.C * compiled.system.row_weights).max() <= _OPEN:
        raise AssemblyError.from_problems(gap_problems(compiled, model, closer.work, moved))
    check_branches(compiled, model, state, closer.work)
    _check_fixed(compiled, model, moved)
    return moved


def _rounds(closer: Closer, enough: float) -> None:
    for _ in range(_ROUNDS):
        size = closer.correct()
        if not np.isfinite(size) or size <= enough:
            return  # closed, or at a pose from which no small motion narrows the gaps


def _go_near(model: Model, compiled: Compiled, state: State, make: MakeCloser) -> None:
    """Bring the state near the guesses, as near as joints and drivers allow."""
    assert model.assembly is not None
    made = copy.copy(model)
    made.assembly, made.drivers = None, dict(model.drivers)
    for joint, guess in model.assembly.guess.items():
        for coordinate, value in guess.coordinates.items():
            told = {"joint": joint, coordinate: value}
            spec, problems = read_named("drivers", f"{joint}_{coordinate}", told, Terms())
            assert not problems  # the guess was checked with the model
            made.drivers[f"guess_of_{joint}_{coordinate}"] = spec  # type: ignore[assignment]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlexmbWarning)  # said of the model itself already
        guessed = compile_system(made, compiled.flexbodies)
    near = new_state(guessed.system, len(guessed.layout.channels))
    near.q[:] = state.q
    _rounds(make(guessed, near), _NEAR)
    if np.all(np.isfinite(near.q)):
        state.q[:] = near.q


def _check_fixed(compiled: Compiled, model: Model, moved: tuple[Moved, ...]) -> None:
    """Refuse a pose for which a fixed body had to move."""
    fixed = dict(zip(model.bodies, body_weights(model) >= HEAVY, strict=True))
    problems = []
    for body in moved:
        far = body.distance > _KEPT * compiled.length or body.angle > _KEPT
        if fixed[body.name] and far:
            what = (
                f"is fixed, but the gaps close only if it moves by {body.said(model.units)}: "
                "free it, or place it where its joints close"
            )
            problems.append(Problem(f"assembly.weights.{body.name}", what))
    if problems:
        raise AssemblyError.from_problems(problems)
