"""Built-in linear elastic, isotropic materials with their values and sources.

In: a name such as ``"steel"``. Out: a :class:`Material` with Young's modulus E [Pa], Poisson's
ratio nu [-] and density [kg/m^3]. Handbook values for the material in general at room temperature:
grades differ by a few per cent, so give your own numbers where that matters.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from flexmb.errors import MaterialError, Problem, nearest

__all__ = ["LIBRARY", "Material", "material"]


@dataclass(frozen=True)
class Material:
    """Linear elastic, isotropic material in SI units."""

    name: str
    E: float  # Pa
    nu: float  # -
    density: float  # kg/m^3
    source: str = "given by the user"

    def __post_init__(self) -> None:
        problems = []
        if not (isfinite(self.E) and self.E > 0):
            problems.append(Problem("material.E", f"must be positive, given {self.E:g} Pa"))
        if not -1.0 < self.nu < 0.5:
            problems.append(
                Problem("material.nu", f"must lie between -1 and 0.5, given {self.nu:g}")
            )
        if not (isfinite(self.density) and self.density > 0):
            problems.append(
                Problem("material.density", f"must be positive, given {self.density:g} kg/m^3")
            )
        if problems:
            raise MaterialError.from_problems(problems)


_EN1993 = "EN 1993-1-1:2005, 3.2.6 (E, nu); EN 1991-1-1:2002, table A.4 (density)"
_EN10088 = "EN 10088-1:2014, grade 1.4301 (E, density); EN 1993-1-4:2006, 2.1.3 (nu)"
_EN1999 = "EN 1999-1-1:2007, 3.2.5"
_SHIGLEY = "Shigley's Mechanical Engineering Design, 10th ed., table A-5"
_ASHBY = (
    "Ashby, Materials Selection in Mechanical Design, appendix A, mid-range (E, density); nu usual"
)

LIBRARY: dict[str, Material] = {
    entry.name: entry
    for entry in (
        Material("steel", 210e9, 0.3, 7850.0, _EN1993),
        Material("stainless steel", 200e9, 0.3, 7900.0, _EN10088),
        Material("aluminium", 70e9, 0.3, 2700.0, _EN1999),
        Material("titanium", 114e9, 0.34, 4420.0, _SHIGLEY + ", titanium alloys"),
        Material("cast iron", 100e9, 0.211, 7200.0, _SHIGLEY + ", gray cast iron"),
        Material("brass", 106e9, 0.324, 8540.0, _SHIGLEY),
        Material("copper", 119e9, 0.326, 8900.0, _SHIGLEY),
        Material("magnesium", 44.8e9, 0.35, 1790.0, _SHIGLEY),
        Material("abs", 2.0e9, 0.4, 1110.0, _ASHBY),
        Material("nylon", 2.9e9, 0.4, 1130.0, _ASHBY),
        Material("pom", 3.8e9, 0.4, 1410.0, _ASHBY),
    )
}
_ALIASES = {"aluminum": "aluminium", "grey cast iron": "cast iron", "gray cast iron": "cast iron"}


def material(name: str | Material) -> Material:
    """The library material of that name; upper and lower case, ``_`` and ``-`` do not matter.

    Raises
    ------
    MaterialError
        Unknown name; lists those there are, nearest first.
    """
    if isinstance(name, Material):
        return name
    key = str(name).casefold().replace("_", " ").replace("-", " ").strip()
    key = _ALIASES.get(key, key)
    if key in LIBRARY:
        return LIBRARY[key]
    names = tuple(LIBRARY)
    problem = Problem("material", f'unknown material "{name}"', names, nearest(key, names))
    raise MaterialError.from_problems([problem])
