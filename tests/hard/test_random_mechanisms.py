"""What runs of random mechanisms tell of their errors; more of them by `random_mechanisms`."""

from __future__ import annotations

import pytest
from truthkit import Memory

from flexmb.analysis.dynamics.dynamics import dynamics
from flexmb.engine.compile import compile_system

from .random_mechanisms import mechanism, verdicts


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


@pytest.mark.seconds
def test_runs_that_part_do_not_still_get_better():
    """Passes of a chaotic motion differ by a third of it and more, whatever the steps."""
    model, duration = mechanism(716)
    model.set_dynamics(duration=duration, outputs=60, accuracy=1e-3)
    ended = dynamics(compile_system(model), model, Memory())
    (note,) = [note for note in ended.notes if "was asked for" in note]
    until = float(note.partition("agree to it until t = ")[2].split()[0])
    assert 3.0 < until < 4.5 and "multiplies errors" in note and "better" not in note
