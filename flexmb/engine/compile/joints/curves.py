"""Curves on their markers, and the table of curve markers.

A curve marker brings one scalar coordinate, so a joint has one equation less than rows for each.
The force across the curve is the multiplier of one row; `Contact` tells its sign in contact.
Sources: Haug, Computer Aided Kinematics and Dynamics, 1989, §3.5; Hong & Liu 2011, §1.3.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.joints.coordinates import Scalar
from flexmb.engine.compile.joints.curve_pieces import Pieces, pieces_of
from flexmb.engine.tables import CURVE_MARKER
from flexmb.errors import FlexmbWarning
from flexmb.model import lookup
from flexmb.model.bodies.markers import PlacedMarker
from flexmb.model.joints.curve import curve_shape
from flexmb.model.model import Model
from flexmb.model.values.names import GROUND
from flexmb.model.values.orientation import rotation_matrix

if TYPE_CHECKING:
    from flexmb.engine.symbolic import Symbolic

__all__ = ["Contact", "Laid", "Slider", "Sliders", "X", "Y", "Z", "lay", "placed_frame"]

Array = NDArray[np.float64]
X, Y, Z = 0, 1, 2
_SAMPLES = 1440  # places along a curve that are tried
_TOLD = 1e-9  # error of the pieces over the size of the curve


class Contact(NamedTuple):
    """A joint that can only push: its row across the curve, and the sign of λ when it does."""

    joint: str
    row: int
    compressed: float


@dataclass(frozen=True)
class Laid:
    """A curve as one marker carries it in the placed pose: x (3,), R (3, 3), global."""

    name: str
    pieces: Pieces
    closed: bool
    turns: bool
    x: Array
    R: Array

    @property
    def length(self) -> float:
        """Length of the curve [m]."""
        return float(self.pieces.ends[-1])

    @property
    def samples(self) -> Array:
        """Places (n,) along the curve, the end of a closed one left out."""
        return np.linspace(0.0, self.length, _SAMPLES, endpoint=not self.closed)

    @property
    def outward(self) -> float:
        """1 if the normal, left of the tangent, leads out of a closed curve, −1 if into it."""
        c = self.pieces.at(self.samples)
        area = np.sum(c[:, 0, X] * c[:, 1, Y] - c[:, 0, Y] * c[:, 1, X])
        return -1.0 if area > 0.0 else 1.0

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """Global points, tangents and normals (n, 3) at places (n,)."""
        c = self.pieces.at(s)
        t = c[:, 1]
        n = np.stack([-t[:, Y], t[:, X], 0.0 * t[:, X]], axis=1)
        return self.x + c[:, 0] @ self.R.T, t @ self.R.T, n @ self.R.T


class Slider(NamedTuple):
    """One curve marker on the way into its table."""

    joint: str
    marker: int
    at: int
    pieces: int
    closed: bool
    turns: bool
    group: int
    side: int
    other: int
    start: float


@dataclass
class Sliders:
    """The curve markers of a model, and the contacts among their joints."""

    found: list[Slider] = field(default_factory=list)
    contacts: list[Contact] = field(default_factory=list)

    def scalars(self) -> list[Scalar]:
        """Their places along the curves."""
        words = ("position", "second_position")
        return [
            Scalar(f"joints.{s.joint}.{words[s.other >= 0 and s.other < k]}", angular=False)
            for k, s in enumerate(self.found)
        ]

    def starts(self) -> list[float]:
        """Where along the curves they begin [m]."""
        return [s.start for s in self.found]

    def number(self, joint: str, on: str) -> int:
        """Number of the curve marker of a joint on the curve of its marker I or J."""
        mine = [k for k, s in enumerate(self.found) if s.joint == joint]
        return mine[1 if on == "J" else 0]

    def couples(self, groups: list[tuple[int, int, int, int]], first: int) -> list[tuple[int, int]]:
        """Pairs of blocks whose tangents couple; `first` is the block of the first coordinate."""
        pairs = []
        for k, s in enumerate(self.found):
            pairs += [(body, first + k) for body in groups[s.group][2:] if body >= 0]
            if s.other > k:
                pairs.append((first + k, first + s.other))
        return pairs

    def table(self, groups: list[tuple[int, int, int, int]], blocks: int, symbolic: Symbolic,
              scalars: int) -> NDArray[np.void]:  # fmt: skip
        """CURVE_MARKER rows; `blocks` bodies and `scalars` coordinates stand before their own."""
        rows = []
        for k, s in enumerate(self.found):
            mine = blocks + scalars + k
            links = [
                symbolic.couple_links.get((body, mine), -1) if body >= 0 else -1
                for body in groups[s.group][2:]
            ]
            other = symbolic.couple_links.get((mine, blocks + scalars + s.other), -1)
            link = symbolic.coordinate_links[s.group, mine]
            rows.append(
                (s.marker, scalars + k, s.at, s.pieces, s.closed, s.turns, s.group, s.side, link,
                 *links, s.other, other if s.other > k else -1)
            )  # fmt: skip
        return np.array(rows, CURVE_MARKER)


def lay(model: Model, curve: str, marker: PlacedMarker) -> Laid:
    """A curve on the marker that carries it, in the placed pose.

    Warns of one that the pieces follow badly, such as an expression with a corner.
    """
    shape = curve_shape(model, curve)
    pieces = pieces_of(shape)
    if pieces.error > _TOLD:
        what = f"is followed within {pieces.error:.2g} of its size only; has it a corner?"
        warnings.warn(f"curves.{curve} {what}", FlexmbWarning, stacklevel=2)
    return Laid(curve, pieces, shape.closed, shape.in_plane, *placed_frame(model, marker))


def placed_frame(model: Model, marker: PlacedMarker) -> tuple[Array, Array]:
    """Global position (3,) and axes (3, 3) of a marker in the placed pose."""
    A = np.eye(3)
    if marker.body != GROUND:
        A = rotation_matrix(model.bodies[marker.body].orientation)
    return lookup.global_position(model, marker), A @ marker.R
