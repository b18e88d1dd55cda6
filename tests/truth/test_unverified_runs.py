"""Runs alone, without a comparison run: what a request costs."""

from __future__ import annotations

import pytest
from accuracyscenes import SCENES, truth_of
from accuracyscenes.judging import judged


@pytest.mark.parametrize("name", ["slider-crank", "Andrews' mechanism", "spatial slider-crank"])
def test_a_loose_request_takes_fewer_evaluations_where_nothing_is_measured(name):
    """Steps grow as about the eighth root of the error; none is kept short for a comparison."""
    knobs = {"verify": False, "method": "explicit-rk"}
    scene = SCENES[name]
    knobs |= {"duration": scene.duration, "outputs": scene.outputs}
    found = {}
    for asked in (1e-2, 1e-5):
        found[asked] = judged(
            scene.make(1.0), lambda t: truth_of(scene, t), accuracy=asked, **knobs
        )
        assert found[asked].achieved < asked
    loose, tight = (found[asked].statistics["residual_evaluations"] for asked in (1e-2, 1e-5))
    assert loose < 0.7 * tight
