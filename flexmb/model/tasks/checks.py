"""Checks: known answers a scene carries along, with their source.

In: a table with ``sensor`` (what a run gives) or with ``body`` (a natural frequency of a flexible
body). Out: :class:`CheckSpec` or :class:`FrequencyCheckSpec`.
"""

from __future__ import annotations

from typing import Annotated

from flexmb.model.values.quantities import Integer, Measured, Quantity, Text
from flexmb.model.values.reading import Spec

__all__ = ["CheckSpec", "FrequencyCheckSpec"]


class CheckSpec(Spec):
    """At ``time`` the channel ``sensor`` is ``value`` within ``tolerance``, says ``source``."""

    sensor: Text
    time: Annotated[float, Quantity("s", "not negative")]
    value: Annotated[float, Measured()]
    tolerance: Annotated[float, Measured(sign="positive")]
    source: Text


class FrequencyCheckSpec(Spec):
    """Natural frequency number ``mode`` of the flexible ``body`` is ``value`` within ``tolerance``.

    ``held`` names interfaces that do not move; without any the body is free, and its rigid motions
    do not count.
    """

    body: Text
    held: tuple[Text, ...] = ()
    mode: Annotated[int, Integer(1)] = 1
    value: Annotated[float, Quantity("Hz", "positive")]
    tolerance: Annotated[float, Quantity("Hz", "positive")]
    source: Text
