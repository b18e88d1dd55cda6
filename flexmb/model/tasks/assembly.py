"""How the first pose is found: which bodies may move, and near which joint coordinates to begin."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import ValidationInfo, model_validator

from flexmb.errors import Problem, nearest
from flexmb.model.values.quantities import Angle, Length, Quantity
from flexmb.model.values.reading import Entry, Reader, Spec, fail, given, names_of

if TYPE_CHECKING:
    from flexmb.model.scenes.scope import Scope

__all__ = ["AssemblySpec", "GuessSpec", "assembly_problems"]


def _weight(value: Any, info: ValidationInfo) -> float | str:
    if value == "fixed":
        return "fixed"
    if isinstance(value, str) and value.isalpha() and value not in names_of(info):
        what = f"a positive number is expected, given {given(value)}"
        raise fail(Problem("", what, ("fixed", "a number or an expression")))
    return Quantity("", "positive").read(value, info)


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
        told = {"angle": self.angle, "stroke": self.stroke}
        return {name: value for name, value in told.items() if value is not None}


class AssemblySpec(Spec):
    """How the first pose is found.

    ``weights`` by body: bodies move as little as the gaps allow, one of weight 10 as if it had ten
    times its mass, a ``"fixed"`` one not at all; 1 by default. ``guess`` by joint: coordinates near
    which the mechanism begins; of several ways to assemble it, the nearest is taken.
    """

    weights: dict[str, Annotated[float | Literal["fixed"], Reader(_weight)]] = {}
    guess: dict[str, Annotated[GuessSpec, Entry()]] = {}


def assembly_problems(scope: Scope) -> Iterator[Problem]:
    """Bodies and joints that do not exist, and guesses of what is driven."""
    spec = scope.model.assembly
    if spec is None:
        return
    for name in spec.weights:
        if not scope.has("bodies", name):
            bodies = scope.names("bodies")
            what = f'unknown body "{name}"'
            yield Problem(f"assembly.weights.{name}", what, bodies, nearest(name, bodies))
    driven = {
        (driver.joint, motion.coordinate): name
        for name, driver in scope.model.drivers.items()
        for motion in driver.motions(scope.model.plane)
        if driver.joint is not None
    }
    for joint, guess in spec.guess.items():
        if not scope.has("joints", joint):
            joints = scope.names("joints")
            what = f'unknown joint "{joint}"'
            yield Problem(f"assembly.guess.{joint}", what, joints, nearest(joint, joints))
            continue
        for coordinate in guess.coordinates:
            where = f"assembly.guess.{joint}"
            yield from scope.coordinate(where, joint, coordinate)
            if (joint, coordinate) in driven:
                what = f'its {coordinate} is driven by "{driven[joint, coordinate]}": '
                what += "leave the guess out, the driver decides"
                yield Problem(f"{where}.{coordinate}", what)
