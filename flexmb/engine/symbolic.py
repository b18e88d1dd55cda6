"""Elimination order and panels of the KKT matrix, found once per system.

Blocks are bodies (6 + m columns, modes first), scalar coordinates and constraint groups. Minimum
degree on the block graph, with two rules that keep all pivots away from zero: a group is eliminated
after both its bodies, or after its child body if it is the joint by which that body hangs in the
spanning tree (its pivot is then −C_q M̂⁻¹ C_qᵀ of a free body, of full rank); a scalar coordinate,
which may have no mass, after the groups that follow it. What closes a loop waits for the
coordinates of curve markers, whose joints have more rows than they take freedoms: first those in
the tree, then those of loops, then all else that closes them. Trees get hardly any fill.
References: Davis, Direct Methods for Sparse Linear Systems (2006), ch. 4, 7.
"""

from __future__ import annotations

import heapq
from collections import deque
from dataclasses import dataclass

import numpy as np

from flexmb.engine.tables import LINK, PANEL, UPDATE, Kkt


@dataclass(frozen=True)
class Blocks:
    """The KKT matrix by blocks: the bodies, the scalar coordinates, then the groups.

    A body or scalar coordinate is a list: for each of its velocity coordinates the column in its
    panel, or −1 if the coordinate is left out of the system.
    """

    columns: list[list[int]]
    group_rows: list[int]
    group_bodies: list[tuple[int, int]]  # bodies of I and J, -1 = ground
    group_coordinates: list[tuple[int, ...]]  # blocks of the scalar coordinates it follows
    couples: list[tuple[int, int]]  # pairs of bodies or coordinates whose tangents couple
    group_sliders: list[tuple[int, ...]]  # blocks of the coordinates of its curve markers


@dataclass(frozen=True)
class Symbolic:
    """The factorisation's tables and where each block went."""

    kkt: Kkt
    panel_of: list[int]  # panel of each block
    group_links: list[tuple[int, int]]  # LINK of each group with its bodies, -1 = ground
    couple_links: dict[tuple[int, int], int]
    coordinate_links: dict[tuple[int, int], int]  # of (group, block)


def analyse(blocks: Blocks) -> Symbolic:
    """Order the blocks, lay out the panels and the updates between them."""
    order, below = _eliminate(blocks)
    panels, starts = _panels(blocks, order, below)
    updates = _updates(blocks, order, below, panels, starts)
    links, *ids = _links(blocks, order, below, panels)
    kkt = _kkt(blocks, order, panels, below, starts, updates, links)
    panel_of = [0] * len(order)
    for k, block in enumerate(order):
        panel_of[block] = k
    return Symbolic(kkt, panel_of, *ids)


def _size(blocks: Blocks, b: int) -> int:
    n = len(blocks.columns)
    return sum(c >= 0 for c in blocks.columns[b]) if b < n else blocks.group_rows[b - n]


def _scalars(blocks: Blocks) -> list[tuple[int, ...]]:
    """Blocks of all scalar coordinates in the rows of each group."""
    both = zip(blocks.group_coordinates, blocks.group_sliders, strict=True)
    return [tuple(dict.fromkeys((*follows, *slides))) for follows, slides in both]


def _graph(blocks: Blocks) -> list[set[int]]:
    n = len(blocks.columns)
    graph: list[set[int]] = [set() for _ in range(n + len(blocks.group_rows))]
    ends = zip(blocks.group_bodies, _scalars(blocks), strict=True)
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


def _waits(blocks: Blocks) -> list[set[int]]:
    """The blocks that must be eliminated before each block."""
    n = len(blocks.columns)
    child = _tree_child(blocks)
    waits: list[set[int]] = [set() for _ in range(n)]
    for g, pair in enumerate(blocks.group_bodies):
        bodies = {b for b in pair if b >= 0}
        waits.append({child[g]} if g in child else bodies)
        for c in blocks.group_coordinates[g]:
            if bodies:
                waits[c].add(n + g)
            else:  # it relates coordinates only
                waits[n + g].add(c)
    _wait_for_sliders(blocks, child, waits)
    return waits


def _wait_for_sliders(blocks: Blocks, child: dict[int, int], waits: list[set[int]]) -> None:
    n = len(blocks.columns)
    first = {c for g in child for c in blocks.group_sliders[g]}
    every = {c for slides in blocks.group_sliders for c in slides}
    for g, slides in enumerate(blocks.group_sliders):
        for c in slides:
            waits[c].add(n + g)
        if g not in child:
            waits[n + g] |= first if slides else every


