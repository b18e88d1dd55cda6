"""Forces that turn with a body: columns that flutter where dead loads would buckle them.

Beck's column, clamped, with a force along its tip: p² + 2Ω² + p Ω sinh a sin b + 2Ω² cosh a cos b
= 0, a, b = √(√(p²/4 + Ω²) ∓ p/2), flutter from 20.05 EI/L² on (Bolotin, Nonconservative Problems,
§2.1). A free column pushed at its end flutters from 109.9 EI/L² on (Beal, AIAA J. 3, 486, 1965). A
force along the middle of the clamped column buckles it at π² EI/L².
"""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line
from scipy.optimize import brentq

import flexmb
from flexmb.analysis.validity.load_factor import LoadFactorMonitor
from flexmb.fe import rectangle, reduce
from flexmb.model import Model
from tests.accuracyscenes.judging import judged

HEIGHT, N = 0.01, 20
UNIT = {"E": 12.0 / HEIGHT**4, "nu": 0.0, "density": 1.0 / HEIGHT**2}  # EI = ρA = L = 1


def body():
    return reduce(
        line(N), material=UNIT, sections={"all": rectangle(HEIGHT, HEIGHT)}, modes=10,
        interfaces={"root": "root", "tip": "tip"}, geometric_stiffening="full", residual="inertia",
    )  # fmt: skip


def column(force, axes, place=(0.0, 0.0, 0.0)):
    """Clamped, with a force towards its root at the tip, along the axes of a marker."""
    model = Model("column")
    model.add_marker("ground.root", position=list(place))
    model.add_body("column", body(), position=list(place))
    model.add_marker("column.middle", position=[0.5, 0.0, 0.0])
    model.add_joint("root", "fixed", between=["ground.root", "column.root"])
    model.add_force("push", "force", at="column.tip", axes=axes, value=[-force, 0, 0])
    return model


def rocket(force):
    model = Model("rocket")
    model.add_body("rocket", body())
    model.add_force("thrust", "force", at="rocket.root", axes="body", value=[force, 0, 0])
    return model


def beck(rate, p):
    root = np.sqrt(p * p / 4 + rate**2)
    a, b = np.sqrt(root - p / 2), np.sqrt(root + p / 2)
    crossed = p * rate * np.sinh(a) * np.sin(b) + 2 * rate**2 * np.cosh(a) * np.cos(b)
    return p * p + 2 * rate**2 + crossed


@pytest.mark.parametrize(("p", "between"), [(5.0, [(3, 6), (18, 22)]), (15.0, [(6, 8), (15, 18)])])
@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (1000.0, -200.0, 300.0)])
def test_becks_column_below_flutter(p, between, place):
    found = np.abs(flexmb.linearize(column(p, "column.tip", place)).eigenvalues.imag)
    wanted = [brentq(beck, *pair, args=(p,)) for pair in between]
    for rate in wanted:
        assert np.abs(found - rate).min() < 2e-3 * rate  # of which shear is a half


@pytest.mark.parametrize(
    ("make", "force"), [(lambda p: column(p, "column.tip"), 20.05), (rocket, 109.9)],
    ids=["clamped", "free"],
)  # fmt: skip
def test_flutter_begins_where_it_must(make, force):
    growth = [flexmb.linearize(make(x * force)).eigenvalues.real.max() for x in (0.99, 1.01)]
    assert growth[0] < 1e-3 < 0.5 < growth[1]


@pytest.mark.parametrize(
    ("axes", "factor"),
    [("global", 4 / np.pi**2), ("column.root", 4 / np.pi**2), ("column.middle", 1 / np.pi**2),
     ("column.tip", 0.0)],
)  # fmt: skip
def test_the_load_factor_knows_which_way_the_force_turns(axes, factor, monkeypatch):
    values = []
    own = LoadFactorMonitor._values
    monkeypatch.setattr("flexmb.analysis.validity.load_factor._MIN_ESTIMATE", 0.0)
    monkeypatch.setattr(
        LoadFactorMonitor, "_values", lambda *args: values.append(own(*args)) or values[-1]
    )
    judged(
        column(1.0, axes), accuracy=1e-3, verify=False, duration=0.02, outputs=4,
        start="quasi-static",
    )  # fmt: skip
    assert values[0][0][:, 0].max() == pytest.approx(factor, rel=2e-3, abs=1e-3)


@pytest.mark.seconds
def test_a_following_force_beyond_eulers_load_is_no_reason_to_refuse_a_run():
    """It was: "its loads are 6.1 of those that buckle it"; the column swings as Beck's."""
    model = column(15.0, "column.tip")
    push = "1e-4*step5(t, 0, 0, 0.05, 1)*(1 - step5(t, 0.05, 0, 0.1, 1))"
    model.add_force("tap", "force", at="column.tip", value=[0, push, 0])
    found = judged(model, accuracy=1e-4, verify=False, duration=1.0, outputs=50)
    assert not found.message
    assert not [note for note in found.notes if "buckle" in note]
