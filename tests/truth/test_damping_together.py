"""Damping of several flexible bodies in one scene: each has its ratio while the others are rigid.

The ratios of the modes that they have together are told, and are those of the linearised scene.
"""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line
from flexiblescenes import STEEL

import flexmb
from flexmb.fe import rectangle, reduce
from flexmb.model import Model

L, WIDTH, HEIGHT = 1.0, 0.02, 0.01
# First bending of the clamped bar along z [Hz]: Blevins, 1979, table 8-1.
FIRST = 1.87510**2 * np.sqrt(STEEL["E"] * HEIGHT**2 / 12 / STEEL["density"]) / (2 * np.pi * L**2)
pytestmark = pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")


def told(result, name):
    damping = result.damping[name]
    return np.array(damping.frequencies), np.array(damping.ratios)


@pytest.mark.seconds
@pytest.mark.parametrize("n", [2, 4])
def test_several_bodies_have_other_ratios_together(n):
    """A bar divided into equal ones that are welded: each has 2 % while the others are rigid."""
    part = reduce(
        line(6, end=(L / n, 0, 0)), material=STEEL, interfaces={"root": "root", "tip": "tip"},
        sections={"all": rectangle(WIDTH, HEIGHT)}, modes=4,
    )  # fmt: skip
    for words, expected in ((0.02, None), ({"rayleigh": {"beta": 1e-4}}, np.pi * 1e-4)):
        model = Model("divided")
        for k in range(n):
            model.add_body(f"bar{k}", part, damping=words, position=[k * L / n, 0, 0])
            before = "ground" if k == 0 else f"bar{k - 1}.tip"
            model.add_joint(f"weld{k}", "fixed", between=[before, f"bar{k}.root"])
        run = flexmb.simulate(model, duration=1e-4, outputs=1, step=1e-4)
        frequencies, ratios = told(run, "")
        lin = flexmb.linearize(model, about="undeformed")
        np.testing.assert_allclose(np.sort(lin.damping_ratios)[:6], np.sort(ratios)[:6], rtol=1e-5)
        assert frequencies[0] == pytest.approx(FIRST, rel=1e-3)
        if expected is None:
            np.testing.assert_allclose(told(run, "bar0")[1], 0.02, rtol=1e-9)
            assert 0.5 * 0.02 < ratios[0] < 0.02
        else:  # β K knows nothing of a division
            assert ratios[0] == pytest.approx(expected * frequencies[0], rel=1e-6)


def test_a_shape_that_two_beams_hold_together_is_damped():
    """A plate on two parallel beams: each alone would be held by the other if that were rigid."""
    beam = reduce(
        line(12, end=(L, 0, 0)), material=STEEL, interfaces={"root": "root", "tip": "tip"},
        sections={"all": rectangle(WIDTH, HEIGHT)}, modes=6,
    )  # fmt: skip
    model = Model("parallel beams")
    model.add_body("plate", mass=1.0, inertia=[0.1] * 3, position=[L, 0, 0])
    for k, z in enumerate((0.0, 0.3)):
        model.add_marker(f"ground.root{k}", position=[0, 0, z])
        model.add_marker(f"plate.tip{k}", position=[0, 0, z])
        model.add_body(f"beam{k}", beam, damping=0.02, position=[0, 0, z])
        model.add_joint(f"root{k}", "fixed", between=[f"ground.root{k}", f"beam{k}.root"])
        model.add_joint(f"tip{k}", "fixed", between=[f"beam{k}.tip", f"plate.tip{k}"])
    run = flexmb.simulate(model, duration=1e-4, outputs=1, step=1e-4)
    np.testing.assert_allclose(told(run, "beam0")[1], 0.02, rtol=1e-9)  # with both ends held
    frequencies, ratios = told(run, "")
    lin = flexmb.linearize(model, about="undeformed")
    values = lin.eigenvalues[lin.eigenvalues.imag > 0]
    values = values[np.abs(values).argsort()][:6]
    np.testing.assert_allclose(np.abs(values) / (2 * np.pi), frequencies[:6], rtol=1e-3)
    np.testing.assert_allclose(-values.real / np.abs(values), ratios[:6], rtol=1e-4)
    assert np.all((0.01 < ratios[:6]) & (ratios[:6] < 0.03))
