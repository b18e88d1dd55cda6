"""Reactions of moving mechanisms: Newton's and Euler's equations of every body, written out."""

from __future__ import annotations

import numpy as np
import pytest
from generators import Mechanism, random_rotation
from scipy.spatial.transform import Rotation
from truthkit import order, run


def thrown(topology):
    """All joint types, a driver, forces off the centres."""
    made = Mechanism(11, topology, "rigid", n=5, acting=False).model
    made.set_gravity([1.0, -2.0, -9.0])
    rng = np.random.default_rng(4)
    for name in made.bodies:
        at = f"{name}.probe"
        made.add_marker(at, position=list(random_rotation(rng)[0]))
        made.add_force(f"push_{name}", "force", at=at, value=["9*cos(5*t)", "4", "7*t"])
    driven = next(name for name, joint in made.joints.items() if joint.type == "revolute")
    made.add_driver("motor", joint=driven, angle="0.5*sin(8*t)")
    return made


@pytest.mark.parametrize("topology", ["chain", "tree", "star"])
def test_reactions_accelerate_the_bodies(topology):
    """m a and J α + ω×Jω of each body are what acts on it.

    To round-off with the explicit pair; generalized-alpha reports accelerations with stiff modes
    held back, of order h².
    """
    made = thrown(topology)
    knobs = {"duration": 0.2, "outputs": 10}
    result = run(made, step=2e-3, method="explicit-rk", **knobs)
    for row in (0, 3, 10):
        balance, size = euler(made, result, row)
        np.testing.assert_allclose(balance, 0, rtol=0, atol=1e-9 * size)
    steps, errors = np.array([4e-3, 2e-3, 1e-3]), []
    for h in steps:
        result = run(made, step=h, newton_tolerance=1e-11, **knobs)
        errors.append(max(np.abs(euler(made, result, row)[0]).max() for row in (3, 10)))
    assert 1.9 < order(steps, errors) < 2.1, errors


def euler(made, result, row):
    """(bodies, 6) what acts less m a and the change of spin, about centres; and their size."""
    t, names = result.t[row], list(made.bodies)
    q, v, vd = (x[row].reshape(len(names), -1) for x in (result.q, result.v, result.vd))
    turns = Rotation.from_quat(q[:, [4, 5, 6, 3]]).as_matrix()
    balance, size = np.zeros((len(names), 6)), 0.0
    for k, body in enumerate(made.bodies.values()):
        R, w, wd = turns[k], v[k, 3:], vd[k, 3:]
        c, J = np.array(body.center), np.array(body.inertia)
        a = vd[k, :3] + R @ (np.cross(wd, c) + np.cross(w, np.cross(w, c)))
        spin = R @ (J @ wd + np.cross(w, J @ w))
        change = np.hstack([body.mass * a, spin])
        push = np.array([9 * np.cos(5 * t), 4, 7 * t])
        arm = R @ (np.array(body.markers["probe"].position) - c)
        gravity = body.mass * np.array(made.gravity)
        balance[k] = np.hstack([gravity + push, np.cross(arm, push)]) - change
        size = max(size, np.abs(change).max())
    for path, part in zip(
        result.layout.reactions, result.reactions[row].reshape(-1, 4, 3), strict=True
    ):
        joint = path.removeprefix("joints.") if path.startswith("joints") else None
        spec = made.joints[joint or made.drivers[path.removeprefix("drivers.")].joint]
        for end, (force, moment) in ((spec.between[1], part[:2]), (spec.between[0], part[2:])):
            owner, _, marker = end.partition(".")
            if owner == "ground":
                continue
            k = names.index(owner)
            given = made.bodies[owner].markers[marker]
            M = turns[k] @ Rotation.from_quat(np.roll(given.orientation, -1)).as_matrix()
            arm = turns[k] @ (np.array(given.position) - np.array(made.bodies[owner].center))
            balance[k] += np.hstack([M @ force, M @ moment + np.cross(arm, M @ force)])
    return balance, size
