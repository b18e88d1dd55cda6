"""Which columns of a run are stored: those that a scene requests by ``[results] keep``.

A name is a group of `GROUPS`, a body, joint, driver, sensor or energy, or a channel, each perhaps
with the wildcards ``*``, ``?`` and ``[...]``. Times and constraint drift are always stored, and so
are the channels that the scene plots or checks.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from fnmatch import translate
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import Problem, SceneError, nearest
from flexmb.results.channels import Columns, list_channels, widths

StoredColumns = dict[str, NDArray[np.int64]]

GROUPS = {
    "sensors": "channels of sensors, states and controllers",
    "poses": "positions and deformation of bodies: what pictures need",
    "modal-coordinates": "deformation alone: what stress and section forces need",
    "velocities": "of bodies and modal coordinates",
    "coordinates": "poses and velocities: what another run needs to begin from the end of this one",
    "accelerations": "of bodies and modal coordinates",
    "reactions": "forces and moments of joints and drivers",
    "multipliers": "of the constraint equations: what studies judge reactions by",
    "energy": "energies and works",
}
"""Groups of columns, and what they hold."""

_ALWAYS = ("time", "drift")
_GROUPS_OF = {
    "q": ("poses", "coordinates"),
    "v": ("velocities", "coordinates"),
    "vd": ("accelerations",),
    "lam": ("multipliers",),
    "reactions": ("reactions",),
    "sensors": ("sensors",),
    "energy": ("energy",),
}
_SECTIONS_OF = {"sensors": ("sensors", "states", "controllers"), "reactions": ()}
_MODAL = re.compile(r"\.eta\.\d+$")


class _Column(NamedTuple):
    """One column with its groups and names."""

    table: str
    number: int
    groups: tuple[str, ...]
    names: tuple[str, ...]


def stored_columns(
    columns: Columns, scene: Mapping[str, Any], unreduced: Collection[str] = ()
) -> StoredColumns:
    """Numbers of the stored columns by table.

    Parameters
    ----------
    columns : Columns
        All columns.
    scene : mapping
        The scene; without ``[results] keep`` everything is stored.
    unreduced : collection of str
        Bodies that are not reduced yet: names of their modal coordinates are accepted.

    Raises
    ------
    SceneError
        Names of nothing.
    """
    requested = tuple(scene.get("results", {}).get("keep", ()))
    everything = {name: np.arange(width) for name, width in widths(columns).items()}
    if not requested:
        return everything
    available, stored, problems = list(_columns(columns, scene)), set[tuple[str, int]](), []
    for i, item in enumerate(requested):
        matches = _matching(available, item)
        body, _, rest = item.removeprefix("bodies.").partition(".")
        if not matches and not (rest.startswith("eta") and body in unreduced):
            problems.append(_unknown(f"results.keep[{i}]", item, available))
        stored |= matches
    if problems:
        raise SceneError.from_problems(problems)
    needed = {str(check["sensor"]) for check in scene.get("check", ()) if "sensor" in check}
    needed |= set(scene.get("view", {}).get("history", ()))
    stressed = tuple(f"{name.removesuffix('.von_mises')}.eta." for name in needed)
    stored |= {
        (c.table, c.number)
        for c in available
        if (c.table == "sensors" and needed & {*c.names})
        or (c.table == "q" and any(name.startswith(stressed) for name in c.names))
    }
    return {
        table: numbers
        if table in _ALWAYS
        else np.array(sorted(k for name, k in stored if name == table), np.int64)
        for table, numbers in everything.items()
    }


def row_bytes(stored: StoredColumns) -> int:
    """Bytes that one row takes in the file."""
    return 8 * sum(len(numbers) for numbers in stored.values())


def describe_missing(
    columns: Columns, scene: Mapping[str, Any], table: str, missing: Iterable[int]
) -> str:
    """The sentence for columns that were not stored, with the request that stores them."""
    wanted = set(missing)
    lacking = [c for c in _columns(columns, scene) if c.table == table and c.number in wanted]
    groups = set.intersection(*({*c.groups} for c in lacking)) if lacking else set()
    narrow = "modal-coordinates" if "modal-coordinates" in groups else _GROUPS_OF[table][0]
    name = lacking[0].names[0] if lacking and lacking[0].names else narrow
    what = narrow if len(lacking) != 1 else name
    return f'{name} was not kept by this run; keep = ["{what}"] in [results] keeps it'


def _columns(columns: Columns, scene: Mapping[str, Any]) -> Iterator[_Column]:
    """Every column that need not be stored."""
    names: dict[tuple[str, int], list[str]] = {}
    for group in ("sensors", "reactions", "energy", "coordinates", "accelerations"):
        for channel in list_channels(columns, scene, group):
            if channel.table in _GROUPS_OF:
                names.setdefault((channel.table, channel.column), []).append(channel.name)
    for k, row in enumerate(columns.rows):
        names["lam", k] = [row]
    bodies = {body.name for body in columns.bodies}
    for table, width in widths(columns).items():
        for k in range(width) if table in _GROUPS_OF else ():
            own = names.get((table, k), [])
            modal = table == "q" and any(_MODAL.search(name) for name in own)
            groups = _GROUPS_OF[table] + (("modal-coordinates",) if modal else ())
            paths = [
                f"{section}.{name}" for name in own for section in _sections(table, name, bodies)
            ]
            if table == "reactions":
                path = columns.reactions[k // 12]
                paths.append(f"{path}.{own[0].partition('.')[2]}" if own else path)
            yield _Column(table, k, groups, (*own, *paths))


def _sections(table: str, name: str, bodies: Collection[str]) -> tuple[str, ...]:
    """Sections of the scene that may stand before a name."""
    if table in ("q", "v", "vd"):
        return ("bodies",) if name.partition(".")[0] in bodies else ()
    return _SECTIONS_OF.get(table, ())


def _matching(available: Iterable[_Column], item: str) -> set[tuple[str, int]]:
    """Columns that an item names: those of a group, of an owner, or of channels."""
    if item in GROUPS:
        return {(c.table, c.number) for c in available if item in c.groups}
    whole = re.compile(translate(item)).match
    owner = re.compile(translate(item + ".*")).match
    return {
        (c.table, c.number)
        for c in available
        if any(whole(name) or owner(name) for name in c.names)
    }


def _unknown(where: str, item: str, available: Iterable[_Column]) -> Problem:
    full = dict.fromkeys(name for column in available for name in column.names[:1])
    owners = dict.fromkeys(name.partition(".")[0] for name in full if ":" not in name)
    allowed = (*GROUPS, *(name for name in owners if name not in GROUPS))
    what = f'there is nothing of the name "{item}" to keep'
    return Problem(where, what, allowed, nearest(item, (*allowed, *full)))
