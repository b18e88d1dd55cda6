"""Contact against closed forms: rebounds, Hertz' impact, rolling and sliding spheres.

Penalty contact needs some depth, and its bristles some way, so what the closed forms take for
rigid is off by d/r or less; steps are chosen for 1e-4 of the motion.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from femeshes import line
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from truthkit import run

import flexmb
from flexmb.engine.forces.contact_pair import damping_factor, hertz_stiffness
from flexmb.errors import FlexmbWarning
from flexmb.fe import rectangle, reduce
from flexmb.model import Model

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


def test_rebound_by_fixed_steps():
    """The impact begins within a step: its speed is that of the step before and of this one."""
    made = ball([0, 0, 0], [0, 0, R + 0.01], [0, 0, -2.0], restitution=0.5, damping="exact")
    found = run(made, duration=0.02, outputs=10, step=2e-5, method="radau")
    assert found["speed.z"][-1] / 2.0 == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize(
    ("gravity", "speed", "least", "is_slow"),
    [(0.0, 5e-4, {}, True), (0.0, 5e-4, {"least_speed": 5e-6}, False), (0.0, 0.05, {}, False),
     (G, 0.2, {}, False), (G, 1e-4, {}, False)],
)  # fmt: skip
def test_impacts_below_the_least_speed_are_named(gravity, speed, least, is_slow):
    """Where they rebound by more than asked; not where a ball comes to rest by ever slower ones."""
    made = ball([0, 0, -gravity], [0, 0, R + speed], [0, 0, -speed], restitution=0.8, **least)
    with warnings.catch_warnings(record=True) as messages:
        warnings.simplefilter("always")
        result = flexmb.simulate(made, duration=2.5, outputs=25)
    assert [str(one.message)[:47] for one in messages] == is_slow * [
        "forces.touch: impacts below its least_speed of "
    ]
    if not gravity:
        assert (abs(result["speed.z"][-1] / speed - 0.8) > 0.01) == is_slow


@pytest.mark.parametrize(("gap", "lies"), [(0.0, True), (1e-5, False)])
def test_a_blow_on_what_lies_against_it_is_named(gap, lies):
    """Three equal balls in a row: the last one leaves with ((1 + e)/2)^2 of the speed of the first.

    Without a gap the two that touch are damped as at the least speed, and leave together.
    """
    model, e = Model("row"), 0.9
    for k, x in enumerate((-0.3, 2 * R - gap, 4 * R)):
        model.add_body(f"b{k}", **BALL, position=[x, 0, 0], velocity=[0 if k else 1.0, 0, 0])
        model.add_sensor(f"v{k}", "velocity", of=f"b{k}")
    for k in range(2):
        model.add_force(
            f"c{k}", "contact", between=[f"b{k}", f"b{k + 1}"],
            shapes=[{"type": "sphere", "radius": R}] * 2, stiffness=1e9, restitution=e,
        )  # fmt: skip
    with warnings.catch_warnings(record=True) as messages:
        warnings.simplefilter("always")
        result = flexmb.simulate(model, duration=1.0, outputs=50)
    assert [str(one.message)[:31] for one in messages] == lies * ["forces.c1: its sides lay agains"]
    assert (abs(result["v2.x"][-1] - ((1 + e) / 2) ** 2) < 2e-3) is not lies


@pytest.mark.parametrize(("method", "x"), [("explicit-rk", 0), ("explicit-rk", 1e3), ("radau", 0)])
def test_a_rebound_has_the_accuracy_of_the_run(method, x):
    """Its damping is by the speed at the onset, not by that where a step ended before it.

    Fall, impact and flight by SciPy from event to event; where steps end differs by the height.
    At 1 km radau's own floor is 1e-9 of this motion.
    """
    e, K, t_end = 0.8, 1e6, 0.18
    chi = brentq(lambda c: math.log((1 + c) / (1 - c * e)) - c * (1 + e), 1e-3, 0.999 / e)
    off = []
    for h in (0.05, 0.0501, 0.0502, 0.0503):
        v0 = math.sqrt(2 * G * h)

        def impact(_, y, v0=v0):
            return y[1], G - K * max(y[0], 0.0) ** 1.5 * (1 + chi * y[1] / v0) / M

        def apart(t, y):
            return y[0] if t > 1e-3 else 1.0

        apart.terminal = True
        out = solve_ivp(impact, (0, 0.1), (0.0, v0), "DOP853", events=apart, rtol=1e-13, atol=1e-15)
        left = t_end - v0 / G - out.t[-1]
        wanted = R - out.y[1, -1] * left - G * left**2 / 2
        found = run(
            ball([0, 0, -G], [x, -x, R + h], stiffness=K, exponent=1.5, restitution=e,
                 damping="exact"),
            duration=t_end, outputs=10, accuracy=1e-9, method=method, verify=False,
        )  # fmt: skip
        off.append(abs(found["place.z"][-1] - wanted))
    assert max(off) < 1e-9 * 0.05


def test_heights_of_a_bouncing_ball():
    """The k-th rebound reaches e^(2k) of the first height.

    Weight takes part in the impact with g T/v, T its duration: 4e-4 here.
    """
    e, h = 0.7, 0.5
    found = run(
        ball([0, 0, -G], [0, 0, R + h], restitution=e, stiffness=1e11),
        duration=1.6, outputs=1600, accuracy=1e-5,
    )  # fmt: skip
    z = found["place.z"] - R
    peaks = [z[k] for k in range(1, len(z) - 1) if z[k - 1] < z[k] >= z[k + 1] and z[k] > 0.02]
    np.testing.assert_allclose(peaks[:3], [h * e ** (2 * k) for k in (1, 2, 3)], rtol=5e-3)
    assert found.statistics["events"] >= 6


@pytest.mark.parametrize(
    "settings",
    [{}, {"method": "radau"}, {"method": "generalized-alpha"}, {"step": 1e-5}, {"x": 1e3}],
)
def test_what_is_pressed_from_rest_sinks_in_as_at_the_least_speed(settings):
    """A ball that just touches is pressed at once: m z'' = K d^n (1 + chi d'/v) - P, v = 1 mm/s."""
    settings = dict(settings)
    x, press = settings.pop("x", 0.0), 400.0
    model = ball([0, 0, -G], [x, 0, R])
    model.add_force("press", "force", at="ball", value=[0, 0, -press])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlexmbWarning)
        result = flexmb.simulate(model, duration=0.05, outputs=50, **settings)
    chi = damping_factor(0.5, "exact")
    assert rebound("exact", chi) == pytest.approx(0.5)

    def sinks(t, y):
        force = 1e8 * max(y[0], 0.0) ** 1.5 * (1 + chi * y[1] / 1e-3)
        return [y[1], (press + M * G - max(force, 0.0)) / M]

    exact = solve_ivp(
        sinks, (0, 0.05), [0, 0], "Radau", t_eval=result.time, rtol=1e-10, atol=1e-14
    ).y[0]
    np.testing.assert_allclose(R - result["place.z"], exact, atol=1e-4 * np.ptp(exact))


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


