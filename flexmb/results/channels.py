"""Tables, columns and channels of a result: every number over time, by name and unit.

A result file holds one table for each kind of quantity and one column for each number of it. The
names of the columns are those of the compiled system's layout.

=============  ==================  ==========================================================
dataset        shape               meaning
=============  ==================  ==========================================================
/time          (n,)                time [s]
/q             (n, nq)             positions, per body r [m], p [-], eta [m kg^1/2 or as scaled]
/v             (n, nv)             velocities, per body r_dot [m/s], w [rad/s, body axes], eta_dot
/vd            (n, nv)             accelerations
/lam           (n, nc)             constraint multipliers [N or N m]
/reactions     (n, 12 reactions)   of each joint and driver: force [N] and moment [N m] on marker J
                                   in its axes, then on marker I in its axes
/sensors       (n, channels)       sensor channels, SI
/energy        (n, energies)       energies and works [J]
/drift         (n, 2)              largest constraint violation: position, velocity
=============  ==================  ==========================================================

The two reactions of a joint, driver or coupler (of a coupler one for each joint, named
``coupler.joint``) are action and reaction. As forces they are equal and opposite; the moments
differ by the moment of the force about the other marker. z is the joint's axis, on J the second
axis of a joint with two; for joints that slide in a planar scene x is the axis and z the normal.
Reactions of drivers and couplers are not included in those of their joints. What acts on the second
angle of a universal joint is reported on J in axes that are rotated by 180 degrees about y: z
against the axis.

`result_file` describes the other datasets. Of q, v, vd, lam, reactions, sensors and energy only
those columns are stored that the scene requests by ``[results] keep``: a group of `GROUPS`, a body,
joint, driver, sensor or energy, or a channel, with or without the wildcards ``*``, ``?`` and
``[...]``. Times, drift, and the channels that the scene plots or checks are always stored.

Channels name the columns for users: ``slider.x`` (a sensor's), ``crank_pin.rod.force.x`` (what the
joint does to that body), ``energy.kinetic``, ``drift.position``, ``rod.eta.0``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import translate
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.tables import BodyColumns, Layout
from flexmb.errors import Problem, ResultFileError, SceneError, nearest
from flexmb.model.sensor import channel_unit


class MarkerPair(NamedTuple):
    """The two markers of a joint or driver."""

    path: str  # such as "joints.crank_pin"
    name: str  # the name without its section, if that is unique
    I: str  # noqa: E741  references such as "crank.pin"
    J: str

    @property
    def body_I(self) -> str:
        """Body of marker I."""
        return self.I.partition(".")[0]

    @property
    def body_J(self) -> str:
        """Body of marker J."""
        return self.J.partition(".")[0]


def marker_pairs(layout: Layout, scene: Mapping[str, Any]) -> tuple[MarkerPair, ...]:
    """Both markers of every object with a reaction, in the order of the table."""
    joints, drivers = scene.get("joints", {}), scene.get("drivers", {})
    pairs = []
    for path in layout.reactions:
        section, _, name = path.partition(".")
        table = scene.get(section, {}).get(name, {})
        joint = str(table.get("joint", ""))
        if section in ("joints", "couplers"):
            joint, table = (name if section == "joints" else name.split(".")[1]), {}
        between = table.get("between") or joints.get(joint, {}).get("between", ("", ""))
        if "marker" in table:
            between = table.get("relative_to", "ground.origin"), table["marker"]
        shown = path if name in joints and name in drivers else name
        pairs.append(MarkerPair(path, shown, str(between[0]), str(between[1])))
    return tuple(pairs)


DRIFT: Final = ("position", "velocity")
_WIDTHS: Final[Mapping[str, Callable[[Layout], int]]] = {
    "time": lambda layout: 1,  # stored without a second axis
    "q": lambda layout: layout.nq,
    "v": lambda layout: layout.nv,
    "vd": lambda layout: layout.nv,
    "lam": lambda layout: layout.nc,
    "reactions": lambda layout: 12 * len(layout.reactions),
    "sensors": lambda layout: len(layout.channels),
    "energy": lambda layout: len(layout.energies),
    "drift": lambda layout: len(DRIFT),
}
TABLES: Final = tuple(_WIDTHS)
CHANNEL_KINDS = ("sensors", "reactions", "energy", "drift", "coordinates", "accelerations")
_BALANCE_CHANNEL = "energy.balance"


@dataclass(frozen=True)
class Columns(Layout):
    """Names and offsets of all columns of a result."""

    @classmethod
    def of(cls, layout: Layout) -> Columns:
        """The columns of a compiled system's layout."""
        return cls(**vars(layout))

    def body(self, name: str) -> BodyColumns:
        """The columns of the body of that name.

        Raises
        ------
        ResultFileError
            No such body; lists those there are, nearest first.
        """
        bodies = {body.name: body for body in self.bodies}
        if name not in bodies:
            raise ResultFileError.unknown(f'the result has no body "{name}"', name, bodies)
        return bodies[name]


