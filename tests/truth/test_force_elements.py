"""Bushings, stops and springs by laws against closed forms.

The frequencies of a mass on a bushing, bouncing on a linear and on a Hertzian stop, Duffing's
oscillator, a line actuator, planar scenes.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipk, gamma
from truthkit import order, reference, run, stiffness_and_mass

from flexmb.analysis.assembly.initial_state import assemble
from flexmb.engine.compile import compile_system
from flexmb.model import Model

LAST_DIGITS = 1e-9


def test_frequencies_of_a_mass_on_a_bushing():
    """k/m along, k_r/J about each axis; the axes of the bushing are those of the ground marker."""
    m, J = 2.0, [0.3, 0.4, 0.5]
    k, turn = [100.0, 300.0, 700.0], [40.0, 50.0, 80.0]
    made = Model("mount")
    made.add_body("m", mass=m, inertia=J)
    made.add_force(
        "mount", "bushing", between=["ground", "m"], stiffness=k, rotational_stiffness=turn
    )
    K, M = stiffness_and_mass(made)
    found = np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real)
    wanted = np.sort([*(x / m for x in k), *(x / j for x, j in zip(turn, J, strict=True))])
    np.testing.assert_allclose(found, wanted, rtol=LAST_DIGITS)


def test_a_bushing_turns_by_its_rotation_vector():
    """About one axis it is the linear spring at any angle below half a turn: J φ'' + k φ = 0."""
    made = Model("twist")
    made.add_body("m", mass=1, inertia=[0.2, 0.2, 0.2], orientation={"axis": "z", "angle": 2.5})
    made.add_force("mount", "bushing", between=["ground", "m"], rotational_stiffness=[9, 9, 5],
                   stiffness=1, free="together")  # fmt: skip
    made.add_sensor("angle", "angle", between=["ground", "m"], axis=None)
    errors = []
    for h in (4e-3, 2e-3):
        found = run(made, duration=2.0, step=h, outputs=20)
        errors.append(np.abs(found["angle"] - 2.5 * np.cos(5.0 * found.t)).max())
        assert found.mismatch() < 1e-3 * found.energy[0, 3]
    assert errors[-1] < 3e-3
    assert 1.9 < order([2.0, 1.0], errors) < 2.1


M_, K_, V = 2.0, 8e4, 1.5


def bouncing(kind, gap=0.03, **fields):
    """A mass that slides towards a stop at speed V; the stop is at x = gap."""
    made = Model("bounce")
    made.add_body("m", mass=M_, inertia=[1, 1, 1], velocity=[V, 0, 0])
    made.add_joint("guide", "prismatic", between=["ground", "m"], axis="x")
    where = {"joint": "guide"} if kind == "translational-stop" else {"between": ["ground.eye", "m"]}
    made.add_marker("ground.eye", position=[-1.0 if "lower" not in fields else 0.0, 0, 0])
    made.add_force("stop", kind, stiffness=K_, **where, **fields)
    for sensor in ("position", "velocity"):
        made.add_sensor(sensor, sensor, of="m")
    return made


STOPS = {
    "joint": ("translational-stop", {"upper": 0.03}),
    "distance": ("stop", {"upper": 1.03}),
    "displacement": ("stop", {"axis": "x", "upper": 1.03}),
    "other side": ("stop", {"axis": "-x", "lower": -0.03}),
}


@pytest.mark.parametrize("name", STOPS)
def test_bouncing_on_a_linear_stop(name):
    """Touches at 20 ms for π √(m/k), goes in by V √(m/k), comes back as fast; slope 2."""
    kind, fields = STOPS[name]
    root = np.sqrt(M_ / K_)
    begin, end = 0.02, 0.02 + np.pi * root
    errors = []
    for h in (2e-4, 1e-4):
        found = run(bouncing(kind, **fields), duration=0.05, step=h, outputs=250)
        x = found["position.x"]
        t = found.t
        inside = 0.03 + V * root * np.sin((t - begin) / root)
        truth = np.where(t < begin, V * t, np.where(t < end, inside, 0.03 - V * (t - end)))
        errors.append(np.abs(x - truth).max() / 0.03)
        stored = 0.5 * K_ * np.clip(x - 0.03, 0.0, None) ** 2
        np.testing.assert_allclose(found.stored("spring"), stored, atol=1e-9)
    assert errors[-1] < 2e-3
    assert errors[-1] < 0.5 * errors[0]


def test_the_explicit_method_bounces_too():
    """Its system has a coordinate without mass on which the stop acts."""
    kind, fields = STOPS["joint"]
    found = run(
        bouncing(kind, **fields), duration=0.08, accuracy=1e-5, outputs=20, method="explicit-rk"
    )
    assert found["velocity.x"][-1] == pytest.approx(-V, rel=1e-4)


def test_a_stop_on_an_angle_counts_turns():
    """A rotor at 20 rad/s meets it after more than a turn, not before."""
    made = Model("rotor")
    made.add_body("rotor", mass=1, inertia=[1, 1, 0.5], angular_velocity=[0, 0, 20])
    made.add_joint("hinge", "revolute", between=["ground", "rotor"], axis="z")
    made.add_force("stop", "rotational-stop", joint="hinge", lower="-90 deg", upper="400 deg",
                   stiffness=2e4)  # fmt: skip
    made.add_sensor("angle", "angle", joint="hinge")
    found = run(made, duration=0.5, step=5e-4, outputs=100, newton_tolerance=1e-10)
    touch, root = np.deg2rad(400) / 20.0, np.sqrt(0.5 / 2e4)
    end = touch + np.pi * root
    t = found.t
    inside = np.deg2rad(400) + 20.0 * root * np.sin((t - touch) / root)
    truth = np.where(t < end, inside, np.deg2rad(400) - 20.0 * (t - end))
    truth = np.where(t < touch, 20.0 * t, truth)
    np.testing.assert_allclose(found["angle"], truth, rtol=0, atol=5e-3)


def test_contact_time_on_a_hertzian_stop():
    """2.94 p/V with p = (m V² (e + 1) / 2k)^(1/(e+1)) (Johnson, Contact Mechanics, 1985, 11.24)."""
    e, k = 1.5, 2e6
    p = (0.5 * M_ * V**2 * (e + 1.0) / k) ** (1.0 / (e + 1.0))
    factor = 2.0 * np.sqrt(np.pi) * gamma(1.0 / (e + 1.0)) / (e + 1.0)
    factor /= gamma(1.0 / (e + 1.0) + 0.5)
    assert factor == pytest.approx(reference("force_elements", "hertz contact time")["value"], 2e-3)
    made = bouncing("stop", axis="x", upper=1.03, exponent=e)
    made.forces["stop"] = made.forces["stop"].model_copy(update={"stiffness": k})
    found = run(made, duration=0.06, accuracy=1e-6, outputs=600)
    assert found["position.x"].max() - 0.03 == pytest.approx(p, rel=1e-3)
    # the way back: x = 0.03 − V (t − end)
    end = found.t[-1] - (0.03 - found["position.x"][-1]) / V
    assert end - 0.02 == pytest.approx(factor * p / V, rel=1e-4)


def test_damping_of_a_stop_takes_energy_and_it_never_pulls():
    found = run(
        bouncing("translational-stop", upper=0.03, damping=1500, depth=1e-3),
        duration=0.06, step=5e-5, outputs=600,
    )  # fmt: skip
    v = found["velocity.x"]
    assert v[-1] == pytest.approx(v[-50], abs=1e-9)  # clear again
    lost = 0.5 * M_ * (V**2 - v[-1] ** 2)
    assert 0.1 * M_ * V**2 < lost < 0.5 * M_ * V**2
    assert -found.stored("damper_work")[-1] == pytest.approx(lost, rel=1e-3)
    force = found.reactions[:, 12 * found.layout.reactions.index("forces.stop") + 2]
    assert force.max() <= 1e-6 * np.abs(force).max()


@pytest.mark.parametrize("kind", ["line", "joint"])
def test_duffings_oscillator(kind):
    """Period 4 K(m) / √(ω² (1 + ε)), ε = k3 a²/k, m = ε / (2 (1 + ε)).

    Kovacic & Brennan, The Duffing Equation, 2011, sec. 2.2.
    """
    k, k3, a = 50.0, 2000.0, 0.4
    law = f"{k}*x + {k3}*x**3"
    made = Model("Duffing", parameters={"k": k})
    made.add_body("m", mass=M_, inertia=[1, 1, 1], position=[2.0 + a, 0, 0])
    made.add_marker("ground.rest", position=[2, 0, 0])
    made.add_marker("m.eye", position=[0, 0, 0])
    made.add_joint("guide", "in-line", between=["ground.rest", "m"], axis="x")
    if kind == "line":
        made.add_force("spring", "spring-damper", between=["ground", "m"], free_length=2.0,
                       spring_force=law)  # fmt: skip
    else:
        made.add_force("spring", "translational-spring-damper", joint="guide", spring_force=law)
    made.add_sensor("x", "position", of="m", relative_to="ground.rest")
    eps = k3 * a * a / k
    period = 4.0 * ellipk(eps / (2.0 * (1.0 + eps))) / np.sqrt(k / M_ * (1.0 + eps))
    errors = []
    for n in (400, 800):
        found = run(made, duration=3.0 * period, step=period / n, outputs=300)
        assert found.stored("spring")[0] == pytest.approx(0.5 * k * a**2 + 0.25 * k3 * a**4)
        errors.append(abs(found["x.x"][-1] / a - 1.0))
        quarter = found["x.x"][found.at([0.25 * period, 2.5 * period])]
        np.testing.assert_allclose(quarter / a, [0.0, -1.0], atol=3e-3)
    assert errors[-1] < 1e-4


def test_a_line_actuator_pushes_apart():
    """Two free masses: m x'' = ±u(t); works agree."""
    made = Model("actuator")
    for name, m, x in (("a", 1.0, 0.0), ("b", 3.0, 1.0)):
        made.add_body(name, mass=m, inertia=[1, 1, 1], position=[x, 0, 0])
        made.add_sensor(name, "velocity", of=name)
    made.add_force("ram", "spring-damper", between=["a", "b"], value="6*t")
    found = run(made, duration=1.0, step=1e-2, outputs=10)
    np.testing.assert_allclose(found["a.x"], -3.0 * found.t**2, atol=1e-4)
    np.testing.assert_allclose(found["b.x"], found.t**2, atol=1e-4)
    assert found.stored("applied_work")[-1] == pytest.approx(0.5 * 9.0 + 1.5, rel=1e-3)


def test_in_a_plane_as_in_space():
    """A planar scene with every element moves as the spatial one, which nothing leads out of it."""
    found = []
    for plane in ("xy", None):
        made = Model("plane", plane=plane, gravity=[0, -9.81, 0])
        made.add_body("m", mass=2, inertia=[0.1, 0.2, 0.3], position=[0.5, 0.1, 0],
                      velocity=[1, -2, 0], angular_velocity=[0, 0, 3])  # fmt: skip
        made.add_marker("m.eye", position=[0.2, 0.1, 0])
        turned = {"axis": "z", "angle": 0.5}
        made.add_marker("ground.turned", position=[0.4, 0, 0], orientation=turned)
        ends = ["ground.turned", "m.eye"]
        made.add_force("bush", "bushing", between=ends, stiffness=[90, 200, 50],
                       rotational_stiffness=9, damping=[1, 2, 3])  # fmt: skip
        made.add_force("beam", "beam", between=ends, E=100, G=50, A=0.1, Iy=0.02, Iz=0.02, J=0.01)
        made.add_force("stop", "stop", between=ends, axis=[1, 1, 0], lower=0.3, stiffness=900,
                       exponent=1.5, damping=5, depth=0.1)  # fmt: skip
        made.add_force("law", "spring-damper", between=ends, spring_force="50*x**3", value="9*t")
        made.add_force("push", "force", at="m.eye", value=["5*t", 1, 0], axes="ground.turned")
        made.add_sensor("m", "position", of="m.eye")
        found.append(run(made, duration=0.5, step=2e-3, outputs=20, newton_tolerance=1e-12))
    flat, deep = found
    assert np.ptp(deep["m.y"]) > 0.1
    for name in ("q", "v", "sensors", "energy"):
        one, other = getattr(flat, name), getattr(deep, name)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * np.abs(other).max())


def test_a_start_inside_a_stop_is_told():
    made = bouncing("translational-stop", upper=-0.002)
    first = assemble(compile_system(made), made)
    assert first.notes == (
        "forces.stop is 0.002 m inside the stop at the start: it pushes from there on",
    )
    made = bouncing("stop", axis="x", upper=1.0)
    assert assemble(compile_system(made), made).notes == ()