def test_hertz_ellipse_by_potentials():
    """Curvatures and depth of an ellipse of contact a, b as integrals over confocal ellipsoids.

    A = p ∫ dw/((a² + w) Δ), B likewise, d = p ∫ dw/Δ, Δ = √((a² + w)(b² + w) w) and p = 3 F/(4π E*)
    (Love, Mathematical Theory of Elasticity, section 137).
    """
    a, b, p = 1.0, 0.6, 3 / (4 * math.pi)

    def over(factor):
        def integrand(x):  # w = x²/(1 − x)², so that both ends are regular
            w, dw = (x / (1 - x)) ** 2, 2 * x / (1 - x) ** 3
            return factor(w) * dw / math.sqrt((a * a + w) * (b * b + w) * w)

        return p * quad(integrand, 0, 1, epsabs=1e-12)[0]

    curvatures = [2 * over(lambda w, s=s: 1 / (s * s + w)) for s in (a, b)]
    depth = over(lambda w: 1.0)
    assert hertz_stiffness(1.0, tuple(curvatures)) == pytest.approx(depth**-1.5, rel=1e-8)
    assert hertz_stiffness(1.0, (1.0, 1.0)) == pytest.approx(4 / 3, rel=1e-12)


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


@pytest.mark.parametrize("friction", [None, {**GLUED, "static": 0.2, "dynamic": 0.2}])
def test_in_a_plane_as_in_space(friction):
    """A ball that is thrown on an incline, in a planar scene and in space, by the same steps."""
    a = 0.3
    pull = [G * math.sin(a), 0, -G * math.cos(a)]
    found = []
    for plane in (None, "zx"):
        made = ball(pull, [0, 0, R + 0.01], stiffness=1e6, friction=friction)
        made.plane = plane
        found.append(run(made, duration=0.15, outputs=30, step=1e-4))
    np.testing.assert_allclose(found[0]["place.x"], found[1]["place.x"], atol=1e-9)
    np.testing.assert_allclose(found[0]["place.z"], found[1]["place.z"], atol=1e-9)
    assert found[0].statistics["steps"] == 1500  # nothing is shortened for the impact
    assert "events" not in found[0].statistics


