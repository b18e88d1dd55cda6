"""What joints on curves leave out: followers lift off, and cams cannot pass through them.

In: the contacts of a compiled system, rows of a run, or the first state. Out: notes for the user,
or the problems of a follower on the wrong side or branch of its cam.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile import Compiled
from flexmb.engine.state import State, Work
from flexmb.errors import Problem
from flexmb.model.model import Model
from flexmb.results import OutputBlock

__all__ = ["Lifts", "branch_problems"]

Array = NDArray[np.float64]
_PULL = 1e-6  # of the largest force of the joint so far: pulls smaller than this are round-off
_CUT = 1e-6  # of the size of a curve that a follower may be inside of it


class Lifts:
    """When each joint that can only push first pulls; fed with the rows of a run in order."""

    def __init__(self, compiled: Compiled) -> None:
        self._contacts = compiled.contacts
        self._largest = np.zeros(len(self._contacts))
        self._first: dict[str, float] = {}

    def see(self, rows: OutputBlock) -> None:
        """Take in some rows."""
        for k, contact in enumerate(self._contacts if len(rows.t) else ()):
            push = contact.compressed * rows.lam[:, contact.row]
            self._largest[k] = max(self._largest[k], float(np.abs(push).max()))
            pulls = push < -_PULL * self._largest[k]
            if contact.joint not in self._first and pulls.any():
                self._first[contact.joint] = float(rows.t[np.argmax(pulls)])

    def notes(self) -> list[str]:
        """A sentence for each."""
        return [
            f"joints.{joint} pulls its follower towards the cam, first at t = {time:.6g} s: there "
            "contact is kept by force; use an impact force in its place, or a stronger spring"
            for joint, time in self._first.items()
        ]


def branch_problems(
    compiled: Compiled, model: Model, state: State, work: Work
) -> Iterator[Problem]:
    """Followers that their cam passes through in the assembled pose: on a wrong branch."""
    system = compiled.system
    for curve in system.parts.curve_markers:
        name = compiled.layout.coordinates[curve["coordinate"]].split(".")[1]
        joint = model.joints[name]
        if joint.type not in ("cam-flat", "cam-roller"):
            continue
        points, size = _points(compiled, curve, state, work)
        row = system.rows[system.groups[curve["group"]]["row"]]
        follower = work.now.marker[int(row["I" if curve["side"] else "J"])]
        if joint.type == "cam-flat":
            height = (points - follower["x"]) @ follower["R"][:, 2]
            cut = min(height.max(), -height.min())
        else:
            assert joint.radius is not None  # a roller has one
            cut = joint.radius - np.linalg.norm(points - follower["x"], axis=1).min()
        if cut > _CUT * size:
            deep = model.units.say(float(cut), "m", 3)
            what = (
                f"touches the curve, but another part of it reaches {deep} into the follower; "
                "begin on the other side or at another place (start), or change the shape there"
            )
            yield Problem(f"joints.{name}", what)


def _points(compiled: Compiled, curve: np.void, state: State, work: Work) -> tuple[Array, float]:
    """Points (n, 3) of a curve where its marker stands now, and the size of the curve [m]."""
    parts = compiled.system.parts
    coordinates = parts.coordinates
    at, n = int(curve["at"]), int(curve["n"])
    ends = parts.pool[at : at + n + 1]
    pieces = parts.pool[at + n + 1 : at + n + 1 + 18 * n].reshape(n, 3, 6)
    t = np.linspace(0.0, 1.0, 5)[:, None] * np.diff(ends)
    powers = t[:, :, None] ** np.arange(6)
    local = np.einsum("tkp,kap->kta", powers, pieces).reshape(-1, 3)
    now = work.now.marker[int(curve["marker"])]
    s = state.q[coordinates[curve["coordinate"]]["iq"]]
    if curve["closed"]:
        s %= ends[-1]
    k = min(max(int(np.searchsorted(ends, s, side="right")) - 1, 0), n - 1)
    here = pieces[k] @ (s - ends[k]) ** np.arange(6)
    slope = pieces[k][:, 1:] @ (np.arange(1, 6) * (s - ends[k]) ** np.arange(5))
    turn = np.eye(3)
    c, d = slope[:2] / np.linalg.norm(slope[:2])
    turn[:2, :2] = [[c, -d], [d, c]]
    R = now["R"] @ turn.T  # of the marker that carries the curve
    return now["x"] + (local - here) @ R.T, float(np.linalg.norm(np.ptp(local, axis=0)))
