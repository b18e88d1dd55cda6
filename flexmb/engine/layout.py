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
    """Names and offsets of all columns of a compiled system.

    The scalar coordinates stand behind the bodies, in this order, in q and in v. A reaction is the
    wrench that a joint or driver transmits, twelve numbers: force and moment on marker J in its
    axes, then force and moment on marker I in its axes.
    """

    bodies: tuple[BodyColumns, ...]
    coordinates: tuple[str, ...]
    nq: int
    nv: int
    nc: int
    rows: tuple[str, ...]
    reactions: tuple[str, ...]
    channels: tuple[str, ...]
    energies: tuple[str, ...]
    fingerprint: str
