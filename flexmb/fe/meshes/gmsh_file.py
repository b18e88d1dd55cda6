"""Files of Gmsh in its formats 4.1 and 4.0, text or binary: nodes, elements and physical groups.

meshio refuses files in which some entities have no physical group (``Mesh.SaveAll``), parametric
nodes and partitioned meshes; of an entity in several groups without a name it knows the first. So
these formats are read here; older ones are left to meshio. Source: Gmsh reference manual, section
MSH file format.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.flexbody.arrays import FloatArray, IntArray

_HEAD = re.compile(rb"\s*\$MeshFormat\s+4\.([01])\s+([01])\s+8\b")
_ENTITIES, _PARTITIONS = b"Entities", b"PartitionedEntities"

Tags = dict[tuple[int, int], list[int]]  # physical tags by dimension and tag of an entity


@dataclass
class _Section:
    """The numbers of one section, read from its begin on."""

    data: bytes | FloatArray  # binary, or all numbers of a text
    old: bool  # format 4.0
    place: int = 0

    def _next(self, count: int, kind: str) -> Any:
        if isinstance(self.data, bytes):
            size = np.dtype(kind).itemsize * count
            if not 0 <= size <= len(self.data) - self.place:
                raise ValueError("a section ends too early")
            part = np.frombuffer(self.data, kind, count, self.place)
            self.place += size
            return part
        if not 0 <= count <= len(self.data) - self.place:
            raise ValueError("a section ends too early")
        self.place += count
        part = self.data[self.place - count : self.place]
        if kind != "<f8" and not (part == np.rint(part)).all():
            raise ValueError("a section has other numbers than its format says")
        return part

    def integers(self, count: int) -> IntArray:
        return np.asarray(self._next(count, "<i4"), dtype=int)

    def sizes(self, count: int) -> IntArray:
        return np.asarray(self._next(count, "<u8"), dtype=int)

    def reals(self, count: int) -> FloatArray:
        return np.asarray(self._next(count, "<f8"), dtype=float)

    def counts(self) -> list[int]:
        """Blocks, and nodes or elements, at the begin of a section."""
        return self.sizes(2 if self.old else 4)[:2].tolist()

    def entity(self) -> list[int]:
        """Dimension and tag of an entity, and a third number."""
        first, second, third = self.integers(3).tolist()
        return [second, first, third] if self.old else [first, second, third]

    def nodes(self, count: int, width: int) -> tuple[IntArray, FloatArray]:
        """Tags, and as many coordinates as `width` of each."""
        if not self.old:
            return self.sizes(count), self.reals(count * width).reshape(-1, width)
        if isinstance(self.data, bytes):
            rows = self._next(count, f"<i4,({width},)<f8")
            return rows["f0"].astype(int), rows["f1"]
        table = self.reals(count * (width + 1)).reshape(-1, width + 1)
        return table[:, 0].astype(int), table[:, 1:]


def read_gmsh(source: Path) -> Any:
    """The mesh of a file in format 4, as one of meshio; None of another one, or of scikit-fem.

    Raises
    ------
    ValueError, LookupError
        The file is damaged.
    """
    import meshio
    from meshio._common import num_nodes_per_cell
    from meshio.gmsh.common import _gmsh_to_meshio_order, _gmsh_to_meshio_type

    data = source.read_bytes()
    head = _HEAD.match(data)
    if head is None or b'"skfem:' in data:
        return None
    old, binary = head[1] == b"0", head[2] == b"1"
    if old and b"$" + _ENTITIES not in data:  # meshio writes such files
        return None
    names = _names(_content(data, b"PhysicalNames"))
    tags: Tags = {}
    for name in (_ENTITIES, _PARTITIONS):
        if content := _content(data, name):
            _read_entities(_section(content, binary, old), name == _PARTITIONS, tags)
    points, tag = _read_nodes(_section(_content(data, b"Nodes"), binary, old))
    order = np.argsort(tag)
    section = _section(_content(data, b"Elements"), binary, old)
    cells: list[tuple[str, IntArray]] = []
    groups: dict[tuple[int, int], list[int]] = {}
    blocks, count = section.counts()
    for _ in range(blocks):
        dim, entity, kind = section.entity()
        word = _gmsh_to_meshio_type[kind]
        width = num_nodes_per_cell[word] + 1
        size = int(section.sizes(1)[0]) * width
        rows = (section.integers(size) if old else section.sizes(size)).reshape(-1, width)[:, 1:]
        place = order[np.searchsorted(tag, rows, sorter=order) % max(len(tag), 1)]
        if (tag[place] != rows).any():
            raise ValueError(f"elements of kind {word} name nodes that are absent")
        for physical in tags.get((dim, entity), ()):
            groups.setdefault((dim, physical), []).append(len(cells))
        cells.append((word, np.asarray(_gmsh_to_meshio_order(word, place))))
    if sum(len(part) for _, part in cells) != count:
        raise ValueError("a section ends too early")
    sets = {}
    for key in [*(key for key in names if key in groups), *sorted(groups.keys() - names.keys())]:
        name = names.get(key, f"{key[0]}:{key[1]}")
        sets[name] = [np.arange(len(part) if k in groups[key] else 0)
                      for k, (_, part) in enumerate(cells)]  # fmt: skip
    return meshio.Mesh(points, cells, cell_sets=sets)


def _content(data: bytes, name: bytes) -> bytes:
    """What a section holds; nothing if there is none."""
    begin = re.search(rb"^\$" + name + rb"[ \t]*\r?\n", data, re.M)
    if begin is None:
        return b""
    end = data.find(b"$End" + name, begin.end())
    if end < 0:
        raise ValueError("a section has no end")
    return data[begin.end() : end]


def _section(content: bytes, binary: bool, old: bool) -> _Section:
    return _Section(content if binary else np.array(content.split(), dtype=float), old)


def _names(content: bytes) -> dict[tuple[int, int], str]:
    """Names by dimension and tag; of groups with one name that of the highest dimension has it."""
    rows = [shlex.split(line) for line in content.decode("utf-8", "replace").splitlines()[1:]]
    of = {(int(row[0]), int(row[1])): row[2] for row in rows if row}
    highest = {
        name: max(key[0] for key, same in of.items() if same == name) for name in of.values()
    }
    return {key: name for key, name in of.items() if key[0] == highest[name]}


def _read_entities(section: _Section, partitions: bool, tags: Tags) -> None:
    """Add the physical tags of all entities."""
    if partitions:
        section.sizes(1)
        section.integers(2 * int(section.sizes(1)[0]))  # ghost entities
    for dim, count in enumerate(section.sizes(4).tolist()):
        for _ in range(count):
            tag = int(section.integers(1)[0])
            if partitions:
                section.integers(2)  # the parent
                section.integers(int(section.sizes(1)[0]))
            section.reals(3 if dim == 0 and not section.old else 6)
            tags[dim, tag] = np.abs(section.integers(int(section.sizes(1)[0]))).tolist()
            if dim > 0:
                section.integers(int(section.sizes(1)[0]))


def _read_nodes(section: _Section) -> tuple[FloatArray, IntArray]:
    """Coordinates and tags in the order of the file."""
    blocks, count = section.counts()
    tags, points = [np.zeros(0, int)], [np.zeros((0, 3))]
    for _ in range(blocks):
        dim, _, parametric = section.entity()
        tag, table = section.nodes(int(section.sizes(1)[0]), 3 + (dim if parametric else 0))
        tags.append(tag)
        points.append(table[:, :3])
    if sum(map(len, tags)) != count:
        raise ValueError("a section ends too early")
    return np.concatenate(points), np.concatenate(tags)
