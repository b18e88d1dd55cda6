"""Numbers and values as tables and labels show them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

__all__ = ["error_text", "headings", "label", "percent", "seconds_text", "value_text"]


_SMALL = 1e-3  # smaller values are written with an exponent


def error_text(value: float) -> str:
    """Two digits: ``1.5e-6``."""
    mantissa, _, exponent = f"{value:.1e}".partition("e")
    return f"{mantissa}e{int(exponent)}" if exponent else mantissa


def seconds_text(value: float) -> str:
    """Three digits, plain where that is short."""
    return f"{value:.3g}"


def percent(share: float) -> str:
    """``1 %``."""
    return f"{100 * share:.2g} %"


def value_text(value: Any) -> str:
    """A knob's value; of a path its last part."""
    if isinstance(value, float):
        if not 0 < abs(value) < _SMALL:
            return f"{value:g}"
        mantissa, _, exponent = f"{value:.5e}".partition("e")
        return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    return PurePath(value).name if isinstance(value, str) and "/" in value else str(value)


def headings(knobs: Sequence[str]) -> dict[str, str]:
    """Knob to the shortest end of its path that no other knob has."""
    short: dict[str, str] = {}
    for knob in knobs:
        parts = knob.split(".")
        ends = [".".join(parts[i:]) for i in range(len(parts) - 1, -1, -1)]
        others = [other for other in knobs if other != knob]
        short[knob] = next(
            (end for end in ends if not any(f".{o}".endswith(f".{end}") for o in others)), knob
        )
    return short


def label(values: Mapping[str, Any]) -> str:
    """``modes=4, step=1e-05``."""
    short = headings(tuple(values))
    return ", ".join(f"{short[knob]}={value_text(value)}" for knob, value in values.items())
