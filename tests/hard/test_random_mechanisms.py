"""What runs of random mechanisms tell of their errors; more of them by `random_mechanisms`."""

from __future__ import annotations

import pytest

from .random_mechanisms import verdicts


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "radau"])
def test_what_is_told_of_random_mechanisms(method):
    """None misses twice its request without a word; one in ten may be told more than three times
    or less than a third."""
    found = [one for seed in range(13) for one in verdicts(seed, method)]
    words = [one.words for one in found]
    assert len(words) > 25
    assert "MISSED" not in words
    assert sum(word != "" for word in words) <= len(words) / 10
