"""Output formats: histories as tables, HTML for notebooks, fields as VTU files.

A table format is one function that takes a `HistoryTable` and a path, and one line in `FORMATS`,
which maps the file name extension to it; `Result.export` and ``flexmb export`` select it by the
extension. A VTU file, which ParaView opens, contains the skin of a part as an unstructured grid
with the displacement, the von Mises stress and the largest and smallest principal stress of each
field, in SI; at a point with several layers the extreme ones. Source: VTK File Formats, The VTK
User's Guide.
"""

from __future__ import annotations

import base64
import csv
import filecmp
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from html import escape
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import OutputError
from flexmb.flexbody import PartResult, principal_stresses, von_mises
from flexmb.flexbody.arrays import Array
from flexmb.folders import whole_file
from flexmb.results.channels import HistoryTable
from flexmb.results.crash_safe_file import WriteLock

_WIDTH, _HEIGHT = 520, 120  # size of the plot in notebooks [pixels]
_POINTS = 400  # points per line
_COLORS = ("#2f6db5", "#c8552b", "#3c8d4f")


_LINE, _TRIANGLE = 3, 5
_TYPES = {"f": "Float64", "i": "Int64", "u": "UInt8"}


def export_table(table: HistoryTable, path: Path, ending: str | None = None) -> Path:
    """Write a table in the format of the file's ending, or of another one.

    Raises
    ------
    OutputError
        No format has this ending, or the file cannot be written.
    """
    key = (path.suffix if ending is None else ending).lower()
    if key not in FORMATS:
        raise OutputError.unknown(f'{path}: no output format has the ending "{key}"', key, FORMATS)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as partial:
            FORMATS[key](table, partial)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    return path


