"""Built-in linear elastic, isotropic materials with their values and sources.

In: a name such as ``"steel"``. Out: a :class:`Material` with Young's modulus E [Pa], Poisson's
ratio nu [-] and density [kg/m^3], with where they are from. Typical values at room temperature, of
standards and handbooks (unit weights of a table are divided by 9.80665 m/s^2 and rounded to three
digits): grades differ by a few per cent, plastics by half, so give your own where that matters.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from flexmb.errors import MaterialError, Problem, nearest

__all__ = ["COLUMNS", "LIBRARY", "Material", "material", "table"]


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
_EN1563 = "EN 1563, informative annex, ferritic grade EN-GJS-400-18"
_EN1992 = (
    "EN 1992-1-1:2004, C30/37, table 3.1 (E), 3.1.3 (nu); EN 1991-1-1:2002, table A.1 (density)"
)
_EN572 = "EN 572-1:2012, soda lime silicate glass"
_SHIGLEY = "Shigley's Mechanical Engineering Design, 10th ed., table A-5"
_ASHBY = (
    "Ashby, Materials Selection in Mechanical Design, appendix A: middle of the range (E, density);"
    " nu: 0.4 taken for all thermoplastics"
)

LIBRARY: dict[str, Material] = {
    entry.name: entry
    for entry in (
        Material("steel", 210e9, 0.3, 7850.0, _EN1993),
        Material("stainless steel", 200e9, 0.3, 7900.0, _EN10088),
        Material("aluminium", 70e9, 0.3, 2700.0, _EN1999),
        Material("titanium", 114e9, 0.34, 4430.0, _SHIGLEY + ", titanium alloys"),
        Material("cast iron", 100e9, 0.211, 7200.0, _SHIGLEY + ", gray cast iron"),
        Material("ductile iron", 169e9, 0.275, 7100.0, _EN1563),
        Material("brass", 106e9, 0.324, 8540.0, _SHIGLEY),
        Material("bronze", 111e9, 0.349, 8170.0, _SHIGLEY + ", phosphor bronze"),
        Material("copper", 119e9, 0.326, 8900.0, _SHIGLEY),
        Material("magnesium", 44.8e9, 0.35, 1790.0, _SHIGLEY),
        Material("inconel", 214e9, 0.29, 8490.0, _SHIGLEY),
        Material("concrete", 33e9, 0.2, 2450.0, _EN1992),
        Material("glass", 70e9, 0.2, 2500.0, _EN572),
        Material("abs", 2.0e9, 0.4, 1110.0, _ASHBY),
        Material("nylon", 2.9e9, 0.4, 1130.0, _ASHBY),
        Material("pom", 3.8e9, 0.4, 1410.0, _ASHBY),
    )
}
_ALIASES = {"aluminum": "aluminium", "grey cast iron": "cast iron", "gray cast iron": "cast iron"}

COLUMNS = ("material", "E [GPa]", "nu", "density [kg/m³]", "source of the typical values")
"""Headings of the rows of :func:`table`."""


def table() -> list[tuple[str, ...]]:
    """The library as rows of text, one for each material; columns as `COLUMNS` says."""
    return [
        (m.name, f"{m.E / 1e9:g}", f"{m.nu:g}", f"{m.density:g}", m.source)
        for m in LIBRARY.values()
    ]


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
