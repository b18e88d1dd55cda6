"""Tables of the units that a system calls: by stage and kind, for rows and for sensors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexmb.engine.jit import CompiledUnit, units_in
from flexmb.engine.joints import ROW_KINDS
from flexmb.engine.kind_registry import KINDS
from flexmb.engine.sensors import CHANNEL_KINDS, MEASURES
from flexmb.engine.state import RowUnits, SensorUnits, Stage, Stages
from flexmb.engine.tables import System


def kinds_of(system: System) -> list:
    """The kinds that a system holds, in the order of their stages."""
    return [kind for kind in KINDS if kind.name in system.kinds]


def stages_of(system: System, scratch: Mapping[str, Any]) -> Stages:
    """What each kind of a system does, stage by stage, its tables with its scratch of one run."""
    kinds, called = kinds_of(system), _called_by_number(system)
    tables = dict(system.kinds)
    for name in scratch.keys() & tables.keys():  # of a system with fewer kinds, too
        tables[name] = tables[name]._replace(scratch=scratch[name])

    def stage(name: str) -> Stage:
        acting = [kind for kind in kinds if name in kind.units]
        used = called.get(name, range(len(acting)))
        units = tuple(kind.units[name] if k in used else None for k, kind in enumerate(acting))
        return Stage(units, tuple(tables[kind.name] for kind in acting))

    stages = {name: stage(name) for name in Stages._fields}
    if system.events == 0:
        stages["events"] = Stage((), ())
    if any(kind.uses_velocity for kind in kinds):
        stages["force_velocity"] = stages["velocity"]
    return Stages(**stages)


def _called_by_number(system: System) -> dict[str, set[int]]:
    """Numbers in a stage of the kinds that sensors, and functions over them, call there."""
    channels, feedback = system.sensors.channels, system.kinds.get("feedback")
    read = set(channels["kind"].tolist())
    acting = set() if feedback is None else set(feedback.tangents["kind"].tolist())
    return {"wrenches": read, "unit_force": acting}


def row_units(system: System) -> RowUnits:
    """Units of the kinds of rows that a system holds, and of those that its sensors measure as."""
    in_joints = np.flatnonzero(np.bincount(system.rows["kind"])).tolist()
    used = {word: set(in_joints) for word in _OF_ROWS}
    every, acting = _terms(system)
    for number, kind in every:
        for word in MEASURES[number].of_row:
            used[word].add(kind)
    for number, kind in acting:
        for word in MEASURES[number].gradient_of_row:
            used[word].add(kind)
    units = {
        word: tuple(
            getattr(kind, word) if k in used[word] else None for k, kind in enumerate(ROW_KINDS)
        )
        for word in _OF_ROWS
    }
    curved = np.array([kind.tangent is not None for kind in ROW_KINDS], np.int64)
    return RowUnits(**units, curved=curved, period=np.array([kind.period for kind in ROW_KINDS]))


_OF_ROWS = ("value", "gradient", "curvature", "tangent")


def sensor_units(system: System) -> SensorUnits:
    """Units of the channels and terms that a system holds."""
    channels = set(system.sensors.channels["what"].tolist())
    measures, acting = ({number for number, _ in terms} for terms in _terms(system))
    return SensorUnits(
        channel=tuple(of.value if k in channels else None for k, of in enumerate(CHANNEL_KINDS)),
        turns=np.array([of.counts_turns for of in CHANNEL_KINDS], np.int64),
        computed=np.array([of.reads == "channels" for of in CHANNEL_KINDS], np.int64),
        measure=tuple(of.value if k in measures else None for k, of in enumerate(MEASURES)),
        gradient=tuple(of.gradient if k in acting else None for k, of in enumerate(MEASURES)),
        level=np.array([of.level for of in MEASURES], np.int64),
    )


def _terms(system: System) -> tuple[set[tuple[int, int]], set[tuple[int, int]]]:
    """Measures of all terms with their kinds of rows, and of those that functions act by."""
    terms, feedback = system.sensors.terms, system.kinds.get("feedback")
    every = list(zip(terms["measure"].tolist(), terms["kind"].tolist(), strict=True))
    acting = set() if feedback is None else set(feedback.tangents["term"].tolist()) - {-1}
    return set(every), {every[t] for t in acting}


def units_of(system: System) -> list[CompiledUnit]:
    """All units of what a system holds."""
    tables = stages_of(system, {}), row_units(system), sensor_units(system)
    return [unit for table in tables for unit in units_in(table)]
