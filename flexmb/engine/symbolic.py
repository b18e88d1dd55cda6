"""Elimination order and panels of the KKT matrix, found once per system.

Blocks are bodies (6 + m columns, modes first) and constraint groups. Minimum degree on the block
graph, with one rule that keeps all pivots away from zero: a group is eliminated after both its
bodies, or after its child body if it is the joint by which that body hangs in the spanning tree
(its pivot is then −C_q M̂⁻¹ C_qᵀ of a free body, of full rank). Trees get hardly any fill.
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
    """The KKT matrix by blocks: first the bodies, then the groups."""

    body_columns: list[int]  # 6 + m of each body
    group_rows: list[int]
    group_bodies: list[tuple[int, int]]  # bodies of I and J, -1 = ground
    couples: list[tuple[int, int]]  # pairs of bodies whose tangents couple


@dataclass(frozen=True)
class Symbolic:
    """The factorisation's tables and where each block went."""

    kkt: Kkt
    panel_of: list[int]  # panel of each block
    group_links: list[tuple[int, int]]  # LINK of each group with its bodies, -1 = ground
    couple_links: dict[tuple[int, int], int]


def analyse(blocks: Blocks) -> Symbolic:
    """Order the blocks, lay out the panels and the updates between them."""
    order, below = _eliminate(blocks)
    panels, starts = _panels(blocks, order, below)
    updates = _updates(blocks, order, below, panels, starts)
    links, group_links, couple_links = _links(blocks, order, below, panels)
    kkt = _kkt(blocks, order, panels, below, starts, updates, links)
    panel_of = [0] * len(order)
    for k, block in enumerate(order):
        panel_of[block] = k
    return Symbolic(kkt, panel_of, group_links, couple_links)


def _size(blocks: Blocks, b: int) -> int:
    n = len(blocks.body_columns)
    return blocks.body_columns[b] if b < n else blocks.group_rows[b - n]


def _graph(blocks: Blocks) -> list[set[int]]:
    n = len(blocks.body_columns)
    graph: list[set[int]] = [set() for _ in range(n + len(blocks.group_rows))]
    pairs = [(n + g, b) for g, pair in enumerate(blocks.group_bodies) for b in pair if b >= 0]
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
    for root in [-1, *range(len(blocks.body_columns))]:
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


def _eliminate(blocks: Blocks) -> tuple[list[int], list[list[int]]]:
    """Elimination order and, for each position, the later blocks its panel has rows of."""
    n = len(blocks.body_columns)
    graph = _graph(blocks)
    child = _tree_child(blocks)
    waits = [set() for _ in range(n)] + [
        {child[g]} if g in child else {b for b in pair if b >= 0}
        for g, pair in enumerate(blocks.group_bodies)
    ]

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
            waits[c].discard(b)
        graph[b] = set()
        for c in neighbours:
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
        sign = 1.0 if block < len(blocks.body_columns) else -1.0
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
    n = len(blocks.body_columns)
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
    couple_links: dict[tuple[int, int], int] = {}
    for a, b in blocks.couples:
        if a >= 0 and b >= 0 and (a, b) not in couple_links:
            couple_links[(a, b)] = len(links)
            links.append(_link(blocks, place, below, panels, a, b))
    return np.array(links, LINK) if links else np.zeros(0, LINK), group_links, couple_links


def _kkt(blocks, order, panels, below, starts, updates, links) -> Kkt:
    n = len(blocks.body_columns)
    rows = [np.arange(starts[b], starts[b] + _size(blocks, b)) for under in below for b in under]
    place = []
    for b in range(len(order)):
        local = np.arange(_size(blocks, b))
        if b < n:  # rigid part behind the modes
            m = len(local) - 6
            local = np.where(local < 6, local + m, local - 6)
        place.append(starts[b] + local)
    return Kkt(
        panels=panels,
        rows=np.concatenate(rows).astype(np.int64) if rows else np.zeros(0, np.int64),
        updates=updates,
        links=links,
        place=np.concatenate(place).astype(np.int64),
    )
