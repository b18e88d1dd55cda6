"""Lasting motion that events make of vibrations which the steps of an implicit method damp.

An event turns the velocity that a vibration has at that time into lasting motion: a clutch that
lets go leaves both sides the speeds of that instant. The run has lost the vibration, and so has its
scout. So it is followed from one event or jump to the next, the earliest first. Where it may count
most, the rest of the run is repeated with it and without it, by the same steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from flexmb.analysis.dynamics.damped_vibrations import state_at_jump
from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.jump_states import JumpStates
from flexmb.analysis.dynamics.verified_run import ANY_ERROR
from flexmb.analysis.dynamics.vibration_error import VibrationError
from flexmb.engine import method
from flexmb.engine.compiled_calls import integration_units
from flexmb.engine.compiled_units import prepare_units
from flexmb.engine.integrators.radau import radau_5
from flexmb.engine.state import State
from flexmb.errors import FlexmbError
from flexmb.results.output_block import OutputBlock

# Least displacement by a lost velocity until the end of the run, over the requested accuracy, for
# which the rest is repeated; it also exceeds the measured error.
_LEAST_MOTION = 0.1
# Least accuracy for which it is measured: of a mass shaken against dry friction, what its bristle
# does at events makes 1e-8 of the motion, whatever the steps.
_LEAST_ACCURACY = 5e-7
# Local tolerance up to an event, over that of the run, and over the accuracy: a vibration whose
# velocity v counts moves by v/ω, ω being its frequency. Largest numbers of steps, over those of
# the run, and in all. After so many intervals in a row that lose no more (two kinds alternate, as
# of a clutch that grips and lets go) others are followed up to a share of its steps.
_TOLERANCE_RATIO, _AMPLITUDE_SHARE, _STEPS_RATIO, _MAX_STEPS = 0.1, 1e-4, 5, 10000
_MAX_IDLE, _IDLE_SHARE = 4, 0.2
# Step that crosses the event, and least lost displacement by the lost velocity (less is no
# vibration, but the place of the event), over the longest step of the run.
_CROSSING_SHARE, _LEAST_PERIOD = 1e-3, 1e-4


def measure_lasting_motion(
    run: Integration, settings: method.Settings, first: State, jumps: JumpStates,
    error: VibrationError, least: float,
) -> None:  # fmt: skip
    """Add the motion that events make of vibrations which the steps damp to the measured error.

    Parameters as of `measure_damped_vibrations`, but `least` is the measured error of positions.
    """
    order = sorted([*jumps.passed(), *jumps.events()[0]], key=lambda k: float(jumps.table[k, 0]))
    if settings.static_after_step == 1 or settings.accuracy < _LEAST_ACCURACY:
        return
    span, scales = settings.end - jumps.table[:, 0], run.state.q_scale
    longest = float(run.state.memory[0]["largest_step"])
    steps, spent, idle = int(run.state.count[0]["steps"]), 0, 0
    most = min(_STEPS_RATIO * steps, _MAX_STEPS)
    largest, worst = max(least, _LEAST_MOTION * settings.accuracy), None
    for begin, k in pairwise(order):
        if span[begin] - span[k] < longest:
            continue  # the steps between are short
        if spent >= most or idle >= _MAX_IDLE and spent > _IDLE_SHARE * steps:
            break
        fine, own = (state_at_jump(run, first, jumps, n) for n in (begin, k))
        before = int(fine.count[0]["steps"])
        _follow(run, settings, fine, float(own.t[0]), most - spent)
        spent += int(fine.count[0]["steps"]) - before
        lost, moved = np.abs(fine.v - own.v), np.abs(fine.q - own.q).max()
        lasting = float((lost * run.compiled.system.weights / scales).max() * span[k])
        vibrates = fine.t[0] == own.t[0] and moved > _LEAST_PERIOD * longest * lost.max()
        idle += 1
        if vibrates and lasting > largest:
            idle, largest, worst = 0, lasting, (begin, own, fine)
    if worst is not None:
        begin, own, fine = worst
        for rows in _rows_with_equal_steps(run, settings, own, fine, jumps):
            error.add(*rows, float(jumps.table[begin, 0]))


def _follow(
    run: Integration, settings: method.Settings, state: State, event: float, most: int
) -> None:
    """Advance a state to an event [s] by steps that follow vibrations, with at most so many.

    Short last steps cross the event, to whose kink the stages of a long one would be blind.
    """
    radau, last = radau_5(), _CROSSING_SHARE * float(run.state.memory[0]["largest_step"])
    prepare_units(integration_units(run.compiled.system, radau))
    tolerance = min(_TOLERANCE_RATIO * settings.tolerance, _AMPLITUDE_SHARE * settings.accuracy)
    for start, end in pairwise((float(state.t[0]), event - last, event)):
        if state.t[0] == start:
            own = settings._replace(tolerance=tolerance, start=start, end=end)
            Integration(run.compiled, radau, own, state, run.times[:0]).integrate(most)


def _rows_with_equal_steps(
    run: Integration, settings: method.Settings, own: State, other: State, jumps: JumpStates
) -> Iterator[tuple[OutputBlock, OutputBlock]]:
    """Rows of two states from the same time on, of which the second follows steps of the first.

    None if the first step fails.
    """
    settings = settings._replace(start=float(own.t[0]))
    times = jumps.outputs[jumps.outputs > settings.start]
    leads = Integration(run.compiled, run.method, settings, own, times)
    same = settings._replace(refinement=1.0, rejection_factor=ANY_ERROR)
    follows = Integration(run.compiled, run.method, same, other, times, leads.plan)
    blocks: tuple[list[OutputBlock], list[OutputBlock]] = [], []
    status = method.SUCCESS
    try:
        while status == method.SUCCESS and not leads.finished:
            status = leads.integrate(leads.chunk)
            blocks[0].append(leads.rows.read())
            while status == method.SUCCESS and follows.state.t[0] < leads.state.t[0]:
                status = follows.integrate(follows.chunk)
                blocks[1].append(follows.rows.read())
    except FlexmbError:  # too many steps: the rows up to there count
        pass
    if all(blocks):
        joined = [OutputBlock.joined(each) for each in blocks]
        rows = min(len(block.t) for block in joined)
        yield joined[0].part(0, rows), joined[1].part(0, rows)
