"""Vibrations that loads excite and the steps of an implicit method damp, measured where they begin.

Radau's method and generalized-α follow stiff parts of a model without their vibrations. So does the
comparison run: the difference of the two tells nothing of them. Where a load or the acceleration of
a driver jumps, a vibration begins about the new equilibrium, with the distance to it for amplitude:
by as much reactions differ between v̇ of M alone and v̇ of M + b ∂F/∂q, which leaves stiff parts in
equilibrium. That costs two solutions at each jump, less those just before it. At the jump where it
is the largest part of a joint's range the run is repeated over a few of its steps, by steps that
follow the vibration: the difference is measured, damping of the model included.

So do stops, contacts, friction and limits of functions excite vibrations. States behind their
events are noted on the way, and at the end of the last pass the run is repeated from some of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.jump_states import MAX_JUMPS, JumpStates
from flexmb.analysis.dynamics.vibration_error import VibrationError, without_reactions
from flexmb.engine import method
from flexmb.engine.compiled_calls import integration_units
from flexmb.engine.compiled_units import prepare_units
from flexmb.engine.integrators.radau import radau_5
from flexmb.engine.state import State
from flexmb.flexbody.arrays import Array
from flexmb.results.output_block import OutputBlock

# Change of a speed over the largest one, from which on the vibration is measured that it excites.
_KICK = 1e-3
# Steps of the run over which it is measured, at outputs and after the first half of one; times of
# comparison in one step; local tolerance, and steps at most.
_WINDOW, _TIMES, _FINE, _MAX_STEPS = 3, 16, 1e-8, 2000
# Following a vibration for long: local tolerance (1e-8 reaches a third as far in as many steps,
# 1e-6 damps a servo linkage), the same over that of the run, comparison times per output. Done if
# the longest steps of the run damp _LATER times more than those after the jump. Otherwise from the
# start over _FIRST steps of the run, with at most _FEW_STEPS, since smooth but fast loads excite
# vibrations without a jump; not if errors of reactions exceed _CLEAR anyhow.
_FOLLOWING, _FINER, _BETWEEN, _LATER = 1e-7, 0.1, 4, 2.0
_FIRST, _FEW_STEPS, _CLEAR = 5, 300, 0.05
# Behind events: steps for all that are followed, over those of the run; the first part of these,
# which shows how far the rest will come; rows of the rest. Local tolerances, each if the one before
# leaves less than a share of the vibration, and does so of more than the one before that. Sixteen
# scenes are told 0.57 to 1.5 times what they lack; half and twice of each of these, or nearly, give
# 0.57 to 1.9, but for 24 rows, with which one is told 0.19.
_SHARE_OF_STEPS, _SHOWS, _ROWS = 0.2, 3, 64
_RATES = "velocities", "reactions"
_LATE, _MANY_ROWS = 0.25, 8  # of the time until the end, in which rows tell what was lost
_RESOLVED = 8.0  # longest steps in the period of a vibration that they damp at most
_ENOUGH = 4  # outputs, with which nothing between them is compared
_TOLERANCES, _SHOWN, _MORE = (1e-7, 1e-9, 1e-11), 0.3, 1.5


class _StateEvaluator:
    """Reactions at single states of a run, with stiff parts filtered by a step or not.

    Parameters
    ----------
    run : Integration
        Whose model, method and settings count.
    first : State
        For the memory of contacts and bristles at jumps.
    jumps : JumpStates
        The states.
    """

    def __init__(self, run: Integration, first: State, jumps: JumpStates) -> None:
        self._state, self._jumps = State(*(array.copy() for array in first)), jumps
        self._time = np.zeros(1)
        self._run = Integration(run.compiled, run.method, run.settings, self._state, self._time)

    def row(self, k: int, t: float, step: float) -> OutputBlock:
        """The row of a state as if at a time [s], or none; with step 0 nothing is filtered."""
        self._jumps.put(k, self._state)
        self._state.t[0] = t
        self._state.memory[0]["last_step"], self._state.count[0]["outputs"] = step, 0
        self._time[0] = t
        self._run.integrate(0)
        return self._run.rows.read()


def measure_damped_vibrations(
    run: Integration, settings: method.Settings, first: State, jumps: JumpStates,
    error: VibrationError, least: float,
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
    error : VibrationError
        Its error so far.
    least : float
        Share of the range of a reaction from which on a vibration is measured.
    """
    passed = jumps.passed()
    if not passed or settings.static_after_step == 1:
        return
    point, weights = _StateEvaluator(run, first, jumps), run.compiled.system.weights
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
        error.add(coarse, fine, begin)
        if not np.any(fine.t > begin + 0.5 * step):  # too fast to be followed until it may end
            error.add(without_reactions(row), row, begin)


