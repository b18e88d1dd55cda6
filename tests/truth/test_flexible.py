"""Flexible bodies in motion: equilibrium under rotation, limits, energy, momentum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from accuracyscenes import beside_a_large_motion
from femeshes import line
from flexiblescenes import flexible_crank, flexible_pendulum, rod
from generators import cloud
from truthkit import momentum, order, run

from flexmb.analysis.assembly.initial_state import assemble
from flexmb.engine.compile import compile_system
from flexmb.errors import AssemblyError
from flexmb.fe import rectangle, reduce
from flexmb.flexbody import Interface, rigid_body
from flexmb.model import Model

E, RHO = 2.1e11, 7800.0
R, L = 0.1, 0.45  # crank and rod, m


def beam(length, modes, n=8, height=0.012):
    """A steel bar along x with the interfaces root and tip."""
    return reduce(
        line(n, end=(length, 0, 0)),
        material={"E": E, "nu": 0.3, "density": RHO},
        interfaces={"root": "root", "tip": "tip"}, modes=modes,
        sections={"all": rectangle(height, 0.02)},
    )  # fmt: skip


# --- a bar turning at constant speed ---


def spinning_bar(hub, speed):
    """The bar on a hub of a given radius, driven about z."""
    made = Model("bar on a hub")
    made.add_body("hub", mass=1.0, inertia=[0.1] * 3)
    made.add_marker("hub.rim", position=[hub, 0, 0])
    made.add_body("bar", beam(0.5, 42), position=[hub, 0, 0])
    made.add_joint("axle", "revolute", between=["ground", "hub"], axis="z")
    made.add_joint("root", "fixed", between=["hub.rim", "bar.root"])
    made.add_driver("motor", joint="axle", angle=f"{speed!r}*t")
    made.add_sensor("tip", "position", of="bar.tip", relative_to="hub")
    made.add_sensor("tip_acceleration", "acceleration", of="bar.tip")
    return made


@pytest.mark.parametrize("hub", [0.0, 0.3])
def test_spinning_bar_is_stretched_from_the_start(hub):
    """Stretch of a bar in equilibrium with its centrifugal load, and no ringing about it.

    With k = Ω √(ρ/E): u(L) = hub/cos kL + tan(kL)/k − hub − L, to first order
    ρ Ω² L²/E (hub/2 + L/3). All modes of 8 elements are kept; they err by some
    (k L/8)², 1e-6.
    """
    length, speed = 0.5, 150.0  # its first bending mode (clamped, 12 mm) is at 250 rad/s
    result = run(
        spinning_bar(hub, speed), duration=0.02, step=5e-6, outputs=200, start="quasi-static",
        newton_tolerance=1e-9,
    )  # fmt: skip
    k = speed * np.sqrt(RHO / E)
    stretch = hub / np.cos(k * length) + np.tan(k * length) / k - hub - length
    first_order = RHO * speed**2 * length**2 / E * (hub / 2 + length / 3)
    assert stretch == pytest.approx(first_order, rel=1e-3)
    reach = np.linalg.norm(result.vector("tip"), axis=1) - hub - length
    np.testing.assert_allclose(reach, stretch, rtol=1e-5)
    acceleration = np.linalg.norm(result.vector("tip_acceleration"), axis=1)
    np.testing.assert_allclose(acceleration, speed**2 * (hub + length + stretch), rtol=1e-5)


# --- slider-crank ---


def slider_crank(rod, speed=150.0):
    """Crank, rod with the markers root and tip, slider; no redundant row, rigid or flexible."""
    made = Model("slider-crank")
    made.add_body("crank", mass=1.0, inertia=[0.01] * 3)
    made.add_marker("crank.pin", position=[R, 0, 0])
    made.add_body("rod", rod, position=[R, 0, 0])
    made.add_body("slider", mass=0.5, inertia=[0.01] * 3, position=[R + L, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "spherical", between=["crank.pin", "rod.root"])
    made.add_joint("wrist", "cylindrical", between=["rod.tip", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_driver("motor", joint="bearing", angle=f"{speed!r}*t + 0.2*sin(100*t)")
    made.add_sensor("slider", "position", of="slider")
    made.add_sensor("span", "position", of="rod.tip", relative_to="rod.root")
    return made


def without_modes(body):
    """The same body with the same interfaces, rigid."""
    rigid = rigid_body(body.mass, body.center, body.inertia_about_center)
    still = np.zeros((3, 0))
    ends = [Interface(end.name, end.position, still, still) for end in body.interfaces]
    return replace(rigid, interfaces=tuple(ends))


def test_no_modes_is_a_rigid_body():
    """A FlexBody without modes against [bodies] with mass, centre and inertia: round-off apart."""
    knobs = {"duration": 0.02, "step": 1e-4, "outputs": 20, "newton_tolerance": 1e-11}
    body = without_modes(beam(L, 0))
    found = run(slider_crank(body), **knobs)
    made = slider_crank(body)
    made.bodies["rod"] = Model("rod").add_body(
        "rod", mass=body.mass, center=body.center.tolist(), position=[R, 0, 0],
        inertia=body.inertia_about_center.tolist(),
        markers={"root": {"position": [0, 0, 0]}, "tip": {"position": [L, 0, 0]}},
    )  # fmt: skip
    wanted = run(made, **knobs)
    np.testing.assert_allclose(found.sensors, wanted.sensors, rtol=0, atol=1e-12)
    size = np.abs(wanted.reaction("joints.pin")).max()
    for joint in ("joints.pin", "joints.guide", "drivers.motor"):
        np.testing.assert_allclose(
            found.reaction(joint), wanted.reaction(joint), rtol=0, atol=1e-9 * size
        )


def test_stiff_rod_approaches_the_rigid_one():
    """Positions differ by the deformation, as 1/E.

    Reactions differ by the ringing that the start leaves: in equilibrium, but not moving along
    with it, by the drive's frequency over the mode's, as 1/√E.
    """
    knobs = {"duration": 0.02, "step": 1e-5, "outputs": 50, "newton_tolerance": 1e-10}
    wanted = run(slider_crank(without_modes(beam(L, 0))), **knobs)
    stiffer = np.array([10.0, 100.0, 1000.0])
    errors, reactions = [], []
    steel = beam(L, 4)
    for factor in stiffer:
        rod = replace(steel, K=factor * steel.K)
        found = run(slider_crank(rod), start="quasi-static", **knobs)
        errors.append(np.abs(found["slider.x"] - wanted["slider.x"]).max())
        size = np.abs(wanted.reaction("joints.pin")).max()
        difference = found.reaction("joints.pin") - wanted.reaction("joints.pin")
        reactions.append(np.abs(difference).max() / size)
    assert -1.1 < order(stiffer, errors) < -0.9, errors
    assert errors[-1] < 1e-6
    assert -0.7 < order(stiffer, reactions) < -0.4, reactions
    assert reactions[-1] < 2e-3, reactions


@pytest.fixture(scope="module")
def driven():
    return {
        h: run(
            slider_crank(beam(L, 6)), duration=0.04, step=h, outputs=400, start="quasi-static",
            newton_tolerance=1e-8,
        )
        for h in (2e-5, 1e-5)
    }  # fmt: skip


def test_driver_work_becomes_energy(driven):
    """Kinetic and strain energy against the drivers' work, added up by the trapezoidal rule."""
    errors = [one.mismatch() / np.ptp(one.stored("kinetic")) for one in driven.values()]
    assert errors[-1] < 1e-5, errors
    assert order(list(driven), errors) > 1.8, errors
    strain = driven[1e-5].stored("strain")
    assert strain.max() > 10 * errors[-1] * np.ptp(driven[1e-5].stored("kinetic"))


