"""Files of MED (Salome, Code_Aster): nodes, elements and groups.

meshio reads no groups of MED, fails on names with other letters than English ones, and on element
types of which none has a group. Elements and nodes have a family each, and a family is a member of
any number of groups. Source: MED, documentation of the file format 3.3 and 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import MeshError
from flexmb.flexbody.arrays import IntArray
from flexmb.untrusted import open_of_others

_KINDS = {
    "PO1": "vertex", "SE2": "line", "SE3": "line3", "SE4": "line4", "TR3": "triangle",
    "TR6": "triangle6", "TR7": "triangle7", "QU4": "quad", "QU8": "quad8", "QU9": "quad9",
    "TE4": "tetra", "T10": "tetra10", "PY5": "pyramid", "P13": "pyramid13", "PE6": "wedge",
    "P15": "wedge15", "P18": "wedge18", "HE8": "hexahedron", "H20": "hexahedron20",
    "H27": "hexahedron27",
}  # fmt: skip
_TO_VTK = {"hexahedron27": [*range(20), 24, 22, 21, 23, 20, 25, 26]}  # middles of the faces


def read_med(source: Path) -> Any:
    """The mesh of a MED file, as one of meshio; None of one with groups of scikit-fem.

    Raises
    ------
    MeshError
        Several meshes or states of one, or elements that are not known.
    OSError, ValueError, LookupError, AttributeError
        The file is damaged.
    """
    import meshio

    with open_of_others(source) as file:
        name = _single(source, file["ENS_MAA"], "meshes")
        mesh = file["ENS_MAA"][name]
        if any(field.startswith("skfem:") for field in file.get("CHA", ())):
            return None
        dim = int(mesh.attrs["ESP"])
        families = file["FAS"][name] if name in file.get("FAS", ()) else {}
        if "NOE" not in mesh:
            mesh = mesh[_single(source, mesh, "states of its mesh")]
        nodes = mesh["NOE"]
        points = nodes["COO"][()].reshape((dim, -1)).T
        row_of_sets = _groups(families.get("NOEUD", {}), [_family(nodes, len(points))])
        cells, members = [], []
        for word, part in mesh.get("MAI", {}).items():
            if word not in _KINDS:
                raise MeshError(f"{source}: elements of type {word} of MED are not read")
            rows = part["NOD"][()].reshape((-1, int(part["NOD"].attrs["NBR"]))).T - 1
            cells.append((_KINDS[word], rows[:, _TO_VTK.get(_KINDS[word], slice(None))]))
            members.append(_family(part, len(rows)))
        cell_sets = _groups(families.get("ELEME", {}), members)
    point_sets = {name: rows for name, (rows,) in row_of_sets.items()}
    return meshio.Mesh(points, cells, point_sets=point_sets, cell_sets=cell_sets)


def _single(source: Path, group: Mapping[str, Any], what: str) -> str:
    if len(group) != 1:
        raise MeshError(f"{source}: the file has {len(group)} {what}: write one into a file")
    return next(iter(group))


def _family(part: Any, count: int) -> IntArray:
    """The family of each node or element; 0 is that without groups."""
    members = part["FAM"][()] if "FAM" in part else np.zeros(count)
    if len(members) != count:
        raise ValueError("as many families as nodes or elements are expected")
    return np.asarray(members, dtype=int)


def _groups(families: Mapping[str, Any], members: list[IntArray]) -> dict[str, list[IntArray]]:
    """Rows of each list of members by the names of their groups."""
    numbers: dict[str, list[int]] = {}
    for family in families.values():
        names = family["GRO"]["NOM"][()] if "GRO" in family else ()
        for name in names:
            numbers.setdefault(_text(name), []).append(int(family.attrs["NUM"]))
    return {
        name: [np.flatnonzero(np.isin(part, own)) for part in members]
        for name, own in numbers.items()
    }


def _text(name: Any) -> str:
    """A name that is stored as 80 signed bytes."""
    data = np.asarray(name).astype(np.int8).tobytes().split(b"\0")[0]
    try:
        return data.decode("utf-8").strip()
    except UnicodeDecodeError:
        return data.decode("latin-1").strip()
