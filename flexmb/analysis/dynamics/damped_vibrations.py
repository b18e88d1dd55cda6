"""Vibrations that loads excite and that the steps of an implicit method damp: their measurement.

Radau's method and generalized-α integrate stiff components without their vibrations. So does the
scout, and the difference of the two runs does not show them. If a load or the acceleration of a
driver jumps, a vibration begins about the new equilibrium; its amplitude is the distance to it. The
reactions of this vibration are the difference between those with v̇ by M alone and with v̇ by
M + b ∂F/∂q, in which stiff components are in equilibrium; less the same difference just before the
jump. At the jump where it is largest over the range of a joint's reaction, a few steps of the run
are repeated with steps that resolve the vibration: the measured difference includes the damping of
the model.

Stops, contacts, friction and limits of functions excite vibrations too. States after their events
are stored during the run. At the end of the last pass the run is repeated from some of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.jump_states import MAX_JUMPS, JumpStates
from flexmb.analysis.dynamics.vibration_error import RATES, VibrationError, without_reactions
from flexmb.engine import method
from flexmb.engine.compiled_calls import integration_units
from flexmb.engine.compiled_units import prepare_units
from flexmb.engine.integrators.radau import radau_5
from flexmb.engine.state import State
from flexmb.flexbody.arrays import Array
from flexmb.results.output_block import OutputBlock

# Least jump of a velocity, over the largest velocity so far, for which its vibration is measured.
_MIN_VELOCITY_JUMP = 1e-3
# Number of steps of the run over which it is measured, from the half of the first one on; times of
# comparison per step; local tolerance; largest number of steps.
_STEPS_MEASURED, _TIMES_PER_STEP, _FINE_TOLERANCE, _MAX_STEPS = 3, 16, 1e-8, 2000
# Resolving a vibration for long: local tolerance (with 1e-8 the same number of steps reaches a
# third as far, with 1e-6 a servo linkage is damped), its ratio to that of the run, comparison times
# per output. It is done if the longest steps of the run damp _LATE_DAMPING times more than those
# after the jump. Otherwise the run is repeated from its start over _STEPS_FROM_START of its steps,
# with at most _FEW_STEPS, since smooth but fast loads excite vibrations without a jump; not if
# errors of reactions exceed _CLEAR_ERROR anyway.
_LONG_TOLERANCE, _TOLERANCE_RATIO, _TIMES_PER_OUTPUT, _LATE_DAMPING = 1e-7, 0.1, 4, 2.0
_STEPS_FROM_START, _FEW_STEPS, _CLEAR_ERROR = 5, 300, 0.05
# After events: total number of steps for all that are resolved, over those of the run; the first
# part of them (1/_FIRST_PART) shows how far the others will reach; rows of the others.
_SHARE_OF_STEPS, _FIRST_PART, _ROWS_AFTER = 0.2, 3, 64
# Lost vibrations are looked for in the last part of the time after an event, with enough rows.
_LATE_SHARE, _MIN_LATE_ROWS = 0.25, 8
_STEPS_PER_PERIOD = 8.0  # longest period that steps damp, over the longest step
_MIN_OUTPUTS = 4  # number of outputs from which on only outputs are compared
# Local tolerances, tried in turn: the next one if the last shows less than _SHOWN_SHARE of the
# vibration, and more than _MIN_INCREASE times the one before. With these numbers sixteen scenes
# have reported errors of 0.57 to 1.5 times the true ones; with half and twice of each 0.57 to 1.9,
# except for 24 rows, with which one has 0.19.
_TOLERANCES, _SHOWN_SHARE, _MIN_INCREASE = (1e-7, 1e-9, 1e-11), 0.3, 1.5


class _StateEvaluator:
    """Reactions at single states of a run, with or without filtering of stiff components.

    Parameters
    ----------
    run : Integration
        The run, with its model, method and settings.
    first : State
        First state, of which the memory of contacts and bristles is used at jumps.
    jumps : JumpStates
        The states.
    """

    def __init__(self, run: Integration, first: State, jumps: JumpStates) -> None:
        self._state, self._jumps = State(*(array.copy() for array in first)), jumps
        self._time = np.zeros(1)
        self._run = Integration(run.compiled, run.method, run.settings, self._state, self._time)

    def row(self, k: int, t: float, step: float) -> OutputBlock:
        """The row of state k at time t [s], or no row; `step` filters, 0: without filtering."""
        self._jumps.put(k, self._state)
        self._state.t[0] = t
        self._state.memory[0]["last_step"], self._state.count[0]["outputs"] = step, 0
        self._time[0] = t
        if step > 0.0:
            self._state.aa[:] = 0.0  # else v̇ holds what is filtered out, by those of the method
        self._run.integrate(0)
        return self._run.rows.read()


def measure_damped_vibrations(
    run: Integration, settings: method.Settings, first: State, jumps: JumpStates,
    error: VibrationError, least: float,
) -> None:  # fmt: skip
    """Add the vibrations that the steps of a run damp to its measured error.

    Parameters
    ----------
    run : Integration
        The run, at its end.
    settings : Settings
        Its settings without a scout.
    first : State
        Its first state.
    jumps : JumpStates
        Its states at jumps.
    error : VibrationError
        Its error so far.
    least : float
        Least vibration of a reaction that is measured, over the range of the reaction.
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
        kicks.append(float((np.abs(row.v[0] - v) * weights / run.state.v_scale).max()))
    worst = {int(np.argmax(shares))} if max(shares, default=0.0) > least else set()
    if max(kicks, default=0.0) > _MIN_VELOCITY_JUMP:
        worst.add(int(np.argmax(kicks)))
    for k, row in (rows[n] for n in sorted(worst)):
        begin, step = jumps.table[k, [0, 2]].tolist()
        coarse, fine = _runs_after_jump(
            run, settings, first, jumps, k, begin + _STEPS_MEASURED * step
        )
        error.add(coarse, fine, begin)
        if not np.any(fine.t > begin + 0.5 * step):  # too fast to be resolved for half a step
            error.add(without_reactions(row), row, begin)


