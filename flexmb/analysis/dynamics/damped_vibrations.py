"""Vibrations that loads excite and the steps of an implicit method damp, measured where they begin.

Radau's method and generalized-α follow stiff parts of a model without their vibrations. So does the
comparison run: the difference of the two tells nothing of them. Where a load or the acceleration of
a driver jumps, a vibration begins about the new equilibrium, with the distance to it for amplitude:
by as much reactions differ between v̇ of M alone and v̇ of M + b ∂F/∂q, which leaves stiff parts in
equilibrium. That costs two solutions at each jump, less those just before it. At the jump where it
is the largest part of a joint's range the run is repeated over a few of its steps, by steps that
follow the vibration: the difference is measured, damping of the model included.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.measured_error import MeasuredError
from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import integration_units
from flexmb.engine.integrators.radau import radau_5
from flexmb.engine.state import State
from flexmb.engine.units import prepare_units
from flexmb.flexbody.arrays import Array
from flexmb.results.output_block import OutputBlock

_MAX_JUMPS = 16  # times that are looked at, evenly among more
_AFTER_START = 1e-9  # of a run: when functions have left their value at its start
_MANY = 10.0  # lengths of a step after a jump, within which it counts: first ones are short
# Change of a speed over the largest one, from which on the vibration is measured that it excites.
_KICK = 1e-3
# Steps of the run over which it is measured, at outputs and after the first half of one; times of
# comparison in one step; local tolerance, and steps at most.
_WINDOW, _TIMES, _FINE, _MAX_STEPS = 3, 16, 1e-8, 2000
# Local tolerance, also over that of the run, and times of comparison for each output, where a
# vibration is followed for long: with 1e-8 as many steps reach a third as far, with 1e-6 those of
# a linkage with a servo damp it. It is if later, longer steps damp so many times more than the
# first ones. Else from the start over some steps of the run, by these steps at most, as loads that
# rise smoothly and yet fast excite what no jump tells; not where errors of reactions are as large
# anyhow.
_FOLLOWING, _FINER, _BETWEEN, _LATER = 1e-7, 0.1, 4, 2.0
_FIRST, _FEW_STEPS, _CLEAR = 5, 300, 0.05


class JumpStates:
    """States of a run just before jumps of functions of time, and the steps after them.

    Parameters
    ----------
    compiled, settings : Compiled, Settings
        What is run, and how.

    Attributes
    ----------
    table : (n, 3 + nq + nv) array
        Times just before and after each jump, largest step after it [s], positions and velocities;
        NaN: not passed yet, or no jump. The first one is the start. Saved with the run.
    """

    def __init__(self, compiled: Compiled, settings: method.Settings) -> None:
        self._layout = compiled.layout
        self.table = np.full((_MAX_JUMPS, 3 + self._layout.nq + self._layout.nv), np.nan)
        span = settings.end - settings.start
        self.table[0, :2] = settings.start, settings.start + _AFTER_START * span
        self.add_jumps(compiled, settings)

    def add_jumps(self, compiled: Compiled, settings: method.Settings) -> None:
        """Take jumps until the end that come after those in the table, as far as there is room."""
        events, free = compiled.system.time_events, np.flatnonzero(np.isnan(self.table[:, 0]))
        later = events[(events[:, 0] > np.nanmax(self.table[:, 1])) & (events[:, 1] < settings.end)]
        if len(later) > len(free):
            later = later[np.linspace(0, len(later) - 1, len(free)).astype(int)]
        self.table[free[: len(later)], :2] = later

    @property
    def before(self) -> Array:
        """Times just before the jumps (n,) [s]."""
        return np.asarray(self.table[np.isfinite(self.table[:, 0]), 0])

    def state(self, k: int) -> tuple[Array, Array]:
        """Positions (nq,) and velocities (nv,) at a jump."""
        return self.table[k, 3 : 3 + self._layout.nq], self.table[k, 3 + self._layout.nq :]

    def passed(self) -> list[int]:
        """Jumps whose state and step are known."""
        return [int(k) for k in np.flatnonzero(np.isfinite(self.table).all(axis=1))]

    def add_steps(self, knots: Array, refinement: float) -> None:
        """Take the ends of steps of the comparison run [s], which has fewer by `refinement`."""
        for row in self.table[np.isfinite(self.table[:, 0]) & np.isnan(self.table[:, 2])]:
            ends = knots[np.searchsorted(knots, row[0]) :] - row[0]
            if knots[0] <= row[1] and len(ends) > 1:
                steps = np.diff(ends)
                largest = steps[ends[:-1] <= _MANY * steps].max(initial=steps[0]) / refinement
                self.table[self.table[:, 0] == row[0], 2] = largest

    def add_rows(self, rows: OutputBlock) -> None:
        """Take rows of the run; those at the jumps are of interest."""
        at = np.searchsorted(rows.t, self.before)
        for k in np.flatnonzero(at < len(rows.t)):
            if rows.t[at[k]] == self.table[k, 0]:
                self.table[k, 3:] = np.concatenate([rows.q[at[k]], rows.v[at[k]]])

    def begins_before(self, time: float) -> bool:
        """Whether a time [s] is that of a jump or within the step after it."""
        after = time - self.table[:, 0]
        return bool(np.any((after >= 0.0) & (after <= self.table[:, 2])))


class _Point:
    """Reactions at single states of a run, with stiff parts filtered by a step or not.

    Parameters
    ----------
    run : Integration
        Whose model, method and settings count.
    first : State
        For the memory of contacts and bristles.
    """

    def __init__(self, run: Integration, first: State) -> None:
        self._state = State(*(array.copy() for array in first))
        self._time = np.zeros(1)
        self._run = Integration(run.compiled, run.method, run.settings, self._state, self._time)

    def row(self, t: float, state: tuple[Array, Array], step: float) -> OutputBlock:
        """The row at positions and velocities, or none; with step 0 nothing is filtered."""
        self._state.t[0] = t
        self._state.q[:], self._state.v[:] = state
        self._state.memory[0]["last_step"], self._state.count[0]["outputs"] = step, 0
        self._time[0] = t
        self._run.integrate(0)
        return self._run.rows.read()


def measure_damped_vibrations(
    run: Integration, settings: method.Settings, first: State, jumps: JumpStates,
    error: MeasuredError, least: float,
) -> None:  # fmt: skip
    """Let a measured error know what vibrations the steps of a run damp.

    Parameters
    ----------
    run : Integration
        The run, at its end.
    settings : Settings
        Its own, were it alone.
    first : State
        Where it began.
    jumps : JumpStates
        Its states at jumps.
    error : MeasuredError
        Its error so far.
    least : float
        Share of the range of a reaction from which on a vibration is measured.
    """
    passed = jumps.passed()
    if not passed or settings.follow == 1:
        return
    point, weights = _Point(run, first), run.compiled.system.weights
    shares, kicks, rows = [], [], []
    for k in passed:
        row, v = _first_vibration(point, jumps, k, float(jumps.table[k, 2]))
        if row is None:
            continue
        rows.append((k, row))
        shares.append(error.reaction_share(row))
        kicks.append(float((np.abs(row.v[0] - v) * weights / run.state.speed).max()))
    worst = {int(np.argmax(shares))} if max(shares, default=0.0) > least else set()
    if max(kicks, default=0.0) > _KICK:
        worst.add(int(np.argmax(kicks)))
    for k, row in (rows[n] for n in sorted(worst)):
        begin, step = jumps.table[k, [0, 2]].tolist()
        coarse, fine = _runs_after_jump(run, settings, first, jumps, k, begin + _WINDOW * step)
        error.add_damped(coarse, fine, begin)
        if not np.any(fine.t > begin + 0.5 * step):  # too fast to be followed until it may end
            error.add_damped(replace(row, reactions=np.zeros_like(row.reactions)), row, begin)


def follow_vibrations(
    run: Integration, settings: method.Settings, first: State, jumps: JumpStates,
    error: MeasuredError, least: float,
) -> None:  # fmt: skip
    """Let a measured error know what reactions lack where first steps follow a vibration that later
    ones damp, or, from the start on, a smooth load excites one.

    Parameters as of `measure_damped_vibrations`, behind which it comes.
    """
    passed = jumps.passed()
    if not passed or settings.follow == 1:
        return
    point, longest = _Point(run, first), float(run.state.memory[0]["largest_step"])
    shares = np.zeros((2, len(passed)))  # of what first steps damp, and the longest ones
    for n, k in enumerate(passed):
        step = float(jumps.table[k, 2])
        for i, h in enumerate((step, max(step, longest))):
            row, _ = _first_vibration(point, jumps, k, h)
            shares[i, n] = error.reaction_share(row) if row is not None else 0.0
    k, most = passed[0], _FEW_STEPS
    end = float(jumps.table[k, 0] + _FIRST * jumps.table[k, 2])
    if shares[1].max() > max(least, _LATER * shares[0].max()):
        k, end = passed[int(shares[1].argmax())], settings.end
        most = min(max(int(run.state.count[0]["steps"]), _FEW_STEPS), _MAX_STEPS)
    elif max(least, error.damped()[1]) > _CLEAR:
        return
    coarse, fine = _runs_after_jump(run, settings, first, jumps, k, end, most)
    error.add_damped(coarse, fine, float(jumps.table[k, 0]), ("velocities", "reactions"))


def _first_vibration(
    point: _Point, jumps: JumpStates, k: int, step: float
) -> tuple[OutputBlock | None, Array]:
    """A row (1, ...) whose reactions are those with which vibrations begin at a jump.

    Its velocities are those after the jump; also returns those before it (nv,). None where a state
    has no accelerations, as of modes without mass.
    """
    (before, after), state = map(float, jumps.table[k, :2]), jumps.state(k)
    rows = [point.row(after, state, 0.0), point.row(after, state, step)]
    if k > 0:  # less what is off in the state itself
        rows += [point.row(before, state, 0.0), point.row(before, state, step)]
    if not all(len(row.t) and np.isfinite(row.reactions).all() for row in rows):
        return None, state[1]
    signs = (1.0, -1.0, -1.0, 1.0)
    parts = [sign * row.reactions for sign, row in zip(signs, rows, strict=False)]
    return replace(rows[0], reactions=np.sum(parts, axis=0)), rows[-2].v[0]


def _runs_after_jump(
    run: Integration, settings: method.Settings, first: State, jumps: JumpStates, k: int,
    end: float, most: int = 0,
) -> tuple[OutputBlock, OutputBlock]:  # fmt: skip
    """Rows after a jump by steps as those of the run, and by steps that follow vibrations.

    Until a time, or the next jump; if that takes more than `most` of these steps, until they are
    taken, and then at outputs and between them alone.
    """
    begin, step = float(jumps.table[k, 0]), float(jumps.table[k, 2])
    end = min(end, jumps.before[k + 1 :].min(initial=settings.end))
    outputs = run.times[(run.times > begin) & (run.times <= end)]
    between = np.linspace(begin, end, _WINDOW * _TIMES + 1)[_TIMES // 2 :]
    if most:
        seen = float(run.times[run.times > begin].min(initial=settings.end))  # the next output
        end = max(end, seen)
        between = np.linspace(seen, end, max(_WINDOW * _TIMES, _BETWEEN * len(outputs)))
    times = np.union1d(outputs, between)
    radau = radau_5()
    prepare_units(integration_units(run.compiled.system, radau))
    blocks, tolerance = [], settings.tolerance
    finer = min(_FINER * tolerance, _FOLLOWING) if most else min(tolerance, _FINE)
    for local, integrator in ((finer, radau), (tolerance, run.method)):
        state = State(*(array.copy() for array in first))
        state.t[0] = begin
        state.q[:], state.v[:] = jumps.state(k)
        state.motion[:], state.speed[:] = run.state.motion, run.state.speed
        if local == tolerance and k > 0:
            state.memory[0]["next_step"] = state.memory[0]["last_step"] = step
        own = settings._replace(tolerance=local, start=begin, end=end)
        again = Integration(run.compiled, integrator, own, state, times)
        again.integrate(most or _MAX_STEPS)
        blocks.append(again.rows.read())
        if most and len(blocks[0].t):
            times, end = blocks[0].t, float(blocks[0].t[-1])
    rows = min(len(block.t) for block in blocks)
    return blocks[1].part(0, rows), blocks[0].part(0, rows)
