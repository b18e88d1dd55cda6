"""What a run achieves beside the known motion: error, told error, steps, processor time."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass

import numpy as np

from flexmb.analysis.dynamics.dynamics import prepare_dynamics, run_dynamics
from flexmb.engine.compile import compile_system
from flexmb.errors import FlexmbWarning

__all__ = ["METHODS", "ROUND_OFF", "Judged", "judged", "largest_error"]

METHODS = {
    "auto": {"method": "auto"},
    "explicit-rk": {"method": "explicit-rk"},
    "order 5": {"method": "explicit-rk", "order": 5},
    "radau": {"method": "radau"},
    "generalized-alpha": {"method": "generalized-alpha"},
}
"""What is judged, by a word: knobs of a run."""

ROUND_OFF = 1e-12
"""Error over peak-to-peak below which nothing is judged."""


class _Rows:
    """Keeps times and sensors of a run."""

    def __init__(self):
        self.blocks = []

    def append(self, block):
        self.blocks.append(block)

    def save_state(self, state):
        pass

    def restart(self):
        self.blocks.clear()


@dataclass(frozen=True)
class Judged:
    """A run beside the truth; `told` is nan where nothing is told."""

    achieved: float
    told: float
    worst: str
    statistics: dict
    cpu: float
    message: str
    notes: tuple[str, ...]

    @property
    def steps(self):
        return self.statistics["steps"]

    @property
    def share(self):
        """The error told over the true one."""
        return self.told / max(self.achieved, 1e-300)

    def is_reached(self, asked):
        """Whether the error is at most twice what was asked for."""
        return self.achieved <= max(2 * asked, ROUND_OFF)

    def is_near(self, asked):
        """Whether the error, or what is told of it, is a fifth of what was asked for, or more."""
        return max(self.achieved, self.told) > max(0.2 * asked * (1 + 1e-9), ROUND_OFF)


def largest_error(found, truth):
    """Largest error of a sensor over its peak-to-peak, that of its component that moves most.

    Both are channels (n,) by name; of a sensor only the components in `truth` count.
    """
    apart, moves = {}, {}
    for channel, wanted in truth.items():
        name = channel.rpartition(".")[0] or channel
        apart[name] = max(apart.get(name, 0.0), np.abs(found[channel] - wanted).max())
        moves[name] = max(moves.get(name, 0.0), np.ptp(wanted))
    most = max(moves.values())
    shares = {name: apart[name] / move for name, move in moves.items() if move > 1e-12 * most}
    worst = max(shares, key=shares.get)
    return shares[worst], worst


def judged(model, truth=None, bodies=None, **knobs):
    """Run a model; `truth(t)` are the channels it should have, if known."""
    model.set_dynamics(**knobs)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlexmbWarning)
        made, rows = compile_system(model, bodies), _Rows()
        prepared = prepare_dynamics(made, model)
        begin = time.process_time()
        outcome = run_dynamics(prepared, rows)
        cpu = time.process_time() - begin
    if outcome.status != "finished":
        return Judged(np.inf, np.nan, "", outcome.statistics, cpu, outcome.message, outcome.notes)
    t = np.concatenate([block.t for block in rows.blocks])
    sensors = np.concatenate([block.sensors for block in rows.blocks])
    found = dict(zip(made.layout.channels, sensors.T, strict=True))
    achieved, worst = largest_error(found, truth(t)) if truth else (np.nan, "")
    told = outcome.statistics.get("measured_error_of_positions", np.nan)
    return Judged(achieved, told, worst, outcome.statistics, cpu, "", outcome.notes)
