"""Scalars of a run: least, largest, mean, ... of channels over its outputs.

In: names such as ``slider.x:max``, the layout of a compiled model, rows of outputs or a result.
Out: one number each, in the scene's units. A vector without its axis (``crank_pin.rod.force``) is
its length. Means are integrals over time, by trapezoids between the outputs; extremes are those of
the outputs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import Problem, nearest
from flexmb.model.scenes.sweep import SCALARS, read_scalar
from flexmb.results.channels import Channel, Columns, all_channels

if TYPE_CHECKING:
    from flexmb.model import Model
    from flexmb.results import OutputBlock, Result
    from flexmb.units import UnitSystem

Array = NDArray[np.float64]

_EXTREMES = ("min", "max")  # of channels for which no scalar is named
_RECOVERED = {  # channels that only a result file can give, and their units in SI
    "von_mises": "Pa", "stress": "Pa", "section_force": "", "mode_energy": "J", "balance": "J",
    "position": "m", "velocity": "m/s", "acceleration": "m/s^2", "angular_velocity": "rad/s",
    "angular_acceleration": "rad/s^2", "angle": "rad", "angle_rate": "rad/s",
    "second_angle": "rad", "second_angle_rate": "rad/s", "stroke": "m", "stroke_rate": "m/s",
}  # fmt: skip
_FORM = re.compile(rf"\w+(?:\.\w+)?\.({'|'.join(_RECOVERED)})(?:\..+)?|energy\.(balance)")
_AXES = "xyz"


class Scalar(NamedTuple):
    """A scalar of a channel, and the columns that it is read from; none: from a result file."""

    channel: str
    word: str  # one of SCALARS
    unit: str = ""  # that of SI
    columns: tuple[Channel, ...] = ()

    @property
    def name(self) -> str:
        """As it is written: ``slider.x:max``."""
        return f"{self.channel}:{self.word}"


def find_scalars(
    columns: Columns, model: Model, names: Sequence[str]
) -> tuple[list[Scalar], list[Problem]]:
    """The scalars of these names, of all sensors by default, and the names of nothing.

    Parameters
    ----------
    columns : Columns
        All columns of a run.
    model : Model
        Its model.
    names : sequence of str
        Such as ``slider.x:max``; without a scalar the least and the largest value.
    """
    scene = model.to_scene_dict(model.folder, dict.fromkeys(model.bodies, ""))
    by_name = all_channels(columns, scene)
    scalars: list[Scalar] = []
    problems: list[Problem] = []
    for i, text in enumerate(names or columns.channels):
        channel, word = read_scalar(text)
        owner = channel.partition(".")[0]
        matches = tuple(
            by_name[name]
            for name in ((channel,) if channel in by_name else (f"{channel}.{a}" for a in _AXES))
            if name in by_name and by_name[name].table != "balance"
        )
        form = _FORM.fullmatch(channel)
        owners = {*model.bodies, *model.joints, "energy"}
        recovered = form if form is not None and owner in owners else None
        if len(matches) not in (1, 3) and recovered is None:
            vectors = (name.removesuffix(".x") for name in by_name if name.endswith(".x"))
            allowed = tuple(dict.fromkeys((*by_name, *vectors)))
            what = f'there is no channel "{channel}"'
            problems.append(Problem(f"sensors[{i}]", what, allowed, nearest(channel, allowed)))
            continue
        kind = "" if recovered is None else recovered[1] or recovered[2]
        unit = matches[0].unit if matches else _RECOVERED[kind]
        scalars += [Scalar(channel, one, unit, matches) for one in ((word,) if word else _EXTREMES)]
    return list(dict.fromkeys(scalars)), problems


def _rms(t: Array, x: Array) -> float:
    return float(np.sqrt(_mean(t, x * x)))


def _mean(t: Array, x: Array) -> float:
    if len(t) < 2:
        return float(x[-1])
    return float(0.5 * np.sum((x[1:] + x[:-1]) * np.diff(t)) / (t[-1] - t[0]))


_FUNCTIONS: dict[str, Callable[[Array, Array], float]] = {
    "min": lambda t, x: float(x.min()),
    "max": lambda t, x: float(x.max()),
    "peak": lambda t, x: float(np.abs(x).max()),
    "peak-to-peak": lambda t, x: float(np.ptp(x)),
    "rms": _rms,
    "mean": _mean,
    "final": lambda t, x: float(x[-1]),
}
assert tuple(_FUNCTIONS) == SCALARS


def scalar_value(word: str, t: Array, x: Array) -> float:
    """A scalar of values x (n,) at times t (n,)."""
    return _FUNCTIONS[word](t, x)


def read_rows(
    scalars: Sequence[Scalar], blocks: Sequence[OutputBlock], units: UnitSystem
) -> dict[str, float]:
    """The scalars by name from the rows of a run."""
    t = np.concatenate([block.t for block in blocks])
    values: dict[str, Array] = {}
    for one in scalars:
        if one.channel not in values:
            parts = [_column(blocks, channel) for channel in one.columns]
            x = parts[0] if len(parts) == 1 else np.sqrt(sum(part * part for part in parts))
            values[one.channel] = units.outward(x, one.unit) if one.unit else x
    return {one.name: scalar_value(one.word, t, values[one.channel]) for one in scalars}


def _column(blocks: Sequence[OutputBlock], channel: Channel) -> Array:
    return np.concatenate([getattr(block, channel.table)[:, channel.column] for block in blocks])


def read_result(scalars: Sequence[Scalar], result: Result) -> dict[str, float]:
    """The scalars by name from a result.

    Raises
    ------
    ResultFileError
        It has no such channel.
    """
    t, values = np.asarray(result.time), dict[str, Array]()
    for one in scalars:
        if one.channel not in values:
            vector = [f"{one.channel}.{axis}" for axis in _AXES]
            whole = one.channel not in result and all(name in result for name in vector)
            values[one.channel] = (
                np.sqrt(sum(result[name] ** 2 for name in vector)) if whole else result[one.channel]
            )
    return {one.name: scalar_value(one.word, t, values[one.channel]) for one in scalars}
