"""How many of the constraint equations are independent at the first state.

As many as velocity coordinates: the constraints alone fix the motion. Fewer than equations: some
repeat others, and reactions are not unique.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile import Compiled
from flexmb.engine.state import Work
from flexmb.engine.tables import System

__all__ = ["LARGEST", "constraint_rank", "dense_jacobian", "n_free"]

LARGEST = 600
"""Coordinates up to which a dense decomposition is affordable; larger models are taken as free,
which only costs digits of the reported reactions."""

_RANK = 1e-8  # relative to the largest singular value; round-off leaves 1e-13


def dense_jacobian(compiled: Compiled, work: Work) -> NDArray[np.float64]:
    """Cq (nc, nv) from the Jacobian rows of the last factorisation."""
    system = compiled.system
    Cq = np.zeros((compiled.layout.nc, compiled.layout.nv))
    for k, row in enumerate(system.rows):
        for side, place in (("I", "jac_I"), ("J", "jac_J")):
            if row[place] >= 0:
                body = system.parts.bodies[system.parts.markers[row[side]]["body"]]
                n = 6 + int(body["m"])
                values = work.dense.jac[row[place] : row[place] + n]
                Cq[k, body["iv"] : body["iv"] + n] = values
    for follow in system.follows:
        assert isinstance(system.parts.coordinates, np.ndarray)  # a row follows one of them
        column = system.parts.coordinates[follow["coordinate"]]["iv"]
        Cq[follow["row"], column] = -follow["factor"]
    if len(system.parts.curve_markers):
        _put_sliders(system, work, Cq)
    return Cq


def _put_sliders(system: System, work: Work, Cq: NDArray[np.float64]) -> None:
    """What the rows on curve markers change with their places along the curves."""
    links, low = system.kkt.links, work.factor.low0
    sliders, coordinates = system.parts.curve_markers, system.parts.coordinates
    assert isinstance(sliders, np.ndarray) and isinstance(coordinates, np.ndarray)
    for slider in sliders:
        group, link = system.groups[slider["group"]], links[slider["link"]]
        column = coordinates[slider["coordinate"]]["iv"]
        stride = 1 if link["flipped"] == 1 else link["stride"]
        for r in range(group["n"]):
            Cq[group["row"] + r, column] = low[link["at"] + r * stride]


def n_free(compiled: Compiled) -> int:
    """Velocity coordinates that may move: all, or those in the plane."""
    return int(np.sum(compiled.system.kkt.column >= 0))


def constraint_rank(compiled: Compiled, work: Work) -> int | None:
    """Rank of Cq at the first state; None for a model too large for a dense decomposition."""
    nc, nv = compiled.layout.nc, n_free(compiled)
    if nv > LARGEST:
        return None
    if nc == 0:
        return 0
    Cq = dense_jacobian(compiled, work)[:, compiled.system.kkt.column >= 0]
    values = np.linalg.svd(Cq, compute_uv=False)
    return int(np.sum(values > _RANK * values[0]))