def widths(layout: Layout) -> dict[str, int]:
    """Number of columns of every table."""
    return {name: width(layout) for name, width in _WIDTHS.items()}


class Channel(NamedTuple):
    """One column of a result."""

    name: str
    table: str
    column: int
    unit: str  # in SI


class HistoryTable(NamedTuple):
    """Channels over time, in the scene's units."""

    title: str  # of the scene
    names: tuple[str, ...]  # of the columns; the first is "time"
    units: tuple[str, ...]  # of the columns, such as "m/s^2"; empty for none
    values: NDArray[np.float64]  # (n, k)


def all_channels(columns: Columns, scene: Mapping[str, Any]) -> dict[str, Channel]:
    """All channels by name; a sensor takes precedence over another channel of the same name."""
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
        return (*energies, Channel(_BALANCE_CHANNEL, "balance", 0, "J"))
    if kind == "drift":
        return tuple(Channel(f"drift.{name}", "drift", i, "") for i, name in enumerate(DRIFT))
    if kind == "coordinates":
        return tuple(_coordinates(columns))
    if kind == "accelerations":
        return tuple(_accelerations(columns))
    what = f'a result has no channels of the kind "{kind}"'
    raise ResultFileError.unknown(what, kind, (*CHANNEL_KINDS, "stress"))


def count_finite_rows(tables: dict[str, NDArray[np.float64]]) -> int:
    """Number of leading rows that hold finite numbers only."""
    k = len(tables["time"])
    finite = np.ones(k, dtype=bool)
    for values in tables.values():
        finite &= np.isfinite(values.reshape(k, -1)).all(axis=1)
    return k if finite.all() else int(np.argmin(finite))


def describe_bad_row(columns: Columns, tables: dict[str, NDArray[np.float64]], row: int) -> str:
    """The sentence for a row that is not finite: its time, and at most five of its names."""
    names: list[str] = []
    for key, start in (("q", "iq"), ("v", "iv"), ("vd", "iv")):
        bad = np.flatnonzero(~np.isfinite(tables[key][row]))
        starts = [getattr(body, start) for body in columns.bodies]
        owners = np.unique(np.searchsorted(starts, bad, side="right") - 1)
        names += [f"body {columns.bodies[k].name}" for k in owners]
    labels = {
        "lam": [f"constraint {name}" for name in columns.rows],
        "reactions": [f"reaction {name}" for name in columns.reactions for _ in range(12)],
        "sensors": [f"sensor {name}" for name in columns.channels],
        "energy": [f"energy {name}" for name in columns.energies],
        "drift": [f"{name} drift" for name in DRIFT],
    }
    for key, label in labels.items():
        names += [label[i] for i in np.flatnonzero(~np.isfinite(tables[key][row]))]
    where = ", ".join(list(dict.fromkeys(names))[:5] or ["time"])
    t = tables["time"][row]
    time = f"at t = {t:g} s" if np.isfinite(t) else "in time"
    return f"the solution is no longer a finite number {time} ({where})"


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
    n = len(columns.coordinates)  # scalar coordinates come after the bodies
    for i, name in enumerate(columns.coordinates):
        state = name.startswith("states.")  # the velocity of this coordinate is the state
        own, rate = (f"{name}.integral", name) if state else (name, f"{name}.rate")
        units = ("m", "m/s") if name.endswith("position") else ("", "")  # position along a curve
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
    """Velocities or accelerations of one body: translation, rotation, modal coordinates."""
    turn = "w" if suffix == "dot" else "w_dot"
    names = [f"r_{suffix}.{axis}" for axis in "xyz"] + [f"{turn}.{axis}" for axis in "xyz"]
    names += [f"eta_{suffix}.{i}" for i in range(body.m)]
    for i, name in enumerate(names):
        yield Channel(f"{body.name}.{name}", table, body.iv + i, units[min(i // 3, 2)])


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
        Names that match nothing.
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
    """The sentence on columns that were not stored, with the request that would store them."""
    wanted = set(missing)
    lacking = [c for c in _columns(columns, scene) if c.table == table and c.number in wanted]
    groups = set.intersection(*({*c.groups} for c in lacking)) if lacking else set()
    narrow = "modal-coordinates" if "modal-coordinates" in groups else _GROUPS_OF[table][0]
    name = lacking[0].names[0] if lacking and lacking[0].names else narrow
    what = narrow if len(lacking) != 1 else name
    return f'{name} was not kept by this run; keep = ["{what}"] in [results] keeps it'


def _columns(columns: Columns, scene: Mapping[str, Any]) -> Iterator[_Column]:
    """Every column that is stored on request only."""
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
    """Sections of the scene that may be written before a name, as in ``sensors.tip``."""
    if table in ("q", "v", "vd"):
        return ("bodies",) if name.partition(".")[0] in bodies else ()
    return _SECTIONS_OF.get(table, ())


def _matching(available: Iterable[_Column], item: str) -> set[tuple[str, int]]:
    """Columns (table, number) that an item means: of a group, of an owner, or channels by
    pattern."""
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