def follow_vibrations(
    run: Integration, settings: method.Settings, first: State, jumps: JumpStates,
    error: VibrationError, least: float,
) -> None:  # fmt: skip
    """Add vibrations to the measured error that short first steps resolve and later steps damp.

    Also those that a smooth load excites from the start. Parameters as of
    `measure_damped_vibrations`, after which it is called.
    """
    passed = jumps.passed()
    if not passed or settings.static_after_step == 1:
        return
    point, longest = _StateEvaluator(run, first, jumps), float(run.state.memory[0]["largest_step"])
    shares = np.zeros((2, len(passed)))  # vibrations that the first and the longest steps damp
    for n, k in enumerate(passed):
        step = float(jumps.table[k, 2])
        for i, h in enumerate((step, max(step, longest))):
            row, _ = _first_vibration(point, jumps, k, h)
            shares[i, n] = error.reaction_share(row) if row is not None else 0.0
    error.is_damped = bool(shares[1].max() > least)
    k, most = passed[0], _FEW_STEPS
    end = float(jumps.table[k, 0] + _STEPS_FROM_START * jumps.table[k, 2])
    if shares[1].max() > max(least, _LATE_DAMPING * shares[0].max()):
        k, end = passed[int(shares[1].argmax())], settings.end
        most = min(max(int(run.state.count[0]["steps"]), _FEW_STEPS), _MAX_STEPS)
    elif max(least, error.of_reactions()[1]) > _CLEAR_ERROR:
        return
    coarse, fine = _runs_after_jump(run, settings, first, jumps, k, end, most)
    error.add(coarse, fine, float(jumps.table[k, 0]), RATES)
    k, share = passed[int(shares.max(axis=0).argmax())], float(shares.max())
    follow = _VibrationRuns(run, settings, first, jumps, error)
    if share <= least:  # a smooth load at the start
        follow.add(passed[0], 0.0, _FEW_STEPS // 2, _TOLERANCES[-1:])
    elif error.of_reactions()[1] < _SHOWN_SHARE * share:
        follow.add(k, share, _FEW_STEPS, _TOLERANCES[1:])


def _first_vibration(
    point: _StateEvaluator, jumps: JumpStates, k: int, step: float
) -> tuple[OutputBlock | None, Array]:
    """A row (1, ...) with reactions and accelerations of the vibrations that begin at a jump.

    Its velocities are those after the jump; also returns those before it (nv,). The row is None if
    the accelerations are not defined, as of modes without mass.
    """
    before, after = map(float, jumps.table[k, :2])
    rows = [point.row(k, after, 0.0), point.row(k, after, step)]
    if 0 < k < MAX_JUMPS:  # subtract the difference just before the jump
        rows += [point.row(k, before, 0.0), point.row(k, before, step)]
    finite = (np.isfinite(row.reactions).all() and np.isfinite(row.vd).all() for row in rows)
    if not all(len(row.t) for row in rows) or not all(finite):
        return None, np.zeros(0)
    signs = (1.0, -1.0, -1.0, 1.0)
    parts = {
        name: sum(sign * getattr(row, name) for sign, row in zip(signs, rows, strict=False))
        for name in ("reactions", "vd")
    }
    return replace(rows[0], **parts), rows[-2].v[0]


def state_at_jump(run: Integration, first: State, jumps: JumpStates, k: int) -> State:
    """The state at jump or event k, with the error scales and the longest step of the run."""
    state = State(*(array.copy() for array in first))
    jumps.put(k, state)
    state.q_scale[:], state.v_scale[:] = run.state.q_scale, run.state.v_scale
    state.memory["largest_step"] = run.state.memory["largest_step"]
    return state


def _runs_after_jump(
    run: Integration, settings: method.Settings, first: State, jumps: JumpStates, k: int,
    end: float, most: int = 0,
) -> tuple[OutputBlock, OutputBlock]:  # fmt: skip
    """Rows after jump k with steps as those of the run, and with steps that resolve vibrations.

    They end at `end` [s] or at the next jump. With `most`, they end after so many resolving steps,
    and begin at the first output.
    """
    begin, step = float(jumps.table[k, 0]), float(jumps.table[k, 2])
    end = min(end, jumps.before[jumps.before > begin].min(initial=settings.end))
    seen = jumps.outputs[jumps.outputs > begin]
    outputs = seen[seen <= end]
    between = np.linspace(begin, end, _STEPS_MEASURED * _TIMES_PER_STEP + 1)[_TIMES_PER_STEP // 2 :]
    if most:
        following = float(seen.min(initial=settings.end))  # the next output
        end = max(end, following)
        between = np.linspace(
            following, end, max(_STEPS_MEASURED * _TIMES_PER_STEP, _TIMES_PER_OUTPUT * len(outputs))
        )
    times = np.union1d(outputs, between)
    radau = radau_5()
    prepare_units(integration_units(run.compiled.system, radau))
    blocks, tolerance = [], settings.tolerance
    finer = (
        min(_TOLERANCE_RATIO * tolerance, _LONG_TOLERANCE)
        if most
        else min(tolerance, _FINE_TOLERANCE)
    )
    for local, integrator in ((finer, radau), (tolerance, run.method)):
        state = state_at_jump(run, first, jumps, k)
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
    """Add vibrations that events of forces excite to the measured error.

    Parameters as of `measure_damped_vibrations`, after which it is called.
    """
    events, changes = jumps.events()
    if not events or settings.static_after_step == 1:
        return
    point, longest = _StateEvaluator(run, first, jumps), float(run.state.memory[0]["largest_step"])
    shares = {}
    for k in events:
        row, _ = _first_vibration(point, jumps, k, longest)
        shares[k] = error.reaction_share(row) if row is not None else 0.0
    kicks = (changes * run.compiled.system.weights / run.state.v_scale).max(axis=1, initial=0.0)
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
        late = late.rows(late.t > max(rows.t.max(initial=begin), end - _LATE_SHARE * (end - begin)))
        if k == last and len(late.t) >= _MIN_LATE_ROWS:
            seen = float(np.ptp(late.t))
            error.add_lost(late, rows, begin, RATES, min(_STEPS_PER_PERIOD * longest, 0.25 * seen))


class _VibrationRuns:
    """Runs that resolve vibrations from a jump or an event to the next output.

    Parameters as of `measure_damped_vibrations`.
    """

    def __init__(
        self, run: Integration, settings: method.Settings, first: State, jumps: JumpStates,
        error: VibrationError,
    ) -> None:  # fmt: skip
        self._run, self._settings, self._first = run, settings, first
        self._jumps, self._error = jumps, error

    def add(self, k: int, share: float, most: int, tolerances: Sequence[float]) -> OutputBlock:
        """Add the vibration that begins at a jump or event to the error.

        Returns rows of it at equal intervals, with the last tolerance tried.

        Parameters
        ----------
        k : int
            Number of the jump or event.
        share : float
            Expected vibration of a reaction over its range; 0: not known.
        most : int
            Largest number of steps.
        tolerances : sequence of float
            Local tolerances, tried in turn until the vibration is resolved.
        """
        begin, largest = float(self._jumps.table[k, 0]), 0.0
        for tolerance in tolerances:
            finer = min(_TOLERANCE_RATIO * self._settings.tolerance, tolerance)
            coarse, fine, output = self._runs(k, finer, most)
            rows = fine.rows(~np.isin(fine.t, self._jumps.outputs))
            share = max(share, self._error.reaction_difference(coarse, fine))
            swing = self._error.reaction_swing(fine)
            at = fine.t >= output
            outputs = at & np.isin(fine.t, self._jumps.outputs)
            if np.any(at):
                at = outputs if outputs.sum() >= _MIN_OUTPUTS else at
                coarse, fine = coarse.rows(at), fine.rows(at)
            elif self._jumps.next_time(k) < output:
                break  # the next jump or event begins a vibration of its own
            before = largest
            largest = self._error.add(coarse, fine, begin, RATES, output)
            shown = max(largest, swing) if np.any(at) else largest
            if shown >= _SHOWN_SHARE * share or 0.0 < largest <= _MIN_INCREASE * before:
                break
        return rows

    def _runs(self, k: int, tolerance: float, most: int) -> tuple[OutputBlock, OutputBlock, float]:
        """Rows with steps as those of the run, and with steps that resolve vibrations.

        Rows are at outputs and, after the first steps, at equal intervals. Also returns the time of
        the first output [s].
        """
        run, jumps, radau = self._run, self._jumps, radau_5()
        begin, after, step = jumps.table[k, :3].tolist()
        end = jumps.before[jumps.before > begin].min(initial=self._settings.end)
        times = jumps.outputs[(jumps.outputs > after) & (jumps.outputs <= end)]
        output = float(times.min(initial=end))
        prepare_units(integration_units(run.compiled.system, radau))
        fine, coarse = (state_at_jump(run, self._first, jumps, k) for _ in range(2))
        if 0 < k < MAX_JUMPS:
            coarse.memory[0]["next_step"] = coarse.memory[0]["last_step"] = step
        own = self._settings._replace(tolerance=tolerance, start=begin, end=end)
        again = Integration(run.compiled, radau, own, fine, times)
        again.integrate(most // _FIRST_PART)
        blocks, reach = [again.rows.read()], float(fine.t[0])
        till = min(begin + (_FIRST_PART + 1) * (reach - begin), end)
        between = np.linspace(reach, till, _ROWS_AFTER + 1)[1:] if till > reach else times[:0]
        times = np.union1d(times[times > reach], between)
        if len(times):
            fine.count["outputs"] = 0
            again = Integration(run.compiled, radau, own._replace(start=reach), fine, times)
            again.integrate(most - most // _FIRST_PART)
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
