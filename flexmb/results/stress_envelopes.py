"""Envelopes of stress over a run, its hot spots, and tables of stress for other programs.

In: a result, whose rows are read as needed. Out: values at places; CSV or HDF5 files of stress at a
time, of envelopes, and of histories for durability analysis. Histories are written in batches, so
that memory stays bounded for any length of run. In HDF5 each column is a dataset of that name with
the attribute unit.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexmb.errors import OutputError, ResultFileError
from flexmb.flexbody import principal_stresses, von_mises
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.flexbody.stress_modes import STRESS
from flexmb.folders import whole_file
from flexmb.model.scenes.parameters import Time
from flexmb.results.crash_safe_file import DiskFile, uninterrupted
from flexmb.results.recovery import Recovery, labels

_COMPONENTS = (*STRESS, "von_mises", "p1", "p2", "p3")
_ENDINGS = (".csv", ".txt", ".h5", ".hdf5")
Columns = list[tuple[str, str]]
Batches = Iterator[list[Sequence[object] | Array]]


class PeakStress(NamedTuple):
    """The largest von Mises stress at each place over a run, and when, in the scene's units."""

    values: Array  # (k,)
    time: Array  # (k,)
    node: IntArray  # (k,)
    layer: tuple[str, ...]
    part: tuple[str, ...]

    @property
    def place(self) -> int:
        """Row of the place with the overall largest stress."""
        return int(np.argmax(self.values))


class StressEnvelope(NamedTuple):
    """Largest and least stress at each place over a run, and when, in the scene's units."""

    largest: Array  # (k,) von Mises, or the largest principal stress
    least: Array  # (k,) the least von Mises, or the least principal stress
    time_of_largest: Array  # (k,)
    time_of_least: Array  # (k,)
    node: IntArray  # (k,)
    layer: tuple[str, ...]
    part: tuple[str, ...]


class HotSpot(NamedTuple):
    """A place where the von Mises stress over the run is larger than at all places near it."""

    value: float  # in the scene's units
    time: float
    node: int
    layer: str
    part: str
    position: tuple[float, float, float]  # body axes


def _principal_pair(stress: Array) -> tuple[Array, Array]:
    values = principal_stresses(stress)
    return values[..., 0], values[..., 2]


_ENVELOPES: dict[str, Callable[[Array], tuple[Array, Array]]] = {
    "von_mises": lambda stress: (von_mises(stress),) * 2,
    "principal": _principal_pair,
}
"""The quantities whose maximum and minimum an envelope contains, from stress components."""


