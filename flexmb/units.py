"""Units: what a file's numbers mean, as factors to SI, and how results are labelled.

In: the name of a system such as ``"mm-t-s"``, or a unit such as ``"N s/m"``. Out: a
:class:`UnitSystem`, which scales and labels quantities named by their SI unit, or a :class:`Unit`.
Conversion happens once, at the border; everything inside is SI, angles in rad. Factors of the inch,
foot, pound and slug: NIST SP 811 (2008), appendix B, exact or as given there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

from flexmb.errors import FlexmbError, Problem

_INCH = 0.0254  # m, exact
_FOOT = 0.3048  # m, exact
_POUND = 0.45359237  # kg, exact
_POUND_FORCE = 4.4482216152605  # N, exact
_ROUND_OFF = 1e-12  # relative


class Dimension(NamedTuple):
    """Powers of length, mass, time, angle and electric current."""

    L: int = 0
    M: int = 0
    T: int = 0
    angle: int = 0
    current: int = 0

    def times(self, other: Dimension, power: int) -> Dimension:
        """This dimension times a power of another."""
        return Dimension(*(a + power * b for a, b in zip(self, other, strict=True)))


class Unit(NamedTuple):
    """One unit: how many SI units it is (angles: rad), and of what."""

    factor: float
    dimension: Dimension


_LENGTH, _MASS, _TIME = Dimension(L=1), Dimension(M=1), Dimension(T=1)
_ANGLE, _FREQUENCY, _FORCE = Dimension(angle=1), Dimension(T=-1), Dimension(1, 1, -2)
_PRESSURE, _ENERGY, _POWER = Dimension(-1, 1, -2), Dimension(2, 1, -2), Dimension(2, 1, -3)
_CURRENT = Dimension(current=1)
_VOLTAGE, _RESISTANCE = _POWER.times(_CURRENT, -1), _POWER.times(_CURRENT, -2)
_INDUCTANCE = _ENERGY.times(_CURRENT, -2)

UNITS: dict[str, Unit] = {
    name: Unit(factor, dimension)
    for dimension, units in (
        (_LENGTH, {"m": 1, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9}),
        (_LENGTH, {"in": _INCH, "ft": _FOOT}),
        (_MASS, {"kg": 1, "g": 1e-3, "mg": 1e-6, "t": 1e3, "tonne": 1e3, "lb": _POUND}),
        (_MASS, {"slug": _POUND_FORCE / _FOOT, "slinch": _POUND_FORCE / _INCH}),
        (_TIME, {"s": 1, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60, "h": 3600}),
        (_ANGLE, {"rad": 1, "mrad": 1e-3, "deg": math.pi / 180, "rev": 2 * math.pi}),
        (_FREQUENCY, {"Hz": 1, "kHz": 1e3}),
        (Dimension(T=-1, angle=1), {"rpm": 2 * math.pi / 60}),
        (_FORCE, {"N": 1, "mN": 1e-3, "uN": 1e-6, "µN": 1e-6, "nN": 1e-9, "kN": 1e3, "MN": 1e6}),
        (_FORCE, {"dyn": 1e-5, "lbf": _POUND_FORCE}),
        (_PRESSURE, {"Pa": 1, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "bar": 1e5}),
        (_PRESSURE, {"psi": _POUND_FORCE / _INCH**2, "psf": _POUND_FORCE / _FOOT**2}),
        (_ENERGY, {"J": 1, "mJ": 1e-3, "µJ": 1e-6, "pJ": 1e-12, "kJ": 1e3, "erg": 1e-7}),
        (_POWER, {"W": 1, "mW": 1e-3, "µW": 1e-6, "pW": 1e-12, "kW": 1e3}),
        (_CURRENT, {"A": 1, "mA": 1e-3, "kA": 1e3}),
        (_VOLTAGE, {"V": 1, "mV": 1e-3, "kV": 1e3}),
        (_RESISTANCE, {"ohm": 1, "Ω": 1, "mohm": 1e-3, "kohm": 1e3}),
        (_INDUCTANCE, {"H": 1, "mH": 1e-3, "uH": 1e-6, "µH": 1e-6}),
    )
    for name, factor in units.items()
}
"""Every unit symbol that may be written, such as in ``"30 mm"``."""

_FACTOR = re.compile(
    r"(?P<sign>[*·/]?)\s*(?P<symbol>1(?=\s*/)|[A-Za-zµΩ]+)"
    r"(?:(?:\^|\*\*)(?P<power>-?\d)|(?P<raised>[²³⁴]))?\s*"
)
_RAISED = {"²": 2, "³": 3, "⁴": 4}


@lru_cache(maxsize=256)
def parse_unit(text: str) -> Unit:
    """A unit from its text: symbols with powers, side by side or divided, such as ``"N s/m"``.

    Raises
    ------
    FlexmbError
        An unknown symbol (nearest first), or text that is no unit.
    """
    factor, dimension, at = 1.0, Dimension(), 0
    text = text.strip()
    while at < len(text):
        match = _FACTOR.match(text, at)
        if match is None or (at == 0 and match["sign"]):
            raise FlexmbError(f'"{text}" is no unit; write units as in "N s/m" or "kg m^2"')
        if match["symbol"] != "1":
            unit = UNITS.get(match["symbol"])
            if unit is None:
                raise _unknown_unit(match["symbol"])
            power = int(match["power"] or _RAISED.get(match["raised"], 1))
            power = -power if match["sign"] == "/" else power
            factor *= unit.factor**power
            dimension = dimension.times(unit.dimension, power)
        at = match.end()
    return Unit(_rounded(factor), dimension)


_WORDS = {
    "degree": "deg", "radian": "rad", "meter": "m", "metre": "m", "millimeter": "mm",
    "millimetre": "mm", "inch": "in", "second": "s", "sec": "s", "minute": "min", "hour": "h",
    "ampere": "A", "amp": "A", "volt": "V", "henry": "H",
    "newton": "N", "kilogram": "kg", "gram": "g", "pascal": "Pa", "hertz": "Hz", "mph": "km/h",
}  # fmt: skip


def _unknown_unit(symbol: str) -> FlexmbError:
    word = symbol.casefold()
    likely = _WORDS.get(word) or _WORDS.get(word.removesuffix("s"))
    force, newton, other = symbol.partition("N")  # "kNm"
    if likely is None and f"{force}{newton}" in UNITS and other in UNITS:
        likely = f"{force}{newton} {other}"
    if likely is None:
        return FlexmbError.unknown_name("unit", symbol, UNITS)
    problem = Problem("", f'unknown unit "{symbol}"', tuple(UNITS), (likely,))
    return FlexmbError.from_problems([problem])


def _rounded(factor: float) -> float:
    """Without the last digits that powers leave: 1e3*1e-3 is 1, not 1.0000000000000002."""
    return float(f"{factor:.15g}")


def _factor(length: float, mass: float, time: float, L: float, M: float, T: float) -> float:
    """Factor to SI of length^L mass^M time^T, with these units of length, mass and time."""
    return _rounded(length**L * mass**M * time**T)


@lru_cache(maxsize=1024)
def _scale(length: float, mass: float, time: float, unit: str) -> float:
    """What the like of `unit` that is made of these units is in SI."""
    L, M, T, *_ = parse_unit(unit).dimension
    return _factor(length, mass, time, L, M, T)


@dataclass(frozen=True)
class UnitSystem:
    """A consistent unit system: one unit each of length, mass and time, in SI; current is in A.

    ``symbols`` gives its own symbol for every SI symbol that is another one in this system.
    Quantities are named by their SI unit: ``system.scale("N s/m")``.
    """

    name: str
    length: float  # m
    mass: float  # kg
    time: float  # s
    symbols: Mapping[str, str] = field(default_factory=dict, compare=False)

    def factor(self, L: float = 0, M: float = 0, T: float = 0) -> float:
        """Factor to SI of a quantity of dimension length^L mass^M time^T.

        >>> unit_system("mm-t-s").factor(L=-1, M=1, T=-2)  # a pressure: MPa
        1000000.0
        """
        return _factor(self.length, self.mass, self.time, L, M, T)

    def scale(self, unit: str) -> float:
        """How many SI units `unit` one unit of this system is; angles are in rad in all systems.

        >>> unit_system("mm-t-s").scale("m/s^2")
        0.001
        """
        return _scale(self.length, self.mass, self.time, unit)

    def label(self, unit: str, raised: bool = False) -> str:
        """The unit of this system for what SI measures in `unit`; `raised`: m² for m^2.

        >>> unit_system("mm-t-s").label("N s/m")
        'N s/mm'
        """
        text = re.sub(r"[A-Za-zΩ]+", lambda m: self.symbols.get(m[0], m[0]), unit)
        for letter, power in _RAISED.items() if raised else ():
            text = text.replace(f"^{power}", letter)
        return text

    def outward(self, value: Any, unit: str) -> Any:
        """An SI number or array in the units of this system."""
        scale = self.scale(unit)
        return value if scale == 1.0 else value / scale

    def written(self, value: float, unit: str) -> float:
        """The shortest number that, read in this system, gives an SI value to the last bit."""
        scale = self.scale(unit)
        if scale == 1.0 or not math.isfinite(value):
            return value
        quotient = value / scale
        near = [quotient]
        for end in (-math.inf, math.inf):
            step = quotient
            for _ in range(3):
                step = math.nextafter(step, end)
                near.append(step)
        short = [float(f"{quotient:.{digits}g}") for digits in (14, 15, 16)]
        return next((number for number in (*short, *near) if number * scale == value), quotient)

    def say(self, value: float, unit: str, digits: int = 6) -> str:
        """An SI value as text in this system, with its unit.

        >>> unit_system("mm-t-s").say(0.03, "m")
        '30 mm'
        """
        return f"{self.outward(value, unit):.{digits}g} {self.label(unit)}".rstrip()

    def components(self, vector: Iterable[float], unit: str, scale: float = 0.0) -> str:
        """Components of an SI vector in this system, by commas; round-off is shown as 0.

        What is below 1e-12 of the largest component, or of `scale`, is round-off.
        """
        values = [float(value) for value in vector]
        least = _ROUND_OFF * max([scale, *(abs(value) for value in values)], default=0.0)
        clean = (value if abs(value) > least else 0.0 for value in values)
        return ", ".join(f"{self.outward(value, unit) if unit else value:.6g}" for value in clean)


def _system(name: str, length: float, mass: float, time: float, symbols: str) -> UnitSystem:
    """A row of the table; symbols of m, kg, s, N, Pa, J, W, Hz in this order, by commas."""
    names = dict(zip(("m", "kg", "s", "N", "Pa", "J", "W", "Hz"), symbols.split(","), strict=True))
    energy, power = names["J"], names["W"]
    if power != "W":
        names |= {"V": f"{power}/A", "ohm": f"{power}/A^2", "Ω": f"{power}/A^2"}
    if energy != "J":
        names["H"] = f"{energy}/A^2"
    return UnitSystem(name, length, mass, time, names)


SI = _system("SI", 1.0, 1.0, 1.0, "m,kg,s,N,Pa,J,W,Hz")
UNIT_SYSTEMS: dict[str, UnitSystem] = {
    system.name: system
    for system in (
        SI,
        _system("mm-t-s", 1e-3, 1e3, 1.0, "mm,t,s,N,MPa,mJ,mW,Hz"),
        _system("mm-kg-s", 1e-3, 1.0, 1.0, "mm,kg,s,mN,kPa,µJ,µW,Hz"),
        _system("mm-kg-ms", 1e-3, 1.0, 1e-3, "mm,kg,ms,kN,GPa,J,kW,kHz"),
        _system("mm-g-ms", 1e-3, 1e-3, 1e-3, "mm,g,ms,N,MPa,mJ,W,kHz"),
        _system("um-kg-s", 1e-6, 1.0, 1.0, "µm,kg,s,µN,MPa,pJ,pW,Hz"),
        _system("cm-g-s", 1e-2, 1e-3, 1.0, "cm,g,s,dyn,dyn/cm^2,erg,erg/s,Hz"),
        _system("in-lbf-s", _INCH, _POUND_FORCE / _INCH, 1.0,
                "in,slinch,s,lbf,psi,lbf in,lbf in/s,Hz"),
        _system("ft-slug-s", _FOOT, _POUND_FORCE / _FOOT, 1.0,
                "ft,slug,s,lbf,psf,lbf ft,lbf ft/s,Hz"),
    )
}  # fmt: skip


def unit_system(name: str | UnitSystem) -> UnitSystem:
    """The unit system of that name (upper and lower case alike).

    Raises
    ------
    FlexmbError
        Unknown name; lists those there are, nearest first.
    """
    if isinstance(name, UnitSystem):
        return name
    for key, system in UNIT_SYSTEMS.items():
        if key.casefold() == str(name).casefold():
            return system
    raise FlexmbError.unknown_name("unit system", str(name), UNIT_SYSTEMS, "units")


_OF_TEXTS = ContextVar("units of texts", default=SI)


@contextmanager
def lengths_in(units: UnitSystem) -> Iterator[None]:
    """Lengths and places in messages about meshes and parts have these units, those of a scene."""
    token = _OF_TEXTS.set(units)
    try:
        yield
    finally:
        _OF_TEXTS.reset(token)


def say_length(value: float, digits: int = 6) -> str:
    """A length [m] as text in the units of `lengths_in`, by default SI.

    >>> with lengths_in(unit_system("mm-t-s")):
    ...     say_length(0.03)
    '30 mm'
    """
    return _OF_TEXTS.get().say(value, "m", digits)


def say_place(point: Iterable[float], digits: int = 4) -> str:
    """A point [m] as text in the same units, ``(1, 0, 0) m``."""
    units = _OF_TEXTS.get()
    values = (f"{units.outward(float(x), 'm') + 0.0:.{digits}g}" for x in point)
    return f"({', '.join(values)}) {units.label('m')}"


def percent(share: float) -> str:
    """A share in percent, two digits below the whole.

    >>> [percent(share) for share in (0.0123, 0.996, 1.23)]
    ['1.2 %', '100 %', '123 %']
    """
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"
