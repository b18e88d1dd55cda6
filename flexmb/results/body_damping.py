"""The damping of a flexible body in a result: the ratio of each of its modes."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass

DAMPING = "damping"  # name of the text in a result


@dataclass(frozen=True)
class BodyDamping:
    """What a scene says of the damping of a body, and what its modes have as the scene joins it.

    Parameters
    ----------
    body, words : str
        Name of the body, and its damping in short. No name: all flexible bodies together.
    frequencies, ratios : tuple of float
        Of each mode as joined, ascending [Hz], and its damping ratio; none without damping.
    """

    body: str
    words: str
    frequencies: tuple[float, ...] = ()
    ratios: tuple[float, ...] = ()

    def summary(self) -> str:
        """The ratios in short."""
        if not self.ratios:
            return ""
        f, z = (self.frequencies[0], self.frequencies[-1]), [100 * ratio for ratio in self.ratios]
        span = f"{len(z)} modes as joined, {f[0]:.4g} to {f[1]:.4g} Hz"
        if max(z) - min(z) <= 1e-4 * max(z):
            return f"{span}: {z[0]:.4g} %"
        return f"{span}: {z[0]:.4g} % of the first, {min(z):.4g} to {max(z):.4g} % of all"


def damping_text(dampings: Iterable[BodyDamping]) -> str:
    """As a text of a result."""
    return json.dumps([asdict(one) for one in dampings])


def read_damping_text(text: str) -> tuple[BodyDamping, ...]:
    """From the text of a result."""
    return tuple(
        BodyDamping(row["body"], row["words"], tuple(row["frequencies"]), tuple(row["ratios"]))
        for row in json.loads(text)
    )
