"""Free flight keeps momentum and moment of momentum: to 1e-12 where the method can.

Linear momentum is a sum of m v over bodies whose frames stand in their centres of mass; joint
forces cancel in it at every time, and a step adds up accelerations with the same weights for all
bodies: it is kept to round-off at any step. Elsewhere momentum is a function of positions and
velocities that is not linear: A(t) turns under what is summed up in body axes, so a method that
does not conserve it by design keeps it to its order, h² for generalized-alpha and h⁵ or h⁸ for the
others. At speeds of some rad/s h⁵ is 1e-12 for h = 4e-3 s; h² is for h = 1e-6 s, which only
bodies without joints can use: with joints Newton's method leaves round-off in the accelerations,
u/(β'h²), which is larger than that.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from generators import cloud
from truthkit import momentum, order, run

from flexmb.flexbody import Interface
from flexmb.model import Model

G = np.array([1.0, -9.0, 3.0])
SPINS = [1.0, 2.0, -1.5], [-1.0, 0.5, 3.0]
SPEED = [0.3, -0.2, 0.5]


def points(m, seed, centered):
    """A cloud; `centered`: its frame is in the centre of mass, which its modes do not move."""
    made = cloud(np.random.default_rng(seed), m)
    if not centered:
        return made
    means = np.einsum("k,kam->am", made.mass, made.N) / made.mass.sum()
    return replace(made, s=made.s - made.center, N=made.N - means)


def add_body(made, name, points, at, spin):
    """A rigid or flexible body with the marker `end` 0.2 m off its frame."""
    place = {"position": at, "velocity": SPEED, "angular_velocity": spin}
    if points.m:
        shapes = 0.1 * np.random.default_rng(9).standard_normal((2, 3, points.m))
        ends = [Interface("end", np.array([0.2, 0.0, 0.0]), *shapes)]
        made.add_body(name, points.flexbody(name, ends), **place)
    else:
        made.add_body(name, **points.rigid_fields(), **place)
        made.add_marker(f"{name}.end", position=[0.2, 0.0, 0.0])


def flight(modes, joint=None, centered=True):
    """One body, or two (with so many modes) and a joint between them; model and clouds."""
    made = Model("free flight")
    clouds = [points(m, 3 + k, centered) for k, m in enumerate(modes)]
    for k, one in enumerate(clouds):
        add_body(made, f"b{k}", one, [0.1 + 0.4 * k, -0.3, 0.2], SPINS[k])
    if joint is not None:
        made.add_marker(
            "b1.start", position=[-0.2, 0.0, 0.0], interface="end" if modes[1] else None
        )
        axis = {} if joint in ("spherical", "fixed") else {"axis": "z"}
        made.add_joint("joint", joint, between=["b0.end", "b1.start"], **axis)
    return made, clouds


SCENES = {
    "rigid body": lambda centered: flight([0], None, centered),
    "flexible body": lambda centered: flight([3], None, centered),
    "rigid bodies on a hinge": lambda centered: flight([0, 0], "revolute", centered),
    "flexible bodies on a ball joint": lambda centered: flight([3, 4], "spherical", centered),
    "rigid and flexible body on a slide": lambda centered: flight([0, 3], "prismatic", centered),
}
each_scene = pytest.mark.parametrize("name", SCENES)


def losses(made, clouds, **knobs):
    """Largest change of momentum and of moment of momentum over their sizes; all bodies turn."""
    result = run(made, **knobs)
    for body in result.layout.bodies:
        # Euler parameters: 2 sin(angle/4), here for half a radian a second
        assert np.abs(result.q - result.q[0])[:, body.iq + 3 : body.iq + 7].max() > (
            0.2 * min(result.t[-1], 1.0)
        )
    found, _ = momentum(clouds, result)
    change = np.abs(found - found[0]).max(axis=0).reshape(2, 3).max(axis=1)
    return change / np.linalg.norm(found[0].reshape(2, 3), axis=1)


@each_scene
@pytest.mark.parametrize(
    "knobs",
    [
        {"step": 0.02}, {"step": 0.001, "spectral_radius": 0.0},
        {"step": 0.25, "method": "explicit-rk"},
        {"step": 0.1, "method": "explicit-rk", "order": 5},
        {"step": 0.1, "method": "radau", "newton_tolerance": 1e-12},
    ],
    ids=["large steps", "small steps", "explicit", "explicit of order 5", "radau"],
)  # fmt: skip
def test_linear_momentum_is_kept_at_any_step(name, knobs):
    made, clouds = SCENES[name](True)
    linear, angular = losses(made, clouds, duration=1.0, outputs=4, **knobs)
    assert linear < 1e-14
    assert angular > 1e-10  # where moment of momentum is not


@each_scene
@pytest.mark.parametrize("method", ["auto", "generalized-alpha", "explicit-rk", "radau"])
def test_linear_momentum_is_kept_under_error_control(name, method):
    """To round-off, of moment of momentum what was asked for."""
    made, clouds = SCENES[name](True)
    linear, angular = losses(
        made, clouds, duration=1.0, outputs=50, accuracy=1e-2, method=method
    )  # fmt: skip
    assert linear < 2e-14
    assert angular < 2e-2


@each_scene
@pytest.mark.parametrize("centered", [True, False])
def test_all_momenta_are_kept_by_small_steps(name, centered):
    """To 1e-12 wherever the frames of the bodies are; by order 8 in a few hundred steps a turn."""
    made, clouds = SCENES[name](centered)
    found = losses(made, clouds, duration=0.5, step=1e-2, outputs=10, method="explicit-rk")
    assert found.max() < 1e-12
    knobs = {"method": "explicit-rk", "order": 5}
    found = losses(made, clouds, duration=0.5, step=2e-3, outputs=10, **knobs)
    assert found.max() < 1e-12


@pytest.mark.parametrize("name", ["rigid body", "flexible body"])
def test_all_momenta_are_kept_by_generalized_alpha_without_joints(name):
    made, clouds = SCENES[name](False)
    found = losses(made, clouds, duration=0.02, step=1e-6, outputs=4, newton_tolerance=1e-12)
    assert found.max() < 1e-12


@each_scene
@pytest.mark.parametrize(
    ("p", "knobs", "h"),
    [
        (2, {"method": "generalized-alpha", "newton_tolerance": 1e-11}, [4e-3, 2e-3, 1e-3]),
        (5, {"method": "explicit-rk", "order": 5}, [2e-2, 1e-2, 5e-3]),
        (5, {"method": "radau", "newton_tolerance": 1e-12}, [5e-2, 2.5e-2]),
        (8, {"method": "explicit-rk", "order": 8}, [1e-1, 5e-2]),
    ],
    ids=["generalized-alpha", "order 5", "radau", "order 8"],
)
def test_moment_of_momentum_errs_by_the_order(name, p, knobs, h):
    """Or the order above, which errors of what is conserved may be of."""
    made, clouds = SCENES[name](False)
    errors = np.array([losses(made, clouds, duration=0.5, outputs=5, step=s, **knobs) for s in h])
    for k in range(2):
        assert p - 0.2 < order(h, errors[:, k]) < p + (0.3 if p == 2 else 1.0), errors[:, k]


@each_scene
def test_the_centre_of_mass_flies_a_parabola(name):
    """Under gravity: x + v t + ½ g t², m g t of momentum; constant accelerations are exact."""
    made, clouds = SCENES[name](True)
    made.set_gravity(G.tolist())
    result = run(made, duration=1.0, step=0.02, outputs=50)
    found, center = momentum(clouds, result)
    mass, t = sum(one.mass.sum() for one in clouds), result.t[:, None]
    start = found[0, :3] / mass
    size = np.linalg.norm(G)
    np.testing.assert_allclose(
        center, center[0] + start * t + 0.5 * G * t**2, rtol=0, atol=1e-12 * size
    )
    np.testing.assert_allclose(found[:, :3] / mass, start + G * t, rtol=0, atol=1e-12 * size)