def _eliminate(blocks: Blocks) -> tuple[list[int], list[list[int]]]:
    """Elimination order and, for each position, the later blocks its panel has rows of."""
    graph = _graph(blocks)
    waits = _waits(blocks)
    after: list[set[int]] = [set() for _ in waits]
    for b, before in enumerate(waits):
        for c in before:
            after[c].add(b)

    def degree(b: int) -> int:
        return sum(_size(blocks, c) for c in graph[b])

    heap = [(degree(b), b) for b in range(len(graph)) if not waits[b]]
    heapq.heapify(heap)
    order: list[int] = []
    below: list[list[int]] = []
    done: set[int] = set()
    while heap:
        d, b = heapq.heappop(heap)
        if b in done or d != degree(b):
            continue
        done.add(b)
        order.append(b)
        neighbours = graph[b]
        below.append(list(neighbours))
        for c in neighbours:
            graph[c] |= neighbours
            graph[c] -= {b, c}
        graph[b] = set()
        for c in after[b]:
            waits[c].discard(b)
        for c in neighbours | after[b]:
            if not waits[c]:
                heapq.heappush(heap, (degree(c), c))
    place = {b: k for k, b in enumerate(order)}
    return order, [sorted(rows, key=place.__getitem__) for rows in below]


def _panels(
    blocks: Blocks, order: list[int], below: list[list[int]]
) -> tuple[np.ndarray, list[int]]:
    panels = np.zeros(len(order), PANEL)
    starts = [0] * len(order)
    at = col = rows = 0
    for k, block in enumerate(order):
        nc = _size(blocks, block)
        nr = sum(_size(blocks, b) for b in below[k])
        sign = 1.0 if block < len(blocks.columns) else -1.0
        panels[k] = (at, nc, nr, col, rows, 0, 0, sign)
        starts[block] = col
        at += (nc + nr) * nc
        col += nc
        rows += nr
    return panels, starts


def _row_offsets(blocks: Blocks, below: list[int]) -> dict[int, int]:
    offsets, row = {}, 0
    for b in below:
        offsets[b] = row
        row += _size(blocks, b)
    return offsets


def _updates(blocks, order, below, panels, starts) -> np.ndarray:
    """Rectangles that panel k subtracts from the panels of its rows' blocks."""
    place = {b: k for k, b in enumerate(order)}
    offsets = [_row_offsets(blocks, rows) for rows in below]
    updates = []
    for k, rows in enumerate(below):
        panels[k]["update"] = len(updates)
        nc = panels[k]["nc"]
        for j, y in enumerate(rows):
            ny, target = _size(blocks, y), panels[place[y]]
            source_y = nc + offsets[k][y]
            for x in rows[j:]:
                nx = _size(blocks, x)
                row = 0 if x == y else ny + offsets[place[y]][x]
                at = target["at"] + row * ny
                updates.append((nc + offsets[k][x], nx, source_y, ny, at, ny, x == y))
        panels[k]["n_update"] = len(updates) - panels[k]["update"]
    return np.array(updates, UPDATE) if updates else np.zeros(0, UPDATE)


def _link(blocks, place, below, panels, first: int, second: int) -> tuple[int, int, int]:
    """Place of the block (first, second); flipped if first is eliminated before second."""
    flipped = place[first] < place[second]
    early, late = (first, second) if flipped else (second, first)
    k = place[early]
    row = _row_offsets(blocks, below[k])[late] + panels[k]["nc"]
    return panels[k]["at"] + row * panels[k]["nc"], panels[k]["nc"], flipped


def _links(blocks, order, below, panels):
    n = len(blocks.columns)
    place = {b: k for k, b in enumerate(order)}
    links: list[tuple[int, int, int]] = []
    group_links: list[tuple[int, int]] = []
    for g, pair in enumerate(blocks.group_bodies):
        ids = []
        for b in pair:
            ids.append(len(links) if b >= 0 else -1)
            if b >= 0:
                links.append(_link(blocks, place, below, panels, n + g, b))
        group_links.append((ids[0], ids[1]))
    coordinate_links: dict[tuple[int, int], int] = {}
    for g, free in enumerate(_scalars(blocks)):
        for c in free:
            coordinate_links[(g, c)] = len(links)
            links.append(_link(blocks, place, below, panels, n + g, c))
    couple_links: dict[tuple[int, int], int] = {}
    for a, b in blocks.couples:
        if a >= 0 and b >= 0 and (a, b) not in couple_links:
            couple_links[(a, b)] = len(links)
            links.append(_link(blocks, place, below, panels, a, b))
    table = np.array(links, LINK) if links else np.zeros(0, LINK)
    return table, group_links, couple_links, coordinate_links


def _kkt(blocks, order, panels, below, starts, updates, links) -> Kkt:
    rows = [np.arange(starts[b], starts[b] + _size(blocks, b)) for under in below for b in under]
    column = np.array([c for columns in blocks.columns for c in columns], np.int64)
    end = sum(_size(blocks, b) for b in range(len(order)))
    place = [
        np.where(np.array(columns) < 0, end, starts[b] + np.array(columns))
        for b, columns in enumerate(blocks.columns)
    ]
    for b in range(len(blocks.columns), len(order)):
        place.append(starts[b] + np.arange(_size(blocks, b)))
    return Kkt(
        panels=panels,
        rows=np.concatenate(rows).astype(np.int64) if rows else np.zeros(0, np.int64),
        updates=updates,
        links=links,
        place=np.concatenate(place).astype(np.int64),
        column=column,
    )
