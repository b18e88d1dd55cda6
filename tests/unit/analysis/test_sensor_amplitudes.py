"""Changes of sensors and reactions by vibrations, beside statics by hand."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.analysis.linear.state_equations import (
    StateEquations,
    Tangents,
    multipliers_of,
    relative_poses,
    relative_rotations,
    sensor_amplitudes,
)
from flexmb.engine.allocation import new_state
from flexmb.engine.compile import compile_system
from flexmb.model import Model


def test_reactions_change_in_the_axes_of_a_marker_that_tilts() -> None:
    """A pendulum that hangs from a ball joint: its weight is across the axes of its own end."""
    mass, g, length, omega = 2.0, 10.0, 0.5, 7.0
    model = Model("pendulum", gravity=[0, 0, -g])
    model.add_body("rod", mass=mass, inertia=[0.01] * 3, position=[0, 0, -length])
    model.add_marker("rod.top", position=[0, 0, length])
    model.add_joint("ball", "spherical", between=["ground", "rod.top"])
    model.add_sensor("rod", "position", of="rod")
    compiled = compile_system(model)
    state = new_state(compiled.system, len(compiled.layout.channels))
    state.q[:], state.v[:], state.vd[:] = [0, 0, -length, 1, 0, 0, 0], 0.0, 0.0
    equations = StateEquations(compiled, state)
    Cq = equations.tangents().Cq
    force = np.array([0.0, 0.0, mass * g, 0.0, 0.0, 0.0])  # of the joint, on the rod
    state.lam[:] = -np.linalg.lstsq(Cq.T, force, rcond=None)[0]
    now = equations.channels_and_reactions()[3:].reshape(2, 6)
    on_rod = now[0] if now[0, 2] > 0.0 else now[1]
    assert on_rod[:3] == pytest.approx(force[:3])
    tilt = 1.0  # about y; the centre moves by -tilt * length along x
    X = np.array([[-tilt * length], [0.0], [0.0], [0.0], [tilt], [0.0]])
    inertia = mass * omega**2 * tilt * length  # along x, for the acceleration -omega² X
    aside = np.array([inertia, 0.0, 0.0, 0.0, inertia * length, 0.0])  # at the top
    lam = -np.linalg.lstsq(Cq.T, aside, rcond=None)[0][:, None]
    change = sensor_amplitudes(equations, np.array([omega]), X, lam)[0, :, 0]
    assert change[:3] == pytest.approx([-length, 0.0, 0.0], abs=1e-6)
    side = change[3:].reshape(2, 6)[0 if now[0, 2] > 0.0 else 1]
    assert side[:3] == pytest.approx([inertia - mass * g * tilt, 0.0, 0.0], abs=1e-4)


def test_angles_without_mass_do_not_hide_multipliers() -> None:
    """An angle of a joint has no mass but what is left of negligible damping: of a robot with an
    angle sensor 0.01 % of forces were told for 50 %."""
    M, Cq = np.diag([2.0, 3.0, 1e-37]), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -1.0]])
    at = Tangents(M, np.zeros((3, 3)), np.zeros((3, 3)), Cq, Cq.T)
    lam = multipliers_of(at, np.array([[5.0], [7.0], [0.0]]), np.array([2]))
    np.testing.assert_allclose(lam[:, 0], [5.0, 0.0], atol=1e-9)


@pytest.mark.parametrize(("joint", "moves"), [("prismatic", 0.5), ("revolute", 0.0)])
def test_a_body_that_slides_is_in_another_pose(joint, moves) -> None:
    """A car on a beam was in one pose at both its ends: 66 % of a moment were told for 20 %."""
    model = Model("trolley", gravity="none")
    for name in ("beam", "car"):
        model.add_body(name, mass=1.0, inertia=[0.1] * 3)
    model.add_joint("a", "spherical", between=["ground", "beam"])
    model.add_joint("rail", joint, between=["beam", "car"], axis="z")
    compiled = compile_system(model)
    car = compiled.layout.bodies[1].iq + 2
    q = np.zeros((2, compiled.layout.nq))
    for body in compiled.layout.bodies:
        q[:, body.iq + 3] = 1.0
    q[1, car] = 0.25 * compiled.length * moves
    parts = np.hstack(relative_poses(compiled, relative_rotations(compiled, model), q))
    assert np.linalg.norm(parts[1] - parts[0]) == pytest.approx(moves / np.hypot(1.0, moves))