def test_quasi_static_start_does_not_ring():
    """The length of the rod over the first periods of its stretching mode (2.6 kHz and more)."""
    rings = {}
    for start in ("quasi-static", "undeformed"):
        result = run(
            slider_crank(beam(L, 6)), duration=1.5e-3, step=1e-6, outputs=150, start=start,
            spectral_radius=0.95,
        )  # fmt: skip
        stretch = np.linalg.norm(result.vector("span"), axis=1) - L
        smooth = np.polynomial.Polynomial.fit(result.t, stretch, 3)
        rings[start] = np.abs(stretch - smooth(result.t)).max() / np.abs(stretch).max()
    assert rings["undeformed"] > 0.2, rings
    assert rings["quasi-static"] < 0.02 * rings["undeformed"], rings


# --- conservation ---


@pytest.mark.seconds
def test_conservative_pendulum_keeps_its_energy():
    """Without numerical damping the energy errs by O(h²) and does not drift."""
    made = Model("flexible pendulum", gravity=[0, -9.81, 0])
    made.add_body("rod", beam(1.0, 2, height=0.004))
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip")
    steps = np.array([4e-4, 2e-4, 1e-4])
    runs = [
        run(
            made, duration=2.0, step=h, outputs=200, spectral_radius=1.0, newton_tolerance=1e-9,
            start="quasi-static",
        )
        for h in steps
    ]  # fmt: skip
    energy = np.ptp(runs[-1].stored("gravity"))
    errors = [one.mismatch() / energy for one in runs]
    assert 1.7 < order(steps, errors) < 2.3, errors
    assert errors[-1] < 1e-7, errors


