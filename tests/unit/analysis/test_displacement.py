"""Displaced motions, and forces carried, are the same about any point of a body."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from flexmb.analysis.effects.perturbation import displaced
from flexmb.analysis.effects.stored_motion import Motion, _move_moments
from flexmb.engine.tables import BodyColumns, Layout

ARM = np.array([0.7, -1.3, 0.4])
RANDOM = np.random.default_rng(3)


def layout(*references):
    bodies = (BodyColumns("body", 0, 0, 0),)
    return Layout(bodies, (), 7, 6, 0, (), (), (), (), "", references=references)


def state(n=5):
    q, v, vd = RANDOM.standard_normal((n, 7)), *RANDOM.standard_normal((2, n, 6))
    q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1)[:, None]
    return q, v, vd


def motion(q, v, vd):
    none = np.zeros((len(q), 0))
    return Motion(np.arange(len(q)), q, v, vd, none, none)


def test_a_displaced_motion_is_that_of_a_body_whatever_its_frame():
    """About the frame and about a point 1.5 m away: one motion, turned by up to 2 rad."""
    frames, points = layout(), layout(tuple(ARM))
    q, v, vd = state()
    dq, dv, dvd = RANDOM.standard_normal((3, 5, 6))
    h = 1e-6
    changes = []
    for sign in (1.0, -1.0):  # the same changes, of the coordinates of the other point
        moved = displaced(frames, motion(q, v, vd), *(sign * h * x for x in (dq, dv, dvd)))
        changes.append(points.of_equations(*moved))
    there = points.of_equations(q, v, vd)
    A = Rotation.from_quat(np.roll(there[0][:, 3:], -1, axis=1))
    shift = (changes[0][0][:, :3] - changes[1][0][:, :3]) / (2 * h)
    ends = [Rotation.from_quat(np.roll(one[0][:, 3:], -1, axis=1)) for one in changes]
    turn = (ends[1].inv() * ends[0]).as_rotvec() / (2 * h)
    rates = [(changes[0][k] - changes[1][k]) / (2 * h) for k in (1, 2)]
    np.testing.assert_allclose(turn, dq[:, 3:], atol=1e-6)
    np.testing.assert_allclose(shift, dq[:, :3] + A.apply(np.cross(dq[:, 3:], ARM)), atol=1e-6)
    whole = points.of_equations(*displaced(frames, motion(q, v, vd), dq, dv, dvd))
    found = displaced(points, motion(*there), np.hstack([shift, turn]), *rates)
    for one, other in zip(whole, found, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_a_displacement_is_the_end_of_a_steady_screw():
    """Of the twist (d, θ) in body axes for one second, integrated by scipy."""
    q, v, vd = state(1)
    dq = RANDOM.standard_normal((1, 6))
    axes = Rotation.from_quat(np.roll(q[0, 3:], -1))
    twist = axes.inv().apply(dq[0, :3])

    def rate(t, _):
        return (axes * Rotation.from_rotvec(t * dq[0, 3:])).apply(twist)

    end = solve_ivp(rate, (0, 1), q[0, :3], rtol=1e-10, atol=1e-12).y[:, -1]
    found, _, _ = displaced(layout(), motion(q, v, vd), dq, np.zeros((1, 6)), np.zeros((1, 6)))
    np.testing.assert_allclose(found[0, :3], end, atol=1e-8)


def test_moments_are_about_the_points_of_the_model_that_takes_them():
    """Their power in any motion of the body is the same."""
    q, v, _ = state()
    forces = RANDOM.standard_normal((5, 6))
    for old, new in ((layout(), layout(tuple(ARM))), (layout(tuple(ARM)), layout())):
        carried = forces.copy()
        _move_moments(carried, q, old, new)
        before = old.of_equations(q, v)[1]
        after = new.of_equations(q, v)[1]
        powers = [(f * u).sum(axis=1) for f, u in ((forces, before), (carried, after))]
        np.testing.assert_allclose(*powers, atol=1e-12)
