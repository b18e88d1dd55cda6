"""Stress and section forces of flexible bodies along a run, from modal coordinates.

In: the modal coordinates of a result and the files of its flexible bodies. Out: stress, von Mises
stress and section forces at a time or at all output times, peaks over the run, in the scene's
units. Components are superposed first; the von Mises stress is taken of their sum.

As channels they are named ``rod.von_mises`` (the largest of the body), ``rod.von_mises.17`` (of
mesh node 17), ``rod.von_mises.17.top``, ``rod.stress.17.top.xx`` and ``rod.section_force.3.2.Mz``
(of beam element 3 at its second end).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ResultFileError
from flexmb.flexbody import (
    SECTION_FORCES,
    STRESS,
    StressModes,
    von_mises,
)
from flexmb.results.reader import ResultReader

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_BATCH_BYTES = 6.4e7  # of stress components at once
_MAX_BYTES = 2e9  # of an answer that still fits into the memory of most machines
_EQUAL_STRESS = 1e-12  # relative: places whose stress differs by less count as one
_KINDS = ("von_mises", "stress", "section_force")


class Stress(NamedTuple):
    """Stress at places of a body, in the scene's units."""

    values: Array  # (k, 6) or (n, k, 6) components in STRESS, body axes; von Mises: (k,) or (n, k)
    node: IntArray  # (k,) mesh node of each place
    layer: tuple[str, ...]  # (k,) such as "top"
    part: tuple[str, ...]  # (k,) mesh group of its section


class PeakStress(NamedTuple):
    """The largest von Mises stress at each place over a run, and when, in the scene's units."""

    values: Array  # (k,)
    time: Array  # (k,)
    node: IntArray  # (k,)
    layer: tuple[str, ...]
    part: tuple[str, ...]

    @property
    def place(self) -> int:
        """Row of the place with the largest stress of all."""
        return int(np.argmax(self.values))


class SectionForces(NamedTuple):
    """Section forces at both ends of beam elements, in the scene's units, local axes."""

    force: Array  # (b, 2, 3) or (n, b, 2, 3): N, Vy, Vz
    moment: Array  # the same of T, My, Mz
    elements: IntArray  # (b, 2) mesh nodes


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


