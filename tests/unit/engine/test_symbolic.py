"""Elimination order and panels of the KKT matrix, against a dense elimination of the pattern."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.engine.symbolic import Blocks, analyse


def blocks(rng, n, extra=0, drivers=0, coupled=0.7):
    """A random tree of n bodies, with joints closing loops, and drivers beside joints."""
    pairs = [(int(rng.integers(-1, k)), k) for k in range(n)]
    while len(pairs) < n + extra:
        a, b = sorted(int(x) for x in rng.integers(-1, n, 2))
        if a < b:
            pairs.append((a, b))
    rows = [int(x) for x in rng.integers(3, 7, len(pairs))]
    for k in range(drivers):
        pairs.append(pairs[k])
        rows.append(1)
    columns = [list(range(6 + int(x))) for x in rng.integers(0, 5, n)]
    couples = [p for p in pairs if p[0] >= 0 and rng.random() < coupled]
    return Blocks(columns, rows, pairs, [() for _ in pairs], couples, [() for _ in pairs])


def sizes(b):
    return [*(len(columns) for columns in b.columns), *b.group_rows]


def order(symbolic):
    return list(np.argsort(symbolic.panel_of))


def filled(b, places):
    """Block pattern below the diagonal after elimination in this order: sets per position."""
    n = len(b.columns)
    graph = [set() for _ in sizes(b)]
    edges = [(n + g, body) for g, pair in enumerate(b.group_bodies) for body in pair]
    for i, j in edges + list(b.couples):
        if i >= 0 and j >= 0:
            graph[i].add(j)
            graph[j].add(i)
    pattern = []
    for k in places:
        below = graph[k]
        pattern.append(set(below))
        for j in below:
            graph[j] |= below - {j}
            graph[j].discard(k)
    return pattern


RANDOM = [(n, extra, drivers) for n in (2, 6, 15) for extra in (0, 3) for drivers in (0, 1)]
RANDOM += [(1, 0, 0), (1, 0, 1)]


@pytest.mark.parametrize(("n", "extra", "drivers"), RANDOM)
def test_panels_hold_exactly_the_fill(n, extra, drivers):
    b = blocks(np.random.default_rng(n), n, extra, drivers)
    s = analyse(b)
    places = order(s)
    assert sorted(places) == list(range(len(sizes(b))))
    assert sorted(s.kkt.place) == list(range(sum(sizes(b))))
    start = {}
    for k, panel in zip(places, s.kkt.panels, strict=True):
        start[k] = int(panel["col"])
        assert panel["nc"] == sizes(b)[k]
    for panel, below in zip(s.kkt.panels, filled(b, places), strict=True):
        wanted = sorted(start[j] + i for j in below for i in range(sizes(b)[j]))
        rows = s.kkt.rows[panel["rows"] : panel["rows"] + panel["nr"]]
        assert sorted(rows) == wanted


@pytest.mark.parametrize(("n", "extra", "drivers"), RANDOM)
def test_no_group_is_eliminated_before_a_body_carries_it(n, extra, drivers):
    """A pivot of full rank: both bodies first, or one that carries no other early group."""
    b = blocks(np.random.default_rng(n + 50), n, extra, drivers)
    s = analyse(b)
    carried = []
    for g, pair in enumerate(b.group_bodies):
        mine = s.panel_of[len(b.columns) + g]
        bodies = [k for k in pair if k >= 0]
        before = [k for k in bodies if s.panel_of[k] < mine]
        assert before
        if len(before) < len(bodies):
            carried += before
    assert len(carried) == len(set(carried))


@pytest.mark.parametrize("coupled", [1.0, 0.0])
@pytest.mark.parametrize("seed", range(5))
def test_trees_get_hardly_any_fill(seed, coupled):
    """Minimum degree is greedy: it may join a few small groups where leaves first would not."""
    b = blocks(np.random.default_rng(seed), 12, coupled=coupled)
    size = sizes(b)
    edges = [(12 + g, k) for g, p in enumerate(b.group_bodies) for k in p if k >= 0] + b.couples
    places = order(analyse(b))
    assert sum(len(below) for below in filled(b, places)) <= 1.2 * len(set(edges))
    leaves_first = [k for body in reversed(range(12)) for k in (body, 12 + body)]

    def products(places):
        pattern = filled(b, places)
        below = [sum(size[j] for j in rows) for rows in pattern]
        return sum(size[k] * (size[k] + n) ** 2 for k, n in zip(places, below, strict=True))

    assert products(places) <= 1.15 * products(leaves_first)


def chain(n):
    return [(k - 1, k) for k in range(n)]


def star(n):
    return [(-1, 0)] + [(0, k) for k in range(1, n)]


def ring(n):
    return [*chain(n), (n - 1, -1)]


@pytest.mark.parametrize("shape", [chain, star, ring])
def test_storage_and_work_grow_linearly(shape):
    def cost(n):
        pairs = shape(n)
        couples, free = [p for p in pairs if p[0] >= 0], [()] * len(pairs)
        kkt = analyse(
            Blocks([list(range(6))] * n, [3] * len(pairs), pairs, free, couples, free)
        ).kkt
        stored = ((kkt.panels["nc"] + kkt.panels["nr"]) * kkt.panels["nc"]).sum()
        return np.array([stored, len(kkt.updates)])

    first, second = cost(100) - cost(50), cost(150) - cost(100)
    np.testing.assert_array_equal(first, second)
    assert (cost(100) < 2.5 * cost(50)).all()
