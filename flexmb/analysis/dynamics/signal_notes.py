"""What a user should know of sensors and functions over channels: loops, singular poses.

In: a model, and the rows of its run. Out: notes.
"""

from __future__ import annotations

import numpy as np

from flexmb.engine.tables import Layout
from flexmb.model.model import Model
from flexmb.model.sensors.channels import feedback_functions, resolved
from flexmb.model.sensors.sensor import OrientationSensorSpec, ReactionSensorSpec, SensorSpec
from flexmb.results import OutputBlock

__all__ = ["SingularPoses", "loop_notes"]

_CLOSE = 1.0  # degrees


def loop_notes(model: Model) -> list[str]:
    """A note for every force that depends on accelerations or reactions, which depend on it."""
    notes = []
    for where, function in feedback_functions(model):
        if not where.startswith("forces."):
            continue
        names = resolved(model, function.expression).channels
        found = [name for name in names if _at_once(model.sensors.get(_owner(model, name)))]
        if found:
            notes.append(
                f"{where} depends on {', '.join(found)}, which depends on forces at the same "
                "moment: an algebraic loop, solved by iteration"
            )
    return notes


def _owner(model: Model, channel: str) -> str:
    return channel if channel in model.sensors else channel.rpartition(".")[0]


def _at_once(spec: SensorSpec | None) -> bool:
    """Whether a sensor measures accelerations or reactions."""
    return spec is not None and (
        "acceleration" in spec.type
        or isinstance(spec, ReactionSensorSpec)
        or getattr(spec, "derivative", 0) == 2
    )


class SingularPoses:
    """How close orientation sensors come to where alpha and gamma are about one axis."""

    def __init__(self, layout: Layout, model: Model) -> None:
        self._nearest: dict[str, tuple[float, float]] = {}
        column = {channel: k for k, channel in enumerate(layout.channels)}
        self._columns = {
            name: (column[f"{name}.beta"], spec.sequence)
            for name, spec in model.sensors.items()
            if isinstance(spec, OrientationSensorSpec)
        }

    def add(self, rows: OutputBlock) -> None:
        """Look at further outputs."""
        for name, (column, sequence) in self._columns.items():
            beta = rows.sensors[:, column]
            if not len(beta):
                continue
            size = np.sin(beta) if sequence[0] == sequence[2] else np.cos(beta)
            off = np.degrees(np.arcsin(np.abs(size)))
            k = int(np.argmin(off))
            self._nearest[name] = min(
                (float(off[k]), float(rows.t[k])), self._nearest.get(name, (np.inf, 0.0))
            )

    @property
    def notes(self) -> list[str]:
        """A note for every sensor that came within a degree."""
        return [
            f"sensors.{name}: at t = {time:.6g} s within {off:.2g} deg of the singular pose of "
            f'"{self._columns[name][1]}", where alpha and gamma turn about one axis and only their '
            "sum or difference is known; another sequence has its singular pose elsewhere"
            for name, (off, time) in self._nearest.items()
            if off < _CLOSE
        ]
