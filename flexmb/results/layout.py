"""The columns of a result by name: the layout of the compiled system, with look-up.

In: the layout as the engine made it, or as a file gives it back. Out: offsets of bodies and
channels, or the names there are.
"""

from __future__ import annotations

from dataclasses import dataclass

from flexmb.engine.layout import BodyColumns, Layout
from flexmb.errors import Problem, ResultFileError, nearest

__all__ = ["BodyColumns", "Columns"]


@dataclass(frozen=True)
class Columns(Layout):
    """Names and offsets of all columns of a result."""

    @classmethod
    def of(cls, layout: Layout) -> Columns:
        """The columns of a compiled system's layout."""
        return cls(**vars(layout))

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
