"""Beginning a run where another one ended: bodies matched by their names.

In: the compiled model, its flexible bodies, another result. Out: positions and velocities to begin
with, and notes on what was matched. Time starts anew at 0; what joints and drivers of the new scene
ask for at that time holds, and what had to give way for it is told afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexmb.errors import Problem, ResultFileError
from flexmb.workflow.origin import body_hash, origin

if TYPE_CHECKING:
    from flexmb.analysis.assembly.initial_state import StartValues
    from flexmb.engine.compile import Compiled
    from flexmb.engine.layout import BodyColumns
    from flexmb.engine.state import State
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result
    from flexmb.units import UnitSystem

__all__ = ["Beginning", "beginning"]

_MOVED = 1e-6  # change of the start that is told: over the size of the model, or the speed
_TURNED = 1e-4  # rad; arccos near 1 leaves 1e-8


@dataclass(frozen=True)
class Beginning:
    """The end of another run as the start of this one."""

    source: Path
    begin: StartValues
    matched: tuple[BodyColumns, ...]
    notes: tuple[str, ...]

    def changes(self, compiled: Compiled, state: State, units: UnitSystem) -> list[str]:
        """What the first state had to change of what was taken over, a sentence for each body."""
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
                (moved > _MOVED * compiled.length, f"moved by {units.say(moved, 'm', 3)}"),
                (turned > _TURNED, f"turned by {turned:.3g} rad"),
                (faster > _MOVED * speed, f"velocity by up to {units.say(faster, 'm/s', 3)}"),
                (spun > _MOVED * speed, f"angular velocity by up to {units.say(spun, 'rad/s', 3)}"),
            )
            found = ", ".join(text for told, text in parts if told)
            if found:
                where = f"bodies.{body.name}: joints and drivers at t = 0 change its start"
                sentences.append(f"{where}: {found}")
        return sentences


def beginning(
    model: Model, compiled: Compiled, bodies: Mapping[str, FlexBody], given: Result | str | Path
) -> Beginning:
    """Match the bodies, states and controllers of a model with those of a result by name.

    Parameters
    ----------
    model, compiled : Model, Compiled
        The model, and what was compiled of it.
    bodies : mapping of str to FlexBody
        Its flexible bodies.
    given : Result or path
        The other run; its last whole row counts.

    Raises
    ------
    ResultFileError
        The result cannot be read, holds no rows, has no body of a name of this model, or is not
        in the plane of a planar model.
    """
    from flexmb.analysis.assembly.initial_state import StartValues
    from flexmb.results import Result

    other = given if isinstance(given, Result) else Result(given)
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
    q, v = compiled.placed.copy(), np.full(compiled.layout.nv, np.nan)
    known = origin(other).get("bodies", {})
    undeformed = []
    for body in matched:
        old = theirs[body.name]
        same = body.m > 0 and _same_modes(bodies[body.name], known.get(body.name, {}))
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
    notes = [_told(other, matched, compiled)]
    if undeformed:
        notes.append(
            f"begins without deformation, being reduced otherwise: {', '.join(undeformed)}"
        )
    return Beginning(other.path, StartValues(q, v), matched, tuple(notes))


def _same_modes(body: FlexBody, known: Mapping[str, str]) -> bool:
    """Whether modal coordinates mean the same as then: the same reduction, or the same body.

    Two reductions of the same mesh with the same options differ by round-off only.
    """
    key = body.provenance.get("key", "")
    return bool(key and key == known.get("key")) or body_hash(body) == known.get("hash")


def _told(other: Result, matched: tuple[BodyColumns, ...], compiled: Compiled) -> str:
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
