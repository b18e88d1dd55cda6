"""Motions that joints allow at first order only, against what can move and what cannot."""

from __future__ import annotations

import numpy as np
import pytest

import flexmb
from flexmb.analysis.assembly.jacobian import ConstraintRows
from flexmb.analysis.mobility.infinitesimal_motion import infinitesimal_motion
from flexmb.engine.compile import compile_system
from flexmb.errors import AssemblyError
from flexmb.model import Model
from tests.hard.redundant import bricard, four_bar, net
from tests.hard.singular import equal_slider_crank, parallelograms


def row_of_links(n, sag=0.0, scale=1.0, at=0.0, gravity=(0.0, -9.81, 0.0)):
    """n links of length one (times `scale`) in a row between two pivots, straight but for a sag."""
    made = Model("links", gravity=list(gravity))
    down = [scale * sag * np.sin(np.pi * k / n) for k in range(n + 1)]
    x = [at + scale * k for k in range(n + 1)]
    made.add_marker("ground.a", position=[x[0], 0, 0])
    made.add_marker("ground.b", position=[x[-1], 0, 0])
    for k in range(n):
        middle = [(x[k] + x[k + 1]) / 2, -(down[k] + down[k + 1]) / 2, 0]
        made.add_body(f"l{k}", mass=1, inertia=[1e-2 * scale**2] * 3, position=middle)
        for name, p, q in (("l", x[k], down[k]), ("r", x[k + 1], down[k + 1])):
            made.add_marker(f"l{k}.{name}", position=[p - middle[0], -q - middle[1], 0])
        made.add_sensor(f"l{k}", "position", of=f"l{k}")
    ends = ["ground.a", *(f"l{k}.{s}" for k in range(n) for s in "lr"), "ground.b"]
    for k in range(n + 1):
        made.add_joint(f"j{k}", "spherical", between=ends[2 * k : 2 * k + 2])
    return made


def motion_of(made):
    constraints = ConstraintRows(compile_system(made))
    return infinitesimal_motion(constraints, constraints.evaluate(constraints.compiled.initial_q))


@pytest.mark.parametrize(("scale", "at"), [(1.0, 0.0), (1e-6, 0.0), (1e3, 0.0), (1.0, 1e3)])
@pytest.mark.parametrize("n", [2, 5])
def test_straight_links_move_across_at_first_order_only(n, scale, at):
    """Each of the n - 1 pins between may begin to move in two directions; turns stay free."""
    motion = motion_of(row_of_links(n, scale=scale, at=at))
    assert motion.motions.shape[1] == 2 * (n - 1)
    assert motion.bodies == tuple(f"l{k}" for k in range(n))
    assert len(motion.joints) == n + 1


@pytest.mark.parametrize(
    "made",
    [row_of_links(4, sag=0.1), net(3), four_bar(), bricard(), parallelograms(2),
     equal_slider_crank()],
    ids=["sag", "free net", "four-bar", "Bricard", "parallelograms", "slider-crank"],
)  # fmt: skip
def test_mechanisms_move_also_where_they_are_singular_or_redundant(made):
    assert motion_of(made) is None


@pytest.mark.parametrize("method", ["auto", "generalized-alpha", "explicit-rk"])
@pytest.mark.parametrize(
    ("scale", "at", "duration"), [(1.0, 0.0, 0.1), (1e-6, 0.0, 1e-6), (1e3, 1e3, 1e5)]
)
def test_no_run_begins_under_a_load_across(method, scale, at, duration):
    made = row_of_links(2, scale=scale, at=at)
    with pytest.raises(AssemblyError, match="2 free motions are infinitesimal: l0, l1 may begin"):
        flexmb.simulate(made, duration=duration, outputs=2, method=method)


@pytest.mark.parametrize("duration", [1e-6, 0.1, 1e5])
def test_a_load_along_the_links_is_borne(duration):
    """The weight of links that hang on one another between two pivots; a warning, and reactions."""
    made = row_of_links(2, gravity=(-9.81, 0.0, 0.0))
    with pytest.warns(flexmb.FlexmbWarning, match="2 free motions are infinitesimal"):
        run = flexmb.simulate(made, duration=duration, outputs=2)
    assert np.allclose(run["l0.x"], 0.5, atol=1e-12) and np.allclose(run["l0.y"], 0, atol=1e-9)
