"""Named forms of functions of time: a constant, a polynomial, a harmonic, a Fourier series.

In: the numbers of a table such as ``{type = "harmonic", amplitude = 2, frequency = 50}``, in the
scene's units. Out: operations over t in SI, the same that expressions lower to.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ValidationInfo

from flexmb.errors import Problem, SceneError
from flexmb.model.functions.expression import Ops, parse
from flexmb.model.values.quantities import Angle, Measured, Quantity, plain, read_number
from flexmb.model.values.reading import (
    Names,
    Reader,
    Spec,
    fail,
    given,
    names_of,
    slot_of,
    under,
    units_of,
)

__all__ = [
    "Constant",
    "Fourier",
    "FunctionForm",
    "Harmonic",
    "Moment",
    "Ordinate",
    "Polynomial",
]


def _coefficients(value: Any, info: ValidationInfo) -> tuple[float, ...]:
    """Numbers c0, c1, c2, ... of which the k-th is a value over time to the power k."""
    names = names_of(info)
    value = plain(value)
    if not isinstance(value, list):
        raise fail(Problem("", f"a list is expected, given {given(value)}"))
    slot = slot_of(names) or ""
    powers = ("", "/s", *(f"/s^{k}" for k in range(2, len(value))))
    found, problems = [], []
    for k, item in enumerate(value):
        unit = (slot or "1") + powers[k] if k else slot
        try:
            found.append(read_number(item, names, unit) * units_of(names).scale(unit))
        except SceneError as error:
            problems += under(f"[{k}]", error.problems)
    if problems:
        raise fail(*problems)
    return tuple(found)


Ordinate = Annotated[float, Measured()]
Moment = Annotated[float, Quantity("s")]


class FunctionForm(Spec):
    """Base of the named forms; each turns its numbers, in SI, into operations over t."""

    def ops(self) -> Ops:
        raise NotImplementedError

    def written(self, table: Any, names: Names) -> Any:
        """What the user gave, such that it can be read without any other file."""
        return table


class Constant(FunctionForm):
    """value"""

    type: Literal["constant"]
    value: Ordinate

    def ops(self) -> Ops:
        return (("const", self.value),)


class Polynomial(FunctionForm):
    """c0 + c1 t + c2 t^2 + ..., with coefficients = [c0, c1, c2, ...]"""

    type: Literal["polynomial"]
    coefficients: Annotated[tuple[float, ...], Reader(_coefficients)]

    def ops(self) -> Ops:
        """Horner's scheme."""
        *lower, highest = self.coefficients or (0.0,)
        program: Ops = (("const", highest),)
        for c in reversed(lower):
            program = (*program, ("t", 0.0), ("*", 0.0), ("const", c), ("+", 0.0))
        return program


class Harmonic(FunctionForm):
    """offset + amplitude sin(2 pi frequency t + phase), frequency in cycles per unit of time"""

    type: Literal["harmonic"]
    amplitude: Ordinate
    frequency: Annotated[float, Quantity("Hz")]
    phase: Angle = 0.0
    offset: Ordinate = 0.0

    def ops(self) -> Ops:
        names = {"a": self.amplitude, "w": 2 * math.pi * self.frequency}
        names |= {"phase": self.phase, "offset": self.offset}
        return parse("offset + a*sin(w*t + phase)", names).ops


Amplitudes = Annotated[tuple[Ordinate, ...], BeforeValidator(plain)]


class Fourier(FunctionForm):
    """offset + sum over k = 1, 2, ... of a_k cos(k w t + phase) + b_k sin(k w t + phase),

    with w = 2 pi frequency, cosine = [a_1, a_2, ...] and sine = [b_1, b_2, ...]
    """

    type: Literal["fourier"]
    frequency: Annotated[float, Quantity("Hz")]
    cosine: Amplitudes = ()
    sine: Amplitudes = ()
    phase: Angle = 0.0
    offset: Ordinate = 0.0

    def ops(self) -> Ops:
        names = {"offset": self.offset, "w": 2 * math.pi * self.frequency, "phase": self.phase}
        terms = ["offset"]
        for wave, letter, amplitudes in (("cos", "a", self.cosine), ("sin", "b", self.sine)):
            for k, amplitude in enumerate(amplitudes, start=1):
                names[f"{letter}{k}"] = amplitude
                terms.append(f"{letter}{k}*{wave}({k}*w*t + phase)")
        program: Ops = ()
        for term in terms:  # each by itself: a long sum would nest too deeply for a parser
            program = (*program, *parse(term, names).ops, *((("+", 0.0),) if program else ()))
        return program