def write_csv(table: HistoryTable, path: Path) -> None:
    """Text with commas, one row per output time, units in the header, all digits of a number."""
    columns = zip(table.names, table.units, strict=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([f"{name} [{unit}]" if unit else name for name, unit in columns])
        # tolist: the shortest text that reads back as the same number
        writer.writerows(table.values.tolist())


FORMATS: Final[Mapping[str, Callable[[HistoryTable, Path], None]]] = {
    ".csv": write_csv,
    ".txt": write_csv,
}
"""Writers of tables by the ending of their files."""


def copy_result(source: Path, flexbodies: Iterable[Path], place: Path) -> Path:
    """Copy a result file and the files of its flexible bodies; see `Result.save`.

    Returns the path of the new result file.
    """
    target = place if place.suffix == ".h5" else place / "result.h5"
    bodies = {file: target.parent / file.name for file in flexbodies}
    with ExitStack() as stack:
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            with suppress(PermissionError):  # in a read-only folder no run writes
                stack.callback(WriteLock(source).release)
            if not _same(source, target):
                stack.callback(WriteLock(target).release)
            for file, copy in bodies.items():
                if copy.exists() and not filecmp.cmp(file, copy, shallow=False):
                    what = "belongs to another result; save this one in a folder of its own"
                    raise OutputError(f"{copy}: {what}")
            for file, copy in {**bodies, source: target}.items():
                if not _same(file, copy):
                    with whole_file(copy) as partial:
                        shutil.copyfile(file, partial)
        except BlockingIOError as error:
            what = "a run is writing it; save the result when it has ended"
            raise OutputError(f"{source}: {what}") from error
        except OSError as error:
            what = f"the result cannot be saved at {target} ({error.strerror or error})"
            raise OutputError(f"{error.filename or target}: {what}") from error
    return target


def notebook_html(
    title: str, facts: Iterable[tuple[str, str]], t: Array, lines: Sequence[tuple[str, str, Array]]
) -> str:
    """HTML of a result with an inline SVG, without any plotting library.

    Parameters
    ----------
    title : str
        Its heading.
    facts : iterable of (str, str)
        Rows of its table.
    t : (n,) array
        Output times.
    lines : sequence of (str, str, array)
        Name, unit and values (n,) of up to three channels that change.
    """
    rows = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th>'
        f'<td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in facts
    )
    polylines, legend = [], []
    every = max(1, len(t) // _POINTS)
    for (name, unit, values), color in zip(lines, _COLORS, strict=False):
        low, high = float(values.min()), float(values.max())
        x = _WIDTH * (t[::every] - t[0]) / (t[::every][-1] - t[0])
        y = _HEIGHT * (0.05 + 0.9 * (high - values[::every]) / (high - low))
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        polylines.append(f'<polyline points="{points}" fill="none" stroke="{color}"/>')
        span = f"{escape(name)}: {low:.4g} to {high:.4g} {escape(unit)}"
        legend.append(f'<span style="color:{color}">{span}</span>')
    box = f'width="{_WIDTH}" height="{_HEIGHT}" viewBox="0 0 {_WIDTH} {_HEIGHT}"'
    frame = f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="white" stroke="#d9dbe0"/>'
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" {box}>{frame}{"".join(polylines)}</svg>'
    history = f"{svg}<br>{' &nbsp; '.join(legend)}" if polylines else ""
    return f"<div><strong>{escape(title)}</strong><table>{rows}</table>{history}</div>"


def _same(one: Path, other: Path) -> bool:
    return other.exists() and other.samefile(one)


def write_vtu(result: PartResult, path: str | Path) -> Path:
    """Write the fields of a part on its skin.

    Raises
    ------
    OutputError
        It has no surface, or the file cannot be written.
    """
    target, surface = Path(path), result.surface
    if surface is None or not len(surface.points):
        raise OutputError(f"{target}: the part has no surface to write")
    cells = [*surface.faces.tolist(), *surface.lines.tolist()]
    kinds = [_TRIANGLE] * len(surface.faces) + [_LINE] * len(surface.lines)
    data = {}
    for name in result.fields:
        data[f"{name}: displacement"] = surface.modes @ result.column(name)
        if result.stress is not None:
            data |= _stress_fields(result, name)
    texts = [
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64">',
        f'<UnstructuredGrid><Piece NumberOfPoints="{len(surface.points)}" '
        f'NumberOfCells="{len(cells)}">',
        "<Points>",
        _array("points", surface.points),
        "</Points><Cells>",
        _array("connectivity", np.array([k for cell in cells for k in cell], dtype=np.int64)),
        _array("offsets", np.cumsum([len(cell) for cell in cells], dtype=np.int64)),
        _array("types", np.array(kinds, dtype=np.uint8)),
        "</Cells><PointData>",
        *(_array(name, values) for name, values in data.items()),
        "</PointData></Piece></UnstructuredGrid></VTKFile>",
    ]
    try:
        with whole_file(target) as partial:
            partial.write_text("\n".join(texts), encoding="ascii")
    except OSError as error:
        raise OutputError(f"{target}: cannot be written ({error.strerror or error})") from error
    return target


def _stress_fields(result: PartResult, name: str) -> dict[str, Array]:
    assert result.stress is not None and result.surface is not None
    components, ids = result.stresses(name), result.stress.ids
    principal = principal_stresses(components)
    nodes = result.surface.node_ids
    count = int(max(ids.max(), nodes.max())) + 1
    fields = {}
    for title, values, extreme in (
        ("von Mises stress", von_mises(components), np.fmax),
        ("largest principal stress", principal[:, 0], np.fmax),
        ("least principal stress", principal[:, 2], np.fmin),
    ):
        whole = np.full(count, np.nan)
        extreme.at(whole, ids, values)
        fields[f"{name}: {title}"] = whole[nodes]
    return fields


def _array(name: str, values: NDArray[np.generic]) -> str:
    """A DataArray: the length in bytes, then the numbers, in base64."""
    plain = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"))
    raw = np.array([plain.nbytes], dtype="<u8").tobytes() + plain.tobytes()
    width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    return (
        f'<DataArray type="{_TYPES[values.dtype.kind]}" Name="{name}"{width} format="binary">'
        f"{base64.b64encode(raw).decode('ascii')}</DataArray>"
    )
