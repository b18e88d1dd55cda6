"""Followers that joints on curves pull: there contact is lost in reality.

In: the contacts of a compiled system, rows of a run. Out: notes for the user.
"""

from __future__ import annotations

import numpy as np

from flexmb.engine.compile import Compiled
from flexmb.results import OutputBlock

_PULL = 1e-6  # of the largest force of the joint so far: pulls smaller than this are round-off


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
