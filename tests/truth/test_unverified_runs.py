"""Runs alone, without a comparison run: what a request costs."""

from __future__ import annotations

import pytest
from accuracyscenes import AWAY, SCENES, moved, truth_of
from accuracyscenes.judging import judged


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("name", "size", "away"),
    [
        (name, size, away)
        for name in ("slider-crank", "Andrews' mechanism", "spatial slider-crank")
        for size, away in ((1.0, None), (1.0, AWAY), (1e-6, None))
        if size == 1.0 or SCENES[name].sized
    ],
)
def test_a_loose_request_takes_fewer_evaluations_where_nothing_is_measured(name, size, away):
    """Steps grow as about the eighth root of the error; none is kept short for a comparison."""
    knobs = {"verify": False, "method": "explicit-rk"}
    scene = SCENES[name]
    knobs |= {"duration": scene.duration, "outputs": scene.outputs}
    found = {}
    for asked in (1e-2, 1e-5):
        model = scene.make(size) if away is None else moved(scene.make(size), away)
        found[asked] = judged(
            model, lambda t: truth_of(scene, t, size, away or (0.0, 0.0, 0.0)), accuracy=asked,
            **knobs,
        )  # fmt: skip
        assert found[asked].achieved < asked
    loose, tight = (found[asked].statistics["residual_evaluations"] for asked in (1e-2, 1e-5))
    assert loose < 0.7 * tight
