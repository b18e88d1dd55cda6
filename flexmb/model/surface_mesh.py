"""Surfaces of rigid bodies from files, and the mass properties of the enclosed volume.

In: an STL file, text or binary, or a VTU file, with data as text or inline, plain or compressed as
most programs write it; for volume cells their boundary is taken. Out: points (n, 3) and triangles
(t, 3), and by the divergence theorem the volume, centre and second moments of a closed surface.
Sources: 3D Systems, Stereolithography Interface Specification; Kitware, VTK file formats; Mirtich,
Fast and accurate computation of polyhedral mass properties, J. Graphics Tools 1, 1996.
"""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import SceneError
from flexmb.flexbody.arrays import Array, IntArray

_MAX_BYTES, _MAX_TRIANGLES = 200e6, 2_000_000
_SAME_POINT = 1e-7  # points of an STL file closer than this fraction of its size are equal
_TYPES = {
    "Float32": "f4", "Float64": "f8", "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2",
    "Int32": "i4", "UInt32": "u4", "Int64": "i8", "UInt64": "u8",
}  # fmt: skip
# corners of the faces of each cell type of VTK
_FACES: Mapping[int, tuple[tuple[int, ...], ...]] = {
    5: ((0, 1, 2),),
    9: ((0, 1, 2, 3),),
    10: ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
    12: ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    13: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    14: ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}  # fmt: skip
_SURFACE_CELLS = (5, 9)


def read_surface(path: Path) -> tuple[Array, IntArray]:
    """Points (n, 3) and triangles (t, 3) of a file, in its own unit.

    Raises
    ------
    SceneError
        No such file, another format, damaged, or too large.
    """
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise SceneError(f'the file "{path}" has more than {_MAX_BYTES / 1e6:g} MB')
        data = path.read_bytes()
    except OSError as error:
        raise SceneError(f'the file "{path}" cannot be read: {error.strerror}') from None
    readers = {".stl": _read_stl, ".vtu": _read_vtu}
    if path.suffix.lower() not in readers:
        raise SceneError(f'"{path.name}" is no .stl or .vtu file')
    try:
        points, faces = readers[path.suffix.lower()](data)
    except SceneError as error:
        raise SceneError(f"{path.name}: {error}") from None
    except (ValueError, IndexError, KeyError, struct.error, zlib.error, ElementTree.ParseError):
        raise SceneError(f"{path.name}: the file is damaged, or of a variant not known") from None
    if not len(faces) or not np.isfinite(points).all():
        raise SceneError(f"{path.name}: holds no triangles, or points that are not finite")
    if len(faces) > _MAX_TRIANGLES:
        what = f"{path.name}: has {len(faces)} triangles, at most {_MAX_TRIANGLES} are drawn"
        raise SceneError(f"{what}; coarsen it")
    return points, faces


def pack_surface(points: Array, faces: IntArray) -> str:
    """A surface as a text; points in single precision."""
    raw = struct.pack("<ii", len(points), len(faces))
    raw += points.astype("<f4").tobytes() + faces.astype("<i4").tobytes()
    return base64.b64encode(zlib.compress(raw)).decode()


def unpack_surface(text: str) -> tuple[Array, IntArray]:
    """The surface from a text of `pack_surface`.

    Raises
    ------
    SceneError
        The text is not a surface.
    """
    try:
        raw = zlib.decompressobj().decompress(base64.b64decode(text, validate=True), int(1e9))
        n, t = struct.unpack("<ii", raw[:8])
        points = np.frombuffer(raw, "<f4", 3 * n, 8).reshape(n, 3).astype(float)
        faces = np.frombuffer(raw, "<i4", 3 * t, 8 + 12 * n).reshape(t, 3).astype(np.int64)
    except (ValueError, struct.error, zlib.error):
        raise SceneError("the text is no surface") from None
    if n < 1 or t < 1 or faces.min() < 0 or faces.max() >= n:
        raise SceneError("the text is no surface")
    return points, faces


