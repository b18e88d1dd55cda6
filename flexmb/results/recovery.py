"""Stress and section forces of flexible bodies along a run, from modal coordinates.

In: the modal coordinates of a result and the files of its flexible bodies. Out: stress, von Mises
stress and section forces at a time or at all output times, and peaks over the run, in the scene's
units. Components are superposed first; the von Mises stress is computed from the sums. Channels are
``rod.von_mises`` (the largest of the body), ``rod.von_mises.17`` (of mesh node 17),
``rod.von_mises.17.top``, ``rod.stress.17.top.xx``, ``rod.stress.17.top.skin.xx`` (of a section) and
``rod.section_force.3.2.Mz`` (of beam element 3 at its second end).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from flexmb.errors import ResultFileError
from flexmb.flexbody import FlexBody, InertiaResponse, StressModes, von_mises
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.flexbody.stress_modes import SECTION_FORCES, SHELL_FORCES, STRESS
from flexmb.model.scenes.parameters import Time
from flexmb.results.reader import ResultReader

_BATCH_BYTES = 6.4e7  # bytes of stress components per batch
_MAX_BYTES = 2e9  # largest answer in bytes, which fits into the memory of most machines


_EQUAL_STRESS = 1e-12  # relative difference below which the stresses at two places are equal


class Stress(NamedTuple):
    """Stress at places of a body, in the scene's units."""

    values: Array  # (k, 6) or (n, k, 6) components in STRESS, body axes; von Mises: (k,) or (n, k)
    node: IntArray  # (k,) mesh node of each place
    layer: tuple[str, ...]  # (k,) such as "top"
    part: tuple[str, ...]  # (k,) mesh group of its section


class ShellForces(NamedTuple):
    """Resultants of shells per length, in the scene's units, local axes."""

    values: Array  # (k, 8) or (n, k, 8) in SHELL_FORCES
    node: IntArray  # (k,)
    part: tuple[str, ...]
    axes: Array  # (k, 3, 3) local axes as columns, body axes


class SectionForces(NamedTuple):
    """Section forces at both ends of beam elements, in the scene's units, local axes."""

    force: Array  # (b, 2, 3) or (n, b, 2, 3): N, Vy, Vz
    moment: Array  # the same of T, My, Mz
    elements: IntArray  # (b, 2) mesh nodes


