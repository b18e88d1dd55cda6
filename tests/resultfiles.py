"""Small result files made without running anything, for the tests of results, view and cli."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.results.output_block import OutputBlock
from flexmb.results.writer import ResultWriter


@dataclass(frozen=True)
class FakeBody:
    """One body of a layout."""

    name: str
    iq: int
    iv: int
    m: int


@dataclass(frozen=True)
class FakeLayout:
    """The layout of a crank and a flexible rod with two modes."""

    bodies: tuple[FakeBody, ...] = (FakeBody("crank", 0, 0, 0), FakeBody("rod", 7, 6, 2))
    nq: int = 16
    nv: int = 14
    nc: int = 3
    coordinates: tuple[str, ...] = ()
    reactions: tuple[str, ...] = ("joints.pin",)
    rows: tuple[str, ...] = ("pin.x", "pin.y", "pin.z")
    channels: tuple[str, ...] = ("slider.x", "slider.y", "slider.z", "turn")
    energies: tuple[str, ...] = ("kinetic", "strain", "balance")
    fingerprint: str = "f00d"


SCENE: dict[str, Any] = {
    "title": "a fake",
    "sensors": {"slider": {"type": "position"}, "turn": {"type": "angle"}},
}


def block(start: int, k: int, layout: FakeLayout | None = None) -> OutputBlock:
    """Rows start..start+k: every number is its row, orientations turn about z by 0.1 rad a row."""
    layout = layout or FakeLayout()
    t = np.arange(start, start + k, dtype=float)
    q = np.repeat(t[:, None], layout.nq, axis=1)
    for body in layout.bodies:
        q[:, body.iq + 3 : body.iq + 7] = 0.0
        q[:, body.iq + 3] = np.cos(0.05 * t)
        q[:, body.iq + 6] = np.sin(0.05 * t)

    def columns(n: int) -> np.ndarray:
        return np.repeat(t[:, None], n, axis=1)

    return OutputBlock(
        t=0.01 * t,
        q=q,
        v=columns(layout.nv),
        vd=columns(layout.nv),
        lam=columns(layout.nc),
        reactions=columns(12 * len(layout.reactions)),
        sensors=columns(len(layout.channels)),
        energy=columns(len(layout.energies)),
        drift=columns(2),
    )


def writer(path: Path, n_outputs: int = 20, **options: Any) -> ResultWriter:
    """An open writer of the fake run."""
    return ResultWriter(path, FakeLayout(), n_outputs, **{"scene": SCENE, **options})