def follow_vibrations(
    run: Integration, settings: method.Settings, first: State, jumps: JumpStates,
    error: VibrationError, least: float,
) -> None:  # fmt: skip
    """Let a measured error know what reactions lack where first steps follow a vibration that later
    ones damp, or, from the start on, a smooth load excites one.

    Parameters as of `measure_damped_vibrations`, behind which it comes.
    """
    passed = jumps.passed()
    if not passed or settings.static_after_step == 1:
        return
    point, longest = _StateEvaluator(run, first, jumps), float(run.state.memory[0]["largest_step"])
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
    elif max(least, error.of_reactions()[1]) > _CLEAR:
        return
    coarse, fine = _runs_after_jump(run, settings, first, jumps, k, end, most)
    error.add(coarse, fine, float(jumps.table[k, 0]), _RATES)
    k, share = passed[int(shares.max(axis=0).argmax())], float(shares.max())
    follow = _VibrationRuns(run, settings, first, jumps, error)
    if share <= least:  # of a smooth load at the start
        follow.add(passed[0], 0.0, _FEW_STEPS // 2, _TOLERANCES[-1:])
    elif error.of_reactions()[1] < _SHOWN * share:
        follow.add(k, share, _FEW_STEPS, _TOLERANCES[1:])


def _first_vibration(
    point: _StateEvaluator, jumps: JumpStates, k: int, step: float
) -> tuple[OutputBlock | None, Array]:
    """A row (1, ...) whose reactions are those with which vibrations begin at a jump.

    Its velocities are those after the jump; also returns those before it (nv,). None where a state
    has no accelerations, as of modes without mass.
    """
    before, after = map(float, jumps.table[k, :2])
    rows = [point.row(k, after, 0.0), point.row(k, after, step)]
    if 0 < k < MAX_JUMPS:  # less what is off in the state itself
        rows += [point.row(k, before, 0.0), point.row(k, before, step)]
    if not all(len(row.t) and np.isfinite(row.reactions).all() for row in rows):
        return None, np.zeros(0)
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
    end = min(end, jumps.before[jumps.before > begin].min(initial=settings.end))
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
        jumps.put(k, state)
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


def follow_events(
    run: Integration, settings: method.Settings, first: State, jumps: JumpStates,
    error: VibrationError, least: float,
) -> None:  # fmt: skip
    """Let a measured error know what reactions lack of vibrations that events of forces excite.

    Parameters as of `measure_damped_vibrations`, behind which it comes.
    """
    events, changes = jumps.events()
    if not events or settings.static_after_step == 1:
        return
    point, longest = _StateEvaluator(run, first, jumps), float(run.state.memory[0]["largest_step"])
    shares = {}
    for k in events:
        row, _ = _first_vibration(point, jumps, k, longest)
        shares[k] = error.reaction_share(row) if row is not None else 0.0
    kicks = (changes * run.compiled.system.weights / run.state.speed).max(axis=1, initial=0.0)
    last = max(events, key=lambda k: float(jumps.table[k, 0]))
    worst = {events[int(kicks.argmax())], max(shares, key=shares.__getitem__)}
    if shares[last] > least:
        worst.add(last)
    steps = int(_SHARE_OF_STEPS * run.state.count[0]["steps"])
    most = min(max(steps, _FEW_STEPS), _MAX_STEPS) // len(worst)
    follow = _VibrationRuns(run, settings, first, jumps, error)
    for k in sorted(worst):
        rows = follow.add(k, shares[k] if shares[k] > least else 0.0, most, _TOLERANCES)
        late = run.rows.read()
        begin, end = float(jumps.table[k, 0]), settings.end
        late = late.rows(late.t > max(rows.t.max(initial=begin), end - _LATE * (end - begin)))
        if k == last and len(late.t) >= _MANY_ROWS:
            seen = float(np.ptp(late.t))
            error.add_lost(late, rows, begin, _RATES, min(_RESOLVED * longest, 0.25 * seen))


class _VibrationRuns:
    """Vibrations that are followed from a jump or an event to the next output.

    Parameters as of `measure_damped_vibrations`.
    """

    def __init__(
        self, run: Integration, settings: method.Settings, first: State, jumps: JumpStates,
        error: VibrationError,
    ) -> None:  # fmt: skip
        self._run, self._settings, self._first = run, settings, first
        self._jumps, self._error = jumps, error

    def add(self, k: int, share: float, most: int, tolerances: Sequence[float]) -> OutputBlock:
        """Let the error know of the vibration that begins at a jump or event.

        Returns even rows of it, by the last tolerance that was tried.

        Parameters
        ----------
        k : int
            Number of the jump or event.
        share : float
            Of the range of a reaction that the vibration has; 0: it is not known.
        most : int
            Steps at most.
        tolerances : sequence of float
            Local ones, each if the one before shows too little of it.
        """
        begin, largest = float(self._jumps.table[k, 0]), 0.0
        for tolerance in tolerances:
            finer = min(_FINER * self._settings.tolerance, tolerance)
            coarse, fine, output = self._runs(k, finer, most)
            rows = fine.rows(~np.isin(fine.t, self._run.times))
            share = max(share, self._error.reaction_difference(coarse, fine))
            swing = self._error.reaction_swing(fine)
            at = fine.t >= output
            outputs = at & np.isin(fine.t, self._run.times)
            if np.any(at):
                at = outputs if outputs.sum() >= _ENOUGH else at
                coarse, fine = coarse.rows(at), fine.rows(at)
            elif self._jumps.next_time(k) < output:
                break  # what comes there has its own vibration
            before = largest
            largest = self._error.add(coarse, fine, begin, _RATES, output)
            shown = max(largest, swing) if np.any(at) else largest
            if shown >= _SHOWN * share or 0.0 < largest <= _MORE * before:
                break
        return rows

    def _runs(self, k: int, tolerance: float, most: int) -> tuple[OutputBlock, OutputBlock, float]:
        """Rows by steps as those of the run, and by steps that follow vibrations.

        At outputs and, behind the first steps, evenly between them; and the time of the first
        output.
        """
        run, jumps, radau = self._run, self._jumps, radau_5()
        begin, after, step = jumps.table[k, :3].tolist()
        end = jumps.before[jumps.before > begin].min(initial=self._settings.end)
        times = run.times[(run.times > after) & (run.times <= end)]
        output = float(times.min(initial=end))
        prepare_units(integration_units(run.compiled.system, radau))
        fine, coarse = (State(*(array.copy() for array in self._first)) for _ in range(2))
        for state in (fine, coarse):
            jumps.put(k, state)
            state.motion[:], state.speed[:] = run.state.motion, run.state.speed
        if 0 < k < MAX_JUMPS:
            coarse.memory[0]["next_step"] = coarse.memory[0]["last_step"] = step
        own = self._settings._replace(tolerance=tolerance, start=begin, end=end)
        again = Integration(run.compiled, radau, own, fine, times)
        again.integrate(most // _SHOWS)
        blocks, reach = [again.rows.read()], float(fine.t[0])
        till = min(begin + (_SHOWS + 1) * (reach - begin), end)
        between = np.linspace(reach, till, _ROWS + 1)[1:] if till > reach else times[:0]
        times = np.union1d(times[times > reach], between)
        if len(times):
            fine.count["outputs"] = 0
            again = Integration(run.compiled, radau, own._replace(start=reach), fine, times)
            again.integrate(most - most // _SHOWS)
            blocks.append(again.rows.read())
        block = OutputBlock.joined(blocks)
        plan = jumps.plan(k)
        own = self._settings if plan is None else run.settings
        own = own._replace(start=begin, end=float(block.t.max(initial=reach)))
        again = Integration(run.compiled, run.method, own, coarse, block.t, plan)
        again.integrate(most)
        other = again.rows.read()
        rows = min(len(block.t), len(other.t))
        return other.part(0, rows), block.part(0, rows), output
