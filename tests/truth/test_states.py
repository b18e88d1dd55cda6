"""Stiff states of very different sizes: problems of the test set of initial value problems.

Published values at the end: Mazzia & Magherini, Test Set for Initial Value Problem Solvers, release
2.4, Bari, 2008.
"""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes import SCENES
from accuracyscenes.judging import judged
from accuracyscenes.states import HIRES_END, OREGO_END, POLLUTION_END, system


@pytest.mark.parametrize(
    ("name", "ends"), [("pollution", POLLUTION_END), ("HIRES", HIRES_END), ("OREGO", OREGO_END)]
)
def test_states_end_where_the_test_set_says(name, ends):
    """Newton's method took corrections of small states for noise: pollution was 1 % off."""
    scene = SCENES[name]
    model = scene.make()
    ways = {
        f"p{k}": np.array([float(model.states[f"y{k}"].start.constant), y])
        for k, y in enumerate(ends, 1)
    }
    found = judged(model, lambda t: ways, duration=scene.duration, outputs=1, accuracy=1e-8)
    assert not found.message and not found.notes
    assert found.is_reached(1e-8)  # over the change of each state


def test_auto_leaves_an_explicit_method_that_stability_limits():
    """It was refused: steps of 3e-4 s would be left for 1e5 s, though radau was named as cure."""
    scene = SCENES["E5"]
    found = judged(scene.make(), scene.truth, duration=1e5, outputs=100, accuracy=1e-8)
    assert not found.message
    assert found.statistics["method"] == "radau"
    assert found.is_reached(1e-8)


@pytest.mark.parametrize("method", ["generalized-alpha", "radau"])
def test_fixed_steps_pass_states_at_rest(method):
    """Of a stiff pair at 1 and a state of their difference: round-off of the pair is not its own.

    Round-off of a state by its scale, 0 with fixed steps, let Newton's method fail at once.
    """
    rates = ["-1e6*(y1 - y2) + sin(t)", "1e6*(y1 - y2)", "1e6*(y1 - y2) - y3"]
    model = system(rates, [1.0, 1.0, 0.0])()
    found = judged(model, duration=2.0, outputs=20, step=0.01, method=method)
    assert not found.message
    assert found.statistics.get("failed_steps", 0) == 0
