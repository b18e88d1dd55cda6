"""Processor time to equal error: error and time over a range of settings, and what lies between."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from flexmb.analysis.dynamics.dynamics import prepare_dynamics, run_dynamics
from flexmb.engine.compile import compile_system

OUTPUTS = 10


@dataclass(frozen=True)
class Point:
    """One setting: error over the size of the mechanism, processor time [s], evaluations."""

    setting: float | int
    error: float
    cpu: float
    evaluations: int = 0


class _LastRow:
    """Keeps the last row of a run."""

    def append(self, block):
        if len(block.t):
            self.sensors = block.sensors[-1].copy()

    def save_state(self, state):
        pass

    def restart(self):
        pass


class Flexmb:
    """One scene by flexmb; what is measured is the run alone, first state to last row."""

    def __init__(self, scene, **knobs):
        self.scene, self.knobs = scene, knobs
        self.model = scene.make()

    def point(self, accuracy):
        model, scene = self.model, self.scene
        model.set_dynamics(
            duration=scene.duration, outputs=OUTPUTS, accuracy=accuracy, **self.knobs
        )
        compiled, rows = compile_system(model), _LastRow()
        prepared = prepare_dynamics(compiled, model)
        begin = time.process_time()
        outcome = run_dynamics(prepared, rows)
        cpu = time.process_time() - begin
        assert outcome.status == "finished", outcome.message
        at = [compiled.layout.channels.index(channel) for channel in scene.channels]
        error = np.abs(rows.sensors[at] - scene.end()).max() / scene.size
        return Point(accuracy, error, cpu, outcome.statistics["residual_evaluations"])


class Exudyn:
    """One scene by Exudyn, with one set of solver settings."""

    def __init__(self, scene, make, **settings):
        self.scene, self.settings = scene, settings
        self.mbs, self.end = make()
        self.mbs.Assemble()

    def point(self, steps):
        import exudyn

        from tests.peers.with_exudyn import solve

        try:
            found, cpu = solve(self.mbs, self.end, self.scene.duration, steps, **self.settings)
        except exudyn.SolverError:  # too long a step
            return Point(steps, np.inf, 0.0)
        return Point(steps, np.abs(found - self.scene.end()).max() / self.scene.size, cpu)


def fastest(one, setting, repeats):
    """The point of a setting with the least time of several."""
    points = [one.point(setting) for _ in range(repeats)]
    return min(points, key=lambda point: point.cpu)


def time_to(points, error):
    """Least time for an error no larger; between points of a fixed order along straight lines."""
    fine = [point.cpu for point in points if point.error <= error]
    times = [min(fine)] if fine else []
    ordered = sorted(points, key=lambda point: point.cpu)
    for coarse, better in zip(ordered, ordered[1:], strict=False):
        if coarse.error > error >= better.error > 0.0:
            share = np.log(coarse.error / error) / np.log(coarse.error / better.error)
            times.append(coarse.cpu * (better.cpu / coarse.cpu) ** share)
    return min(times, default=np.nan)


def steps_until(error, one, first, longest):
    """Points of twice as many steps each, until the error is reached or one takes long."""
    points, steps = [], first
    while True:
        point = fastest(one, int(steps), 2)
        if np.isfinite(point.error):
            points.append(point)
        if point.error < error or point.cpu > longest:
            return points
        steps *= 2
