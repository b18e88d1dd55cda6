"""Mesh files in any format that meshio reads, and those that it reads wrongly or not at all.

meshio prints, may end the process on a file it cannot read, keeps bookkeeping among the groups and
leaves gmsh's two formats different: :func:`read_mesh` catches or normalises all of that. Groups
without a name are called ``"dim:tag"``.
"""

from __future__ import annotations

import contextlib
import io
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import MeshError
from flexmb.fe.meshes.abaqus_deck import ABAQUS, read_abaqus
from flexmb.fe.meshes.damaged_file import damage
from flexmb.fe.meshes.gmsh_file import read_gmsh
from flexmb.fe.meshes.med_file import read_med
from flexmb.fe.meshes.mesh import Mesh, dimension
from flexmb.fe.meshes.nastran_deck import is_nastran, read_nastran
from flexmb.fe.meshes.scikit_fem_mesh import has_skfem_groups, mesh_of_skfem_file
from flexmb.fe.meshes.vtk_cells import cells_left_out, rename_cells, teach_meshio
from flexmb.flexbody.arrays import IntArray
from flexmb.folders import missing_file
from flexmb.untrusted import check_reading, hdf5_beside, serve_reading

Groups = dict[str, dict[str, list[IntArray]]]

# kinds whose dimension meshio 5.3.5 does not know, so that it fails on them
_FORGOTTEN = ("wedge15", "pyramid13", "hexahedron24")


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
    check_is_there(source)
    if not source.stat().st_size:
        raise MeshError(f"{source}: the mesh file is empty; export it again")
    problem = check_reading(source, "flexmb.fe.meshes.mesh_file")
    if problem is not None:
        raise MeshError(f"{source}: the mesh file {problem}")
    return _read(source)


def check_is_there(source: Path) -> None:
    """Refuse a mesh file that is missing or a folder, with the nearest names.

    Raises
    ------
    MeshError
        It is.
    """
    if source.is_dir():
        raise MeshError(f"{source}: is a folder, not a mesh file")
    if not source.is_file():
        raise MeshError.from_problems([missing_file(source, "there is no such mesh file")])


def _read(source: Path) -> Mesh:
    raw = _read_quietly(source)
    try:
        if has_skfem_groups(raw):
            return mesh_of_skfem_file(raw, source.name)
        points = np.asarray(raw.points, dtype=float)
        if points.ndim == 2 and points.shape[1] < 3:
            points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
        blocks, became = _merge_blocks(raw)
        groups = _named_groups(raw, became)
        node_sets = {name: np.asarray(nodes, int) for name, nodes in raw.point_sets.items()}
    except MeshError as error:
        raise MeshError(f"{source}: the mesh file is damaged: {error}") from None
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
        raise MeshError(f"{source}: {damage(source, error)}") from error
    own = (getattr(raw, "note", ""), getattr(raw, "numbers", None))
    return Mesh(points, blocks, node_sets, groups, source.name, *own)


def _read_raw(source: Path) -> Any:
    import meshio

    own, suffix = None, source.suffix.lower()
    if suffix in ABAQUS:
        own = read_abaqus(source)
    elif is_nastran(source):
        own = read_nastran(source)
    elif suffix == ".med":
        own = read_med(source)
    elif suffix == ".msh":
        own = read_gmsh(source)
    return meshio.read(source) if own is None else own


def _read_quietly(source: Path) -> Any:
    import meshio

    for kind in _FORGOTTEN:
        meshio._mesh.topological_dimension.setdefault(kind, 3)
    teach_meshio()
    noise = io.StringIO()
    try:
        with (
            contextlib.redirect_stdout(noise),
            contextlib.redirect_stderr(noise),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")
            raw = _read_raw(source)
        try:
            rename_cells(raw)
            note = cells_left_out(noise.getvalue())
        except MeshError as error:
            raise MeshError(f"{source}: {error}") from None
        raw.note = getattr(raw, "note", "") or note
        return raw
    except MeshError:
        raise
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:  # noqa: BLE001  its parsers let through what there is
        reason = error
    if source.suffix.lower() not in meshio.extension_to_filetypes:
        raise MeshError(
            f'{source}: no mesh format has the suffix "{source.suffix}"; allowed: .msh (Gmsh), '
            ".inp (Abaqus), .bdf, .nas, .fem, .dat (Nastran), .vtu, .vtk, .med, .xdmf and others "
            "of meshio; a geometry such as .step or .iges is to be meshed at first"
        )
    raise MeshError(f"{source}: {damage(source, reason)}") from reason


def _merge_blocks(raw: Any) -> tuple[dict[str, IntArray], list[IntArray]]:
    """One block per kind; and for each raw block the row of each of its elements in the merged
    block."""
    from meshio._common import num_nodes_per_cell

    kinds = list(dict.fromkeys(block.type for block in raw.cells))
    blocks: dict[str, IntArray] = {}
    became: list[IntArray] = [np.zeros(0, dtype=int)] * len(raw.cells)
    for kind in kinds:
        numbers = [k for k, block in enumerate(raw.cells) if block.type == kind]
        cells = np.concatenate([np.asarray(raw.cells[k].data, dtype=int) for k in numbers])
        if cells.shape[1] != num_nodes_per_cell.get(kind, cells.shape[1]):
            raise MeshError(f"elements of kind {kind} with {cells.shape[1]} nodes")
        blocks[kind], rows = _without_repeats(cells)
        ends = np.cumsum([len(raw.cells[k].data) for k in numbers])
        for number, part in zip(numbers, np.split(rows, ends[:-1]), strict=True):
            became[number] = part
    return blocks, became


def _without_repeats(cells: IntArray) -> tuple[IntArray, IntArray]:
    """The distinct elements, in order of first occurrence, and the row of each given one among
    them."""
    _, first, same = np.unique(
        np.sort(cells, axis=1), axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return cells[first[order]], rank[same.ravel()]


# data of a file that hold numbers of groups: gmsh's, Nastran's properties, references or materials
# of others
_TAGS = (
    "gmsh:physical", "nastran:ref", "medit:ref", "tetgen:ref", "ugrid:ref", "avsucd:material",
    "netgen:index", "su2:tag",
)  # fmt: skip


def _named_groups(raw: Any, became: list[IntArray]) -> dict[str, dict[str, IntArray]]:
    groups: Groups = {}
    for name, per_block in raw.cell_sets.items():
        if name.startswith("gmsh:"):
            continue
        for number, rows in enumerate(per_block):
            if rows is not None and len(rows):
                _add_rows(
                    groups, name, raw.cells[number].type, became[number][np.asarray(rows, int)]
                )
    by_name = set(groups)
    names = _names_of_tags(raw.field_data)
    tagged = next((raw.cell_data[key] for key in _TAGS if key in raw.cell_data), ())
    for number, tags in enumerate(tagged):
        kind = raw.cells[number].type
        for tag in np.unique(tags[tags != 0]):
            key = (dimension(kind), int(tag))
            name = names.get(key, f"{key[0]}:{key[1]}")
            if name not in by_name:
                _add_rows(groups, name, kind, became[number][np.asarray(tags) == tag])
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


def _add_rows(groups: Groups, name: str, kind: str, rows: IntArray) -> None:
    groups.setdefault(name, {}).setdefault(kind, []).append(rows)


def _read_apart(source: Path) -> None:
    # the reading in the main process raises the error again
    with hdf5_beside(), contextlib.suppress(MeshError):
        _read(source)


if __name__ == "__main__":
    serve_reading(_read_apart)
