"""Stress and section forces as channels of a result.

They are named ``rod.von_mises`` (the largest of the body), ``rod.von_mises.17`` (of
mesh node 17), ``rod.von_mises.17.top``, ``rod.stress.17.top.xx`` and ``rod.section_force.3.2.Mz``
(of beam element 3 at its second end).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ResultFileError
from flexmb.flexbody import SECTION_FORCES, STRESS

Array = NDArray[np.float64]
_EQUAL_STRESS = 1e-12  # relative: places whose stress differs by less count as one


class StressChannel(NamedTuple):
    """The parts of the name of a stress or section-force channel."""

    body: str
    kind: str  # one of von_mises, stress, section_force
    words: tuple[str, ...]

    @property
    def unit(self) -> str:
        """In SI."""
        if self.kind != "section_force":
            return "Pa"
        return "N" if self.words[-1:] and self.words[-1] in SECTION_FORCES[:3] else "N m"

    def __str__(self) -> str:
        return ".".join((self.body, self.kind, *self.words))


def _von_mises_channel(result: Any, channel: StressChannel) -> Array:
    if len(channel.words) > 2:
        raise _wrong_form(channel, "von_mises.17 or von_mises.17.top")
    node = _number(channel, channel.words[0], "node") if channel.words else None
    layer = channel.words[1] if len(channel.words) > 1 else None
    largest: Array = result.von_mises(channel.body, node=node, layer=layer).values.max(axis=1)
    return largest


def _stress_component(result: Any, channel: StressChannel) -> Array:
    if len(channel.words) not in (2, 3):
        raise _wrong_form(channel, "stress.17.xx or stress.17.top.xx")
    component = _index_of(channel, channel.words[-1], STRESS, "component of stress")
    layer = channel.words[1] if len(channel.words) == 3 else None
    node = _number(channel, channel.words[0], "node")
    stress = result.stress(channel.body, node=node, layer=layer)
    values = stress.values[:, :, component]
    difference = np.ptp(values, axis=1).max(initial=0.0)
    if difference > _EQUAL_STRESS * np.abs(values).max(initial=0.0):
        places = zip(stress.layer, stress.part, strict=True)
        names = ", ".join(sorted({" of ".join(filter(None, place)) for place in places}))
        count = len(stress.layer)
        what = f'the body "{channel.body}" has {count} stresses at node {node} ({names})'
        raise ResultFileError(f"{what}; name a layer, or use result.stress for all of them")
    return np.asarray(values[:, 0])


def _section_force(result: Any, channel: StressChannel) -> Array:
    if len(channel.words) != 3:
        raise _wrong_form(channel, "section_force.3.1.Mz: element, end 1 or 2, component")
    component = _index_of(channel, channel.words[2], SECTION_FORCES, "section force")
    end = _index_of(channel, channel.words[1], ("1", "2"), "end of a beam element")
    element = _number(channel, channel.words[0], "beam element")
    forces = result.section_forces(channel.body)
    if element >= len(forces.elements):
        what = f'the body "{channel.body}" has no beam element {element}'
        raise ResultFileError(f"{what}; it has those from 0 to {len(forces.elements) - 1}")
    table = forces.force if component < 3 else forces.moment
    return np.asarray(table[:, element, end, component % 3])


def _index_of(channel: StressChannel, word: str, allowed: tuple[str, ...], what: str) -> int:
    if word not in allowed:
        raise ResultFileError.unknown(f'{channel}: "{word}" is no {what}', word, allowed)
    return allowed.index(word)


def _number(channel: StressChannel, word: str, what: str) -> int:
    if not word.isdecimal():
        raise ResultFileError(f'{channel}: "{word}" is no number of a {what}, from 0')
    return int(word)


def _wrong_form(channel: StressChannel, form: str) -> ResultFileError:
    return ResultFileError(f"{channel}: is not of the form {channel.body}.{form}")


STRESS_CHANNELS: dict[str, Callable[[Any, StressChannel], Array]] = {
    "von_mises": _von_mises_channel,
    "stress": _stress_component,
    "section_force": _section_force,
}
"""How channels are recovered, by the second word of their names."""
