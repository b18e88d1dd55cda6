"""A block of output rows, as analyses hand them to a result file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.tables import Layout
from flexmb.flexbody.arrays import Array
from flexmb.results.channels import TABLES


@dataclass(frozen=True)
class OutputBlock:
    """k output rows: times, and all quantities at them (SI; columns as in the layout)."""

    t: Array  # (k,)
    q: Array  # (k, nq)
    v: Array  # (k, nv)
    vd: Array  # (k, nv)
    lam: Array  # (k, nc)
    reactions: Array  # (k, 12 reactions)
    sensors: Array  # (k, channels)
    energy: Array  # (k, energies)
    drift: Array  # (k, 2)

    def tables(self) -> dict[str, Array]:
        """The arrays by the name of their dataset."""
        named = {field.name: getattr(self, field.name) for field in fields(self)}
        named["time"] = named.pop("t")
        return {name: np.asarray(named[name], dtype=np.float64) for name in TABLES}

    def in_global_frame(self, layout: Layout) -> OutputBlock:
        """The rows with the motion of the frames of bodies, as result files hold them."""
        if not layout.is_moved:
            return self
        q, v, vd = layout.of_frames(self.q, self.v, self.vd)
        return replace(self, q=q, v=v, vd=vd)

    def part(self, start: int, stop: int) -> OutputBlock:
        """The rows from start to stop."""
        return OutputBlock(*(getattr(self, field.name)[start:stop] for field in fields(self)))

    @classmethod
    def joined(cls, blocks: Sequence[OutputBlock]) -> OutputBlock:
        """The rows of all blocks, in order."""
        parts = ([getattr(one, field.name) for one in blocks] for field in fields(cls))
        return cls(*map(np.concatenate, parts))

    def rows(self, mask: NDArray[np.bool_]) -> OutputBlock:
        """The rows where `mask` (k,) is true."""
        if mask.all():
            return self
        return OutputBlock(*(getattr(self, field.name)[mask] for field in fields(self)))