class Recovery(ResultReader):
    """Stress and section forces of the flexible bodies of a run; see `Result`."""

    def stress(
        self,
        body: str,
        time: float | None = None,
        *,
        node: int | None = None,
        layer: str | None = None,
    ) -> Stress:
        """Stress components of a flexible body, averaged at the nodes of each section.

        Parameters
        ----------
        body : str
            Name of the body.
        time : float, optional
            In the scene's units; all output times by default.
        node : int, optional
            Mesh node, from 0; all places by default.
        layer : str, optional
            Such as ``"top"``; all by default.

        Returns
        -------
        Stress
            ``values`` (k, 6) or (n, k, 6): xx yy zz yz zx xy in body axes.

        Raises
        ------
        ResultFileError
            No such body, node, layer or time, a body without stress, or an answer that does not fit
            into memory.
        """
        modes, rows = self._places(body, node, layer)
        eta = self._eta(body, time)
        self._fits(6 * len(rows) * math.prod(eta.shape[:-1]), body)
        return Stress(self.in_scene_units(modes.at(eta, rows), "Pa"), *_labels(modes, rows))

    def von_mises(
        self,
        body: str,
        time: float | None = None,
        *,
        node: int | None = None,
        layer: str | None = None,
    ) -> Stress:
        """The von Mises stress of a flexible body; parameters and errors as for `stress`.

        Returns
        -------
        Stress
            ``values`` (k,) at a time, (n, k) over all output times.
        """
        modes, rows = self._places(body, node, layer)
        eta = self._eta(body, time)
        self._fits(len(rows) * math.prod(eta.shape[:-1]), body)
        values = np.empty((*eta.shape[:-1], len(rows)))
        for part in _batches(eta, len(rows)):
            values[part] = von_mises(modes.at(eta[part], rows))
        return Stress(self.in_scene_units(values, "Pa"), *_labels(modes, rows))

    def peak_von_mises(self, body: str, *, layer: str | None = None) -> PeakStress:
        """The largest von Mises stress over the run at each place, and when.

        Parameters
        ----------
        body : str
            Name of the body.
        layer : str, optional
            Such as ``"top"``; all by default.

        Returns
        -------
        PeakStress
            Also `place`, the row of the largest of all.

        Raises
        ------
        ResultFileError
            No such body or layer, a body without stress, or a result without rows.
        """
        modes, rows = self._places(body, None, layer)
        eta = self._eta(body, None)
        peak, when = np.full(len(rows), -1.0), np.zeros(len(rows), dtype=int)
        for part in _batches(eta, len(rows)):
            values = von_mises(modes.at(eta[part], rows))
            best = values.argmax(axis=0)
            highest = values[best, np.arange(len(rows))]
            larger = highest > peak
            peak[larger], when[larger] = highest[larger], best[larger] + (part.start or 0)
        return PeakStress(self.in_scene_units(peak, "Pa"), self.time[when], *_labels(modes, rows))

    def section_forces(self, body: str, time: float | None = None) -> SectionForces:
        """Section forces of the beams of a flexible body at both ends of each element.

        Parameters
        ----------
        body : str
            Name of the body.
        time : float, optional
            In the scene's units; all output times by default.

        Raises
        ------
        ResultFileError
            No such body or time, or a body without beams.
        """
        modes = self.flexbody(body).section_forces
        if modes is None:
            raise ResultFileError(f"{self.flexbodies[body]}: holds no section forces of beams")
        values = modes.at(self._eta(body, time))
        force, moment = (
            self.in_scene_units(values[..., :3], "N"),
            self.in_scene_units(values[..., 3:], "N m"),
        )
        return SectionForces(force, moment, modes.elements)

    def close(self) -> None:
        """Release the arrays and bodies read so far."""
        super().close()
        self._bodies = None

    def _stress_channel(self, name: str) -> StressChannel | None:
        """The parts of the name; None for names of other channels."""
        body, *words = name.split(".")
        if body in self.flexbodies and words and words[0] in _KINDS:
            return StressChannel(body, words[0], tuple(words[1:]))
        return None

    def _stress_values(self, channel: StressChannel) -> Array:
        """The channel over time (n,) in the scene's units.

        Raises
        ------
        ResultFileError
            No such node, layer, component, beam element or end; says which there are.
        """
        recover = {
            "von_mises": _von_mises_channel,
            "stress": _stress_component,
            "section_force": _section_force,
        }[channel.kind]
        values = np.array(recover(self, channel))
        values.flags.writeable = False
        return values

    def _eta(self, body: str, time: float | None) -> Array:
        """(n, m) modal coordinates at all output times, or (m,) at one."""
        columns = self.layout.body(body)
        start = columns.iq + 7
        eta = self.part("q", slice(start, start + columns.m))
        if time is None and len(eta):
            return eta
        i, s = self.row_at(time or 0.0)
        return np.asarray((1.0 - s) * eta[i] + s * eta[min(i + 1, len(eta) - 1)])

    def _places(
        self, body: str, node: int | None, layer: str | None
    ) -> tuple[StressModes, IntArray]:
        modes = self.flexbody(body).stress
        if modes is None:
            what = (
                f'{self.flexbodies[body]}: holds no stress; reduce the mesh with stress = "surface"'
            )
            raise ResultFileError(what)
        if layer is not None and layer not in modes.layers:
            what = f'the body "{body}" has no stress in a layer "{layer}"'
            raise ResultFileError.unknown(what, layer, modes.layers)
        rows = modes.rows(node, layer)
        if not len(rows):
            where = f" in the layer {layer}" if layer is not None and node in modes.ids else ""
            what = f'the body "{body}" has no stress at node {node}{where}'
            raise ResultFileError(f"{what}; it has stress at {len(np.unique(modes.ids))} nodes")
        return modes, rows

    def _fits(self, numbers: float, body: str) -> None:
        if 8 * numbers > _MAX_BYTES:
            what = f'the stress of "{body}" at all places and times takes {8e-9 * numbers:.3g} GB'
            raise ResultFileError(f"{what}: give a time, a node or a layer, or ask for the peaks")


def _labels(
    modes: StressModes, rows: IntArray
) -> tuple[IntArray, tuple[str, ...], tuple[str, ...]]:
    layer = tuple(modes.layers[i] for i in modes.layer[rows])
    return modes.ids[rows], layer, tuple(modes.parts[i] for i in modes.part[rows])


def _batches(eta: Array, places: int) -> list[slice]:
    """Rows of eta (n, m) in batches whose stress fits into memory; all of eta (m,)."""
    if eta.ndim == 1:
        return [slice(None)]
    size = max(1, int(_BATCH_BYTES / (48 * max(places, 1))))
    return [slice(start, start + size) for start in range(0, len(eta), size)]


def _von_mises_channel(result: Recovery, channel: StressChannel) -> Array:
    if len(channel.words) > 2:
        raise _wrong_form(channel, "von_mises.17 or von_mises.17.top")
    node = _number(channel, channel.words[0], "node") if channel.words else None
    layer = channel.words[1] if len(channel.words) > 1 else None
    largest: Array = result.von_mises(channel.body, node=node, layer=layer).values.max(axis=1)
    return largest


def _stress_component(result: Recovery, channel: StressChannel) -> Array:
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
    return values[:, 0]


def _section_force(result: Recovery, channel: StressChannel) -> Array:
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
    return table[:, element, end, component % 3]


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
