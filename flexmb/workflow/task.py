"""Which analysis a run makes, and that analysis ready to go.

In: a compiled model. Out: a :class:`Task` that writes the rows of dynamics or of kinematics into
whatever takes them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flexmb.errors import Problem, SceneError, nearest
from flexmb.progress import Progress

if TYPE_CHECKING:
    from flexmb.analysis.dynamics.analysis import Outcome, Sink
    from flexmb.engine.compile import Compiled
    from flexmb.model import Model
    from flexmb.workflow.begin import Beginning

__all__ = ["ANALYSES", "Task", "chosen_analysis", "prepared_task"]

ANALYSES = ("dynamics", "kinematics")
"""Sections of a scene that say how to run it, and the names of what they run."""


@dataclass(frozen=True)
class Task:
    """An analysis that is ready: its number of rows, what it does, notes."""

    analysis: str
    rows: int
    run: Callable[[Sink], Outcome]
    notes: tuple[str, ...] = ()

    def scene(self, scene: dict[str, Any]) -> dict[str, Any]:
        """The scene as the result keeps it: without the sections of other analyses."""
        return {k: v for k, v in scene.items() if k == self.analysis or k not in ANALYSES}


def chosen_analysis(model: Model, asked: str | None, begins_elsewhere: bool = False) -> str:
    """The analysis that is asked for, or that of the only section the scene has.

    Raises
    ------
    SceneError
        Unknown, not in the scene, or not told though the scene has both.
    """
    has = [name for name in ANALYSES if getattr(model, name) is not None]
    if asked is not None and asked not in ANALYSES:
        what = f'unknown analysis "{asked}"'
        raise SceneError.from_problems([Problem("", what, ANALYSES, nearest(asked, ANALYSES))])
    if not has and asked is None:
        raise SceneError("the scene has no [dynamics] and no [kinematics]: give its duration")
    if asked is not None and asked not in has:
        raise SceneError(f"the scene has no [{asked}]: give its duration")
    if asked is None and len(has) > 1:
        raise SceneError(
            "the scene has [dynamics] and [kinematics]: say which one to run (--analysis dynamics "
            "or --analysis kinematics)"
        )
    chosen = asked or has[0]
    if chosen == "kinematics" and begins_elsewhere:
        raise SceneError(
            "a kinematic analysis begins where its drivers say, not where another run ended: "
            "leave --from out, or guess joint coordinates (assembly.guess)"
        )
    return chosen


def prepared_task(
    analysis: str, compiled: Compiled, model: Model, other: Beginning | None, progress: Progress
) -> Task:
    """Compile kernels and find the first state of an analysis.

    Parameters
    ----------
    analysis : str
        From `chosen_analysis`.
    compiled, model : Compiled, Model
        The model and what was compiled of it.
    other : Beginning, optional
        Where another run ended, to begin there.
    progress : Progress
        Told every phase.
    """
    from flexmb.analysis.dynamics.analysis import integrate, prepare
    from flexmb.analysis.kinematics.kinematics import prepare_kinematics, run_kinematics

    if analysis == "kinematics":
        ready = prepare_kinematics(compiled, model, progress=progress)
        return Task(
            analysis, ready.points, lambda sink: run_kinematics(ready, sink, progress=progress)
        )
    begin = other.begin if other is not None else None
    prepared = prepare(compiled, model, begin=begin, progress=progress)
    notes: tuple[str, ...] = ()
    if other is not None:
        changes = other.changes(compiled, prepared.run.state, model.units)
        notes = (*other.notes, *changes)
    assert model.dynamics is not None  # it is prepared
    return Task(
        analysis,
        model.dynamics.n_rows,
        lambda sink: integrate(prepared, sink, progress=progress),
        notes,
    )
