"""Kinematic analysis and assembly: span and outputs; which bodies may move, where joints begin."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import model_validator

from flexmb.errors import Problem
from flexmb.model.values.quantities import Angle, Integer, Length, Time, WordOr
from flexmb.model.values.reading import Entry, Spec, fail


class KinematicsSpec(Spec):
    """Motion that joints and drivers fix alone, without integration.

    ``duration`` [s]; ``outputs`` intervals of equal length are recorded, each with positions,
    velocities, accelerations and the reactions of that motion, to round-off whatever their number.
    """

    duration: Time
    outputs: Annotated[int, Integer(1)] = 200


class GuessSpec(Spec):
    """Coordinates of a joint to begin near: ``angle``, ``stroke`` or both."""

    angle: Angle | None = None
    stroke: Length | None = None

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if self.angle is None and self.stroke is None:
            raise fail(Problem("", 'give "angle", "stroke" or both'))
        return self

    @property
    def coordinates(self) -> dict[str, float]:
        """What is guessed, by the name of the coordinate."""
        values = {"angle": self.angle, "stroke": self.stroke}
        return {name: value for name, value in values.items() if value is not None}


class AssemblySpec(Spec):
    """How the first pose is computed.

    ``weights`` by body: bodies move as little as the gaps allow, one of weight 10 as if it had ten
    times its mass, a ``"fixed"`` one not at all; 1 by default. ``guess`` by joint: coordinates near
    which the mechanism begins; of several ways to assemble it, the nearest is taken.
    """

    weights: dict[
        str,
        Annotated[float | Literal["fixed"], WordOr("fixed", "a positive number", "", "positive")],
    ] = {}
    guess: dict[str, Annotated[GuessSpec, Entry()]] = {}
