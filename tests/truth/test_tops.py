"""Symmetric tops in closed form: steady precession, the sleeping top, the free one.

C and A are the moments of inertia about the axis of symmetry and across it, at the fixed point;
Goldstein, Classical Mechanics, 3rd ed., sections 5.6 and 5.7.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from truthkit import extrapolated, order, run

from flexmb.model import Model

M, L, G = 2.0, 0.3, 9.81
C = 0.02
ACROSS = 0.03  # about the centre of mass
A = ACROSS + M * L**2


def top(tilt, angular_velocity):
    """A top on a ball joint at the origin, its axis turned about x out of the vertical z."""
    made = Model("top", gravity=[0, 0, -G])
    made.add_body(
        "top", mass=M, center=[0, 0, L], inertia=[ACROSS, ACROSS, C],
        orientation={"axis": "x", "angle": float(tilt)}, angular_velocity=list(angular_velocity),
    )  # fmt: skip
    made.add_joint("point", "spherical", between=["ground", "top"])
    made.add_sensor("centre", "position", of="top.center")
    return made


def axis_at(tilt, azimuth):
    """(n, 3) unit vectors; at azimuth 0 as `top` stands."""
    up = np.full_like(azimuth, np.cos(tilt))
    return np.stack([np.sin(tilt) * np.sin(azimuth), -np.sin(tilt) * np.cos(azimuth), up], axis=1)


@pytest.mark.parametrize("root", ["slow", "fast"])
@pytest.mark.parametrize("tilt", [0.6, 2.0])
def test_steady_precession(tilt, root):
    """A Φ² cos θ − C s Φ + m g l = 0 for a spin s in space; the pin bears weight and m l sin θ Φ².

    Both roots keep the tilt and turn at Φ; errors are of order h².
    """
    spin = 200.0
    p = np.sqrt((C * spin) ** 2 - 4 * A * np.cos(tilt) * M * G * L)
    rates = (C * spin + np.array([1, -1]) * p) / (2 * A * np.cos(tilt))
    rate = rates[np.argmin(np.abs(rates)) if root == "slow" else np.argmax(np.abs(rates))]
    axis = axis_at(tilt, np.zeros(1))[0]
    own = spin - rate * np.cos(tilt)
    made = top(tilt, rate * np.array([0, 0, 1.0]) + own * axis)
    steps = np.array([1e-4, 5e-5])
    runs = [run(made, duration=1.0, step=h, outputs=50, newton_tolerance=1e-11) for h in steps]
    wanted = axis_at(tilt, rate * runs[0].t)
    places = [one.vector("centre") / L for one in runs]
    errors = [np.abs(place - wanted).max() for place in places]
    assert 1.9 < order(steps, errors) < 2.1, errors
    np.testing.assert_allclose(extrapolated(*places), wanted, rtol=0, atol=1e-5)
    forces = []
    for one in runs:
        turned = Rotation.from_quat(one.q[:, [4, 5, 6, 3]])  # J is the top's origin
        forces.append(turned.apply(one.reactions[:, :3]))
    inward = -M * L * rate**2 * wanted * [1, 1, 0]
    size = np.abs(inward).max() + M * G
    np.testing.assert_allclose(
        extrapolated(*forces), inward + [0, 0, M * G], rtol=0, atol=1e-5 * size
    )
    np.testing.assert_allclose(runs[0].reactions[:, 3:6], 0, atol=1e-12)  # it is a ball joint


@pytest.mark.parametrize("share", [0.3, 0.6, 1.1, 1.5])
def test_a_sleeping_top_wakes_below_its_critical_spin(share):
    """Upright it is stable from (C s)² = 4 A m g l on; `share` is (C s)² of that.

    Below, the slightest push takes it down to cos θ = 2 share − 1: energy and both momenta leave
    (1 − u)²(1 + u − 2 share) = 0 there for u = cos θ. A push of 1e-4 rad changes that by as much.
    """
    spin = np.sqrt(share * 4 * A * M * G * L) / C
    made = top(1e-4, spin * axis_at(1e-4, np.zeros(1))[0])
    result = run(made, duration=4.0, outputs=2000, accuracy=1e-5)
    deepest = result["centre.z"].min() / L
    if share > 1:
        assert np.arccos(deepest) < 1e-4 / np.sqrt(1 - 1 / share) * 1.5
    else:
        assert deepest == pytest.approx(2 * share - 1, abs=5e-4)


@pytest.mark.parametrize("across", [0.5, 2.0])
def test_free_symmetric_body_precesses_about_its_momentum(across):
    """At |H|/A about H, which stays, with its axis at a constant angle to it (A here across)."""
    along, spin = 1.0, np.array([1.5, -0.8, 3.0])
    made = Model("free")
    made.add_body("body", mass=1.0, inertia=[across, across, along], angular_velocity=list(spin))
    H = np.array([across, across, along]) * spin
    steps = np.array([2e-3, 1e-3])
    runs = [run(made, duration=5.0, step=h, outputs=50, newton_tolerance=1e-11) for h in steps]
    turned = Rotation.from_rotvec(np.outer(runs[0].t, H / across))
    wanted = turned.apply([0, 0, 1])
    axes = [Rotation.from_quat(one.q[:, [4, 5, 6, 3]]).apply([0, 0, 1]) for one in runs]
    errors = [np.abs(axis - wanted).max() for axis in axes]
    assert 1.9 < order(steps, errors) < 2.1, errors
    np.testing.assert_allclose(extrapolated(*axes), wanted, rtol=0, atol=1e-7)
    # In body axes the angular velocity turns at (C − A)/A of its third component.
    angle = (along - across) / across * spin[2] * runs[0].t
    c, s = np.cos(angle), np.sin(angle)
    seen = np.stack([c * spin[0] - s * spin[1], s * spin[0] + c * spin[1], spin[2] + 0 * c], axis=1)
    rates = extrapolated(*[one.v[:, 3:6] for one in runs])
    np.testing.assert_allclose(rates, seen, rtol=0, atol=1e-7 * np.linalg.norm(spin))