class StressEnvelopes(Recovery):
    """Largest stresses over a run, where and when; see `Result`."""

    def peak_von_mises(
        self, body: str, *, layer: str | None = None, mode_acceleration: bool = False
    ) -> PeakStress:
        """The largest von Mises stress over the run at each place, and when.

        Parameters
        ----------
        body : str
            Name of the body.
        layer : str, optional
            Such as ``"top"``; all by default.
        mode_acceleration : bool
            As for `stress`.

        Returns
        -------
        PeakStress
            Also `place`, the row of the largest of all.

        Raises
        ------
        ResultFileError
            No such body or layer, a body without stress, or a result without rows.
        """
        one = self.stress_envelope(body, layer=layer, mode_acceleration=mode_acceleration)
        return PeakStress(one.largest, one.time_of_largest, one.node, one.layer, one.part)

    def stress_envelope(
        self,
        body: str,
        quantity: str = "von_mises",
        *,
        layer: str | None = None,
        mode_acceleration: bool = False,
    ) -> StressEnvelope:
        """Largest and least stress over the run at each place, and when; rows are read as needed.

        Parameters
        ----------
        body : str
            Name of the body.
        quantity : {"von_mises", "principal"}
            Of principal stresses the largest and the least.
        layer, mode_acceleration
            As for `stress`.

        Raises
        ------
        ResultFileError
            As `stress`, and an unknown quantity.
        """
        if quantity not in _ENVELOPES:
            what = f'no envelope of "{quantity}"'
            raise ResultFileError.unknown(what, quantity, _ENVELOPES)
        modes, rows = self.stress_places(body, None, layer)
        values = np.stack([np.full(len(rows), -np.inf), np.full(len(rows), np.inf)])
        when = np.zeros((2, len(rows)), dtype=int)
        for part, stress in self._stresses(body, modes, rows, None, mode_acceleration):
            pair = _ENVELOPES[quantity](stress)
            for side, (series, pick) in enumerate(zip(pair, (np.argmax, np.argmin), strict=True)):
                best = pick(series, axis=0)
                extreme = series[best, np.arange(len(rows))]
                better = extreme > values[0] if side == 0 else extreme < values[1]
                values[side, better] = extreme[better]
                when[side, better] = best[better] + (part.start or 0)
        largest, least = (self.in_scene_units(side, "Pa") for side in values)
        return StressEnvelope(
            largest, least, self.time[when[0]], self.time[when[1]], *labels(modes, rows)
        )

    def hot_spots(
        self,
        body: str,
        count: int = 10,
        *,
        distance: float | None = None,
        layer: str | None = None,
        mode_acceleration: bool = False,
    ) -> list[HotSpot]:
        """Places where the von Mises stress over the run is largest, each the maximum of its
        surroundings.

        Parameters
        ----------
        body : str
            Name of the body.
        count : int
            Largest number of places.
        distance : float, optional
            Least distance between two of them, in the scene's units; a twentieth of the body's size
            by default.
        layer, mode_acceleration
            As for `stress`.
        """
        peak = self.peak_von_mises(body, layer=layer, mode_acceleration=mode_acceleration)
        nodes = self.flexbody(body).nodes
        assert nodes is not None  # a body with stress has nodes
        places = nodes.position[np.searchsorted(nodes.ids, peak.node)]
        gap = 0.05 * float(np.linalg.norm(np.ptp(nodes.position, axis=0)))
        if distance is not None:
            gap = distance * self.units.scale("m")
        spots: list[HotSpot] = []
        open_places = np.ones(len(peak.values), dtype=bool)
        while len(spots) < count and open_places.any():
            k = int(np.flatnonzero(open_places)[peak.values[open_places].argmax()])
            position = self.in_scene_units(places[k].copy(), "m")
            spots.append(
                HotSpot(
                    float(peak.values[k]), float(peak.time[k]), int(peak.node[k]), peak.layer[k],
                    peak.part[k], (float(position[0]), float(position[1]), float(position[2])),
                )
            )  # fmt: skip
            open_places &= np.linalg.norm(places - places[k], axis=1) > gap
        return spots


def export_stress(
    result: StressEnvelopes,
    path: str | Path,
    body: str,
    *,
    time: Time | None = None,
    nodes: Sequence[int] | None = None,
    layer: str | None = None,
    mode_acceleration: bool = False,
) -> Path:
    """Write stress of a flexible body: components, von Mises, principal stresses.

    Parameters
    ----------
    result : Result
        The run.
    path : path
        A .csv or .h5 file.
    body : str
        Name of the body.
    time : float, optional
        All places at this time, a row for each.
    nodes : sequence of int, optional
        Histories at these mesh nodes, a row for each output time. Without time and nodes: the
        envelope over the run, a row for each place.
    layer, mode_acceleration
        As for `Result.stress`.

    Raises
    ------
    ResultFileError
        The body, place or time is not in the result.
    OutputError
        An ending without a format, or a file that cannot be written.
    """
    target = Path(path)
    if target.suffix.lower() not in _ENDINGS:
        what = f'{target}: no format of stress has the ending "{target.suffix}"'
        raise OutputError.unknown(what, target.suffix, _ENDINGS)
    if time is not None and nodes is not None:
        raise ResultFileError("give either a time, for all places, or nodes, for their histories")
    words = {"layer": layer, "mode_acceleration": mode_acceleration}
    if nodes is not None:
        columns, batches = _histories(result, body, nodes, layer, mode_acceleration)
    elif time is not None:
        one = result.stress(body, time, **words)  # type: ignore[arg-type]
        values = np.concatenate([*_all_components(np.asarray(one.values))], axis=1)
        columns, batches = _places(result, body, one, [*_COMPONENTS], values)
    else:
        mises = result.stress_envelope(body, "von_mises", **words)  # type: ignore[arg-type]
        principal = result.stress_envelope(body, "principal", **words)  # type: ignore[arg-type]
        values = np.column_stack(
            [
                mises.largest, mises.time_of_largest, principal.largest,
                principal.time_of_largest, principal.least, principal.time_of_least,
            ]
        )  # fmt: skip
        names = ["von_mises", "time_of_von_mises", "p1", "time_of_p1", "p3", "time_of_p3"]
        columns, batches = _places(result, body, mises, names, values)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(target) as partial:
            write = _write_csv if target.suffix.lower() in (".csv", ".txt") else _write_hdf5
            write(partial, columns, batches)
    except OSError as error:
        raise OutputError(f"{target}: cannot be written ({error.strerror or error})") from error
    return target


