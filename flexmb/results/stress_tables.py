"""Tables of stress for other programs: at a time, envelopes, histories for durability.

In: a result. Out: CSV or HDF5. Histories are written batch by batch, so that memory stays bounded
however long the run is. In HDF5 each column is a dataset of its name with the attribute unit.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import OutputError, ResultFileError
from flexmb.flexbody import STRESS, principal_stresses, von_mises
from flexmb.folders import whole_file
from flexmb.results.stress_envelopes import StressEnvelopes

Array = NDArray[np.float64]
_COMPONENTS = (*STRESS, "von_mises", "p1", "p2", "p3")
_ENDINGS = (".csv", ".txt", ".h5", ".hdf5")


def export_stress(
    result: StressEnvelopes,
    path: str | Path,
    body: str,
    *,
    time: float | None = None,
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
        What the result does not have.
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


Columns = list[tuple[str, str]]
Batches = Iterator[list[Sequence[object] | Array]]


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

    with h5py.File(path, "w") as file:
        for batch in batches:
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