def test_free_flexible_body_keeps_its_momentum():
    """Linear and angular momentum summed over its point masses, and the way of its centre."""
    rng = np.random.default_rng(3)
    points = cloud(rng, 3)
    made = Model("tumbling body")
    made.add_body(
        "body",
        points.flexbody("body"),
        velocity=[0.3, -0.2, 0.1],
        angular_velocity=[1.0, 2.0, -1.5],
    )
    steps = np.array([2e-3, 1e-3, 5e-4])
    errors = []
    for h in steps:
        result = run(made, duration=2.0, step=h, outputs=50, newton_tolerance=1e-10)
        momenta, center = momentum([points], result)
        errors.append(np.abs(momenta - momenta[0]).max(axis=0) / np.abs(momenta[0]).max())
        mass = points.mass.sum()
        way = center - center[0] - result.t[:, None] * momenta[0, :3] / mass
        errors[-1] = np.append(errors[-1], np.abs(way).max())
        assert np.abs(result.q[:, 7:]).max() > 1e-3  # it does deform
    errors = np.array(errors)
    for k in range(errors.shape[1]):
        if errors[0, k] > 1e-11:  # conserved to round-off else
            assert 1.8 < order(steps, errors[:, k]) < 2.3, errors[:, k]
    assert errors[-1].max() < 1e-5, errors[-1]


# --- a rotor at the end of a bar that sags ---


def first_state_of_a_rotor(axes, height=0.015, speed=1500.0, offset=0.0):
    """A driven disc of 20 kg on a bearing at the end of a clamped bar, from elastic equilibrium."""
    made = Model("overhung rotor", gravity=[0, 0, -9.81])
    made.add_body("bar", rod(height, 1.0))
    spin = {"angular_velocity": [speed, 0, 0], "axes": axes}
    made.add_body("disc", mass=20.0, inertia=[0.4, 0.2, 0.2], center=[0, offset, 0],
                  position=[1, 0, 0], initial={"origin": spin})  # fmt: skip
    made.add_joint("foot", "fixed", between=["ground", "bar.root"])
    made.add_joint("bearing", "revolute", between=["bar.tip", "disc"], axis="x")
    made.add_driver("motor", joint="bearing", angle=f"{speed}*t")
    compiled = compile_system(made)
    return compiled, assemble(compiled, made, start="quasi-static").state


