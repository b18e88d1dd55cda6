"""The one sentence in which an audit ends."""

from __future__ import annotations

import pytest

from flexmb.workflow.audit import Audit, EffectOutcome


def effect(name: str, body: str, share: float | None, verdict: str) -> EffectOutcome:
    return EffectOutcome(name, body, False, "", share, "", "tip", None, verdict)


FURTHER = "further modes"
MODES = [effect(FURTHER, body, share, "missing") for body, share in (("k", 0.011), ("j", 0.016))]
OPEN = [effect(FURTHER, body, None, "not known") for body in ("c", "f")]
FINE = effect("vibration", "j", 1e-4, "may stay off")
BUDGET = "the budget of 1 % of the peak-to-peak of every sensor"
LARGEST = f"further modes of j is left out and contributes 1.6 %: more than {BUDGET}"
UNKNOWN = "what further modes of c, further modes of f would contribute is not known"


@pytest.mark.parametrize(
    ("effects", "sentence"),
    [
        ([FINE], f"what is left out stays within {BUDGET}"),
        ([FINE, *OPEN], f"{UNKNOWN}; the rest stays within {BUDGET}"),
        ([FINE, MODES[1]], LARGEST),
        ([*MODES, *OPEN], f"{LARGEST}; so is further modes of k; {UNKNOWN}"),
    ],
)
def test_all_that_is_missing_or_not_known_is_named(effects, sentence):
    assert Audit("", 0.01, tuple(effects), (), 0.0).sentence() == sentence


def test_a_long_list_ends_with_a_number():
    many = [effect("deformation", f"b{k}", 0.5 - 0.01 * k, "missing") for k in range(8)]
    sentence = Audit("", 0.01, tuple(many), (), 0.0).sentence()
    assert sentence.startswith("deformation of b0 is left out and contributes 50 %")
    assert sentence.endswith("deformation of b4 and 3 more")
