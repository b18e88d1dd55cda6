"""Elimination order and panels of the KKT matrix, found once per system.

Blocks are bodies (6 + m columns, modes first), scalar coordinates and constraint groups. The order
is that of minimum degree on the block graph, with rules that keep all pivots away from zero:

- A group is eliminated after both its bodies. If it connects a body to its parent in the spanning
  tree, it only has to follow this child body: its pivot is then −C_q M̂⁻¹ C_qᵀ of a free body, of
  full rank.
- A scalar coordinate, which may have no mass, is eliminated after the groups that follow it.
- Joints with curve markers have more rows than they remove degrees of freedom. Groups that close
  loops therefore come after the coordinates of curve markers: those with curve markers of their own
  after the curve coordinates of the tree, all others after all curve coordinates.

Tree structures get hardly any fill.
References: Davis, Direct Methods for Sparse Linear Systems (2006), ch. 4, 7.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flexmb.engine.tables import LINK, PANEL, UPDATE, Kkt


@dataclass(frozen=True)
class Blocks:
    """Structure of the KKT matrix by blocks: the bodies, the scalar coordinates, then the groups.

    A body or scalar coordinate is a list: for each of its velocity coordinates the column in its
    panel, or −1 if the coordinate is left out of the system.
    """

    columns: list[list[int]]
    group_rows: list[int]
    group_bodies: list[tuple[int, int]]  # bodies of I and J, -1 = ground
    group_coordinates: list[tuple[int, ...]]  # blocks of the scalar coordinates in its rows
    couples: list[tuple[int, int]]  # pairs of bodies or coordinates that tangents couple
    group_curve_coordinates: list[tuple[int, ...]]  # blocks of the coordinates of its curve markers


@dataclass(frozen=True)
class Symbolic:
    """Tables of the factorisation, and the place of each block."""

    kkt: Kkt
    panel_of: list[int]  # panel of each block
    group_links: list[tuple[int, int]]  # LINK of each group with its bodies, -1 = ground
    couple_links: dict[tuple[int, int], int]  # LINK of each pair of coupled blocks
    coordinate_links: dict[tuple[int, int], int]  # LINK of (group, block of a scalar coordinate)


@dataclass(frozen=True)
class _Fill:
    """The blocks below the diagonal of the factor, panel by panel, in elimination order."""

    first: np.ndarray  # (panels + 1,) first entry of each panel
    panel: np.ndarray  # panel of each entry, ascending
    block: np.ndarray  # block whose rows the entry holds, ascending in each panel
    row: np.ndarray  # first row of the entry, counted from below the diagonal block

    def entry(self, panel: np.ndarray, block: np.ndarray) -> np.ndarray:
        """Numbers of the entries for these pairs of panel and block."""
        n = len(self.first)
        return np.searchsorted(self.panel * n + self.block, panel * n + block)


def analyse(blocks: Blocks) -> Symbolic:
    """Order the blocks, lay out the panels and the updates between them."""
    sizes = _sizes(blocks)
    order, below = _minimum_degree_order(blocks, sizes)
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    size = np.array(sizes, np.int64)[order]
    fill = _fill_pattern(below, size)
    panels = _panels(fill, size, np.array(order) < len(blocks.columns))
    updates = _updates(fill, panels)
    pairs, *ids = _links(blocks)
    kkt = Kkt(
        panels=panels,
        rows=_concatenate_ranges(panels["col"][fill.block], size[fill.block]),
        updates=updates,
        links=_link_table(fill, panels, place[pairs]),
        place=_unknown_places(blocks, panels, place),
        column=_columns(blocks),
    )
    return Symbolic(kkt, place.tolist(), *ids)


def _sizes(blocks: Blocks) -> list[int]:
    """Columns of each block that belong to the system."""
    return [sum(c >= 0 for c in columns) for columns in blocks.columns] + blocks.group_rows


def _offsets(counts: np.ndarray) -> np.ndarray:
    """(n + 1,) offsets of consecutive parts of these lengths, and the end of the last."""
    return np.append(0, np.cumsum(counts, dtype=np.int64))


def _concatenate_ranges(starts: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """The ranges start, start + 1, ... with these counts, one after the other."""
    ends = _offsets(counts)
    return np.repeat(starts - ends[:-1], counts) + np.arange(ends[-1])


def _group_scalars(blocks: Blocks) -> list[tuple[int, ...]]:
    """Blocks of all scalar coordinates in the rows of each group."""
    both = zip(blocks.group_coordinates, blocks.group_curve_coordinates, strict=True)
    return [
        tuple(dict.fromkeys((*follows, *curve_coordinates))) for follows, curve_coordinates in both
    ]


def _graph(blocks: Blocks) -> list[set[int]]:
    n = len(blocks.columns)
    graph: list[set[int]] = [set() for _ in range(n + len(blocks.group_rows))]
    ends = zip(blocks.group_bodies, _group_scalars(blocks), strict=True)
    pairs = [(n + g, b) for g, (pair, free) in enumerate(ends) for b in (*pair, *free) if b >= 0]
    for a, b in pairs + [(a, b) for a, b in blocks.couples if a >= 0 and b >= 0]:
        graph[a].add(b)
        graph[b].add(a)
    return graph


def _tree_child(blocks: Blocks) -> dict[int, int]:
    """Child body of each group that belongs to the spanning tree from ground."""
    touching: dict[int, list[int]] = {}
    for g, pair in enumerate(blocks.group_bodies):
        for b in pair:
            touching.setdefault(b, []).append(g)
    child: dict[int, int] = {}
    seen: set[int] = set()
    for root in [-1, *range(len(blocks.columns))]:
        if root in seen:
            continue
        seen.add(root)
        queue = deque([root])
        while queue:
            body = queue.popleft()
            for g in touching.get(body, []):
                i, j = blocks.group_bodies[g]
                other = j if i == body else i
                if other not in seen:
                    seen.add(other)
                    child[g] = other
                    queue.append(other)
    return child


def _precedence(blocks: Blocks) -> Iterator[tuple[int, int]]:
    """Pairs of blocks; the first must be eliminated before the second."""
    n = len(blocks.columns)
    child = _tree_child(blocks)
    for g, pair in enumerate(blocks.group_bodies):
        bodies = [b for b in pair if b >= 0]
        for b in [child[g]] if g in child else bodies:
            yield b, n + g
        for c in blocks.group_coordinates[g]:  # a group without bodies relates coordinates only
            yield (n + g, c) if bodies else (c, n + g)
    yield from _precedence_of_curves(blocks, child)


def _precedence_of_curves(blocks: Blocks, child: dict[int, int]) -> Iterator[tuple[int, int]]:
    n = len(blocks.columns)
    first = {c for g in child for c in blocks.group_curve_coordinates[g]}
    every = {c for curve_coordinates in blocks.group_curve_coordinates for c in curve_coordinates}
    for g, curve_coordinates in enumerate(blocks.group_curve_coordinates):
        for c in curve_coordinates:
            yield n + g, c
        if g not in child:
            for c in first if curve_coordinates else every:
                yield c, n + g


def _minimum_degree_order(blocks: Blocks, size: list[int]) -> tuple[list[int], list[list[int]]]:
    """Elimination order; for each position those of the later blocks with rows in its panel."""
    graph = _graph(blocks)
    waits = [0] * len(graph)  # number of blocks that must still be eliminated before
    after: dict[int, list[int]] = {}
    for b, c in set(_precedence(blocks)):
        waits[c] += 1
        after.setdefault(b, []).append(c)
    degree = [sum(size[c] for c in near) for near in graph]
    heap = [(degree[b], b) for b in range(len(graph)) if not waits[b]]
    heapq.heapify(heap)
    order: list[int] = []
    below: list[set[int]] = []
    place: dict[int, int] = {}
    while heap:
        d, b = heapq.heappop(heap)
        if b in place or d != degree[b]:
            continue
        place[b] = len(order)
        order.append(b)
        neighbours = graph[b]
        below.append(neighbours)
        for c in neighbours:
            near = graph[c]
            near.discard(b)
            degree[c] -= size[b]
            for x in neighbours - near:
                if x != c:
                    near.add(x)
                    degree[c] += size[x]
        later = after.get(b, [])
        for c in later:
            waits[c] -= 1
        for c in (*neighbours, *later):
            if not waits[c]:
                heapq.heappush(heap, (degree[c], c))
    return order, [sorted(place[c] for c in rows) for rows in below]


def _fill_pattern(below: list[list[int]], size: np.ndarray) -> _Fill:
    counts = np.array([len(rows) for rows in below], np.int64)
    first, panel = _offsets(counts), np.repeat(np.arange(len(below)), counts)
    block = np.array([b for rows in below for b in rows], np.int64)
    row = _offsets(size[block])
    return _Fill(first, panel, block, row[:-1] - row[first[panel]])


def _panels(fill: _Fill, size: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """PANEL rows without their updates; `moves`: whether a block is a body or scalar coordinate."""
    panels = np.zeros(len(size), PANEL)
    rows = _offsets(size[fill.block])[fill.first]
    panels["nc"], panels["nr"] = size, np.diff(rows)
    panels["at"] = _offsets((size + panels["nr"]) * size)[:-1]
    panels["col"], panels["rows"] = _offsets(size)[:-1], rows[:-1]
    panels["sign"] = np.where(moves, 1.0, -1.0)
    return panels


def _updates(fill: _Fill, panels: np.ndarray) -> np.ndarray:
    """UPDATE rows: rectangles that each panel subtracts from the panels of its rows' blocks.

    There is one for each entry y of a panel with itself and each later entry x. The range of the
    updates of each panel is filled in.
    """
    entries = np.arange(len(fill.block))
    counts = fill.first[fill.panel + 1] - entries
    y, x = np.repeat(entries, counts), _concatenate_ranges(entries, counts)
    ends = _offsets(counts)[fill.first]
    panels["update"], panels["n_update"] = ends[:-1], np.diff(ends)
    nc, size = panels["nc"][fill.panel[y]], panels["nc"][fill.block]
    target = panels[fill.block[y]]
    diagonal = x == y
    other = fill.entry(fill.block[y[~diagonal]], fill.block[x[~diagonal]])
    row = np.zeros(len(y), np.int64)
    row[~diagonal] = size[y[~diagonal]] + fill.row[other]
    updates = np.zeros(len(y), UPDATE)
    updates["x"], updates["nx"] = nc + fill.row[x], size[x]
    updates["y"], updates["ny"] = nc + fill.row[y], size[y]
    updates["at"] = target["at"] + row * size[y]
    updates["stride"], updates["diagonal"] = size[y], diagonal
    return updates


def _links(blocks: Blocks):
    """Pairs of blocks (n, 2) to which tables refer, and the number of the pair for each use."""
    n = len(blocks.columns)
    pairs: list[tuple[int, int]] = []
    group_links: list[tuple[int, int]] = []
    for g, (i, j) in enumerate(blocks.group_bodies):
        ids = []
        for b in (i, j):
            ids.append(len(pairs) if b >= 0 else -1)
            if b >= 0:
                pairs.append((n + g, b))
        group_links.append((ids[0], ids[1]))
    coordinate_links: dict[tuple[int, int], int] = {}
    for g, free in enumerate(_group_scalars(blocks)):
        for c in free:
            coordinate_links[(g, c)] = len(pairs)
            pairs.append((n + g, c))
    couple_links: dict[tuple[int, int], int] = {}
    for a, b in blocks.couples:
        if a >= 0 and b >= 0 and (a, b) not in couple_links:
            couple_links[(a, b)] = len(pairs)
            pairs.append((a, b))
    return np.array(pairs, np.int64).reshape(-1, 2), group_links, couple_links, coordinate_links


def _link_table(fill: _Fill, panels: np.ndarray, places: np.ndarray) -> np.ndarray:
    """LINK rows of pairs of places (n, 2); flipped if the first is eliminated first."""
    early, late = places.min(axis=1), places.max(axis=1)
    nc = panels["nc"][early]
    table = np.zeros(len(places), LINK)
    table["at"] = panels["at"][early] + (nc + fill.row[fill.entry(early, late)]) * nc
    table["stride"], table["flipped"] = nc, places[:, 0] == early
    return table


def _columns(blocks: Blocks) -> np.ndarray:
    """(nv,) column of each velocity coordinate in its panel."""
    return np.array([c for columns in blocks.columns for c in columns], np.int64)


def _unknown_places(blocks: Blocks, panels: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(nv + nc,) permuted index of each unknown; one past the end if it is not in the matrix."""
    n, start = len(blocks.columns), panels["col"][place]
    column = _columns(blocks)
    moving = np.repeat(start[:n], [len(columns) for columns in blocks.columns]) + column
    moving[column < 0] = panels["nc"].sum()
    return np.append(moving, _concatenate_ranges(start[n:], np.array(blocks.group_rows, np.int64)))
