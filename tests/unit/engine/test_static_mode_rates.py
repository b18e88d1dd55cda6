"""Rates of quasi-static modes from their past: exact for motions that are cubic in time."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line

from flexmb.engine.allocation import new_run, new_state, new_work
from flexmb.engine.bodies.static_mode_rates import (
    extrapolation_error,
    put_rates,
    record_point_ahead,
    update_history,
)
from flexmb.engine.bodies.static_mode_tables import PAST_POINTS
from flexmb.engine.bodies.static_modes import STATIC_MODES
from flexmb.engine.compile import compile_system
from flexmb.fe import rectangle, reduce
from flexmb.model import Model

STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7850.0}
NOW, PAST = 0.3, np.array([0.27, 0.25, 0.22, 0.2])  # at uneven intervals


class Bar:
    """A quasi-static bar at one moment, and its tables."""

    def __init__(self):
        body = reduce(line(8, end=(0.5, 0, 0)), material=STEEL, modes=2,
                      interfaces={"root": "root", "tip": "tip"},
                      sections={"all": rectangle(0.02, 0.01)})  # fmt: skip
        model = Model("bar")
        model.add_body("bar", body, deformation="quasi-static")
        model.add_joint("pin", "revolute", between=["ground", "bar.root"], axis="z")
        system = compile_system(model).system
        self.state, self.work = new_state(system), new_work(system)
        self.run = new_run(system, self.state, self.work)
        name = STATIC_MODES.name
        self.of = system.kinds[name]._replace(scratch=self.work.kinds[name])
        row = system.parts.bodies[self.of.rows[0]]
        self.q, self.v = row["iq"] + 7 + self.of.modes, row["iv"] + 6 + self.of.modes
        m, o = len(self.of.modes), self.of.history[0]
        self.times = self.state.history[o : o + PAST_POINTS]
        self.values = self.state.history[o + PAST_POINTS : o + PAST_POINTS * (1 + m)]
        self.values = self.values.reshape(PAST_POINTS, m)
        self.polynomials = np.random.default_rng(1).standard_normal((4, m))

    def motion(self, t, derivative=0):
        """(n, modes) a cubic of each mode."""
        return np.stack(
            [np.polyval(np.polyder(p, derivative), np.atleast_1d(t)) for p in self.polynomials.T],
            axis=1,
        )

    def remember(self, times):
        self.times[:], self.values[:] = times, self.motion(times)
        self.work.now.history[:] = self.state.history


@pytest.fixture
def bar():
    return Bar()


@pytest.mark.parametrize("past", [PAST, np.array([NOW, *PAST[:3]])])
def test_rates_are_those_of_the_cubic_through_the_past(bar, past):
    """Whether the newest point is the present or lies before it."""
    bar.remember(past)
    bar.state.t[0], bar.state.q[bar.q] = NOW, bar.motion(NOW)[0]
    put_rates(bar.run, bar.of, bar.run.state_point)
    np.testing.assert_allclose(bar.state.v[bar.v], bar.motion(NOW, 1)[0], rtol=1e-9)
    np.testing.assert_allclose(bar.state.vd[bar.v], bar.motion(NOW, 2)[0], rtol=1e-7)


def test_two_points_of_the_past_give_a_parabola_without_acceleration(bar):
    bar.polynomials[0] = 0.0
    bar.remember([PAST[0], PAST[1], -np.inf, -np.inf])
    bar.state.t[0], bar.state.q[bar.q] = NOW, bar.motion(NOW)[0]
    put_rates(bar.run, bar.of, bar.run.state_point)
    np.testing.assert_allclose(bar.state.v[bar.v], bar.motion(NOW, 1)[0], rtol=1e-9)
    assert not bar.state.vd[bar.v].any()


def test_values_that_jump_have_no_rates(bar):
    bar.remember(PAST)
    bar.state.t[0], bar.state.q[bar.q] = NOW, bar.motion(NOW)[0] + 100.0
    put_rates(bar.run, bar.of, bar.run.state_point)
    assert not bar.state.v[bar.v].any() and not bar.state.vd[bar.v].any()


def test_a_point_of_the_present_alone_gives_no_rate(bar):
    """Just behind an event that follows a jump: round-off over 1e-14 s was a rate of 100."""
    bar.of.window[:] = 0.01
    bar.remember([NOW - 1e-14, -np.inf, -np.inf, -np.inf])
    bar.state.t[0], bar.state.q[bar.q] = NOW, bar.motion(NOW)[0] + 1e-12
    put_rates(bar.run, bar.of, bar.run.state_point)
    assert not bar.state.v[bar.v].any() and not bar.state.vd[bar.v].any()


def test_points_ahead_give_a_past_on_their_cubic(bar):
    bar.state.t[0], h = NOW, 0.01
    for k in range(PAST_POINTS):
        at = bar.run.state_point if k == 0 else bar.run.trial_point
        at.t[0], at.q[bar.q] = NOW + k * h, bar.motion(NOW + k * h)[0]
        record_point_ahead(bar.run, bar.of, at)
    np.testing.assert_allclose(bar.times, NOW - h * np.arange(PAST_POINTS))
    np.testing.assert_allclose(bar.values, bar.motion(bar.times), rtol=1e-9)


def test_points_ahead_that_jump_give_no_past(bar):
    bar.state.t[0] = NOW
    for k in range(PAST_POINTS):
        at = bar.run.state_point if k == 0 else bar.run.trial_point
        at.t[0], at.q[bar.q] = NOW + 0.01 * k, 1.0 * (k > 1)
        record_point_ahead(bar.run, bar.of, at)
    assert np.all(bar.times == -np.inf)


@pytest.mark.parametrize(("interval", "factor"), [(0.02, 1.0), (0.08, 1 / 64)])
def test_what_is_extrapolated_is_off_by_its_distance(bar, interval, factor):
    """Over the scale of errors; shorter steps than those of the past count by their cube."""
    bar.remember(NOW - interval * np.arange(PAST_POINTS))
    h, trial, v = 0.02, bar.work.trial, bar.v
    bar.of.reach[:] = 1.0
    bar.state.t[0], bar.state.q_scale[:], trial.t[0] = NOW, 0.5, NOW + h
    bar.state.q[bar.q], trial.dq[v], trial.q[bar.q] = 1.0, 3.0, 1.0 + 3.0 * h + 0.01
    found = extrapolation_error(bar.run, bar.of, bar.run.trial_point)
    most = bar.run.system.weights[v].max()
    assert found == pytest.approx(factor * 0.01 * most / 0.5, rel=1e-9)


def test_departures_from_the_path_of_the_rates_are_summed(bar):
    """Of steps, beside the sizes of the deformation; both by the mode that moves most."""
    bar.remember(PAST)
    h, trial, weight = 0.02, bar.work.trial, bar.run.system.weights[bar.v]
    bar.state.t[0], trial.t[0] = NOW, NOW + h
    bar.state.q[bar.q], bar.state.v[bar.v], bar.state.vd[bar.v] = 1.0, 3.0, 50.0
    for off in (0.02, 0.05):
        trial.q[bar.q] = 1.0 + 3.0 * h + 25.0 * h**2 + off
        update_history(bar.run, bar.of, bar.run.trial_point)
    memory = bar.state.memory[0]
    assert memory["static_lag"] == pytest.approx(0.07 * weight.max(), rel=1e-9)
    assert memory["static_size"] == pytest.approx(2.21 * weight.max(), rel=1e-9)


def test_the_present_becomes_the_newest_point(bar):
    bar.remember(PAST)
    bar.state.t[0], bar.state.q[bar.q], bar.state.v[bar.v] = NOW, bar.motion(NOW)[0], 1.0
    update_history(bar.run, bar.of, bar.run.state_point)
    times = [NOW, *PAST[:3]]
    np.testing.assert_allclose(bar.times, times)
    np.testing.assert_allclose(bar.values, bar.motion(times), rtol=1e-12)
