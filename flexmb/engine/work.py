"""State and scratch memory of a run, allocated once; scratch is filled with NaN."""

from __future__ import annotations

import numpy as np

from flexmb.engine.method import AGE, CONTRACTION, COUNTS, MEMORY, SHARE, SYMMETRIC
from flexmb.engine.state import (
    BODY_NOW,
    MARKER_NOW,
    SLIDER_NOW,
    Before,
    Constraints,
    Dense,
    ElementNow,
    Events,
    Factor,
    Live,
    Now,
    State,
    Trial,
    Work,
)
from flexmb.engine.tables import NO_FRICTION, System


def sizes(system: System) -> tuple[int, int, int]:
    """nq, nv, nc."""
    m = system.parts.bodies["m"]
    n = 0 if system.parts.coordinates is None else len(system.parts.coordinates)
    return int((7 + m).sum()) + n, int((6 + m).sum()) + n, len(system.rows)


def new_state(system: System, channels: int = 0) -> State:
    """State at rest at the origin: unit orientation, everything else zero."""
    nq, nv, nc = sizes(system)
    q = np.zeros(nq)
    q[system.parts.bodies["iq"] + 3] = 1.0
    memory = np.zeros(MEMORY)
    memory[CONTRACTION], memory[AGE], memory[SHARE] = 1.0, -1.0, 1.0
    memory[SYMMETRIC] = 0.0 if _rubs(system) else 1.0
    return State(
        np.zeros(1), q, *(np.zeros(nv) for _ in range(6)), np.zeros(nc), np.zeros(nc),
        np.zeros(3), np.zeros(3), np.zeros(channels), q.copy(), memory,
        np.zeros(COUNTS, dtype=np.int64), np.zeros(_memory(system)),
    )  # fmt: skip


def _rows(table: object) -> int:
    return 0 if table is None else len(table)  # type: ignore[arg-type]


def _rubs(system: System) -> bool:
    """Whether there is dry friction, whose matrix is far from symmetric."""
    touching = system.contacts
    found = isinstance(touching, np.ndarray) and bool(np.any(touching["model"] != NO_FRICTION))
    return found or _rows(system.frictions) > 0


def _memory(system: System) -> int:
    """Length of the elements' memory; 0 if none has any."""
    n = 0
    for row in system.contacts if system.contacts is not None else ():
        n += 1 if row["model"] == NO_FRICTION else 5  # see tables.CONTACT
    n += 2 * _rows(system.frictions)
    return 1 + n if n else 0


def _nan(*shape: int) -> np.ndarray:
    return np.full(shape, np.nan)


def _nan_records(n: int, dtype: np.dtype) -> np.ndarray:
    return np.full(n * dtype.itemsize // 8, np.nan).view(dtype)


def new_work(system: System, channels: int = 0, stages: int = 0) -> Work:
    """Scratch for one run of `system` by a method with `stages` explicit stages."""
    nq, nv, nc = sizes(system)
    m = system.parts.bodies["m"]
    nfun = len(system.functions.start) - 1
    nfun += int(np.sum(system.follows["first"]))
    depth = max(int(system.functions.depth), int(system.sensors.programs.depth))
    sliders = system.parts.sliders
    now = Now(
        _nan_records(len(m), BODY_NOW),
        _nan_records(len(system.parts.markers), MARKER_NOW),
        _nan(12 * int(m.sum()) + 1),
        None if sliders is None else _nan_records(len(sliders), SLIDER_NOW),
        _nan(_memory(system)),
        _nan(1),
        _nan(_rows(system.frictions), 2),
        _new_element(system),
    )
    trial = Trial(
        t=_nan(1), q=_nan(nq), v=_nan(nv), vd=_nan(nv), aa=_nan(nv), aa_start=_nan(nv),
        lam=_nan(nc), dq=_nan(nv), res=_nan(nv), zero=np.zeros(nv), power=_nan(3),
        work_done=_nan(3), angles=_nan(channels),
        before=Before(_nan(1), _nan(nq), _nan(nv), _nan(3), _nan(3), _nan(_memory(system))),
        stages=_nan(stages, nq + nv), error=_nan(2), jerk=_nan(nv), stack=_nan(depth, 3),
        variables=_nan(max(1, len(system.sensors.channels)), 3),
    )  # fmt: skip
    con = Constraints(_nan(nc), _nan(nc), _nan(1), _nan(nc), _nan(max(1, nfun), 3))
    live = None if system.signals is None else _new_live(system)
    n = 3 * _rows(system.contacts) + _rows(system.frictions) + _rows(system.stops)
    events = Events(_nan(n), _nan(n))
    return Work(now, con, _new_dense(system), _new_factor(system), trial, live, events)


def _new_live(system: System) -> Live:
    n = 6 + int(system.parts.bodies["m"].max(initial=0))
    partials = len(system.signals.partials)
    channels = len(system.sensors.channels)
    return Live(_nan(1), _nan(channels), _nan(partials), _nan(4, 12), _nan(n), _nan(n))


def _new_element(system: System) -> ElementNow | None:
    if system.elements is None:
        return None
    n = 6 + int(system.parts.bodies["m"].max(initial=0))
    scalars = 0 if system.parts.coordinates is None else len(system.parts.coordinates)
    return ElementNow(
        _nan(6), _nan(6), _nan(3, 3), _nan(6), _nan(6), _nan(6, 6), _nan(6, 6), _nan(6, 12),
        _nan(6, 12), _nan(6, 12), _nan(12, 12), _nan(6, n), _nan(scalars),
        _nan(int(system.elements.programs.depth), 3),
    )  # fmt: skip


def _new_dense(system: System) -> Dense:
    n = 6 + int(system.parts.bodies["m"].max(initial=0))
    jac = max(_jac_end(system, "I", "jac_I"), _jac_end(system, "J", "jac_J"), 1)
    return Dense(
        _nan(n, n), _nan(2, 6, n), _nan(6, n), _nan(12, 12), _nan(2, 12), _nan(jac), _nan(3, 3)
    )


def _new_factor(system: System) -> Factor:
    panels = system.kkt.panels
    length = int(panels["at"][-1] + (panels["nc"][-1] + panels["nr"][-1]) * panels["nc"][-1])
    largest = int(((panels["nc"] + panels["nr"]) * panels["nc"]).max())
    n = int(panels["nc"].sum()) + 1
    factor = Factor(
        *(_nan(length) for _ in range(4)), _nan(largest), _nan(largest), _nan(n), np.zeros(n),
        _nan(n), np.ones(1, dtype=np.int64), np.zeros(1, dtype=np.int64), _nan(n), _nan(n), _nan(n),
    )  # fmt: skip
    factor.d[-1], factor.diagonal[-1] = 1.0, np.inf
    return factor


def _jac_end(system: System, side: str, field: str) -> int:
    """One past the last entry of the Jacobian rows on one side."""
    rows = system.rows
    used = rows[field] >= 0
    if not used.any():
        return 0
    body = system.parts.markers["body"][rows[side][used]]
    return int((rows[field][used] + 6 + system.parts.bodies["m"][body]).max())
