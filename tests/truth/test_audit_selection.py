"""Numbers of the audit that were not: estimates that fail, and modes beside static responses."""

from __future__ import annotations

import json

import numpy as np
import pytest
from flexiblescenes import BEAM_PERIOD, STEEL

import flexmb
from flexmb.errors import FlexmbError
from flexmb.model import Model
from flexmb.workflow.audit import Audit
from flexmb.workflow.effect import BOTH, MODES
from flexmb.workflow.effect_estimates import Estimates
from flexmb.workflow.run import run_single


def swinging_bar(modes, **words):
    """A bar that swings with 0.08 of its first frequency, and follows its loads."""
    speed = 0.08 * 2 * np.pi / BEAM_PERIOD
    model = Model("swinging bar")
    model.add_body(
        "bar", mesh={"type": "beam", "length": 1.0, "divisions": 20}, material=STEEL,
        sections={"all": {"type": "rectangle", "y": 0.01, "z": 0.01}},
        interfaces={"root": "start", "tip": "end"}, modes=modes, stress="none", **words,
    )  # fmt: skip
    model.add_joint("hub", "revolute", between=["ground", "bar.root"], axis="z")
    model.add_driver("motor", joint="hub", angle=f"0.5*(1 - cos({speed}*t))")
    model.add_sensor("tip", "position", of="bar.tip")
    model.set_dynamics(duration=4 * np.pi / speed, outputs=200, accuracy=1e-5)
    return model


@pytest.mark.seconds
def test_an_effect_whose_estimate_fails_is_taken_in(monkeypatch, tmp_path):
    """Of a hinged blade that folds up without stiffening there is none: that is not little."""
    known = Estimates.estimate

    def estimate(self, effect):
        if effect.name == BOTH and not effect.on:
            raise FlexmbError("the motions about the computed one have no inertia in the mean")
        return known(self, effect)

    monkeypatch.setattr(Estimates, "estimate", estimate)
    model = swinging_bar(4)
    model.set_effects(choice="auto", budget=0.01)
    run = flexmb.simulate(model, output=tmp_path / "auto")
    chosen = json.loads(run.texts["effects"])
    assert chosen["words"]["bar"]["geometric_stiffening"] == "full"
    assert [step[4] for step in chosen["steps"] if step[3] == BOTH] == ["not known"]


@pytest.mark.seconds
def test_what_nothing_may_switch_is_estimated_once(monkeypatch, tmp_path):
    """The scene states the number of modes: where another effect is taken in, what more modes would
    do decides nothing."""
    known, asked = Estimates.estimate, []

    def estimate(self, effect):
        asked.append((effect.name, effect.on))
        return known(self, effect)

    monkeypatch.setattr(Estimates, "estimate", estimate)
    model = swinging_bar(4)
    model.set_effects(choice="auto", budget=1e-5)
    run = flexmb.simulate(model, output=tmp_path / "auto")
    taken = {step[0] for step in json.loads(run.texts["effects"])["steps"]}
    assert taken == {"1", "2"}
    assert asked.count((MODES, False)) == 1
    assert ("deformation", True) not in asked  # the run without it has told that
    made = Audit.from_text(run.texts["audit"])
    (one,) = (one for one in made.effects if one.effect == "deformation")
    assert (one.on, one.verdict, one.why) == (True, "needed", "as told of the run without it")
    assert one.share > 1e-5 and one.cost > 1.0


@pytest.mark.seconds
def test_runs_of_an_audit_end_at_no_bound(tmp_path):
    model = swinging_bar(4)
    model.set_validity(deflection=1e-6)
    with pytest.raises(FlexmbError, match="bound 1e-06"):
        run_single(model, tmp_path / "judged", pictures=False)
    report = run_single(model, tmp_path / "not", pictures=False, is_judged=False)
    assert flexmb.load_result(report.result).status == "finished"


@pytest.mark.seconds
def test_more_modes_stand_beside_the_static_responses_that_a_body_has(tmp_path):
    """A bar of two modes takes static responses to its inertia, one of eight modes does not: the
    shapes of the first must be among those of the second. Runs with 2 and 8 modes are 2e-10 apart.
    """
    words = {"deformation": "quasi-static", "inertia_coupling": "constant"}
    run = flexmb.simulate(swinging_bar(2, **words), output=tmp_path / "two")
    made = next(one for one in flexmb.audit(run).effects if one.effect == MODES)
    more = flexmb.simulate(swinging_bar(8, **words), output=tmp_path / "eight")
    assert np.abs(run["tip.y"] - more["tip.y"]).max() < 1e-8 * np.ptp(run["tip.y"])
    assert made.share < 1e-6
