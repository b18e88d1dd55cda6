"""Options for the damping of a flexible body: damping ratios over its natural frequencies.

A ratio of 1 is critical damping. Sources: Rayleigh damping α M + β K has the ratio α/(2ω) + βω/2
(Clough & Penzien, Dynamics of Structures, 2nd ed., §12-3). The preset "adams" is what Adams Solver
takes if a FLEX_BODY has no CRATIO (see its documentation of FLEX_BODY): 1 % below 100 Hz, 10 %
below 1 kHz, 100 % above.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np

from flexmb.errors import FlexmbError, Problem
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.options import Say, Unit, read_options

_Ratio = Annotated[float, Unit("", "not negative")]
_Frequency = Annotated[float, Unit("Hz", "positive")]
_ROUND_OFF = 1e-12

PRESETS = ("adams",)
LAWS = ("ratio", "bands", "table", "rayleigh", "preset")
WHICH_MODES = {
    "joined": "as joined",
    "clamped": "with all interfaces held",
    "free": "of the free body",
}
"""Which modes the ratios belong to, in words."""


@dataclass(frozen=True, kw_only=True)
class Band:
    """The ratio of all modes from one frequency to below another; open where one is left out."""

    above: Annotated[float, Unit("Hz", "not negative")] = 0.0
    below: _Frequency | None = None
    ratio: _Ratio


@dataclass(frozen=True, kw_only=True)
class RatioTable:
    """Ratios at ascending frequencies; linear between them, constant beyond."""

    frequencies: tuple[_Frequency, ...]
    ratios: tuple[_Ratio, ...]

    def check(self, say: Say) -> list[Problem]:
        """As many ratios as frequencies, which ascend."""
        return _list_problems(self.frequencies, self.ratios)


@dataclass(frozen=True, kw_only=True)
class Rayleigh:
    """Damping alpha M + beta K, by its coefficients or by the ratios at two frequencies."""

    alpha: Annotated[float, Unit("1/s", "not negative")] | None = None
    beta: Annotated[float, Unit("s", "not negative")] | None = None
    frequencies: tuple[_Frequency, ...] | None = None
    ratios: tuple[_Ratio, ...] | None = None

    def check(self, say: Say) -> list[Problem]:
        """Coefficients, or two ratios that need no negative ones."""
        words = [name for name in ("alpha", "beta", "frequencies", "ratios")
                 if getattr(self, name) is not None]  # fmt: skip
        if words not in (["alpha"], ["beta"], ["alpha", "beta"], ["frequencies", "ratios"]):
            what = "give alpha, beta or both, or two frequencies with their ratios"
            return [Problem("", f"has {' and '.join(words) or 'nothing'}; {what}")]
        f, z = self.frequencies or (), self.ratios or ()
        if not f:
            return []
        if problems := _list_problems(f, z):
            return problems
        if len(f) > 2:
            return [Problem("frequencies", "two are expected; more of them make a table")]
        coefficients = rayleigh_coefficients(self)
        if min(coefficients) >= -_ROUND_OFF * max(coefficients):
            return []
        name, value = ("alpha", "beta")[np.argmin(coefficients)], min(coefficients)
        what = f"need a negative {name}, {value:.3g}, which feeds energy in: the second must lie"
        limits = f"between {f[0] / f[1]:.4g} and {f[1] / f[0]:.4g} times the first"
        return [Problem("ratios", f"{what} {limits}")]


@dataclass(frozen=True, kw_only=True)
class DampingOptions:
    """Damping ratios of a flexible body's modes: of all, by bands, table or two coefficients.

    `modes` has those of single modes by number, from 1 on. `of` says which modes: of the body as
    the scene joins it, with all interfaces held, or of the free body. What vibrates above
    `critical_above` is damped critically.
    """

    ratio: _Ratio | None = None
    bands: tuple[Band, ...] | None = None
    table: RatioTable | None = None
    rayleigh: Rayleigh | None = None
    preset: Literal["adams"] | None = None
    modes: dict[str, _Ratio] | None = None
    of: Literal["joined", "clamped", "free"] = "joined"
    critical_above: _Frequency | None = None

    def check(self, say: Say) -> list[Problem]:
        """One law, ratios up to 1, numbers of modes, bands without gaps."""
        problems = []
        words = [name for name in LAWS if getattr(self, name) is not None]
        if len(words) > 1 or not (words or self.modes or self.critical_above):
            what = f"has {' and '.join(words) or 'no ratios'}; give one of them"
            problems.append(Problem("", what, LAWS))
        modes: Any = {} if self.modes is None else self.modes
        if not isinstance(modes, Mapping):
            return [Problem("modes", f"a table {{number = ratio}} is expected, given {modes!r}")]
        ratios: dict[str, float | None] = {"ratio": self.ratio}
        ratios |= {f"modes.{k}": value for k, value in modes.items()}
        ratios |= {f"bands[{k}].ratio": band.ratio for k, band in enumerate(self.bands or ())}
        for name, part in (("table", self.table), ("rayleigh", self.rayleigh)):
            listed = (part and part.ratios) or ()
            ratios |= {f"{name}.ratios[{k}]": one for k, one in enumerate(listed)}
        for where, value in ratios.items():
            if value is not None and not 0.0 <= value <= 1.0:
                percent = f"; {value:g} % is {value / 100:g}" if 1.0 < value <= 100.0 else ""
                what = f"must lie between 0 and 1 (critical damping), is {value:g}{percent}"
                problems.append(Problem(where, what))
        problems += [
            Problem(f"modes.{number}", "is no number of a mode: 1, 2, 3, ... by frequency")
            for number in modes
            if not (number.isdecimal() and int(number) > 0)
        ]
        return problems + ([] if self.bands is None else _band_problems(self.bands, say))

    def ratios(self, frequencies: FloatArray) -> FloatArray:
        """Ratios (k,) by the law alone, at frequencies (k,) [Hz]."""
        f = np.asarray(frequencies, dtype=float)
        z = np.full(f.shape, self.ratio or 0.0)
        for band in _ADAMS if self.preset else self.bands or ():
            below = np.inf if band.below is None else band.below
            z[(f >= band.above) & (f < below)] = band.ratio
        if self.table is not None:
            z = np.interp(f, self.table.frequencies, self.table.ratios)
        if self.rayleigh is not None:
            alpha, beta = rayleigh_coefficients(self.rayleigh)
            z = alpha / (4 * np.pi * f) + np.pi * beta * f
        if self.critical_above is not None:
            z = np.where(f > self.critical_above, np.maximum(z, 1.0), z)
        return np.asarray(z)

    def ratios_of_modes(self, frequencies: FloatArray, where: str) -> FloatArray:
        """Ratios (k,) of modes 1, 2, ... of these frequencies (k,), ascending [Hz].

        Raises
        ------
        FlexmbError
            A mode that does not exist, or a cut-off frequency below all of them.
        """
        f, z = frequencies, self.ratios(frequencies)
        there = f"the body has {len(f)} modes {WHICH_MODES[self.of]}"
        there += f", from {f[0]:.4g} Hz on" if len(f) else ""
        problems = [
            Problem(f"{where}.modes.{number}", f"there is no such mode: {there}")
            for number in self.modes or {}
            if int(number) > len(f)
        ]
        if self.critical_above is not None and not np.any(f <= self.critical_above):
            what = f"{self.critical_above:.4g} Hz is below all modes: {there}"
            problems.append(Problem(f"{where}.critical_above", what))
        if problems:
            raise FlexmbError.from_problems(problems)
        for number, ratio in (self.modes or {}).items():
            z[int(number) - 1] = ratio
        return z

    def sentence(self) -> str:
        """The options in short, as text."""
        parts = [] if self.ratio is None else [f"{100 * self.ratio:.4g} %"]
        parts += [] if not self.bands else [f"{len(self.bands)} bands"]
        parts += [] if self.table is None else [f"table of {len(self.table.ratios)} ratios"]
        parts += [] if self.preset is None else [f'preset "{self.preset}"']
        if self.rayleigh is not None:
            alpha, beta = rayleigh_coefficients(self.rayleigh)
            parts.append(f"Rayleigh with alpha = {alpha:.4g} 1/s, beta = {beta:.4g} s")
        parts += [f"mode {k} {100 * z:.4g} %" for k, z in (self.modes or {}).items()]
        if self.critical_above is not None:
            parts.append(f"critical above {self.critical_above:.4g} Hz")
        return f"{', '.join(parts)} of the modes {WHICH_MODES[self.of]}"


_ADAMS = (
    Band(below=100.0, ratio=0.01),
    Band(above=100.0, below=1000.0, ratio=0.1),
    Band(above=1000.0, ratio=1.0),
)


def damping_table(words: Any) -> Any:
    """The table for a single ratio of all modes or for the name of a preset; tables unchanged."""
    if isinstance(words, str):
        return {"preset": words}
    if not isinstance(words, Mapping):
        return {"ratio": words}
    modes = words.get("modes")
    if not isinstance(modes, Mapping):
        return words
    return {**words, "modes": {str(number): ratio for number, ratio in modes.items()}}


def read_damping(words: Any, where: str = "damping") -> DampingOptions | None:
    """Damping from plain data in SI: a ratio of all modes, the name of a preset, or a table.

    Raises
    ------
    FlexmbError
        Everything that is wrong with it.
    """
    if words is None or isinstance(words, DampingOptions):
        return words
    try:
        damping: DampingOptions = read_options(
            DampingOptions, damping_table(words), where, FlexmbError
        )
    except FlexmbError as error:
        alone = not isinstance(words, Mapping)
        problems = (replace(p, where=where) if alone else p for p in error.problems)
        raise FlexmbError.from_problems(problems) from None
    return damping


def plain_options(value: Any) -> Any:
    """Damping as plain data, without options that are not set."""
    if isinstance(value, DampingOptions):
        value = asdict(value)
    if isinstance(value, Mapping):
        return {k: plain_options(item) for k, item in value.items() if item is not None}
    return [plain_options(item) for item in value] if isinstance(value, list | tuple) else value


def rayleigh_coefficients(part: Any) -> tuple[float, float]:
    """Alpha [1/s] and beta [s] of Rayleigh damping, of options or a specification of them."""
    if part.frequencies is None:
        return part.alpha or 0.0, part.beta or 0.0
    (w1, w2), (z1, z2) = (2.0 * np.pi * f for f in part.frequencies), part.ratios
    both = 2.0 / (w2**2 - w1**2)
    return w1 * w2 * both * (z1 * w2 - z2 * w1), both * (z2 * w2 - z1 * w1)


def _list_problems(f: tuple[float, ...], z: tuple[float, ...]) -> list[Problem]:
    if len(f) != len(z) or len(f) < 2:
        what = f"two or more frequencies and as many ratios are expected, given {len(f)}, {len(z)}"
        return [Problem("", what)]
    return [Problem("frequencies", "must ascend")] if any(b <= a for a, b in pairwise(f)) else []


def _band_problems(bands: tuple[Any, ...], say: Say) -> list[Problem]:
    """Bands must follow one another from 0 on, without gaps."""
    if not bands:
        return [Problem("bands", "one band or more is expected, given []")]
    rows = [(band.above, np.inf if band.below is None else band.below) for band in bands]
    problems = [
        Problem(f"bands[{k}]", f"must end above {say(start, 'Hz')}, where it begins")
        for k, (start, end) in enumerate(rows)
        if not end > start
    ]
    if problems:
        return problems
    reached, before = 0.0, -1
    for k in [*sorted(range(len(rows)), key=rows.__getitem__), -1]:
        start, end = (np.inf, np.inf) if k < 0 else rows[k]
        upto = f"to {say(start, 'Hz')}" if np.isfinite(start) else "on"
        if start > reached:
            what = "no band has a ratio for modes from"
            problems.append(Problem("bands", f"{what} {say(reached, 'Hz')} {upto}; 0 is none"))
        elif start < reached:
            what = f"overlaps bands[{before}] from {say(start, 'Hz')} on"
            problems.append(Problem(f"bands[{k}]", what))
        if end > reached:
            reached, before = end, k
    return problems
