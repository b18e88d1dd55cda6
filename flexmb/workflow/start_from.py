"""The start of a run from the end of another one: bodies matched by their names.

In: the compiled model, its flexible bodies, another result. Out: positions and velocities to begin
with, and notes on what was matched. Time starts again at 0. The joints and drivers of the new scene
take precedence at that time; what they change of the other run's end is reported afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexmb.errors import Problem, ResultFileError
from flexmb.workflow.resume import body_hash, provenance

if TYPE_CHECKING:
    from flexmb.analysis.assembly.initial_state import StartValues
    from flexmb.engine.compile import Compiled
    from flexmb.engine.state import State
    from flexmb.engine.tables import BodyColumns
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result
    from flexmb.units import UnitSystem

_MIN_CHANGE = 1e-6  # change of the start that is reported: over the model's size, or the speed
_MIN_ROTATION = 1e-4  # rad; arccos near 1 leaves 1e-8


@dataclass(frozen=True)
class StartState:
    """The end of another run as the start of this one."""

    source: Path
    begin: StartValues
    matched: tuple[BodyColumns, ...]
    notes: tuple[str, ...]

    def changes(self, compiled: Compiled, state: State, units: UnitSystem) -> list[str]:
        """What differs in the first state from the end of the other run, a sentence per body."""
        speed = max(float(np.abs(np.nan_to_num(self.begin.v)).max(initial=0.0)), 1e-12)
        changes = np.abs(state.v - self.begin.v)
        sentences = []
        for body in self.matched:
            q, p = self.begin.q[body.iq :], state.q[body.iq :]
            moved = float(np.linalg.norm(p[:3] - q[:3]))
            turned = 2.0 * float(np.arccos(min(abs(float(p[3:7] @ q[3:7])), 1.0)))
            change = changes[body.iv :]
            faster, spun = float(change[:3].max()), float(change[3:6].max())
            parts = (
                (moved > _MIN_CHANGE * compiled.length, f"moved by {units.say(moved, 'm', 3)}"),
                (turned > _MIN_ROTATION, f"turned by {turned:.3g} rad"),
                (faster > _MIN_CHANGE * speed, f"velocity by up to {units.say(faster, 'm/s', 3)}"),
                (
                    spun > _MIN_CHANGE * speed,
                    f"angular velocity by up to {units.say(spun, 'rad/s', 3)}",
                ),
            )
            changed = ", ".join(text for reported, text in parts if reported)
            if changed:
                where = f"bodies.{body.name}: joints and drivers at t = 0 change its start"
                sentences.append(f"{where}: {changed}")
        return sentences


def match_start(
    model: Model, compiled: Compiled, bodies: Mapping[str, FlexBody], source: Result | str | Path
) -> StartState:
    """Match the bodies, states and controllers of a model with those of a result by name.

    Parameters
    ----------
    model, compiled : Model, Compiled
        The model, and its compiled system.
    bodies : mapping of str to FlexBody
        Its flexible bodies.
    source : Result or path
        The other run; its last complete row is taken.

    Raises
    ------
    ResultFileError
        The result cannot be read, holds no rows, has no body of a name of this model, or is not
        in the plane of a planar model.
    """
    from flexmb.analysis.assembly.initial_state import StartValues
    from flexmb.results import Result

    other = source if isinstance(source, Result) else Result(source)
    if not len(other.time):
        raise ResultFileError(f"{other.path}: holds no output rows to begin from")
    if model.plane not in (None, other.model.get("plane")):
        what = f"is no run in the plane {model.plane}, in which this scene moves"
        raise ResultFileError(f"{other.path}: {what}")
    theirs = {body.name: body for body in other.layout.bodies}
    matched = tuple(body for body in compiled.layout.bodies if body.name in theirs)
    if not matched:
        names = tuple(body.name for body in compiled.layout.bodies)
        what = f"has no body of this scene; it has {', '.join(theirs)}"
        raise ResultFileError.from_problems([Problem(str(other.path), what, names)])
    q, v = compiled.initial_q.copy(), np.full(compiled.layout.nv, np.nan)
    reductions = provenance(other).get("bodies", {})
    undeformed = []
    for body in matched:
        old = theirs[body.name]
        same = body.m > 0 and _same_modes(bodies[body.name], reductions.get(body.name, {}))
        m = body.m if same else 0
        q[body.iq : body.iq + 7 + m] = other.part("q", slice(old.iq, old.iq + 7 + m))[-1]
        v[body.iv : body.iv + 6 + body.m] = 0.0
        v[body.iv : body.iv + 6 + m] = other.part("v", slice(old.iv, old.iv + 6 + m))[-1]
        if body.m > 0 and not same:
            undeformed.append(body.name)
    scalars = other.layout.coordinates
    old_at = {name: other.layout.nv - len(scalars) + k for k, name in enumerate(scalars)}
    first = compiled.layout.nv - len(compiled.layout.coordinates)
    for k, name in enumerate(compiled.layout.coordinates):
        if name.startswith("states.") and name in old_at:
            v[first + k] = other.part("v", [old_at[name]])[-1, 0]
    notes = [_matching_note(other, matched, compiled)]
    if undeformed:
        notes.append(
            f"begins without deformation, since its reduction differs: {', '.join(undeformed)}"
        )
    return StartState(other.path, StartValues(q, v), matched, tuple(notes))


def _same_modes(body: FlexBody, stored: Mapping[str, str]) -> bool:
    """Whether modal coordinates have the same meaning: the same reduction, or the same body.

    Two reductions of the same mesh with the same options differ by round-off only.
    """
    key = body.provenance.get("key", "")
    return bool(key and key == stored.get("key")) or body_hash(body) == stored.get("hash")


def _matching_note(other: Result, matched: tuple[BodyColumns, ...], compiled: Compiled) -> str:
    names = {body.name for body in matched}
    left = [body.name for body in compiled.layout.bodies if body.name not in names]
    gone = [body.name for body in other.layout.bodies if body.name not in names]
    unit = other.units.label("s")
    text = f"begins at t = 0 as {other.path} ended at t = {other.time[-1]:g} {unit}: "
    text += ", ".join(body.name for body in matched)
    if left:
        text += f"; as placed in the scene: {', '.join(left)}"
    if gone:
        text += f"; not in this scene: {', '.join(gone)}"
    return text