def _all_components(stress: Array) -> tuple[Array, Array, Array]:
    return stress, von_mises(stress)[..., None], principal_stresses(stress)


def _places(
    result: StressEnvelopes, body: str, one: object, names: list[str], values: Array
) -> tuple[Columns, Batches]:
    """A row for each place: node, position, layer, section, values."""
    nodes, units = result.flexbody(body).nodes, result.units
    assert nodes is not None
    node, layer, part = (getattr(one, name) for name in ("node", "layer", "part"))
    position = units.outward(nodes.position[np.searchsorted(nodes.ids, node)], "m")
    length, pressure, second = (units.label(unit) for unit in ("m", "Pa", "s"))
    columns: Columns = [("node", ""), *((axis, length) for axis in "xyz"), ("layer", "")]
    columns += [("section", "")]
    columns += [(name, second if name.startswith("time") else pressure) for name in names]
    rows: list[Sequence[object] | Array] = [node, *position.T, layer, part, *values.T]
    return columns, iter([rows])


def _histories(
    result: StressEnvelopes,
    body: str,
    nodes: Sequence[int],
    layer: str | None,
    mode_acceleration: bool,
) -> tuple[Columns, Batches]:
    """A row for each output time: all components at each place of the nodes."""
    places = [result.stress_places(body, node, layer) for node in nodes]
    rows = np.concatenate([rows for _, rows in places])
    modes, units = places[0][0], result.units
    pressure = units.label("Pa")
    names = []
    for row in rows:
        words = [str(modes.ids[row]), modes.layers[modes.layer[row]]]
        same = [
            r for r in rows if (modes.ids[r], modes.layer[r]) == (modes.ids[row], modes.layer[row])
        ]
        words += [modes.parts[modes.part[row]]] if len(same) > 1 else []
        names.append(".".join(words))
    columns: Columns = [("time", units.label("s"))]
    columns += [(f"{name}.{part}", pressure) for name in names for part in _COMPONENTS]

    def batches() -> Batches:
        for part, stress in result.stress_batches(body, rows, mode_acceleration):
            values = np.concatenate(_all_components(units.outward(stress, "Pa")), axis=2)
            yield [result.time[part], *values.reshape(len(values), -1).T]

    return columns, batches()


def _write_csv(path: Path, columns: Columns, batches: Batches) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([f"{name} [{unit}]" if unit else name for name, unit in columns])
        for batch in batches:
            plain = [c.tolist() if isinstance(c, np.ndarray) else c for c in batch]
            writer.writerows(zip(*plain, strict=True))


def _write_hdf5(path: Path, columns: Columns, batches: Batches) -> None:
    import h5py

    path.touch()
    # HDF5 ends the process if a disk fails, so it writes to a file that hides failures
    disk = DiskFile(path)
    try:
        with uninterrupted():
            file = h5py.File(disk, "w")
        try:
            for batch in batches:
                with uninterrupted():
                    _append_batch(file, columns, batch)
                if disk.failure is not None:
                    break
        finally:
            with uninterrupted():
                file.close()
    finally:
        disk.close()
    if disk.failure is not None:
        raise disk.failure


def _append_batch(file: Any, columns: Columns, batch: Sequence[Sequence[object] | Array]) -> None:
    """Append rows to the datasets of an open HDF5 file."""
    import h5py

    for (name, unit), values in zip(columns, batch, strict=True):
        if isinstance(values, tuple | list):
            text = np.array(values, dtype=object)
            file.create_dataset(name, data=text, dtype=h5py.string_dtype())
            continue
        array = np.asarray(values)
        if name not in file:
            shape = {"maxshape": (None,), "chunks": (min(max(len(array), 1), 65536),)}
            file.create_dataset(name, data=array, **shape)
            file[name].attrs["unit"] = unit
        else:
            size = len(file[name])
            file[name].resize((size + len(array),))
            file[name][size:] = array
