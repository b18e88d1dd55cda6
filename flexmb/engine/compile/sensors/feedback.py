"""Tables of functions over channels: which run, what they read, where they act in the KKT matrix.

Each function that acts (a component of a load, the force on a scalar coordinate, the rate of a
state) depends on markers and states by its channels; for each pair of what acts and what it depends
on, one rank-one block stands in the iteration matrix.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.bodies.marker import MarkerTable
from flexmb.engine.lowering import Lowering
from flexmb.engine.sensor_kinds import CHANNEL_KINDS, MEASURES
from flexmb.engine.sensor_tables import (
    FEEDBACK_TANGENT,
    PARTIAL,
    Feedback,
    Sensors,
)
from flexmb.engine.symbolic import Symbolic
from flexmb.engine.tables import Functions
from flexmb.model.sensors.control import State

__all__ = ["FeedbackTables", "Start", "feedback_tables", "starts"]


class Start(NamedTuple):
    """Where a state starts: a value, or that of a function at the first moment."""

    iv: int
    value: float
    program: int  # -1: the value


class _Effect(NamedTuple):
    """What a function acts on: a component of a row of a kind, or a scalar coordinate."""

    program: int
    kind: int
    row: int
    on: int
    a: int
    iv: int
    block: int


@dataclass
class FeedbackTables:
    """The tables, and the blocks that each of their tangents couples."""

    feedback: Feedback
    blocks: list[tuple[int, int]]

    @property
    def couples(self) -> list[tuple[int, int]]:
        """Pairs of different blocks."""
        return [pair for pair in dict.fromkeys(self.blocks) if pair[0] != pair[1]]

    def place(self, symbolic: Symbolic) -> None:
        """Tell every tangent where its block is."""
        for tangent, pair in zip(self.feedback.tangents, self.blocks, strict=True):
            tangent["panel"] = symbolic.panel_of[pair[0]]
            tangent["link"] = symbolic.couple_links.get(pair, -1)


def starts(states: tuple[State, ...], ivs: Mapping[str, int], functions: Functions) -> list[Start]:
    """The start of every state."""
    return [
        Start(ivs[state.name], state.start, -1)
        if isinstance(state.start, float)
        else Start(ivs[state.name], 0.0, functions.put(state.start))
        for state in states
    ]


def feedback_tables(
    lowering: Lowering,
    kinds: Sequence[str],
    numbers: Mapping[str, int],
    sensors: Sensors,
    scalars: NDArray[np.void],
) -> FeedbackTables | None:
    """Tables of all functions that name channels; None if there are none.

    `kinds` are those that functions act through, in their order; `numbers` are those of the
    channels by name. Blocks are numbered as in `symbolic.Blocks`: bodies, then scalar coordinates.
    """
    live = {k: f.channels for k, f in enumerate(lowering.functions.programs) if f.channels}
    if not live:
        return None
    markers = lowering.markers
    partials: list[tuple[int, int]] = []
    tangents: list[tuple[int, ...]] = []
    blocks: list[tuple[int, int]] = []
    for effect in _effects(live, lowering, kinds, scalars):
        for name in live[effect.program]:
            pair = effect.program, numbers[name]
            if pair not in partials:
                partials.append(pair)
            at = partials.index(pair)
            acts = effect.kind, effect.row, effect.on, effect.a, effect.iv
            for term, side, state, block in _sources(
                sensors, numbers[name], scalars, markers, len(markers.bodies)
            ):
                tangents.append((at, *acts, -1, term, side, state, -1))
                blocks.append((effect.block, block))
    used = sorted({numbers[name] for names in live.values() for name in names})
    feedback = Feedback(
        programs=np.array(list(live), np.int64),
        channels=np.array(used, np.int64),
        partials=np.array(partials, PARTIAL),
        tangents=np.array(tangents, FEEDBACK_TANGENT),
        implicit=int(any(_implicit(sensors, c) for c in used)),
    )
    return FeedbackTables(feedback, blocks)


def _effects(
    live: Mapping[int, Any],
    lowering: Lowering,
    kinds: Sequence[str],
    scalars: NDArray[np.void],
) -> Iterator[_Effect]:
    """Everything that a function over channels acts on."""
    for action in lowering.actions:
        body = lowering.markers.body(action.marker)
        if action.program in live and body >= 0:
            kind = kinds.index(action.kind)
            yield _Effect(action.program, kind, action.row, action.on, action.a, -1, body)
    for k, scalar in enumerate(scalars):
        if int(scalar["fun"]) in live:
            block = len(lowering.markers.bodies) + k
            yield _Effect(int(scalar["fun"]), -1, -1, 0, 0, int(scalar["iv"]), block)


def _sources(sensors: Sensors, number: int, scalars, markers: MarkerTable, n_bodies: int):
    """(term, side, state, block) of everything that a channel depends on."""
    channel = sensors.channels[number]
    reads = CHANNEL_KINDS[channel["what"]].reads
    if reads == "state":
        iv = int(channel["first"])
        yield -1, 0, iv, n_bodies + int(np.flatnonzero(scalars["iv"] == iv)[0])
    elif reads == "terms":
        for k in range(channel["first"], channel["first"] + channel["n"]):
            term = sensors.terms[k]
            for side, marker in enumerate((int(term["I"]), int(term["J"]))):
                body = markers.body(marker) if marker >= 0 else -1
                if body >= 0:
                    yield k, side, -1, body


def _implicit(sensors: Sensors, number: int) -> bool:
    """Whether a channel depends on accelerations, or on reactions and other forces."""
    channel = sensors.channels[number]
    reads = CHANNEL_KINDS[channel["what"]].reads
    if reads == "terms":
        terms = sensors.terms[channel["first"] : channel["first"] + channel["n"]]
        return any(MEASURES[term["measure"]].level == 2 for term in terms)
    return reads in ("forces", "channels")