def test_a_rotor_whose_speed_is_given_in_its_own_axes_sags_with_its_bearing():
    """By the weight F of the disc and w of the bar: F L3/3EI + w L3/8EI. The bar stands still."""
    compiled, state = first_state_of_a_rotor("body")
    disc = compiled.layout.bodies[1]
    sag = 9.81 * (20.0 / 3 + 7800.0 * 0.015**2 / 8) / (2.1e11 * 0.015**4 / 12)
    assert state.q[disc.iq + 2] == pytest.approx(-sag, rel=0.01)
    assert np.abs(state.v[disc.iv : disc.iv + 6] - [0, 0, 0, 1500, 0, 0]).max() < 0.01


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param({}, id="it precesses with the bar"),
        pytest.param({"height": 0.04, "speed": 700.0, "offset": 0.03}, id="it folds the bar"),
    ],
)
def test_a_rotor_whose_speed_does_not_tilt_with_its_bearing_is_named(scene):
    with pytest.raises(AssemblyError, match=r"no elastic equilibrium.*bodies.disc.*in global axes"):
        first_state_of_a_rotor("global", **scene)


def test_a_body_that_spins_elsewhere_is_not_named():
    """A rod that turns far above its critical speed, beside a top that shares nothing with it."""
    made = Model("rod and top", gravity=[0, -9.81, 0])
    made.add_body("rod", rod(0.002, 1.0))
    made.add_body("top", mass=1.0, inertia=[1, 1, 1], position=[5, 0, 0],
                  angular_velocity=[0, 0, 9])  # fmt: skip
    made.add_joint("hub", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_driver("motor", joint="hub", angle="3000*t")
    lowest = 1.8751**2 * np.sqrt(2.1e11 * 0.002**2 / 12 / 7800.0)  # of a clamped bar of 1 m
    above = f"begin slower; bodies.rod .* at rest, {lowest:.3g} rad/s$"
    with pytest.raises(AssemblyError, match=above):
        assemble(compile_system(made), made, start="quasi-static")


@pytest.mark.parametrize("method", ["generalized-alpha", "radau"])
@pytest.mark.parametrize(("scene", "duration"), [(flexible_crank, 0.02), (flexible_pendulum, 0.3)])
def test_a_large_motion_beside_changes_no_steps(scene, duration, method):
    """A flywheel of 1 km that shares nothing with a flexible machine leaves it its accuracy."""
    knobs = {"duration": duration, "outputs": 20, "method": method, "accuracy": 1e-3,
             "verify": False}  # fmt: skip
    models = scene(), beside_a_large_motion(scene())
    alone, beside = (run(model, **knobs) for model in models)
    for name in models[0].sensors:
        own = alone.vector(name)
        off = np.abs(beside.vector(name) - own).max() / np.ptp(own, axis=0).max()
        assert off < 2e-3, name
    steps = [one.statistics["steps"] for one in (alone, beside)]
    assert steps[1] == pytest.approx(steps[0], rel=0.25)


@pytest.mark.slow
def test_a_pass_that_damped_a_vibration_shows_no_order():
    """Its error was the amplitude: order 2.5 was told of radau, and a third pass 400 times finer.

    The method that follows all vibrations is the reference.
    """
    knobs = {"duration": 2 * np.pi * 30.3 / 150, "outputs": 50}
    fine = run(flexible_crank(), accuracy=1e-9, method="explicit-rk", verify=False, **knobs)
    own = run(flexible_crank(), accuracy=1.2e-4, method="radau", **knobs)
    off = np.abs(own["slider.x"] - fine["slider.x"]).max() / np.ptp(fine["slider.x"])
    assert off < 1.2e-4
    assert off / 3 < own.statistics["measured_error_of_positions"] < 1.2e-4
    assert own.statistics["passes"] == 2  # 46 786 steps in three passes, for 25 000
