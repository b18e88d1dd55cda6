"""Checks: known answers a scene carries along, with their source."""

from __future__ import annotations

from typing import Annotated

from flexmb.model.quantities import Measured, Quantity, Text
from flexmb.model.reading import Spec

__all__ = ["CheckSpec"]


class CheckSpec(Spec):
    """At ``time`` the channel ``sensor`` is ``value`` within ``tolerance``, says ``source``."""

    sensor: Text
    time: Annotated[float, Quantity("s", "not negative")]
    value: Annotated[float, Measured()]
    tolerance: Annotated[float, Measured(sign="positive")]
    source: Text
