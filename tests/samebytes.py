"""Whether two result files hold the same run to the last bit."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from flexmb.results.channels import TABLES


def assert_same_bytes(one: Path, other: Path) -> None:
    """Compare the tables and both kept states of two finished runs."""
    with h5py.File(one, locking=False) as a, h5py.File(other, locking=False) as b:
        assert list(a["progress"][:]) == list(b["progress"][:])
        rows = int(a["progress"][0])
        for name in TABLES:
            assert a[name][:rows].tobytes() == b[name][:rows].tobytes(), name
        for name in ("saves", "rows", "arrays", "0", "1"):
            assert (
                np.asarray(a[f"state/{name}"][()]).tobytes()
                == np.asarray(b[f"state/{name}"][()]).tobytes()
            ), name
