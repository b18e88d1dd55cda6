"""Motion recovered from stored states against the sensors of the time loop, which know it."""

from __future__ import annotations

import numpy as np
import pytest
from flexiblescenes import rod

import flexmb
from flexmb.model import Model
from flexmb.results.marker_history import MOTIONS, _rotation_rate, _rotation_rate_change


@pytest.fixture(scope="module")
def spun() -> flexmb.Result:
    """A soft rod that stiffens as it is thrown about a universal joint, with a marker on an arm."""
    made = Model("thrown rod", gravity=[0, -9.81, 3.0])
    body = rod(0.004, geometric_stiffening="full")
    made.add_body("rod", body)
    made.add_marker("rod.lug", position=[0.47, 0.03, -0.02], interface="tip")
    made.add_body("cart", mass=2.0, inertia=[0.02] * 3, velocity=[0.4, 0, 0])
    made.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
    made.add_joint("cross", "universal", between=["cart", "rod.root"], axis="z", second_axis="y")
    for motion in MOTIONS:
        made.add_sensor(motion, motion, of="rod.lug")
    for kind in ("angle", "second_angle"):
        made.add_sensor(kind, kind, joint="cross")
        made.add_sensor(f"{kind}_rate", kind, joint="cross", derivative=1)
    made.add_sensor("stroke", "stroke", joint="rail")
    made.add_sensor("stroke_rate", "stroke", joint="rail", derivative=1)
    return flexmb.simulate(made, duration=1.0, outputs=50, accuracy=1e-3)


def test_a_marker_moves_as_its_sensors_say(spun: flexmb.Result) -> None:
    for motion in MOTIONS:
        sensors = np.array([spun[f"{motion}.{axis}"] for axis in "xyz"])
        recovered = np.array([spun[f"rod.lug.{motion}.{axis}"] for axis in "xyz"])
        scale = np.abs(sensors).max()
        assert scale > 0
        np.testing.assert_allclose(recovered, sensors, rtol=0, atol=1e-11 * scale)
        assert spun.unit(f"rod.lug.{motion}.x") == spun.unit(f"{motion}.x")


def test_joints_have_the_coordinates_that_their_sensors_say(spun: flexmb.Result) -> None:
    for joint, kind in (("cross", "angle"), ("cross", "second_angle"), ("rail", "stroke")):
        for name in (kind, f"{kind}_rate"):
            values, scale = spun[name], np.ptp(spun[name])
            assert scale > 0.05
            np.testing.assert_allclose(spun[f"{joint}.{name}"], values, rtol=0, atol=1e-11 * scale)


def test_the_energies_of_the_modes_sum_to_that_of_the_body(spun: flexmb.Result) -> None:
    modes = range(spun.layout.body("rod").m)
    eta = np.array([spun[f"rod.eta.{k}"] for k in modes])
    elastic = 0.5 * np.einsum("in,ij,jn->n", eta, spun.flexbody("rod").K, eta)
    total = sum(spun[f"rod.mode_energy.{k}"] for k in modes)
    np.testing.assert_allclose(total, elastic, rtol=1e-12)
    assert elastic.max() > 0


def test_the_turning_of_large_rotation_vectors_is_that_of_their_matrices() -> None:
    """Angular velocity and its change by differences of exp(theta), small and large angles."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(3)
    h = 1e-4
    for size in (1e-9, 0.1, 0.5, 0.6, 2.0, 3.0):
        theta, rate = rng.normal(size=(2, 3))
        theta *= size / np.linalg.norm(theta)

        def angular(t: float, theta=theta, rate=rate) -> np.ndarray:
            x, y = Rotation.from_rotvec(theta + (t + h) * rate), theta + (t - h) * rate
            return (x * Rotation.from_rotvec(y).inv()).as_rotvec() / (2 * h)

        at = theta[None, :], rate[None, :]
        np.testing.assert_allclose(_rotation_rate(*at)[0], angular(0.0), atol=1e-6)
        slope = (angular(1e-3) - angular(-1e-3)) / 2e-3
        np.testing.assert_allclose(_rotation_rate_change(*at)[0], slope, atol=1e-4)


def test_what_was_not_stored_cannot_be_recovered_and_is_not_listed(tmp_path) -> None:
    made = Model("pendulum", gravity=[0, -9.81, 0])
    made.add_body("bob", mass=1.0, inertia=[0.1] * 3)
    made.add_marker("ground.hook", position=[0, 1.0, 0])
    made.add_marker("bob.eye", position=[0, 1.0, 0])
    made.add_joint("hinge", "revolute", between=["ground.hook", "bob.eye"], axis="z")
    made.set_results(keep=["poses"])
    result = flexmb.simulate(made, duration=0.1, outputs=5, step=1e-2)
    names = result.channels("motion")
    assert "bob.eye.position.x" in names and "hinge.angle" in names
    assert not [name for name in names if "velocity" in name or "rate" in name]
    assert "bob.eye.velocity.x" not in result
