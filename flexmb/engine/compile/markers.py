"""Table of markers, made while joints, forces and sensors ask for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.pool import Pool
from flexmb.engine.tables import MARKER
from flexmb.model.bodies.markers import PlacedMarker
from flexmb.model.values.names import GROUND


@dataclass
class Markers:
    """Markers by index; equal ones share a row and the pool's numbers."""

    bodies: list[str]
    pool: Pool
    rows: list[tuple[Any, ...]] = field(default_factory=list)
    known: dict[tuple[Any, ...], int] = field(default_factory=dict)
    modes: dict[bytes, int] = field(default_factory=dict)
    framed: set[int] = field(default_factory=set)  # markers whose axes matter
    numbers: dict[str, int] = field(init=False)  # of the bodies by name, -1 for ground

    def __post_init__(self) -> None:
        self.numbers = {GROUND: -1} | {name: k for k, name in enumerate(self.bodies)}

    def add(self, marker: PlacedMarker, point: bool = False) -> int:
        """Index of the marker; `point` if only its place matters to who asks."""
        row = self._row(marker)
        body, modes, rho, arm, R = row
        key = body, modes, rho.tobytes(), arm.tobytes(), R.tobytes()
        if key not in self.known:
            self.known[key] = len(self.rows)
            self.rows.append(row)
        if not point:
            self.framed.add(self.known[key])
        return self.known[key]

    def frame_together(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Let the axes of both markers of a pair matter where those of one do."""
        partners: dict[int, set[int]] = {}
        for i, j in pairs:
            partners.setdefault(i, set()).add(j)
            partners.setdefault(j, set()).add(i)
        self.framed |= {k for k, row in enumerate(self.rows) if row[1] >= 0}  # moved by modes
        waiting = list(self.framed)
        while waiting:
            new = partners.get(waiting.pop(), set()) - self.framed
            self.framed |= new
            waiting.extend(new)

    def own(self, marker: PlacedMarker) -> int:
        """Index of a row for this marker that no other shares: one that slides along a curve."""
        self.rows.append(self._row(marker))
        self.framed.add(len(self.rows) - 1)
        return len(self.rows) - 1

    def _row(self, marker: PlacedMarker) -> tuple[Any, ...]:
        body = self.numbers[marker.body]
        modes = self._modes(marker)
        rho, arm = marker.rho, marker.arm
        if modes < 0:  # what no mode moves is one rigid place
            rho, arm = marker.position, np.zeros(3)
        return body, modes, rho, arm, marker.R

    def body(self, marker: int) -> int:
        """Body of a marker, -1 for ground."""
        return self.rows[marker][0]

    def on_ground(self) -> NDArray[np.float64]:
        """Positions (n, 3) of those on the ground so far."""
        return np.array([row[2] for row in self.rows if row[0] < 0]).reshape(-1, 3)

    def _modes(self, marker: PlacedMarker) -> int:
        if marker.Phi_t is None or marker.Phi_r is None or marker.Phi_t.shape[1] == 0:
            return -1
        both = np.vstack([marker.Phi_t, marker.Phi_r])
        key = marker.body.encode() + both.tobytes()
        if key not in self.modes:
            self.modes[key] = self.pool.add(both)
        return self.modes[key]

    def table(self) -> NDArray[np.void]:
        """MARKER rows."""
        table = np.zeros(len(self.rows), MARKER)
        if self.rows:
            table["point"] = [
                k not in self.framed and row[1] < 0 for k, row in enumerate(self.rows)
            ]
            for k, name in enumerate(("body", "modes", "rho", "arm", "R")):
                table[name] = [row[k] for row in self.rows]
        return table
