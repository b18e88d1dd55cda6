"""Contacts: pairs of simple shapes on two markers that push each other apart when they overlap.

Normal force K d^n (1 + chi d'/d0'), d the depth and d0' the speed of the impact, never a pull (Hunt
and Crossley 1975). The damping chi follows from the coefficient of restitution e:

- exact: chi (1 + e) = ln((1 + chi)/(1 - chi e)), for which the law gives e back at all speeds
  (Gonthier, McPhee, Lange & Piedboeuf, Multibody Syst. Dyn. 11 (2004) 209);
- flores: chi = 8 (1 - e)/(5 e) (Flores, Machado, Silva & Martins, Multibody Syst. Dyn. 25 (2011)
  357), a few percent off below e = 0.8;
- lankarani-nikravesh: chi = 3 (1 - e^2)/4 (J. Mech. Design 112 (1990) 369), for e near 1.

K by Hertz needs round shapes and their materials.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.bodies.option_specs import MaterialField
from flexmb.model.forces.friction import Friction
from flexmb.model.values.quantities import Axis, Integer, Pair, Position, Quantity, Size, Text
from flexmb.model.values.reading import Reader, Spec, Variant, fail

__all__ = [
    "CONTACT_SHAPES",
    "PAIRS",
    "ContactSpec",
    "CylinderSide",
    "PlaneSide",
    "PointsSide",
    "SphereSide",
    "damping_factor",
]


class SphereSide(Spec):
    """A sphere about the marker."""

    type: Literal["sphere"] = "sphere"
    radius: Size


class PlaneSide(Spec):
    """A plane through the marker; what it meets is where its normal ``axis`` leads.

    ``axis`` is a global direction in the placed pose, by default z of the marker.
    """

    type: Literal["plane"] = "plane"
    axis: Axis | None = None


class CylinderSide(Spec):
    """A round cylinder about the marker, touched from outside, or a bore, from inside.

    ``axis`` is a global direction in the placed pose, by default z of the marker; ``length`` lies
    half on each side of the marker, without it the cylinder is endless. Its ends do not touch.
    """

    type: Literal["cylinder"] = "cylinder"
    radius: Size
    axis: Axis | None = None
    length: Size | None = None
    side: Literal["outside", "inside"] = "outside"


class PointsSide(Spec):
    """Points of the marker's body, each of which makes contact by itself.

    ``points`` in the body frame, or those of the mesh of a flexible body: ``nodes`` by their
    numbers or ``"surface"`` for all that are drawn, or the nodes of a named ``group``.
    """

    type: Literal["points"] = "points"
    points: tuple[Position, ...] | None = None
    nodes: tuple[Annotated[int, Integer(0)], ...] | Literal["surface"] | None = None
    group: Text | None = None

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        told = [key for key in ("points", "nodes", "group") if getattr(self, key) is not None]
        if len(told) != 1:
            raise fail(Problem("", 'give exactly one of "points", "nodes" and "group"'))
        if not getattr(self, told[0]):
            raise fail(Problem(told[0], "is an empty list"))
        return self


CONTACT_SHAPES: dict[str, type[Spec]] = {
    "sphere": SphereSide,
    "plane": PlaneSide,
    "cylinder": CylinderSide,
    "points": PointsSide,
}
PAIRS = (
    ("sphere", "sphere"),
    ("sphere", "plane"),
    ("sphere", "cylinder"),
    ("points", "plane"),
    ("points", "sphere"),
    ("points", "cylinder"),
)
"""Pairs of shapes that can touch, in either order."""

_Side = Annotated[Any, Variant("contact shape", lambda: CONTACT_SHAPES)]


def _restitution(value: Any, info: ValidationInfo) -> float:
    number = Quantity().read(value, info)
    if not 0 <= number <= 1:
        raise fail(Problem("", f"must lie between 0 and 1, is {number:g}"))
    return number


def _exponent(value: Any, info: ValidationInfo) -> float:
    number = Quantity().read(value, info)
    if not 1 <= number <= 5:
        raise fail(Problem("", f"must lie between 1 and 5, is {number:g}"))
    return number


class ContactSpec(Spec):
    """Contact between ``shapes`` on the markers ``between``.

    ``stiffness`` K with the ``exponent`` n (K d^n, numbers in the units of the scene), or the
    ``materials`` of both sides, from which and the radii Hertz' law follows; ``restitution`` with
    the law of ``damping``. Impacts slower than ``least_speed`` are damped as those of that speed.
    """

    type: Literal["contact"]
    between: Pair
    shapes: tuple[_Side, _Side]
    stiffness: Annotated[float, Quantity("N/m", "positive")] | None = None
    exponent: Annotated[float, Reader(_exponent)] = 1.5
    materials: tuple[MaterialField, MaterialField] | None = None
    restitution: Annotated[float, Reader(_restitution)] = 1.0
    damping: Literal["exact", "flores", "lankarani-nikravesh"] = "exact"
    least_speed: Annotated[float, Quantity("m/s", "positive")] = 1e-3
    friction: Friction | None = None

    @model_validator(mode="after")
    def _words_fit(self) -> Self:
        problems = [*self._pair_problems(), *self._stiffness_problems()]
        if self.restitution == 0 and self.damping != "lankarani-nikravesh":
            what = f'"{self.damping}" damping of no rebound at all is infinite'
            cure = 'give a small restitution, or damping = "lankarani-nikravesh"'
            problems.append(Problem("restitution", f"{what}: {cure}"))
        if problems:
            raise fail(*problems)
        return self

    def _pair_problems(self) -> list[Problem]:
        kinds = self.kinds
        if kinds in PAIRS or kinds[::-1] in PAIRS:
            return []
        what = f"there is no contact between {kinds[0]} and {kinds[1]}"
        return [Problem("shapes", what, tuple(f"{a} - {b}" for a, b in PAIRS))]

    def _stiffness_problems(self) -> list[Problem]:
        if (self.stiffness is None) == (self.materials is None):
            return [Problem("", 'give either "stiffness" or "materials" (for Hertz\' law)')]
        if self.materials is None:
            return []
        problems = []
        if "points" in self.kinds:
            what = "a point has no radius, so Hertz' law says nothing: give stiffness"
            problems.append(Problem("materials", what))
        if self.exponent != 1.5:
            problems.append(Problem("exponent", "is 1.5 in Hertz' law; leave it out"))
        for k, found in enumerate(self.materials):
            if not hasattr(found, "nu") or isinstance(found.nu, tuple):
                what = "Hertz' law needs a material that is the same in all directions"
                problems.append(Problem(f"materials[{k}]", what))
        return problems

    @property
    def kinds(self) -> tuple[str, str]:
        """Names of the two shapes."""
        return self.shapes[0].type, self.shapes[1].type

    @property
    def round_side(self) -> int:
        """The side that is a sphere or points, 0 or 1; of two spheres the first."""
        return 0 if self.kinds in PAIRS else 1


def damping_factor(restitution: float, law: str) -> float:
    """chi of a coefficient of restitution in [0, 1].

    >>> damping_factor(1.0, "exact")
    0.0
    """
    e = restitution
    if e == 1.0:
        return 0.0
    if law == "flores":
        return 8.0 * (1.0 - e) / (5.0 * e)
    if law == "lankarani-nikravesh":
        return 0.75 * (1.0 - e * e)
    low, high = 0.0, 1.0 / e
    for _ in range(
        200
    ):  # bisection: the left side grows slower than the right one from its root on
        chi = 0.5 * (low + high)
        more = math.log1p(chi) - math.log1p(-chi * e) if chi * e < 1.0 else math.inf
        low, high = (chi, high) if chi * (1.0 + e) > more else (low, chi)
    return 0.5 * (low + high)
