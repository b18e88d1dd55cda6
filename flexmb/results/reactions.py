"""Reactions of joints, couplers and drivers: which two markers, which columns, on which body.

The table holds per joint or driver twelve columns: force and moment on marker J in the axes of
marker J, then those on marker I in the axes of marker I (z: the joint's axis, on J the second one
of a joint with two; of what slides in a planar scene x is the axis, z the normal). The two are
action and reaction: equal and opposite as forces; the moments differ by the arm between the
markers. Those of drivers and couplers are not included in those of their joints; a coupler has one
for each of its joints, named ``coupler.joint``. What acts on the second angle of a universal joint
is reported on J in axes that are turned by half a turn about y: z against the axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.tables import Layout
from flexmb.errors import ResultFileError

Array = NDArray[np.float64]
NOT_UNIQUE = "reactions_not_unique"
"""The statistic that names the joints and drivers whose reactions redundant equations share."""


class Reaction(NamedTuple):
    """What a joint or driver does to a body, over time, in the joint's axes there."""

    force: Array  # (n, 3) on the marker
    moment: Array  # (n, 3) about the marker
    on: str  # the marker, such as "rod.big_end"
    by: str  # the marker on the other side
    unique: bool = True  # False: constraints are redundant, the minimum-norm reaction is reported


class MarkerPair(NamedTuple):
    """The two markers of a joint or driver."""

    path: str  # such as "joints.crank_pin"
    name: str  # the same without its section, where that is enough
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
    """Both markers of all that has a reaction, in the order of the table."""
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


def find_side(pairs: tuple[MarkerPair, ...], name: str, on: str) -> tuple[int, str, MarkerPair]:
    """Number of the joint or driver, side ``"I"`` or ``"J"``, and its markers.

    Parameters
    ----------
    pairs : tuple of MarkerPair
        From `marker_pairs`.
    name : str
        A joint or driver: ``crank_pin`` or ``joints.crank_pin``.
    on : str
        ``"I"``, ``"J"``, a body, or a marker such as ``rod.big_end``.

    Raises
    ------
    ResultFileError
        No such joint or driver, or it is not on that body.
    """
    number = next((i for i, pair in enumerate(pairs) if name in (pair.name, pair.path)), None)
    if number is None:
        what = f'the result has no reaction of "{name}"'
        raise ResultFileError.unknown(what, name, [pair.name for pair in pairs])
    pair = pairs[number]
    for side, marker, body in (("J", pair.J, pair.body_J), ("I", pair.I, pair.body_I)):
        if on in (side, marker, body):
            return number, side, pair
    allowed = dict.fromkeys((pair.body_I, pair.body_J, pair.I, pair.J, "I", "J"))
    raise ResultFileError.unknown(f'{pair.path} does not act on "{on}"', on, allowed)
