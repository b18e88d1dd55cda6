"""What the columns of a result mean: names and offsets of every body, row, channel and energy.

In: the layout of a compiled system (anything with these attributes). Out: the same as plain data
that a result file stores and gives back. Per body q = [r(3), p(4), eta(m)] starting at `iq`, and
v = [r_dot(3), w(3), eta_dot(m)] starting at `iv`; p are Euler parameters, scalar part first, and w
is the angular velocity in body axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from flexmb.errors import Problem, ResultFileError, nearest

__all__ = ["BodyColumns", "Columns", "SystemLayout"]


class BodyLayout(Protocol):
    """One body of a compiled system: its name, offsets into q and v, number of modes."""

    @property
    def name(self) -> str: ...
    @property
    def iq(self) -> int: ...
    @property
    def iv(self) -> int: ...
    @property
    def m(self) -> int: ...


class SystemLayout(Protocol):
    """The layout of a compiled system, as far as a result file needs it."""

    @property
    def bodies(self) -> Sequence[BodyLayout]: ...
    @property
    def nq(self) -> int: ...
    @property
    def nv(self) -> int: ...
    @property
    def nc(self) -> int: ...
    @property
    def rows(self) -> Sequence[str]: ...
    @property
    def channels(self) -> Sequence[str]: ...
    @property
    def energies(self) -> Sequence[str]: ...
    @property
    def fingerprint(self) -> str: ...


@dataclass(frozen=True)
class BodyColumns:
    """Where one body stands in q and v."""

    name: str
    iq: int
    iv: int
    m: int


@dataclass(frozen=True)
class Columns:
    """Names and offsets of all columns of a result, as read from its file."""

    bodies: tuple[BodyColumns, ...]
    nq: int
    nv: int
    nc: int
    rows: tuple[str, ...]
    channels: tuple[str, ...]
    energies: tuple[str, ...]
    fingerprint: str

    @classmethod
    def of(cls, layout: SystemLayout) -> Columns:
        """The columns of a compiled system's layout."""
        return cls(
            bodies=tuple(
                BodyColumns(b.name, int(b.iq), int(b.iv), int(b.m)) for b in layout.bodies
            ),
            nq=int(layout.nq),
            nv=int(layout.nv),
            nc=int(layout.nc),
            rows=tuple(layout.rows),
            channels=tuple(layout.channels),
            energies=tuple(layout.energies),
            fingerprint=str(layout.fingerprint),
        )

    def body(self, name: str) -> BodyColumns:
        """The columns of the body of that name.

        Raises
        ------
        ResultFileError
            No such body; lists those there are, nearest first.
        """
        for body in self.bodies:
            if body.name == name:
                return body
        raise unknown("body", name, tuple(body.name for body in self.bodies))

    def channel(self, name: str) -> int:
        """Column of the sensor channel of that name.

        Raises
        ------
        ResultFileError
            No such channel; lists those there are, nearest first.
        """
        if name in self.channels:
            return self.channels.index(name)
        raise unknown("channel", name, self.channels)


def unknown(kind: str, name: str, names: tuple[str, ...]) -> ResultFileError:
    """The error for a name that the result does not have."""
    what = f'the result has no {kind} "{name}"'
    return ResultFileError.from_problems([Problem("", what, names, nearest(name, names))])
