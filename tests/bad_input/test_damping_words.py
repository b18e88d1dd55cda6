"""What is wrong with the damping of a flexible body, in a sentence."""

from __future__ import annotations

import pytest
from flexiblescenes import rod

import flexmb
from flexmb.errors import FlexmbError
from flexmb.model import Model

BAD = {
    "negative": (-0.1, "bodies.bar.damping: must be zero or positive, is -0.1"),
    "percent": (2, "bodies.bar.damping: must lie between 0 and 1 .*, is 2; 2 % is 0.02"),
    "unknown preset": ("addams", 'bodies.bar.damping: unknown name "addams"; nearest: adams'),
    "two laws": ({"ratio": 0.1, "preset": "adams"}, "has ratio and preset; give one of them"),
    "no law": ({"of": "free"}, "has no ratios; give one of them"),
    "misspelt": ({"ratoi": 0.1}, 'unknown key "ratoi"; .*nearest: ratio|nearest: ratio'),
    "overlap": (
        {"bands": [{"below": 100, "ratio": 0.1}, {"above": 90, "ratio": 0.2}]},
        r"damping.bands\[1\]: overlaps bands\[0\] from 90 Hz on",
    ),
    "gap": (
        {"bands": [{"below": 100, "ratio": 0.1}, {"above": 200, "ratio": 0.2}]},
        "damping.bands: no band has a ratio for modes from 100 Hz to 200 Hz",
    ),
    "open end": (
        {"bands": [{"below": 100, "ratio": 0.1}]}, "no band has a ratio for modes from 100 Hz on"
    ),
    "empty band": (
        {"bands": [{"above": 5, "below": 5, "ratio": 0.1}]}, r"bands\[0\]: must end above 5 Hz"
    ),
    "ratio of a band": ({"bands": [{"ratio": 10}]}, r"bands\[0\].ratio: must lie between 0 and 1"),
    "unequal lists": (
        {"table": {"frequencies": [1, 2, 3], "ratios": [0.1, 0.2]}},
        "damping.table: two or more frequencies and as many ratios are expected, given 3, 2",
    ),
    "descending": (
        {"table": {"frequencies": [3, 2], "ratios": [0.1, 0.2]}},
        "damping.table.frequencies: must ascend",
    ),
    "both Rayleighs": (
        {"rayleigh": {"alpha": 1, "ratios": [0.1, 0.1]}},
        "damping.rayleigh: has alpha and ratios; give alpha, beta or both, or two frequencies",
    ),
    "negative alpha": (
        {"rayleigh": {"frequencies": [1, 10], "ratios": [0.01, 0.5]}},
        "rayleigh.ratios: need a negative alpha, .*between 0.1 and 10 times the first",
    ),
    "no number": ({"modes": {"first": 0.1}}, "damping.modes.first: is no number of a mode"),
    "mode 13": (
        {"ratio": 0, "modes": {13: 0.1}},
        "bodies.bar.damping.modes.13: there is no such mode: the body has 12 modes as joined",
    ),
    "low cut-off": (
        {"ratio": 0.01, "critical_above": 1.0},
        "damping.critical_above: 1 Hz is below all modes: .*from 8.38[0-9]* Hz on",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_mistakes_are_named(name):
    words, sentence = BAD[name]
    model = Model("bad")
    with pytest.raises(FlexmbError, match=sentence):
        model.add_body("bar", rod(0.01, 1.0, modes=6), damping=words)
        model.add_joint("wall", "fixed", between=["ground", "bar.root"])
        flexmb.simulate(model, duration=1e-3, outputs=2)


def test_a_mode_beyond_all_is_refused_before_the_reduction():
    model = Model("bad")
    with pytest.raises(FlexmbError, match="damping.modes.99: there is no such mode: .* at most 32"):
        model.add_body(
            "bar", mesh={"type": "beam", "length": 1}, material="steel",
            interfaces={"root": "start"}, modes=14, damping={"modes": {99: 0.1}},
        )  # fmt: skip
