"""Unit systems: what a file's numbers mean, as factors to SI.

In: the name of a system such as ``"mm-t-s"``. Out: a :class:`UnitSystem` whose ``factor(L, M, T)``
multiplies a number of dimension length^L mass^M time^T into SI. Conversion happens once, at the
border; everything inside is SI. Factors of the inch, foot, pound and slug: NIST SP 811 (2008),
appendix B, exact or as given there.
"""

from __future__ import annotations

from dataclasses import dataclass

from flexmb.errors import FlexmbError, Problem, nearest

__all__ = ["UNIT_SYSTEMS", "UnitSystem", "unit_system"]

_INCH = 0.0254  # m, exact
_FOOT = 0.3048  # m, exact
_POUND_FORCE = 4.4482216152605  # N, exact


@dataclass(frozen=True)
class UnitSystem:
    """A consistent unit system: one unit each of length, mass and time, in SI."""

    name: str
    length: float  # m
    mass: float  # kg
    time: float  # s

    def factor(self, L: float = 0, M: float = 0, T: float = 0) -> float:
        """Factor to SI of a quantity of dimension length^L mass^M time^T.

        >>> unit_system("mm-t-s").factor(L=-1, M=1, T=-2)  # a pressure: MPa
        1000000.0
        """
        exact = self.length**L * self.mass**M * self.time**T
        return float(f"{exact:.15g}")  # 1e3*1e-3 is 1, not 1.0000000000000002


UNIT_SYSTEMS: dict[str, UnitSystem] = {
    system.name: system
    for system in (
        UnitSystem("SI", 1.0, 1.0, 1.0),
        UnitSystem("mm-t-s", 1e-3, 1e3, 1.0),
        UnitSystem("mm-kg-s", 1e-3, 1.0, 1.0),
        UnitSystem("mm-kg-ms", 1e-3, 1.0, 1e-3),
        UnitSystem("mm-g-ms", 1e-3, 1e-3, 1e-3),
        UnitSystem("cm-g-s", 1e-2, 1e-3, 1.0),
        UnitSystem("in-lbf-s", _INCH, _POUND_FORCE / _INCH, 1.0),
        UnitSystem("ft-slug-s", _FOOT, _POUND_FORCE / _FOOT, 1.0),
    )
}


def unit_system(name: str | UnitSystem) -> UnitSystem:
    """The unit system of that name (upper and lower case alike).

    Raises
    ------
    FlexmbError
        Unknown name; lists those there are, nearest first.
    """
    if isinstance(name, UnitSystem):
        return name
    for known, system in UNIT_SYSTEMS.items():
        if known.casefold() == str(name).casefold():
            return system
    names = tuple(UNIT_SYSTEMS)
    problem = Problem("units", f'unknown unit system "{name}"', names, nearest(str(name), names))
    raise FlexmbError.from_problems([problem])
