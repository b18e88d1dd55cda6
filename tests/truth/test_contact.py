"""Contact against closed forms: rebounds, Hertz' impact, rolling and sliding spheres.

Penalty contact needs some depth, and its bristles some way, so what the closed forms take for
rigid is off by d/r or less; steps are chosen for 1e-4 of the motion.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from truthkit import run

from flexmb.engine.compile.hertz import hertz_stiffness
from flexmb.model import Model
from flexmb.model.contacts import damping_factor

pytestmark = pytest.mark.slow

G, R, M = 9.81, 0.1, 1.0
BALL = {"mass": M, "inertia": [0.4 * M * R * R] * 3}
GLUED = {"static": 0.8, "dynamic": 0.8, "stiffness": 1e5, "damping": 100.0}


def ball(gravity, position, velocity=(0, 0, 0), shape=None, **contact):
    """A ball before a plane z = 0, or another shape at the origin."""
    made = Model("ball", gravity=gravity)
    made.add_body("ball", **BALL, position=position, velocity=velocity)
    made.add_force(
        "touch", "contact", between=["ball", "ground"],
        shapes=[{"type": "sphere", "radius": R}, shape or {"type": "plane"}],
        **{"stiffness": 1e8, "restitution": 0.5, **contact},
    )  # fmt: skip
    made.add_sensor("place", "position", of="ball")
    made.add_sensor("speed", "velocity", of="ball")
    return made


def rebound(law, chi):
    """Restitution of F = K dⁿ (1 + χ ḋ/ḋ₀): the root of χ (1 + e) = ln((1 + χ)/(1 − χ e))."""
    return brentq(
        lambda e: chi * (1 + e) - math.log((1 + chi) / (1 - chi * e)), 1e-9, 1 / chi - 1e-12
    )


@pytest.mark.parametrize(
    ("law", "e"),
    [("exact", 0.2), ("exact", 0.5), ("exact", 0.9), ("flores", 0.5), ("lankarani-nikravesh", 0.9)],
)
def test_rebound(law, e):
    """Speed after an impact over that before, without weight; what published laws give, they give.

    The impact obeys v dv/dd = −K dⁿ (1 + χ v/v₀)/m, which separates: both branches have the same
    depth for χ (1 + e) = ln((1 + χ)/(1 − χ e)), for all K, n, m and v₀ (Gonthier et al. 2004).
    """
    found = run(
        ball([0, 0, 0], [0, 0, R + 0.01], [0, 0, -2.0], restitution=e, damping=law),
        duration=0.02, outputs=10, accuracy=1e-4,
    )  # fmt: skip
    chi = damping_factor(e, law)
    wanted = e if law == "exact" else rebound(law, chi)
    assert found["speed.z"][-1] / 2.0 == pytest.approx(wanted, abs=2e-3)
    assert found.mismatch() <= 1e-3 * 0.5 * M * 4.0


def test_heights_of_a_bouncing_ball():
    """The k-th rebound reaches e^(2k) of the first height; contact lasts some thousandths."""
    e, h = 0.7, 0.5
    found = run(
        ball([0, 0, -G], [0, 0, R + h], restitution=e, stiffness=1e9),
        duration=1.6, outputs=1600, accuracy=1e-4,
    )  # fmt: skip
    z = found["place.z"] - R
    peaks = [z[k] for k in range(1, len(z) - 1) if z[k - 1] < z[k] >= z[k + 1] and z[k] > 0.02]
    np.testing.assert_allclose(peaks[:3], [h * e ** (2 * k) for k in (1, 2, 3)], rtol=5e-3)
    assert found.statistics["events"] >= 6


def test_impact_of_two_spheres():
    """Duration 2.94 (15/16 m/(E* √R*))^(2/5) v^(−1/5), depth (15/16 m v²/(E* √R*))^(2/5).

    Johnson, Contact Mechanics (1985), section 11.4; m and R* those of the pair.
    """
    E, nu, radius, speed = 2.1e11, 0.3, 0.02, 1.0
    mass = 4 / 3 * math.pi * radius**3 * 7850
    made = Model("impact")
    for name, side in (("a", -1), ("b", 1)):
        made.add_body(
            name, mass=mass, inertia=[0.4 * mass * radius**2] * 3,
            position=[side * (radius + 1e-5), 0, 0], velocity=[-side * speed / 2, 0, 0],
        )  # fmt: skip
    made.add_force(
        "touch", "contact", between=["a", "b"], shapes=[{"type": "sphere", "radius": radius}] * 2,
        materials=[{"E": E, "nu": nu, "density": 7850}] * 2,
    )  # fmt: skip
    made.add_sensor("gap", "position", of="b", relative_to="a")
    found = run(made, duration=2e-4, outputs=2000, accuracy=1e-5)
    depth = 2 * radius - found["gap.x"]
    inside = found.t[depth > 0]
    stiff = E / (2 * (1 - nu**2)) * math.sqrt(radius / 2)
    size = (15 / 16 * mass / 2 * speed**2 / stiff) ** 0.4
    assert inside[-1] - inside[0] == pytest.approx(2.94 * size / speed, rel=5e-3)
    assert depth.max() == pytest.approx(size, rel=1e-3)


def test_depth_under_an_ellipse_of_contact():
    """Crossed cylinders' ratio B/A = 2: depths by Hertz' tables (Johnson, section 4.2, by F₂).

    Approximation of Johnson's eq. (4.26c): F₂ = 1 − ((B/A)^0.0684 − 1), good to some 2 %.
    """
    found = hertz_stiffness(1.0, (1.0, 2.0))
    factor = 1 - (2**0.0684 - 1)
    approximate = 4 / 3 * 2**-0.25 * factor**-1.5
    assert found == pytest.approx(approximate, rel=0.02 * 1.5)


@pytest.mark.parametrize(("mu", "share"), [(0.5, None), (0.05, 0.05)])
def test_sphere_on_an_incline(mu, share):
    """It rolls with 5/7 g sin a if μ ≥ 2/7 tan a, else it slides with g (sin a − μ cos a)."""
    a = 0.3
    friction = {**GLUED, "static": mu, "dynamic": mu}
    found = run(
        ball([G * math.sin(a), 0, -G * math.cos(a)], [0, 0, R], friction=friction),
        duration=1.0, outputs=50, accuracy=1e-3,
    )  # fmt: skip
    pull = np.polyfit(found.t[20:], found["place.x"][20:], 2)[0] * 2
    slides = G * (math.sin(a) - mu * math.cos(a))
    assert pull == pytest.approx(5 / 7 * G * math.sin(a) if share is None else slides, rel=1e-6)


def test_ball_thrown_flat_slides_until_it_rolls():
    """A sphere set down with speed v slides for 2 v/(7 μ g) and rolls on with 5/7 v."""
    mu, speed = 0.2, 1.0
    friction = {**GLUED, "static": mu, "dynamic": mu}
    depth = (M * G / 1e8) ** (2 / 3)
    found = run(
        ball([0, 0, -G], [0, 0, R - depth], [speed, 0, 0], friction=friction),
        duration=0.4, outputs=400, accuracy=1e-4,
    )  # fmt: skip
    end = 2 * speed / (7 * mu * G)
    sliding = (found.t > 0.01) & (found.t < 0.9 * end)
    np.testing.assert_allclose(
        found["speed.x"][sliding], speed - mu * G * found.t[sliding], atol=1e-4
    )
    # the bristle rings down after it sticks: ω = √(k/m · 7/2), damped at 100/(2·447) of critical
    assert found["speed.x"][-1] == pytest.approx(5 / 7 * speed, rel=1e-4)


def test_sphere_that_rolls_in_a_bore():
    """(7/5) (R − r) θ'' = −g sin θ, any angle."""
    from scipy.integrate import solve_ivp

    bore, angle = 0.5, 0.6
    found = run(
        ball(
            [0, 0, -G], [(bore - R) * math.sin(angle), 0, -(bore - R) * math.cos(angle)],
            shape={"type": "cylinder", "radius": bore, "axis": "y", "side": "inside"},
            friction=GLUED,
        ),
        duration=1.0, outputs=100, accuracy=1e-3,
    )  # fmt: skip
    truth = solve_ivp(
        lambda t, y: [y[1], -5 / 7 * G / (bore - R) * math.sin(y[0])],
        (0, 1), [angle, 0], t_eval=found.t, rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    swing = np.arctan2(found["place.x"], -found["place.z"])
    # it is let go without load: depth and bristle take up the weight in the first moments
    np.testing.assert_allclose(swing, truth.y[0], atol=2e-3)