def open_edges(faces: IntArray) -> int:
    """Number of edges that do not have exactly two triangles, one in each direction; 0 if
    closed."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    sense = np.where(pairs[:, 0] < pairs[:, 1], 1, -1)
    _, edge = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    edge = edge.ravel()
    count, balance = np.bincount(edge), np.bincount(edge, weights=sense)
    return int(np.sum((count % 2 != 0) | (balance != 0)))


def enclosed(points: Array, faces: IntArray) -> tuple[float, Array, Array]:
    """Volume, centre (3,), and second moments (3, 3) about it over the volume.

    It sums over the tetrahedra between the triangles and a point; a surface with normals inwards
    gives the same result.
    """
    origin = points.mean(axis=0)
    a, b, c = (points[faces[:, k]] - origin for k in range(3))
    v = np.einsum("ti,ti->t", a, np.cross(b, c)) / 6.0
    volume = float(v.sum())
    if volume == 0.0:
        return 0.0, origin, np.zeros((3, 3))
    total = a + b + c
    center = (v @ total) / 4.0 / volume
    second = sum(np.einsum("t,ti,tj->ij", v, x, x) for x in (a, b, c, total)) / 20.0 / volume
    return abs(volume), origin + center, np.asarray(second) - np.outer(center, center)


def _read_stl(data: bytes) -> tuple[Array, IntArray]:
    count = struct.unpack("<I", data[80:84])[0] if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count:
        rows = np.frombuffer(
            data, np.dtype([("n", "<f4", 3), ("x", "<f4", (3, 3)), ("a", "<u2")]), count, 84
        )
        corners = rows["x"].reshape(-1, 3).astype(float)
    elif data[:5].lower() == b"solid":
        words = [line.split() for line in data.decode("utf-8", "replace").splitlines()]
        corners = np.array([[float(x) for x in row[1:4]] for row in words if row[:1] == ["vertex"]])
    else:
        raise SceneError("is no STL file")
    corners = corners.reshape(-1, 3)
    if len(corners) % 3:
        raise SceneError("a triangle lacks a corner")
    size = float(np.ptp(corners, axis=0).max()) if len(corners) else 0.0
    grid = np.round(corners / (_SAME_POINT * size or 1.0))
    _, first, number = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    return corners[first], number.reshape(-1, 3).astype(np.int64)


def _read_vtu(data: bytes) -> tuple[Array, IntArray]:
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise SceneError("holds definitions of entities, which no mesh needs")
    if b"<AppendedData" in data:
        raise SceneError('its data are appended; write it with data "inline", or as text')
    root = ElementTree.fromstring(data)
    piece = root.find("UnstructuredGrid/Piece")
    if piece is None:
        raise SceneError("holds no unstructured grid")
    array = _Reader(root)
    points = array.read(piece.find("Points/DataArray")).reshape(-1, 3).astype(float)
    named = {one.get("Name"): one for one in piece.findall("Cells/DataArray")}
    ends = array.read(named["offsets"]).astype(int)
    nodes, kinds = array.read(named["connectivity"]).astype(int), array.read(named["types"])
    faces = list[tuple[int, ...]]()
    volumes: dict[tuple[int, ...], tuple[int, ...]] = {}
    for start, end, kind in zip([0, *ends[:-1]], ends, kinds, strict=True):
        for corners in _FACES.get(int(kind), ()):
            face = tuple(int(n) for n in nodes[start:end][list(corners)])
            if int(kind) in _SURFACE_CELLS:
                faces.append(face)
            elif volumes.pop(tuple(sorted(face)), None) is None:
                volumes[tuple(sorted(face))] = face
    faces += volumes.values()
    triangles = [(f[0], f[k], f[k + 1]) for f in faces for k in range(1, len(f) - 1)]
    used, number = np.unique(np.array(triangles, dtype=int).reshape(-1, 3), return_inverse=True)
    return points[used], number.reshape(-1, 3).astype(np.int64)


class _Reader:
    """Arrays of a VTU file."""

    def __init__(self, root: Any) -> None:
        self.order = ">" if root.get("byte_order") == "BigEndian" else "<"
        self.header = np.dtype(self.order + _TYPES[root.get("header_type", "UInt32")])
        compressor = root.get("compressor", "")
        self.compressed = bool(compressor)
        if compressor not in ("", "vtkZLibDataCompressor"):
            raise SceneError(f"is compressed by {compressor}; write it with zlib, or as text")

    def read(self, element: Any) -> NDArray[Any]:
        """The numbers of one array."""
        kind, text = _TYPES[element.get("type")], (element.text or "").strip()
        if element.get("format", "ascii") == "ascii":
            return np.array(text.split(), dtype=float)
        size = self.header.itemsize
        if not self.compressed:
            raw = base64.b64decode(text)
            count = int(np.frombuffer(raw, self.header, 1)[0])
            return np.frombuffer(raw[size : size + count], self.order + kind)
        blocks = int(np.frombuffer(base64.b64decode(text[:24])[:size], self.header)[0])
        length = -(-(3 + blocks) * size // 3) * 4  # length of the header in base 64
        sizes = np.frombuffer(base64.b64decode(text[:length])[: (3 + blocks) * size], self.header)[
            3:
        ]
        raw, pieces, at = base64.b64decode(text[length:]), [], 0
        for one in sizes.tolist():
            pieces.append(zlib.decompressobj().decompress(raw[at : at + one], int(_MAX_BYTES)))
            at += one
        return np.frombuffer(b"".join(pieces), self.order + kind)
