"""Channels: every number over time of a result, by name and unit.

In: the columns of a result and its scene. Out: names such as ``slider.x`` (a sensor's),
``crank_pin.rod.force.x`` (what the joint does to that body), ``energy.kinetic``, ``drift.position``
and ``rod.eta.0``, each with its table, its column there and its unit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.tables import BodyColumns
from flexmb.errors import ResultFileError
from flexmb.model.sensors.sensor import channel_unit
from flexmb.results.columns import DRIFT, Columns
from flexmb.results.reactions import MarkerPair, marker_pairs

CHANNEL_KINDS = ("sensors", "reactions", "energy", "drift", "coordinates", "accelerations")
_BALANCE = "energy.balance"


class Channel(NamedTuple):
    """One column of a result."""

    name: str
    table: str
    column: int
    unit: str  # that of SI


class HistoryTable(NamedTuple):
    """Channels over time, in the scene's units."""

    title: str  # of the scene
    names: tuple[str, ...]  # of the columns; the first is "time"
    units: tuple[str, ...]  # of the columns, such as "m/s^2"; empty for none
    values: NDArray[np.float64]  # (n, k)


def all_channels(columns: Columns, scene: Mapping[str, Any]) -> dict[str, Channel]:
    """All channels by name; a sensor's name goes before any other that is equal."""
    by_name: dict[str, Channel] = {}
    for kind in CHANNEL_KINDS:
        for channel in list_channels(columns, scene, kind):
            by_name.setdefault(channel.name, channel)
    return by_name


def list_channels(columns: Columns, scene: Mapping[str, Any], kind: str) -> tuple[Channel, ...]:
    """The channels of one of `CHANNEL_KINDS`, in order.

    Raises
    ------
    ResultFileError
        No such kind.
    """
    if kind == "sensors":
        return tuple(_sensors(columns, scene))
    if kind == "reactions":
        return tuple(_reactions(marker_pairs(columns, scene)))
    if kind == "energy":
        energies = [
            Channel(f"energy.{name}", "energy", i, "J") for i, name in enumerate(columns.energies)
        ]
        return (*energies, Channel(_BALANCE, "balance", 0, "J"))
    if kind == "drift":
        return tuple(Channel(f"drift.{name}", "drift", i, "") for i, name in enumerate(DRIFT))
    if kind == "coordinates":
        return tuple(_coordinates(columns))
    if kind == "accelerations":
        return tuple(_accelerations(columns))
    what = f'a result has no channels of the kind "{kind}"'
    raise ResultFileError.unknown(what, kind, (*CHANNEL_KINDS, "stress"))


def _sensors(columns: Columns, scene: Mapping[str, Any]) -> Iterator[Channel]:
    owners = ("sensors", "states", "controllers")
    tables = {name: table for owner in owners for name, table in scene.get(owner, {}).items()}
    for i, name in enumerate(columns.channels):
        yield Channel(name, "sensors", i, channel_unit(tables, name) or "")


def _reactions(pairs: tuple[MarkerPair, ...]) -> Iterator[Channel]:
    for i, pair in enumerate(pairs):
        for side, body in zip("JI", (pair.body_J, pair.body_I), strict=True):
            first = 12 * i + (0 if side == "J" else 6)
            for k, (what, unit) in enumerate((("force", "N"), ("moment", "N m"))):
                for c, axis in enumerate("xyz"):
                    name = f"{pair.name}.{body}.{what}.{axis}"
                    yield Channel(name, "reactions", first + 3 * k + c, unit)


def _coordinates(columns: Columns) -> Iterator[Channel]:
    for body in columns.bodies:
        names = [(f"r.{axis}", "m") for axis in "xyz"] + [(f"p.{i}", "") for i in range(4)]
        names += [(f"eta.{i}", "") for i in range(body.m)]
        for i, (name, unit) in enumerate(names):
            yield Channel(f"{body.name}.{name}", "q", body.iq + i, unit)
        yield from _rates(body, "v", "dot", ("m/s", "rad/s", "1/s"))
    n = len(columns.coordinates)  # scalar ones stand behind the bodies
    for i, name in enumerate(columns.coordinates):
        state = name.startswith("states.")  # its velocity is the state
        own, rate = (f"{name}.integral", name) if state else (name, f"{name}.rate")
        units = ("m", "m/s") if name.endswith("position") else ("", "")  # along a curve
        yield Channel(own, "q", columns.nq - n + i, units[0])
        yield Channel(rate, "v", columns.nv - n + i, units[1])


def _accelerations(columns: Columns) -> Iterator[Channel]:
    for body in columns.bodies:
        yield from _rates(body, "vd", "ddot", ("m/s^2", "rad/s^2", "1/s^2"))
    n = len(columns.coordinates)
    for i, name in enumerate(columns.coordinates):
        unit = "m/s^2" if name.endswith("position") else ""
        yield Channel(f"{name}.rate_dot", "vd", columns.nv - n + i, unit)


def _rates(
    body: BodyColumns, table: str, suffix: str, units: tuple[str, str, str]
) -> Iterator[Channel]:
    """Velocities or accelerations of one body: of translation, rotation, modal coordinates."""
    turn = "w" if suffix == "dot" else "w_dot"
    names = [f"r_{suffix}.{axis}" for axis in "xyz"] + [f"{turn}.{axis}" for axis in "xyz"]
    names += [f"eta_{suffix}.{i}" for i in range(body.m)]
    for i, name in enumerate(names):
        yield Channel(f"{body.name}.{name}", table, body.iv + i, units[min(i // 3, 2)])
