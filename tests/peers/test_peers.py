"""The mechanisms that are timed beside another program move as the textbook says in both."""

from __future__ import annotations

import pytest

from tests.peers.scenes import SCENES
from tests.peers.work_precision import Exudyn, Flexmb


@pytest.mark.parametrize("name", SCENES)
def test_the_model_of_flexmb_moves_as_the_textbook_says(name):
    point = Flexmb(SCENES[name], verify=False).point(1e-8)
    assert point.error < 1e-8


@pytest.mark.parametrize("name", SCENES)
def test_exudyn_goes_to_the_same_motion_with_the_square_of_its_step(name):
    pytest.importorskip("exudyn")
    from tests.peers.with_exudyn import MODELS, solvers

    for how, make in MODELS[name].items():
        settings = list(solvers(how).values())[-1]
        coarse, fine = (Exudyn(SCENES[name], make, **settings).point(n) for n in (4000, 8000))
        assert fine.error < 1e-3
        assert fine.error < 0.3 * coarse.error or fine.error < 1e-11