def test_energy_never_grows_in_impacts():
    """Three balls in a corner of two planes and a post, any restitution: no energy from nothing."""
    rng = np.random.default_rng(5)
    made = Model("corner", gravity=[-2.0, 0, -G])
    sides = {"floor": {"type": "plane"}, "wall": {"type": "plane", "axis": "x"}}
    sides["post"] = {"type": "cylinder", "radius": 0.1, "axis": "y"}
    made.add_marker("ground.post", position=[0.5, 0, 0])
    for k in range(3):
        place = [0.15 + 0.25 * k, 0.02 * k, 0.3 + 0.1 * k]
        made.add_body(f"b{k}", **BALL, position=place, velocity=rng.normal(size=3).tolist())
        for name, side in sides.items():
            marker = "ground.post" if name == "post" else "ground"
            made.add_force(
                f"{name}{k}", "contact", between=[marker, f"b{k}"], stiffness=1e6,
                shapes=[side, {"type": "sphere", "radius": R}], restitution=0.3 + 0.3 * k,
                friction={"static": 0.5, "dynamic": 0.3, "stiffness": 1e5},
            )  # fmt: skip
    for i, j in ((0, 1), (1, 2), (0, 2)):
        made.add_force(
            f"pair{i}{j}", "contact", between=[f"b{i}", f"b{j}"], stiffness=1e6, restitution=0.8,
            shapes=[{"type": "sphere", "radius": R}] * 2,
        )  # fmt: skip
    found = run(made, duration=1.0, outputs=500, accuracy=1e-4)
    energy = found.stored("kinetic", "gravity", "spring")
    moved = energy.max() - energy.min()
    assert moved > 5.0
    # between outputs it may rise by as much as the balance is off
    assert np.diff(energy).max() < 2e-3 * moved
    assert found.mismatch() < 5e-3 * moved
    assert found.statistics["events"] > 10


