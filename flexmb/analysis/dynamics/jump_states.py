"""States of a run from which vibrations may begin: at jumps of functions of time, after events.

The state just before a jump of a load or of the acceleration of a driver is stored, and the state
after an event of a contact, a stop, friction or a limit of a function. From there the run may be
repeated, with its own steps or with shorter ones. A resumed run has these states too.
"""

from __future__ import annotations

import numpy as np

from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.state import Plan, State
from flexmb.flexbody.arrays import Array
from flexmb.results.output_block import OutputBlock

MAX_JUMPS = 16
"""Rows of `JumpStates.table` for jumps, a uniform selection if there are more; then events."""
_MAX_EVENTS = 18  # rows for events; of more events every third one, then every ninth, ...
_AFTER_START = 1e-9  # time just after the start, over the duration of the run
# A step counts as one after a jump if it begins within this many of its own lengths from the jump:
# the first steps are very short.
_MAX_STEPS_AFTER = 10.0
_STORED_STEPS = 64  # number of step ends stored with a jump or event


class JumpStates:
    """States of a run just before jumps of functions of time and after events, and the steps there.

    Parameters
    ----------
    compiled, settings : Compiled, Settings
        The model and the settings of the run.
    times : (n,) array
        Times at which errors count (`seen_times`) [s].

    Attributes
    ----------
    table : (n, 4 + nq + 3 nv + nc + history + channels + ends) array
        Times just before and after each jump, largest step after it [s], positions and velocities;
        NaN: not reached yet, or no jump. The first row is the start. Rows of events follow those of
        jumps; they also have the next step [s], velocities some steps later, accelerations,
        multipliers and the history of elements. At the end of all rows are the angles of sensors,
        which count turns, and the ends of some steps of the scout [s]. Saved with the run.
    """

    def __init__(self, compiled: Compiled, settings: method.Settings, times: Array) -> None:
        self._times = times
        nq, nv, nc = (getattr(compiled.layout, name) for name in ("nq", "nv", "nc"))
        behind = [1, nv, nv, nc, compiled.system.history] if compiled.system.events else [0] * 5
        sizes = [3, nq, nv, *behind, len(compiled.layout.channels), _STORED_STEPS]
        self._columns = [slice(b - n, b) for n, b in zip(sizes, np.cumsum(sizes), strict=True)]
        self._of_jumps = self._columns[2].stop
        rows = MAX_JUMPS + (_MAX_EVENTS if compiled.system.events else 0)
        self.table = np.full((rows, sum(sizes)), np.nan)
        span = settings.end - settings.start
        self.table[0, :2] = settings.start, settings.start + _AFTER_START * span
        self.add_jumps(compiled, settings)

    def add_jumps(self, compiled: Compiled, settings: method.Settings) -> None:
        """Add the jumps that follow those in the table, up to the end of the run or of the room."""
        events, jumps = compiled.system.time_events, self.table[:MAX_JUMPS]
        free = np.flatnonzero(np.isnan(jumps[:, 0]))
        later = events[(events[:, 0] > np.nanmax(jumps[:, 1])) & (events[:, 1] < settings.end)]
        if len(later) > len(free):
            later = later[np.linspace(0, len(later) - 1, len(free)).astype(int)]
        self.table[free[: len(later)], :2] = later

    @property
    def before(self) -> Array:
        """Times just before the jumps (n,) [s]."""
        times = self.table[:MAX_JUMPS, 0]
        return np.asarray(times[np.isfinite(times)])

    @property
    def outputs(self) -> Array:
        """Times at which errors count, and those just before jumps (n,) [s]."""
        return np.union1d(self._times, self.before)

    def put(self, k: int, state: State) -> None:
        """Set a state to the one just before jump k, or to the one after event k."""
        row, (_, q, v, step, _, vd, lam, history, angles, _) = self.table[k], self._columns
        state.t[0], state.q[:], state.v[:], state.angles[:] = row[0], row[q], row[v], row[angles]
        if k >= MAX_JUMPS:
            for array in (state.vd, state.vd_before, state.aa):
                array[:] = row[vd]
            state.lam[:] = state.lam_before[:] = row[lam]
            state.history[:] = row[history]
            state.memory[0]["next_step"] = state.memory[0]["last_step"] = row[step][0]

    def passed(self) -> list[int]:
        """Numbers of the jumps whose state and step are known."""
        jumps = self.table[:MAX_JUMPS, : self._of_jumps]
        return [int(k) for k in np.flatnonzero(np.isfinite(jumps).all(axis=1))]

    def events(self) -> tuple[list[int], Array]:
        """Numbers of the events, and the change of velocities in the steps after them (n, nv)."""
        rows = MAX_JUMPS + np.flatnonzero(np.isfinite(self.table[MAX_JUMPS:, 0]))
        _, _, v, _, later, *_ = self._columns
        changes = np.zeros((len(rows), v.stop - v.start))
        if len(rows):
            changes = np.abs(self.table[rows, later] - self.table[rows, v])
        return rows.tolist(), changes

    def plan(self, k: int) -> Plan | None:
        """Steps of the scout from jump or event k on, as far as they are stored; or None."""
        ends = self.table[k, self._columns[-1]]
        ends = ends[np.isfinite(ends)]
        return Plan(ends, np.array([len(ends)])) if len(ends) > 1 else None

    def next_time(self, k: int) -> float:
        """Time of the next stored jump or event after k [s], or infinite."""
        later = self.table[self.table[:, 0] > self.table[k, 1], 0]
        return float(later.min(initial=np.inf))

    def add_events(self, states: Array) -> None:
        """Add states after events (rows of `Events.states`); if the table is full, keep a third."""
        events = self.table[MAX_JUMPS:]
        for state in states:
            free = np.flatnonzero(np.isnan(events[:, 0]))
            if not len(free):
                third = events[::3].copy()
                events[:] = np.nan
                events[: len(third)], free = third, np.array([len(third)])
            events[free[0], :2], events[free[0], 3 : 2 + len(state)] = state[0], state[1:]

    def add_steps(self, knots: Array, refinement: float) -> None:
        """Add the times between steps of the scout [s]; the run has `refinement` times as many."""
        jumps = self.table[:MAX_JUMPS]
        for row in jumps[np.isfinite(jumps[:, 0]) & np.isnan(jumps[:, 2])]:
            ends = knots[np.searchsorted(knots, row[0]) :] - row[0]
            if knots[0] <= row[1] and len(ends) > 1:
                steps = np.diff(ends)
                largest = (
                    steps[ends[:-1] <= _MAX_STEPS_AFTER * steps].max(initial=steps[0]) / refinement
                )
                jumps[jumps[:, 0] == row[0], 2] = largest
        for time, ends in zip(self.table[:, 1], self.table[:, self._columns[-1]], strict=True):
            n = int(np.isfinite(ends).sum())
            if n == 0 and knots[0] <= time < knots[-1]:
                new = knots[np.searchsorted(knots, time, side="right") - 1 :]
            else:
                new = knots[1:] if n > 0 and knots[0] == ends[n - 1] else knots[:0]
            ends[n : n + len(new)] = new[: _STORED_STEPS - n]

    def add_rows(self, rows: OutputBlock) -> None:
        """Store positions and velocities of the rows at jumps."""
        at = np.searchsorted(rows.t, self.before)
        for k in np.flatnonzero(at < len(rows.t)):
            if rows.t[at[k]] == self.table[k, 0]:
                both = np.concatenate([rows.q[at[k]], rows.v[at[k]]])
                self.table[k, 3 : self._of_jumps] = both
                self.table[k, self._columns[-2]] = rows.sensors[at[k]]

    def begins_before(self, time: float) -> bool:
        """Whether a time [s] is at a jump or within the largest step after it."""
        after, steps = time - self.table[:MAX_JUMPS, 0], self.table[:MAX_JUMPS, 2]
        return bool(np.any((after >= 0.0) & (after <= steps)))
