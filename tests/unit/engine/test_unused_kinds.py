"""A scene compiles only the kinds of elements it holds."""

from __future__ import annotations

import pytest
from benchmarks.kinds import INNER, fresh


@pytest.mark.slow
@pytest.mark.parametrize("kind", [None, *INNER])
def test_no_other_kind_is_compiled(kind):
    """Friction in joints follows a coordinate of its joint, which costs nothing of another kind."""
    assert fresh(kind)["inner"] == ([] if kind is None else [kind])