@pytest.mark.seconds
def test_elastic_bar_that_hits_a_wall():
    """It stays for 2 L/c and leaves as fast as it came (St. Venant; Goldsmith, Impact, 1960).

    Ten elements follow the wave front to some tenth of the length.
    """
    E, rho, length, speed = 2.1e11, 7800.0, 0.5, 1.0
    bar = reduce(
        line(10, end=(length, 0, 0)), material={"E": E, "nu": 0.3, "density": rho},
        interfaces={"tip": "tip"}, modes=54, sections={"all": rectangle(0.02, 0.02)},
    )  # fmt: skip
    made = Model("bar")
    gap = 1e-5
    made.add_body("bar", bar, velocity=[speed, 0, 0])
    made.add_marker("ground.wall", position=[length + gap, 0, 0])
    made.add_force(
        "touch", "contact", between=["bar.tip", "ground.wall"], stiffness=1e10, exponent=1,
        shapes=[{"type": "points", "nodes": [10]}, {"type": "plane", "axis": "-x"}],
    )  # fmt: skip
    made.add_sensor("tip", "position", of="bar.tip")
    stay = 2 * length / math.sqrt(E / rho)
    found = run(made, duration=gap / speed + 2 * stay, outputs=1000, step=2e-7)
    inside = found.t[found["tip.x"] > length + gap]
    assert inside[-1] - inside[0] == pytest.approx(stay, rel=0.1)
    momentum = bar.mass * found.v[:, 0]  # of the mean-axis frame
    assert momentum[-1] == pytest.approx(-bar.mass * speed, rel=0.05)
    assert found.mismatch() < 1e-2 * 0.5 * bar.mass * speed**2


@pytest.mark.parametrize("method", ["generalized-alpha", "explicit-rk", "radau"])
def test_steps_too_long_for_an_impact_are_told(method):
    """The ball crosses the depth of its impact within one step: energy from nothing, and a word."""
    made = ball([0, 0, -G], [0, 0, R + 0.5])
    made.set_dynamics(duration=0.6, step=1e-2, outputs=60, method=method)
    with pytest.warns(FlexmbWarning, match=r"energy balance is off by \d+ % .* 0\.01 s are too lo"):
        flexmb.simulate(made)


def test_a_ball_at_rest_is_no_alarm(recwarn):
    """It lies on the plane, where the force of 1e8 N/m^1.5 carries its weight."""
    depth = (M * G / 1e8) ** (2 / 3)
    made = ball([0, 0, -G], [0, 0, R - depth])
    made.set_dynamics(duration=0.1, step=1e-3, outputs=10)
    rest = flexmb.simulate(made)
    assert not [warning for warning in recwarn if "energy" in str(warning.message)]
    assert rest.statistics["energy_balance_error"] < 1e-2


def pushed_back(t, omega=1000.0):
    """Place and force of a mass of 1 kg that is thrown by 2 m/s between stops 0.6 m apart."""
    count, phase = np.divmod(t + 0.15, 0.3 + np.pi / omega)
    late = np.maximum(omega * (phase - 0.3), 0.0)
    x = np.where(late > 0.0, 0.3 + 2 / omega * np.sin(late), -0.3 + 2 * phase)
    return np.where(count % 2 == 0, x, -x), 2 * omega * np.sin(late)


@pytest.mark.parametrize("method", ["auto", "radau"])
def test_pulses_of_stops_between_many_outputs(method):
    """Of 400 outputs those are compared at which the pulses of 3 ms are highest."""
    made = Model("stops")
    made.add_body("m", mass=1, inertia=[1] * 3, velocity=[2, 0, 0])
    made.add_joint("guide", "prismatic", between=["ground", "m"], axis="x")
    made.add_force("stops", "translational-stop", joint="guide", lower=-0.3, upper=0.3,
                   stiffness=1e6)  # fmt: skip
    made.add_sensor("m", "position", of="m")
    found = run(made, duration=3.0, outputs=400, accuracy=1e-4, method=method)
    x, force = pushed_back(found.t)
    own = np.abs(found.reaction("forces.stops")).max(axis=1)
    off = np.abs(own - force).max() / np.ptp(own)
    assert off / 3 < found.statistics["measured_error_of_reactions"] < 3 * off
    assert np.abs(found["m.x"] - x).max() < 1e-4
