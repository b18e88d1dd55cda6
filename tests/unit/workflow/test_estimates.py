"""Estimates of effects with more rows, and those that an earlier run has told."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from flexmb.analysis.effects.contribution import Contribution
from flexmb.units import unit_system
from flexmb.workflow.audit import EarlierAudits, EffectOutcome, _outcome
from flexmb.workflow.effect import Effect
from flexmb.workflow.effect_estimates import Estimates

COUPLING = Effect("inertia coupling", "rod", False, "rigid")


def estimates(monkeypatch, *shares):
    """Estimates along a motion that turns, each of a run with four times the rows of the last."""
    finer = None
    told = {}
    for k in reversed(range(len(shares))):
        of = SimpleNamespace(
            finer=finer and finer.of, turns=20.0, model=SimpleNamespace(units=unit_system("SI")),
            motion=SimpleNamespace(t=range(100 * 4**k + 1)),
        )  # fmt: skip
        told[id(of)] = [Contribution("tip", "m", shares[k], shares[k])]
        finer = Estimates(of)
    monkeypatch.setattr(Estimates, "_estimate", lambda self, effect: (told[id(self.of)], 1.0))
    return finer


@pytest.mark.parametrize(
    ("shares", "counts"),
    [
        ((0.02, 0.08, 0.082), 0.082),  # 2 % counted, the smaller of the first two
        ((0.08, 0.02, 0.022), 0.022),
        ((0.08, 0.085, 0.3), 0.085),  # which agree
        ((0.005, 0.5), 0.005),  # too little to be in doubt
        ((1e3, 1e-4, 2e-4, 0.5), 2e-4),  # below what matters twice
    ],
)
def test_the_finer_estimate_counts(shares, counts, monkeypatch):
    ((one,), _) = estimates(monkeypatch, *shares).estimate(COUPLING)
    assert (one.share, one.unsettled) == (counts, "")


@pytest.mark.parametrize(("fine", "share", "verdict"), [
    (0.08, 0.08, "missing"), (0.004, None, "not known"),
])  # fmt: skip
def test_an_estimate_that_does_not_settle_says_so(fine, share, verdict, monkeypatch):
    """A coarse one of 2 % is not proof of 0.4 %, nor is it how much 8 % is."""
    made = _outcome(estimates(monkeypatch, 0.02, fine), COUPLING, 0.01)
    assert (made.share, made.verdict) == (share, verdict)
    assert f"2 % of tip with 101 rows, {100 * fine:.2g} % with 401" in made.why


def test_what_was_taken_in_is_told_as_by_the_run_without_it():
    run = SimpleNamespace(run_time=2.0)
    earlier = EarlierAudits()
    told = EffectOutcome("deformation", "rod", False, "rigid", 0.2, "", "tip", None, "missing")
    earlier.add([told, replace(told, body="", effect="gravity")], run)
    on = Effect("deformation", "rod", True, "u/L 0.01")
    made = earlier.outcome(on, SimpleNamespace(run_time=7.0), 0.01)
    assert (made.on, made.share, made.indicator, made.cost) == (True, 0.2, "u/L 0.01", 3.5)
    assert (made.verdict, made.why) == ("needed", "as told of the run without it")
    assert earlier.outcome(replace(on, on=False), run, 0.01) is None
    assert earlier.outcome(replace(on, body=""), run, 0.01) is None


def test_an_effect_is_found_among_those_of_more_rows_by_its_body(monkeypatch):
    """Its indicator is of the rows, and ended an audit with a traceback."""
    few = replace(COUPLING, on=True, indicator="Ω/ω1 0.092")
    fine = [replace(few, body=body, indicator="Ω/ω1 0.093") for body in ("crank", "rod")]
    told = [[Contribution("tip", "m", one, one, at_rest=True)] for one in (0.5, 0.2)]
    monkeypatch.setattr(Estimates, "_alike", lambda self, effect: fine)
    monkeypatch.setattr(Estimates, "_change", lambda self, *effects: (None, None, None, 1.0))
    monkeypatch.setattr(Estimates, "_alone", lambda self, *effects: told[0])
    monkeypatch.setattr(Estimates, "_each", lambda self, effects: told)
    assert Estimates(None)._estimate(few) == (told[1], 1.0)


@pytest.mark.parametrize(
    ("effect", "share"),
    [
        (replace(COUPLING, on=True), 0.1),
        (COUPLING, 0.5),  # off: a run with it may need another body
        (Effect("gravity", "", False, ""), 0.1),
        (Effect("damping", "", True, ""), 0.5),
    ],
)
def test_large_effects_are_told_by_a_run(effect, share, monkeypatch):
    of = SimpleNamespace(has_origin=False, turns=0.0)
    estimated, run = ([Contribution("tip", "m", one, one)] for one in (0.5, 0.1))
    monkeypatch.setattr(Estimates, "_estimate", lambda self, effect: (estimated, 1.0))
    monkeypatch.setattr(Estimates, "_switched", lambda self, effect: run)
    ((one,), _) = Estimates(of).estimate(effect)
    assert one.share == share