class Recovery(ResultReader):
    """Stress and section forces of the flexible bodies of a run; see `Result`."""

    def stress(
        self,
        body: str,
        time: Time | None = None,
        *,
        node: int | None = None,
        layer: str | None = None,
        section: str | None = None,
        mode_acceleration: bool = False,
    ) -> Stress:
        """Stress components of a flexible body, averaged at the nodes of each section.

        Parameters
        ----------
        body : str
            Name of the body.
        time : float or str, optional
            In the scene's units, or with its own, ``"30 ms"``; all output times by default.
        node : int, optional
            Mesh node, from 0; all places by default.
        layer : str, optional
            Such as ``"top"``; all by default.
        section : str, optional
            The mesh group that gave it; all by default.
        mode_acceleration : bool
            Add the static response to the body's own acceleration and rotation that its modes lack.

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
        modes, rows = self.stress_places(body, node, layer, section)
        self._fits(6 * len(rows) * self._moments(time), body)
        parts = [s for _, s in self._stresses(body, modes, rows, time, mode_acceleration)]
        values = parts[0][0] if time is not None else np.concatenate(parts)
        return Stress(self.in_scene_units(values, "Pa"), *labels(modes, rows))

    def von_mises(
        self,
        body: str,
        time: Time | None = None,
        *,
        node: int | None = None,
        layer: str | None = None,
        section: str | None = None,
        mode_acceleration: bool = False,
    ) -> Stress:
        """The von Mises stress of a flexible body; parameters and errors as for `stress`.

        Returns
        -------
        Stress
            ``values`` (k,) at a time, (n, k) over all output times.
        """
        modes, rows = self.stress_places(body, node, layer, section)
        self._fits(len(rows) * self._moments(time), body)
        batches = self._stresses(body, modes, rows, time, mode_acceleration)
        parts = [von_mises(stress) for _, stress in batches]
        values = parts[0][0] if time is not None else np.concatenate(parts)
        return Stress(self.in_scene_units(values, "Pa"), *labels(modes, rows))

    def section_forces(
        self, body: str, time: Time | None = None, *, mode_acceleration: bool = False
    ) -> SectionForces:
        """Section forces of the beams of a flexible body at both ends of each element.

        Parameters
        ----------
        body : str
            Name of the body.
        time : float or str, optional
            In the scene's units, or with its own, ``"30 ms"``; all output times by default.
        mode_acceleration : bool
            As for `stress`.

        Raises
        ------
        ResultFileError
            No such body or time, or a body without beams.
        """
        modes = self.flexbody(body).section_forces
        if modes is None:
            raise ResultFileError(f"{self.flexbodies[body]}: holds no section forces of beams")
        values = self._resultants(body, "section_forces", time, mode_acceleration)
        force, moment = (
            self.in_scene_units(values[..., :3], "N"),
            self.in_scene_units(values[..., 3:], "N m"),
        )
        return SectionForces(force, moment, modes.elements)

    def shell_forces(
        self, body: str, time: Time | None = None, *, mode_acceleration: bool = False
    ) -> ShellForces:
        """Membrane forces, moments and transverse forces of shells at their nodes, per length.

        Parameters and errors are those of `section_forces`.
        """
        modes = self.flexbody(body).shell_forces
        if modes is None:
            what = "holds no resultants of shells; if it has shells, reduce the mesh again"
            raise ResultFileError(f"{self.flexbodies[body]}: {what}")
        values = self._resultants(body, "shell_forces", time, mode_acceleration)
        scales = [self.units.scale("N" if name[0] == "M" else "N/m") for name in SHELL_FORCES]
        parts = tuple(modes.parts[i] for i in modes.part)
        return ShellForces(values / scales, modes.ids, parts, modes.axes)

    def close(self) -> None:
        """Release the arrays and bodies read so far."""
        super().close()
        self._bodies = None

    def _stress_channel(self, name: str) -> StressChannel | None:
        """The parts of the name; None for names of other channels."""
        body, *words = name.split(".")
        if body in self.flexbodies and words and words[0] in STRESS_CHANNELS:
            return StressChannel(body, words[0], tuple(words[1:]))
        return None

    def _stress_values(self, channel: StressChannel) -> Array:
        """The channel over time (n,) in the scene's units.

        Raises
        ------
        ResultFileError
            No such node, layer, component, beam element or end; says which there are.
        """
        values = np.array(STRESS_CHANNELS[channel.kind](self, channel))
        values.flags.writeable = False
        return values

    def _moments(self, time: Time | None) -> int:
        return len(self.time) if time is None else 1

    def _batches(
        self, body: str, time: Time | None, width: int, mode_acceleration: bool
    ) -> Iterator[tuple[slice, Array, Array | None]]:
        """Batches of output times: their rows, modal coordinates (t, m), and with mode acceleration
        the twelve numbers (t, 12) of the body's acceleration.

        ``width`` is the number of values per row.
        """
        columns, flexbody = self.layout.body(body), self.flexbody(body)
        v = slice(columns.iv, columns.iv + 6)
        if mode_acceleration and not flexbody.answers_inertia:
            what = "does not know what its modes lack of its own inertia loads: reduce the mesh "
            raise ResultFileError(f"{self.flexbodies[body]}: {what}again, in mean axes")
        omits = mode_acceleration and flexbody.omitted_stress is not None
        # columns.iq + 7: the run may have stored modal coordinates alone
        first = columns.iq if omits else columns.iq + 7
        q = slice(first, columns.iq + 7 + columns.m)
        if not len(self.time):
            raise ResultFileError(f"{self.path}: the result holds no rows")
        if time is not None:
            i, s = self.row_at(time)
            batches, mix = [slice(i, i + 2)], s
        else:
            size, mix = max(1, int(_BATCH_BYTES / (8 * max(width, 1)))), None
            batches = [slice(k, k + size) for k in range(0, len(self.time), size)]
        for rows in batches:
            tables = [self.some_rows("q", rows, q)]
            if omits:
                tables += [self.some_rows(name, rows, v) for name in ("v", "vd")]
            if mix is not None:
                tables = [((1 - mix) * t[:1] + mix * t[-1:]) for t in tables]
            c = self._inertia_numbers(flexbody, *tables) if omits else None
            yield rows, tables[0][:, 7 if omits else 0 :], c

    def _inertia_numbers(self, body: FlexBody, q: Array, v: Array, vd: Array) -> Array:
        """(t, 12) numbers of `InertiaResponse`: acceleration of the centre minus gravity, alpha,
        omega."""
        p = q[:, 3:7] / np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
        w, x, y, z = p.T
        A = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        gravity = self.model.get("gravity", "none")
        g = np.zeros(3) if isinstance(gravity, str) else np.array(gravity, dtype=float)
        a = np.einsum("abt,ta->tb", A, vd[:, :3] - g * self.units.scale("m/s^2"))
        omega, alpha, center = v[:, 3:6], vd[:, 3:6], body.center
        a = a + np.cross(alpha, center) + np.cross(omega, np.cross(omega, center))
        return InertiaResponse.factors(a, alpha, omega)

    def stress_batches(
        self, body: str, rows: IntArray, mode_acceleration: bool = False
    ) -> Iterator[tuple[slice, Array]]:
        """Batches of output times, and stress (t, k, 6) at places of a body [Pa]."""
        modes, _ = self.stress_places(body, None, None)
        return self._stresses(body, modes, rows, None, mode_acceleration)

    def _stresses(
        self,
        body: str,
        modes: StressModes,
        rows: IntArray,
        time: Time | None,
        mode_acceleration: bool,
    ) -> Iterator[tuple[slice, Array]]:
        """Batches of output times and their stress (t, k, 6) at places [Pa]."""
        width = 6 * len(rows)
        omitted = self.flexbody(body).omitted_stress
        for part, eta, c in self._batches(body, time, width, mode_acceleration):
            stress = modes.at(eta, rows)
            if c is not None and omitted is not None and omitted.stress is not None:
                flat = omitted.stress[rows].reshape(width, 12).astype(np.float64)
                stress = stress - (c @ flat.T).reshape(stress.shape)
            yield part, stress

    def _resultants(
        self, body: str, name: str, time: Time | None, mode_acceleration: bool
    ) -> Array:
        """(..., k, c) section or shell forces by the name of the part of the body, SI."""
        flexbody = self.flexbody(body)
        modes, omitted = getattr(flexbody, name), flexbody.omitted_stress
        width = int(np.prod(modes.modes.shape[:-1]))
        self._fits(width * self._moments(time), body)
        parts = []
        for _, eta, c in self._batches(body, time, width, mode_acceleration):
            values = modes.at(eta)
            if c is not None and omitted is not None and getattr(omitted, name) is not None:
                flat = getattr(omitted, name).reshape(width, 12).astype(np.float64)
                values = values - (c @ flat.T).reshape(values.shape)
            parts.append(values)
        return np.asarray(parts[0][0] if time is not None else np.concatenate(parts))

    def stress_places(
        self, body: str, node: int | None, layer: str | None, section: str | None = None
    ) -> tuple[StressModes, IntArray]:
        """The stress per mode of a body, and its places at a node, in a layer and a section.

        Raises
        ------
        ResultFileError
            No such body, node or layer, or a body without stress.
        """
        modes = self.flexbody(body).stress
        if modes is None:
            what = (
                f'{self.flexbodies[body]}: holds no stress; reduce the mesh with stress = "surface"'
            )
            raise ResultFileError(what)
        if layer is not None and layer not in modes.layers:
            what = f'the body "{body}" has no stress in a layer "{layer}"'
            raise ResultFileError.unknown(what, layer, modes.layers)
        if section is not None and section not in modes.parts:
            what = f'the body "{body}" has no stress in a section "{section}"'
            raise ResultFileError.unknown(what, section, modes.parts)
        rows = modes.rows(node, layer, section)
        if not len(rows):
            where = f" in the layer {layer}" if layer is not None and node in modes.ids else ""
            where += f" of {section}" if section is not None and node in modes.ids else ""
            what = f'the body "{body}" has no stress at node {node}{where}'
            raise ResultFileError(f"{what}; it has stress at {len(np.unique(modes.ids))} nodes")
        return modes, rows

    def _fits(self, numbers: float, body: str) -> None:
        if 8 * numbers > _MAX_BYTES:
            what = f'the stress of "{body}" at all places and times takes {8e-9 * numbers:.3g} GB'
            raise ResultFileError(f"{what}: give a time, a node or a layer, or ask for the peaks")


def labels(modes: StressModes, rows: IntArray) -> tuple[IntArray, tuple[str, ...], tuple[str, ...]]:
    """Node, layer and section of places."""
    layer = tuple(modes.layers[i] for i in modes.layer[rows])
    return modes.ids[rows], layer, tuple(modes.parts[i] for i in modes.part[rows])


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
    node = _number(channel, channel.words[0], "node") if channel.words else None
    layer, section = _layer_and_section(result, channel, channel.words[1:])
    stress = result.von_mises(channel.body, node=node, layer=layer, section=section)
    largest: Array = stress.values.max(axis=1)
    return largest


def _stress_component(result: Any, channel: StressChannel) -> Array:
    if len(channel.words) < 2:
        raise _wrong_form(channel, "stress.17.xx, stress.17.top.xx or stress.17.top.skin.xx")
    component = _index_of(channel, channel.words[-1], STRESS, "component of stress")
    node = _number(channel, channel.words[0], "node")
    layer, section = _layer_and_section(result, channel, channel.words[1:-1])
    stress = result.stress(channel.body, node=node, layer=layer, section=section)
    values = stress.values[:, :, component]
    difference = np.ptp(values, axis=1).max(initial=0.0)
    if difference > _EQUAL_STRESS * np.abs(values).max(initial=0.0):
        modes, rows = result.stress_places(channel.body, node, layer, section)
        count, names = len(rows), modes.place_names(rows)
        what = f'the body "{channel.body}" has {count} stresses at node {node} ({names})'
        cure = "name a layer, a section or both, or use result.stress for all of them"
        raise ResultFileError(f"{what}; {cure}")
    return np.asarray(values[:, 0])


def _layer_and_section(
    result: Any, channel: StressChannel, words: tuple[str, ...]
) -> tuple[str | None, str | None]:
    modes, _ = result.stress_places(channel.body, None, None)
    layer, section = modes.layer_and_part(words)
    if layer is not None and layer not in modes.layers and words:
        what = f'the body "{channel.body}" has no stress in a layer or section "{layer}"'
        raise ResultFileError.unknown(what, layer, [*modes.layers, *modes.parts])
    return layer, section


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
