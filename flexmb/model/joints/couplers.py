"""Couplers: one equation between coordinates of two or three joints.

Gears and racks roll on the pitch circles: their wheels hang by two joints on one common body, the
carrier (ground, or an arm that turns itself), and what counts are their motions relative to it from
the placed pose on. A linear coupler is a1 x1 + a2 x2 (+ a3 x3) = constant in the coordinates
themselves. Ratios from teeth or radii get their sign from where the axes lie (`gearing`).
Source: Hong & Liu 2011, sections 1.3, 1.7; Willis, Principles of Mechanism, 1841.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem, nearest
from flexmb.model.values.quantities import Integer, Number, Pair, Quantity, Size, Text, plain
from flexmb.model.values.reading import Reader, Spec, fail, given, names_of, read_entry

__all__ = [
    "COUPLER_TYPES",
    "AngleTerm",
    "CouplerSpec",
    "GearSpec",
    "LinearCouplerSpec",
    "RackSpec",
    "StrokeTerm",
]

_Teeth = Annotated[int, Integer(1)]


class GearSpec(Spec):
    """Two wheels in mesh, spur, bevel or of a planetary train.

    ``joints`` are those by which they hang on their common carrier. One of ``teeth``, ``radii`` and
    ``ratio``, the turns of the second wheel for one of the first, relative to the carrier and about
    the joints' own axes, negative for opposite senses. With teeth or radii the sense follows from
    the axes: wheels turn in opposite senses about parallel axes, bevel wheels as seen from where
    their axes meet, and in the same sense if one lies inside the other (``internal``).
    """

    type: Literal["gear"]
    joints: Pair
    teeth: tuple[_Teeth, _Teeth] | None = None
    radii: tuple[Size, Size] | None = None
    ratio: Number | None = None
    internal: bool = False

    @model_validator(mode="after")
    def _one_measure(self) -> Self:
        told = [key for key in ("teeth", "radii", "ratio") if getattr(self, key) is not None]
        problems = []
        if len(told) != 1:
            what = f"given {' and '.join(told)}" if told else "given none"
            problems.append(
                Problem("", f'give exactly one of "teeth", "radii" and "ratio", {what}')
            )
        elif self.ratio == 0:
            what = "is zero: the second wheel would never turn; leave the gear out, or give turns"
            problems.append(Problem("ratio", what))
        elif self.ratio is not None and self.internal:
            what = "has no say beside a ratio, whose sign tells the sense; leave it out"
            problems.append(Problem("internal", what))
        if problems:
            raise fail(*problems)
        return self


class RackSpec(Spec):
    """A pinion that rolls on a rack; ``joints`` hang the pinion, then the rack, on the carrier.

    The rack moves as the point of the pinion that is nearest to the joint of the rack.
    """

    type: Literal["rack-and-pinion"]
    joints: Pair
    radius: Size


class AngleTerm(Spec):
    """One angle in a linear coupler and its factor."""

    joint: Text
    coordinate: Literal["angle", "second_angle"]
    factor: Number


class StrokeTerm(Spec):
    """One stroke in a linear coupler and its factor."""

    joint: Text
    coordinate: Literal["stroke"]
    factor: Annotated[float, Quantity("1/m")]


_TERMS: dict[str, type[AngleTerm | StrokeTerm]] = {
    "angle": AngleTerm,
    "second_angle": AngleTerm,
    "stroke": StrokeTerm,
}


def _term(value: Any, info: ValidationInfo) -> AngleTerm | StrokeTerm:
    if isinstance(value, AngleTerm | StrokeTerm):
        return value
    asked = value.get("coordinate") if isinstance(value, dict) else "angle"
    if asked is None:
        raise fail(Problem("coordinate", "is missing", tuple(_TERMS)))
    if asked not in tuple(_TERMS):
        what = f"unknown coordinate {given(asked)}"
        raise fail(Problem("coordinate", what, tuple(_TERMS), nearest(str(asked), _TERMS)))
    spec, problems = read_entry(_TERMS[asked], value, names_of(info))
    if spec is not None and spec.factor == 0:
        problems = [Problem("factor", "is zero: leave the term out")]
    if problems or spec is None:
        raise fail(*problems)
    return spec


def _as_table(value: AngleTerm | StrokeTerm, info: SerializationInfo) -> dict[str, Any]:
    return value.model_dump(mode="json", exclude_none=True, context=info.context)


Term = Annotated[AngleTerm | StrokeTerm, Reader(_term, _as_table)]


class LinearCouplerSpec(Spec):
    """a1 x1 + a2 x2 (+ a3 x3) = ``constant``, x angles [rad] and strokes of joints.

    ``terms`` are two or three tables of ``joint``, ``coordinate`` and ``factor``.
    """

    type: Literal["linear"]
    terms: Annotated[tuple[Term, ...], BeforeValidator(plain)]
    constant: Number = 0.0

    @model_validator(mode="after")
    def _two_or_three_different(self) -> Self:
        keys = [(term.joint, term.coordinate) for term in self.terms]
        if len(keys) not in (2, 3):
            raise fail(Problem("terms", f"two or three terms are expected, given {len(keys)}"))
        twice = next((key for key in keys if keys.count(key) > 1), None)
        if twice is not None:
            what = f'the {twice[1]} of joint "{twice[0]}" stands here twice: add up its factors'
            raise fail(Problem("terms", what))
        return self


CouplerSpec = GearSpec | RackSpec | LinearCouplerSpec
COUPLER_TYPES: dict[str, type[Spec]] = {
    "gear": GearSpec,
    "rack-and-pinion": RackSpec,
    "linear": LinearCouplerSpec,
}
