"""Tables of functions over channels: which run, what they read, where they act in the KKT matrix.

Each function that acts (a component of a load, the force on a scalar coordinate, the rate of a
state) depends on markers and states by its channels; for each pair of what acts and what it depends
on, one rank-one block stands in the iteration matrix.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.markers import Markers
from flexmb.engine.compile.pool import Functions
from flexmb.engine.compile.sensors.sensor import of_acceleration, sides_of
from flexmb.engine.element_tables import Elements
from flexmb.engine.sensor_tables import PARTIAL, PLACE, PULL, STATE, SUM, Sensors, Signals
from flexmb.engine.symbolic import Symbolic
from flexmb.model.sensors.signals import State

__all__ = ["Start", "SignalTables", "signal_tables", "starts"]


class Start(NamedTuple):
    """Where a state starts: a value, or that of a function at the first moment."""

    iv: int
    value: float
    program: int  # -1: the value


class _Effect(NamedTuple):
    """What a function acts on: a component of a load, or a scalar coordinate."""

    program: int
    load: int
    a: int
    iv: int
    block: int


@dataclass
class SignalTables:
    """The signals, and the blocks that each of their pulls couples."""

    signals: Signals
    blocks: list[tuple[int, int]]

    @property
    def couples(self) -> list[tuple[int, int]]:
        """Pairs of different blocks."""
        return [pair for pair in dict.fromkeys(self.blocks) if pair[0] != pair[1]]

    def place(self, symbolic: Symbolic) -> None:
        """Tell every pull where its block is."""
        for pull, pair in zip(self.signals.pulls, self.blocks, strict=True):
            pull["panel"] = symbolic.panel_of[pair[0]]
            pull["link"] = symbolic.couple_links.get(pair, -1)


def starts(states: tuple[State, ...], ivs: Mapping[str, int], functions: Functions) -> list[Start]:
    """The start of every state."""
    return [
        Start(ivs[state.name], state.start, -1)
        if isinstance(state.start, float)
        else Start(ivs[state.name], 0.0, functions.put(state.start))
        for state in states
    ]


def signal_tables(
    functions: Functions,
    numbers: Mapping[str, int],
    sensors: Sensors,
    loads: NDArray[np.void],
    scalars: NDArray[np.void] | None,
    markers: Markers,
    elements: Elements | None,
) -> SignalTables | None:
    """Tables of all functions that name channels; None if there are none.

    `numbers` are those of the channels by name. Blocks are numbered as in `symbolic.Blocks`:
    bodies, then scalar coordinates.
    """
    live = {k: f.channels for k, f in enumerate(functions.programs) if f.channels}
    if not live:
        return None
    n_bodies = len(markers.bodies)
    partials: list[tuple[int, int]] = []
    pulls: list[tuple[int, ...]] = []
    blocks: list[tuple[int, int]] = []
    for effect in _effects(live, loads, scalars, markers) + _acting(
        live, len(loads), markers, elements
    ):
        for name in live[effect.program]:
            pair = effect.program, numbers[name]
            if pair not in partials:
                partials.append(pair)
            at = partials.index(pair)
            for term, side, state, block in _sources(
                sensors, numbers[name], scalars, markers, n_bodies
            ):
                pulls.append((at, effect.load, effect.a, effect.iv, -1, term, side, state, -1))
                blocks.append((effect.block, block))
    used = sorted({numbers[name] for names in live.values() for name in names})
    signals = Signals(
        programs=np.array(list(live), np.int64),
        channels=np.array(used, np.int64),
        partials=np.array(partials, PARTIAL),
        pulls=np.array(pulls, PULL),
        implicit=np.array([any(_implicit(sensors, c) for c in used)], np.int64),
    )
    return SignalTables(signals, blocks)


def _effects(live, loads, scalars, markers: Markers) -> list[_Effect]:
    """Everything that a function over channels acts on."""
    found = [
        _Effect(int(program), k, a, -1, markers.body(int(load["marker"])))
        for k, load in enumerate(loads)
        for a, program in enumerate(load["fun"])
        if int(program) in live
    ]
    for k, scalar in enumerate(scalars if scalars is not None else ()):
        if int(scalar["fun"]) in live:
            block = len(markers.bodies) + k
            found.append(_Effect(int(scalar["fun"]), -1, 0, int(scalar["iv"]), block))
    return found


def _acting(live, n_loads: int, markers: Markers, elements: Elements | None) -> list[_Effect]:
    """The same of mutual loads and actuators, both sides of each numbered behind the loads."""
    if elements is None:
        return []
    mutual: Any = () if elements.mutual is None else elements.mutual
    laws: Any = () if elements.laws is None else elements.laws
    found = [
        _Effect(int(program), 2 * k + side, a, -1, markers.body(int(load[end])))
        for k, load in enumerate(mutual)
        for a, program in enumerate(load["fun"])
        for side, end in enumerate(("marker", "other"))
        if int(program) in live and load[end] >= 0
    ]
    found += [
        _Effect(int(row["fun"]), 2 * (len(mutual) + k) + side, 0, -1, markers.body(int(row[end])))
        for k, row in enumerate(laws)
        for side, end in enumerate(("J", "I"))
        if int(row["fun"]) in live
    ]
    return [e._replace(load=n_loads + e.load) for e in found if e.block >= 0]


def _sources(sensors: Sensors, number: int, scalars, markers: Markers, n_bodies: int):
    """(term, side, state, block) of everything that a channel depends on."""
    channel = sensors.channels[number]
    if channel["what"] == STATE:
        iv = int(channel["first"])
        assert scalars is not None  # a state is one of them
        yield -1, 0, iv, n_bodies + int(np.flatnonzero(scalars["iv"] == iv)[0])
    elif channel["what"] == SUM:
        for k in range(channel["first"], channel["first"] + channel["n"]):
            term = sensors.terms[k]
            for side in sides_of(term):
                body = markers.body(int(term["I" if side == 0 else "J"]))
                if body >= 0:
                    yield k, side, -1, body


def _implicit(sensors: Sensors, number: int) -> bool:
    """Whether a channel depends on accelerations, or on reactions and other forces."""
    channel = sensors.channels[number]
    terms = sensors.terms[channel["first"] : channel["first"] + max(channel["n"], 0)]
    if channel["what"] == SUM:
        return any(of_acceleration(term) for term in terms)
    return int(channel["what"]) not in (STATE, PLACE)
