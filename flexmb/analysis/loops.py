"""What a user should know of functions over channels: loops at one moment.

In: a model. Out: notes.
"""

from __future__ import annotations

from flexmb.model.model import Model
from flexmb.model.sensors import ReactionSensorSpec, SensorSpec
from flexmb.model.signals import live_functions, resolved

__all__ = ["loop_notes"]


def loop_notes(model: Model) -> list[str]:
    """A note for every force that depends on accelerations or reactions, which depend on it."""
    notes = []
    for where, function in live_functions(model):
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
