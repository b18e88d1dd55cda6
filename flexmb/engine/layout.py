"""Names of everything the tables hold by index: bodies, rows, channels, energies.

Per body q = [r(3), p(4), eta(m)] starting at `iq`, and v = [r_dot(3), w(3), eta_dot(m)] starting at
`iv`; p are Euler parameters, scalar part first, and w is the angular velocity in body axes.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ENERGIES", "BodyColumns", "Layout"]

ENERGIES = ("kinetic", "strain", "gravity", "spring", "driver_work", "damper_work", "applied_work")


@dataclass(frozen=True)
class BodyColumns:
    """Where one body stands in q and v."""

    name: str
    iq: int
    iv: int
    m: int


@dataclass(frozen=True)
class Layout:
    """Names and offsets of all columns of a compiled system."""

    bodies: tuple[BodyColumns, ...]
    nq: int
    nv: int
    nc: int
    rows: tuple[str, ...]
    channels: tuple[str, ...]
    energies: tuple[str, ...]
    fingerprint: str
