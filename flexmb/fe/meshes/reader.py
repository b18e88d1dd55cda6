"""Reading a mesh file with meshio, without its surprises.

In: a path. Out: a :class:`Mesh`. meshio prints, may end the process on a file it cannot read,
keeps bookkeeping among the groups, and leaves gmsh's two formats different; here all of that is
caught or normalised: one block per element kind, every group under its name (or ``"dim:tag"``
where the file names none), elements repeated by the file for several groups kept once.
"""

from __future__ import annotations

import contextlib
import io
import os
import struct
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import MeshError
from flexmb.fe.meshes.mesh import Mesh, dimension
from flexmb.flexbody.arrays import IntArray

__all__ = ["read_mesh"]

Groups = dict[str, dict[str, list[IntArray]]]

_UNREADABLE = (  # what meshio's parsers let through on a file they cannot parse
    SystemExit, OSError, EOFError, ValueError, LookupError, TypeError, AttributeError,
    AssertionError, ArithmeticError, RuntimeError, MemoryError, struct.error,
)  # fmt: skip

_FORGOTTEN = ("wedge15", "pyramid13", "hexahedron24")  # meshio 5.3.5 fails on these: no dimension


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    """Read a mesh in any format that meshio knows by its suffix.

    Parameters
    ----------
    path : path
        The file; coordinates are kept in its own unit.

    Raises
    ------
    MeshError
        No such file, or one that cannot be read.
    """
    source = Path(path)
    if not source.is_file():
        raise MeshError(f"{source}: there is no such mesh file")
    raw = _read_quietly(source)
    points = np.asarray(raw.points, dtype=float)
    if points.ndim == 2 and points.shape[1] < 3:
        points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    blocks, kept = _merge_blocks(raw)
    groups = _named_groups(raw, kept)
    node_sets = {name: np.asarray(nodes, int) for name, nodes in raw.point_sets.items()}
    return Mesh(points, blocks, node_sets, groups, source=source.name)


def _read_quietly(source: Path) -> Any:
    import meshio

    for kind in _FORGOTTEN:
        meshio._mesh.topological_dimension.setdefault(kind, 3)
    noise = io.StringIO()
    try:
        with (
            contextlib.redirect_stdout(noise),
            contextlib.redirect_stderr(noise),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")
            return meshio.read(source)
    except meshio.ReadError as error:
        reason = str(error)
    except _UNREADABLE as error:
        reason = "" if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}"
    known = source.suffix.lower() in meshio.extension_to_filetypes
    what = "is damaged or not of the format its suffix says" if known else "has an unknown suffix"
    raise MeshError(f"{source}: the mesh file {what}" + (f" ({reason})" if reason else ""))


def _merge_blocks(raw: Any) -> tuple[dict[str, IntArray], list[IntArray]]:
    """One block per kind, and for each raw block the row that each of its elements became."""
    kinds = list(dict.fromkeys(block.type for block in raw.cells))
    blocks: dict[str, IntArray] = {}
    became: list[IntArray] = [np.zeros(0, dtype=int)] * len(raw.cells)
    for kind in kinds:
        numbers = [k for k, block in enumerate(raw.cells) if block.type == kind]
        cells = np.concatenate([np.asarray(raw.cells[k].data, dtype=int) for k in numbers])
        blocks[kind], rows = _without_repeats(cells)
        ends = np.cumsum([len(raw.cells[k].data) for k in numbers])
        for number, part in zip(numbers, np.split(rows, ends[:-1]), strict=True):
            became[number] = part
    return blocks, became


def _without_repeats(cells: IntArray) -> tuple[IntArray, IntArray]:
    """The distinct elements in their first order, and for each given one its row among them."""
    _, first, same = np.unique(
        np.sort(cells, axis=1), axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return cells[first[order]], rank[same.ravel()]


def _named_groups(raw: Any, became: list[IntArray]) -> dict[str, dict[str, IntArray]]:
    groups: Groups = {}
    for name, per_block in raw.cell_sets.items():
        if name.startswith("gmsh:"):
            continue
        for number, rows in enumerate(per_block):
            if rows is not None and len(rows):
                _add(groups, name, raw.cells[number].type, became[number][np.asarray(rows, int)])
    by_name = set(groups)
    names = _names_of_tags(raw.field_data)
    for number, tags in enumerate(raw.cell_data.get("gmsh:physical", ())):
        kind = raw.cells[number].type
        for tag in np.unique(tags[tags != 0]):
            key = (dimension(kind), int(tag))
            name = names.get(key, f"{key[0]}:{key[1]}")
            if name not in by_name:
                _add(groups, name, kind, became[number][np.asarray(tags) == tag])
    return {
        name: {kind: np.unique(np.concatenate(rows)) for kind, rows in kinds.items()}
        for name, kinds in groups.items()
    }


def _names_of_tags(field_data: Mapping[str, Any]) -> dict[tuple[int, int], str]:
    """gmsh's names of physical groups by (dimension, tag)."""
    return {
        (int(entry[1]), int(entry[0])): name
        for name, entry in field_data.items()
        if np.shape(entry) == (2,)
    }


def _add(groups: Groups, name: str, kind: str, rows: IntArray) -> None:
    groups.setdefault(name, {}).setdefault(kind, []).append(rows)
