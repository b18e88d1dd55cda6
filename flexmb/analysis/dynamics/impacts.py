"""What a run says of its impacts: speeds that their damping does not fit, and peaks it misses."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from flexmb.analysis.dynamics.integration import Integration
from flexmb.engine.compile import Compiled
from flexmb.engine.forces.contact_pair import (
    BLOW_SPEED,
    BLOW_WORK,
    FASTEST,
    HARDEST_SPEED,
    HARDEST_WORK,
    PEAK,
    REBOUND,
    takes_a_blow,
)
from flexmb.model.model import Model
from flexmb.model.sensor import ReactionSensorSpec
from flexmb.results.output_block import OutputBlock
from flexmb.units import UnitSystem

# Impacts of a contact are slow if the fastest one has less than this many times its least_speed; a
# rebound by less than this share of the size of the model is not reported.
_SPEED_RATIO, _MIN_REBOUND = 10.0, 1e-4
_BLOW = 0.01  # work of a blow in a contact over the energy that moved, above which it is reported
# Share of the peak of a contact force that a sensor must show in one of its rows.
_SHOWN = 0.8


def slow_impacts(run: Integration, units: UnitSystem) -> Iterator[str]:
    """A sentence for each contact that is damped for speeds which its impacts do not have.

    It applies if the fastest impacts are about as slow as least_speed and the contact rebounds
    after one below it. Not reported are contacts that had faster impacts, that rebound by a
    negligible distance, or whose motion drivers fix; nor contacts of several points, which have no
    restitution of their own. It also applies if sides that lie against each other, damped as at
    least_speed, take a blow.
    """
    for name, element in run.compiled.elements.items():
        if element.kind != "contacts" or element.n > 1 or run.settings.determinate == 1:
            continue
        row, state = run.compiled.system.kinds["contacts"].rows[element.row], run.state.history
        slow, history = float(row["slow"]), state[row["impacts"] :]
        fastest = float(history[FASTEST])
        least = _MIN_REBOUND * run.compiled.length
        say = partial(units.say, unit="m/s", digits=2)
        blow = (
            (BLOW_WORK, BLOW_SPEED) if takes_a_blow(row, state) else (HARDEST_WORK, HARDEST_SPEED)
        )
        if history[blow[0]] > _BLOW * run.rows.balance.moved:
            hit = float(history[blow[1]])
            yield (
                f"{name}: its sides lay against each other when a blow drove them together with "
                f"{say(hit)}; it is damped as an impact of {say(slow)}, its least_speed, and "
                "rebounds by far less than its restitution: a small gap gives the blow its own "
                f"speed, or give least_speed = {units.outward(hit, 'm/s'):.1g}"
            )
        elif row["damping"] > 0.0 and fastest < _SPEED_RATIO * slow and history[REBOUND] > least:
            yield (
                f"{name}: impacts below its least_speed of {say(slow)} are damped as those of that "
                f"speed, so that they rebound by more than its restitution; the fastest one has "
                f"{say(fastest)}: give least_speed = {units.outward(fastest / 100, 'm/s'):.1g}"
            )


class MissedPeaks:
    """Peaks of contact forces that lie between the outputs of a run.

    An impact is often shorter than the interval of outputs. The force of a contact, of all its
    points together, is compared with the sensors that record it.
    """

    def __init__(self, compiled: Compiled, model: Model) -> None:
        self._contacts: dict[str, int] = {}  # place of its impacts in the history, by sensor
        self._columns: dict[str, list[int]] = {}
        self._largest: dict[str, float] = {}
        channels = compiled.layout.channels
        for name, spec in model.sensors.items():
            if not isinstance(spec, ReactionSensorSpec) or spec.quantity != "force":
                continue
            element = compiled.elements.get(f"forces.{spec.force}")
            if element is None or element.kind != "contacts":
                continue
            row = compiled.system.kinds["contacts"].rows[element.row + element.n - 1]
            self._contacts[name] = int(row["impacts"])
            self._columns[name] = [
                k for k, channel in enumerate(channels) if channel.rpartition(".")[0] == name
            ]
            self._largest[name] = 0.0

    def add(self, rows: OutputBlock) -> None:
        """Take the next rows."""
        for name, columns in self._columns.items():
            size = np.linalg.norm(rows.sensors[:, columns], axis=1).max(initial=0.0)
            self._largest[name] = max(self._largest[name], float(size))

    def sentences(self, run: Integration, model: Model) -> Iterator[str]:
        """A sentence for each sensor that misses more than a fifth of the peak of its contact."""
        say = partial(model.units.say, unit="N", digits=2)
        for name, place in self._contacts.items():
            peak, shown = float(run.state.history[place + PEAK]), self._largest[name]
            if shown < _SHOWN * peak:
                yield (
                    f"sensors.{name}: its contact pushes with up to {say(peak)} between outputs, "
                    f"which show {say(shown)} at most: give more outputs, or list times about the "
                    "impact"
                )
