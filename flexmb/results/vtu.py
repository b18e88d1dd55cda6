"""Fields of a part as a VTU file, which ParaView and others open.

An unstructured grid of the skin (triangles, lines of beams) with the displacement, the von Mises
stress and the largest and least principal stress of each field, in SI; arrays are base64 in XML.
Of several layers at a point the largest von Mises stress counts, and the extreme principal ones.
Source: VTK File Formats, The VTK User's Guide.
"""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import OutputError
from flexmb.flexbody import PartResult, principal_stresses, von_mises
from flexmb.folders import whole_file

Array = NDArray[np.float64]
_LINE, _TRIANGLE = 3, 5
_TYPES = {"f": "Float64", "i": "Int64", "u": "UInt8"}


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
