"""Quasi-static modes as springs without mass, against all modes dynamic and static condensation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from femeshes import line
from flexiblescenes import BEAM_PERIOD, STEEL, rod
from truth.test_effects import channels, pendulum

import flexmb
from flexmb.analysis.assembly.mechanism_modes import condensation
from flexmb.errors import ReductionError, SolverError
from flexmb.fe import rectangle, reduce
from flexmb.model import Model

pytestmark = pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")

MIXED = ({"dynamic": [0, 1, 2, 3]}, {"band": [0, 200]}, "automatic")


def clamped(deformation):
    made = Model("clamped beam with a heavy ball")
    made.add_body("beam", rod(0.01, 1.0, 20, 8), deformation=deformation)
    made.add_body("ball", mass=5.0, inertia=[0.01] * 3, position=[1.0, 0, 0])
    made.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    made.add_joint("tie", "fixed", between=["beam.tip", "ball"])
    made.add_force("load", "force", at="ball", value=[0, "10*sin(12*t)", 0])
    made.add_sensor("tip", "position", of="ball")
    return made


def welded(deformation):
    made = Model("welded chain")
    bar = rod(0.01, 0.4, 8, 4)
    for k in range(3):
        made.add_body(f"bar{k}", bar, position=[0.4 * k, 0, 0], deformation=deformation)
        before = "ground" if k == 0 else f"bar{k - 1}.tip"
        made.add_joint(f"weld{k}", "fixed", between=[before, f"bar{k}.root"])
    made.add_force("load", "force", at="bar2.tip", value=[0, "10*sin(12*t)", 0])
    made.add_sensor("tip", "position", of="bar2.tip")
    return made


def redundant(deformation):
    """Four revolute joints with parallel axes, the rocker's shaft out of line by 3 degrees."""
    made = Model("four-bar with a beam")
    made.add_body("crank", mass=0.5, inertia=[0.01] * 3, center=[0, 0.1, 0])
    made.add_marker("crank.pin", position=[0, 0.2, 0])
    made.add_body("beam", rod(0.01, 1.0, 10, 8), position=[0, 0.2, 0], deformation=deformation)
    made.add_marker("ground.right", position=[1.0, -0.4, 0])
    made.add_body("rocker", mass=1.0, inertia=[0.05] * 3, center=[0, 0.3, 0],
                  position=[1.0, -0.4, 0])  # fmt: skip
    made.add_marker("rocker.pin", position=[0, 0.6, 0])
    made.add_joint("left", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("crank_pin", "revolute", between=["crank.pin", "beam.root"], axis="z")
    made.add_joint("rocker_pin", "revolute", between=["beam.tip", "rocker.pin"], axis="z")
    lean = [np.sin(np.deg2rad(3)), 0, np.cos(np.deg2rad(3))]
    made.add_joint("right", "revolute", between=["ground.right", "rocker"], axis=lean)
    made.add_driver("motor", joint="left", angle={"type": "step", "t1": 1.0, "y1": 1.0})
    made.add_sensor("tip", "energy", quantity="strain")
    return made


def unlike(deformation):
    """A bar of one kind of modes welded to one of another."""
    made = Model("two kinds of modes", gravity=[0, -9.81, 0])
    made.add_body("inner", rod(0.012, 0.5, 8, 4), deformation="quasi-static")
    made.add_body("outer", rod(0.012, 0.5, 8, 4), position=[0.5, 0, 0], deformation=deformation)
    made.add_joint("hub", "revolute", between=["ground", "inner.root"], axis="z")
    made.add_joint("weld", "fixed", between=["inner.tip", "outer.root"])
    made.add_driver("motor", joint="hub", angle="sin(4*t)")
    made.add_sensor("tip", "position", of="outer.tip")
    return made


@pytest.mark.parametrize(
    "words", ["dynamic", pytest.param({"dynamic": [0, 1]}, marks=pytest.mark.slow)]
)
def test_quasi_static_bodies_join_others(words):
    knobs = {"duration": 0.3, "outputs": 30, "accuracy": 1e-4, "start": "quasi-static"}
    every = unlike("dynamic")
    every.bodies["inner"] = every.bodies["inner"].model_copy(update={"deformation": "dynamic"})
    (full,), (some,) = (channels(made, ("tip.y",), **knobs)[0] for made in (every, unlike(words)))
    np.testing.assert_allclose(some, full, atol=2e-3 * np.ptp(full))


def turned(deformation, speed=6.0):
    made = Model("turned beam")
    made.add_body("beam", rod(0.01, 1.0, 10, 6), deformation=deformation)
    made.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
    made.add_driver("motor", joint="hub", angle=f"sin({speed}*t)-{speed}*t")
    made.add_sensor("tip", "position", of="beam.tip", relative_to="beam.root")
    return made


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("scene", "channel", "error", "method"),
    [(clamped, "tip.y", 1.5e-3, "radau")]
    + [pytest.param(*case, method, marks=pytest.mark.slow)
       for method in ("radau", "generalized-alpha")
       for case in ((welded, "tip.y", 1.5e-3), (turned, "tip.y", 3e-3), (redundant, "tip", 2e-2))],
)  # fmt: skip
def test_dynamic_and_quasi_static_modes_together(scene, channel, error, method):
    """Vibrations of clamped bodies and of what hangs on them, self-stress of redundant joints."""
    knobs = {"duration": 1.0, "accuracy": 1e-4, "outputs": 60, "start": "quasi-static"}
    (full,), _ = channels(scene("dynamic"), (channel,), **knobs)
    if scene is redundant and method == "generalized-alpha":
        knobs["accuracy"] = 1e-5  # at 1e-4 it reports reactions 2 % off, and pays drivers by them
    for deformation in MIXED:
        (some,), result = channels(scene(deformation), (channel,), **knobs, method=method)
        assert np.abs(some - full).max() < error * np.ptp(full), deformation
        assert result.statistics["largest_position_drift"] < 1e-9
        assert abs(result.statistics["energy_balance_error"]) < 2e-3


def test_the_error_of_a_residual_flexibility_falls_with_the_square_of_the_speed():
    errors = []
    for speed in (8.0, 4.0):
        knobs = {"duration": 3.0 / speed, "accuracy": 1e-7, "start": "quasi-static", "outputs": 30}
        full, some = (
            channels(turned(word, speed), ("tip.y",), method="radau", **knobs)[0][0]
            for word in ("dynamic", {"dynamic": [0, 1]})
        )
        errors.append(np.abs(full - some).max() / np.abs(full).max())
    assert errors[0] < 1e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)


def guyan(body, dynamic):
    """Frequencies of a beam that is clamped at its root, all other modes condensed [Hz].

    From the matrices of the body: 1/ω² are the eigenvalues of K⁻¹ M in the motions that the clamp
    leaves free, M without entries of the condensed modes.
    """
    m, end = body.m, body.interface("root")
    M = np.zeros((6 + m, 6 + m))
    M[:3, :3] = body.mass * np.eye(3)
    x, y, z = body.S1
    M[:3, 3:6] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    M[3:6, :3] = M[:3, 3:6].T
    M[3:6, 3:6] = np.trace(body.S0) * np.eye(3) - body.S0
    both = np.ix_(dynamic, dynamic)
    M[6:, 6:][both] = body.M_eta[both]
    free = np.vstack([-end.Phi_t, -end.Phi_r, np.eye(m)])  # the root is at the origin
    values = np.linalg.eigvals(np.linalg.solve(body.K, free.T @ M @ free)).real
    return 1 / (2 * np.pi * np.sqrt(np.sort(values[values > 1e-12 * values.max()])[::-1]))


@pytest.mark.parametrize("dynamic", [[0, 1], [0, 1, 2, 3], []])
def test_linearised_modes_are_those_of_static_condensation(dynamic):
    body = rod(0.01, 1.0, 20, 8)
    made = Model("clamped")
    others = [k for k in range(body.m) if k not in dynamic]
    made.add_body("beam", body, deformation={"quasi_static": others})
    made.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    frequencies = flexmb.linearize(made).frequencies
    expected = guyan(body, dynamic)
    assert len(frequencies) == len(expected)
    np.testing.assert_allclose(frequencies, expected, rtol=1e-6)
    assert frequencies[0] == pytest.approx(1 / BEAM_PERIOD, rel=0.006)


RADIUS, BALL, ARM, STRETCH = 0.4, 1.0, 2e-3, 5.25e4  # m, kg, kg m², N/m


def governor():
    """A ball that slides on an arm and hangs on a light rod, soft along its axis."""
    body = reduce(
        line(4, end=(RADIUS, 0, 0)), material={**STEEL, "density": 10.0}, modes=1,
        interfaces={"root": "root", "tip": "tip"}, sections={"all": rectangle(0.1, 0.1)},
    )  # fmt: skip
    made = Model("governor")
    made.add_body("arm", mass=0.01, inertia=[ARM / 2] * 3)
    body = replace(body, K=STRETCH / (STEEL["E"] * 0.01 / RADIUS) * body.K)
    made.add_body("rod", body, deformation="quasi-static")
    made.add_body("ball", mass=BALL, inertia=[ARM / 2] * 3, position=[RADIUS, 0, 0])
    made.add_joint("hub", "revolute", between=["ground", "arm"], axis="z")
    made.add_joint("guide", "prismatic", between=["arm", "ball"], axis="x")
    made.add_joint("root", "spherical", between=["arm", "rod.root"])
    made.add_joint("tip", "spherical", between=["rod.tip", "ball"])
    made.add_force("torque", "torque", at="arm", value=[0, 0, "1 + sin(2*t)"])
    for name, kind in {"p": "position", "v": "velocity"}.items():
        made.add_sensor(name, kind, of="ball")
    return made


@pytest.mark.parametrize("method", ["radau", pytest.param("explicit-rk", marks=pytest.mark.slow)])
def test_what_a_soft_rod_lets_out_slows_the_turn(method):
    """Angular momentum and energy of a ball that centrifugal force takes outwards.

    L = (m r² + J) ω = ∫M dt and k (r − r₀) = m ω² r, m with a third of the rod, J with its height.
    """
    m, J = BALL + 0.04 / 3, ARM + 0.04 * 0.01 / 12
    knobs = {"duration": 3.0, "outputs": 30, "start": "quasi-static"}
    (x, y, u, v), result = channels(
        governor(), ("p.x", "p.y", "v.x", "v.y"), **knobs, accuracy=1e-5, method=method
    )
    t, r = result.time, np.hypot(x, y)
    momentum = t + (1 - np.cos(2 * t)) / 2
    omega = (x * v - y * u) / r**2
    np.testing.assert_allclose((m * r**2 + J) * omega, momentum, atol=1e-4 * momentum[-1])
    np.testing.assert_allclose(r - RADIUS, m * omega**2 * r / STRETCH, atol=1e-6)
    # dr/dt by dω of both: (m r² + J) dω + 2 m r ω dr = M dt, (k − m ω²) dr = 2 m ω r dω
    grows = 2 * m * omega * r / (STRETCH - m * omega**2)
    rate = (1 + np.sin(2 * t)) * grows / (m * r**2 + J + 2 * m * r * omega * grows)
    np.testing.assert_allclose(((x * u + y * v) / r)[2:], rate[2:], atol=1e-2 * rate.max())
    assert r[-1] - RADIUS > 2e-3
    assert result.statistics["energy_balance_error"] < 1e-4


def spun_up(deformation):
    made = Model("beam that spins up")
    made.add_body("beam", rod(0.01, 1.0, 10, 6), deformation=deformation)
    made.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
    made.add_driver("motor", joint="hub", angle="1.5*t**5")
    made.add_sensor("torque", "reaction", driver="motor", quantity="moment", axes="global")
    return made


@pytest.mark.parametrize(
    ("method", "error"),
    [("radau", 2e-4)]
    + [pytest.param(*case, marks=pytest.mark.slow)
       for case in (("generalized-alpha", 2e-4), ("explicit-rk", 8e-4))],
)  # fmt: skip
def test_a_driver_pays_for_the_changing_rate_of_the_deformation(method, error):
    """At a steady rate its torque was 2e-3 off, energy 5e-3; the vibrations are 2e-5 here."""
    knobs = {"duration": 1.0, "outputs": 50, "start": "quasi-static"}
    (full,), _ = channels(spun_up("dynamic"), ("torque.z",), **knobs, accuracy=1e-7)
    (some,), result = channels(
        spun_up("quasi-static"), ("torque.z",), **knobs, accuracy=1e-4, method=method
    )
    assert np.abs(some - full).max() < error * np.ptp(full)
    assert result.statistics["energy_balance_error"] < 1e-4


@pytest.mark.parametrize("method", ["radau", "generalized-alpha"])
def test_a_driver_that_turns_a_quasi_static_beam_balances_its_energy(method):
    """At a steady rate of the deformation 1.3 % were lacking, by steps of 0.1 s 30 %."""
    knobs = {"duration": 3.0, "start": "quasi-static", "accuracy": 1e-4, "method": method}
    result = flexmb.simulate(turned("quasi-static"), outputs=60, verify=False, **knobs)
    assert result.statistics["energy_balance_error"] < 3e-4


def test_radau_is_of_order_three_at_least_with_kinetostatic_bodies():
    """Angular momentum of the governor; what is carried outwards jumped at the end of a step."""
    errors = []
    for step in (0.04, 0.01):
        knobs = {"duration": 3.0, "outputs": 30, "start": "quasi-static", "method": "radau"}
        (x, y, u, v), result = channels(
            governor(), ("p.x", "p.y", "v.x", "v.y"), **knobs, accuracy=None, step=step
        )
        t, m, J = result.time, BALL + 0.04 / 3, ARM + 0.04 * 0.01 / 12
        momentum = t + (1 - np.cos(2 * t)) / 2
        r2 = x**2 + y**2
        errors.append(np.abs((m * r2 + J) * (x * v - y * u) / r2 - momentum).max())
    assert errors[1] < errors[0] / 4**3


@pytest.mark.parametrize(
    "method",
    ["generalized-alpha", *(pytest.param(k, marks=pytest.mark.slow) for k in ("radau", "hht"))],
)
@pytest.mark.parametrize("load", ["10*(1 + sign(t - 0.2))", "5*(sign(turn + 0.15) - 1)"])
def test_a_jump_of_a_load_leaves_no_rate_in_fixed_steps(load, method):
    """Reactions beside a jump, of time or of what is measured, against another method's."""

    def made():
        model = Model("pendulum under a torque that jumps", gravity=[0, -9.81, 0])
        model.add_body("beam", rod(0.01, 1.0, 10, 6), deformation="quasi-static")
        model.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
        model.add_sensor("turn", "angle", joint="hub")
        model.add_force("torque", "torque", at="beam.root", value=[0, 0, load])
        model.add_sensor("R", "reaction", joint="hub", axes="global")
        return model

    knobs = {"duration": 0.4, "outputs": 100, "start": "quasi-static", "verify": False}
    exact, _ = channels(made(), ("R.x", "R.y"), **knobs, method="radau")
    steps, result = channels(
        made(), ("R.x", "R.y"), **knobs, accuracy=None, method=method, step=1e-3
    )
    either = np.abs(result.time - 0.2) < 1e-9  # both sides of the jump are right there
    assert np.abs(steps - exact)[:, ~either].max() < 0.01 * np.abs(exact).max()


def beam_on_a_stop(deformation, height=-0.2, stiffness=2e4):
    made = Model("beam on a stop", gravity=[0, -9.81, 0])
    made.add_body("beam", rod(0.01, 1.0, 10, 6), deformation=deformation)
    made.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
    made.add_marker("ground.below", position=[1.0, height, 0])
    made.add_force("bump", "stop", between=["ground.below", "beam.tip"], axis="y", lower=0.0,
                   stiffness=stiffness, damping=20.0, depth=1e-4)  # fmt: skip
    return made


@pytest.mark.slow
def test_a_stop_that_is_stiffer_than_a_quasi_static_body_is_named():
    """By far: whether a stop of 2e4 N/m settles depends on round-off."""
    knobs = {"duration": 0.3, "outputs": 30, "accuracy": 1e-3}
    with pytest.raises(SolverError, match=r"bodies.beam: loads .* stop.* them"):
        flexmb.simulate(beam_on_a_stop("quasi-static", -0.3, 2e6), **knobs)


@pytest.mark.seconds
def test_a_stop_that_one_method_fails_at_names_the_other():
    """All modes but the slowest are quasi-static; the other method does it."""
    made = beam_on_a_stop({"band": [0, 0.1]}, -0.0974)
    knobs = {"duration": 0.4, "outputs": 40}
    with pytest.raises(SolverError, match=r'bodies.beam: a force .* use method = "radau", or'):
        flexmb.simulate(made, **knobs, method="generalized-alpha")
    assert flexmb.simulate(made, **knobs, method="radau").statistics["steps"] < 1500


@pytest.mark.parametrize("height", [-0.05, -0.0974, -0.2868])
def test_radau_bounces_at_a_stop_of_any_height(height):
    """No matrix fits stages on both sides of its damper's kinks: one of two such runs failed."""
    runs = []
    for step, accuracy in ((None, 1e-4), (2e-4, None)):
        made = beam_on_a_stop({"band": [0, 0.1]}, height)
        made.add_sensor("tip", "position", of="beam.tip")
        knobs = {"duration": 0.4, "outputs": 40, "method": "radau", "verify": False}
        runs.append(flexmb.simulate(made, **knobs, step=step, accuracy=accuracy))
        assert runs[-1].statistics["energy_balance_error"] < 2e-4
    np.testing.assert_allclose(*(run["tip.y"] for run in runs), atol=1e-4)
    assert runs[0].statistics["steps"] < 1000


@pytest.mark.slow
def test_a_run_with_a_residual_flexibility_resumes_bit_for_bit(tmp_path):
    def interrupt(phase: str, share: float, detail: str = "") -> None:
        if phase == "integrate" and share > 0.2:
            raise KeyboardInterrupt

    made = turned({"dynamic": [0, 1]})
    knobs = {"accuracy": 1e-4, "duration": 2.0, "outputs": 400, "verify": False}
    whole = flexmb.simulate(made, output=tmp_path / "whole", **knobs)
    flexmb.simulate(made, output=tmp_path / "part", progress=interrupt, **knobs)
    assert flexmb.load_result(tmp_path / "part").status != "finished"
    again = flexmb.resume(tmp_path / "part")
    assert np.array_equal(whole["tip.y"], again["tip.y"])


def test_modes_without_stiffness_cannot_be_quasi_static():
    body = rod(0.012)
    K = body.K.copy()
    K[3] = K[:, 3] = 0.0
    made = pendulum(replace(body, K=K), deformation={"quasi_static": [3]})
    with pytest.raises(ReductionError, match="mode 3 of the body has no stiffness"):
        flexmb.simulate(made, duration=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "deformation", [{"band": [0, 60]}, {"band": [0, 0.1]}, "automatic", "quasi-static"]
)
def test_a_plate_on_four_ball_joints_follows_a_load_like_one_that_vibrates(deformation, tmp_path):
    """Rigid it would be held six times over; the joints need its compliance."""

    def made(**words):
        model = Model("plate on four supports")
        corners = {"a": (0, -0.5), "b": (1, -0.5), "c": (1, 0.5), "d": (0, 0.5)}
        groups = {"a": "x0y0", "b": "x1y0", "c": "x1y1", "d": "x0y1"}
        model.add_body(
            "plate", mesh={"type": "plate", "length": 1.0, "width": 1.0, "divisions": [4, 4]},
            material="steel", sections={"surface": {"type": "shell", "thickness": 0.01}},
            interfaces=groups, modes=6, stress="none", markers={"centre": {"node": 12}}, **words,
        )  # fmt: skip
        for name, (x, y) in corners.items():
            model.add_marker(f"ground.{name}", position=[x, y, 0])
            model.add_joint(name, "spherical", between=[f"ground.{name}", f"plate.{name}"])
        push = {"type": "step", "t1": 2.0, "y1": -500.0}
        model.add_force("push", "force", at="plate.centre", value=[0, 0, push])
        model.add_sensor("middle", "position", of="plate.centre")
        model.set_validity(node_loads="any")
        model.set_dynamics(duration=2.0, outputs=20, method="radau", accuracy=1e-5)
        return model

    z = flexmb.simulate(made(deformation=deformation), output=tmp_path)["middle.z"][-1]
    still = flexmb.simulate(made(), output=tmp_path / "dynamic")["middle.z"][-1]
    assert z == pytest.approx(still, rel=1e-3)


def test_massless_motions_follow_in_equilibrium() -> None:
    """K T and K' L leave no force on a coordinate without mass; K need not be symmetric."""
    K = np.array([[5.0, -1.0, 2.0], [-1.5, 4.0, 1.0], [0.5, 2.5, 3.0]])
    T, L, remaining = condensation(np.diag([1.0, 2.0, 0.0]), K)
    assert remaining.tolist() == [0, 1]
    np.testing.assert_allclose((K @ T)[2], 0.0, atol=1e-14)
    np.testing.assert_allclose((K.T @ L)[2], 0.0, atol=1e-14)
    np.testing.assert_array_equal(T[:2], np.eye(2))


def arm_with_a_load():
    """All that moves is driven: positions go where the deformation puts them, step by step."""
    made = Model("arm", gravity=[0, -9.81, -3.0])
    made.add_body("arm", rod(0.012, 0.5, 8, 4), deformation="quasi-static")
    made.add_body("load", mass=0.3, inertia=[1e-4] * 3, position=[0.5, 0, 0])
    made.add_joint("hub", "revolute", between=["ground", "arm.root"], axis="z")
    made.add_joint("grip", "fixed", between=["arm.tip", "load"])
    made.add_driver("motor", joint="hub", angle="60*t")
    made.add_sensor("tip", "position", of="load")
    return made


@pytest.mark.parametrize("method", ["generalized-alpha", "hht", "newmark"])
def test_small_steps_do_not_feed_back_what_moved_by_deformation(method):
    knobs = {"duration": 0.01, "outputs": 20, "start": "quasi-static"}
    names = ("tip.x", "tip.y", "tip.z")
    exact, _ = channels(arm_with_a_load(), names, **knobs, accuracy=1e-8)
    steps, _ = channels(arm_with_a_load(), names, **knobs, accuracy=None, method=method, step=2e-5)
    np.testing.assert_allclose(steps, exact, atol=1e-6)


def test_a_quasi_static_bar_on_a_bushing_that_is_much_stiffer():
    """A bar on a hinge and a bushing that a torque bends: loads and deformation ran away."""
    length, side, stiffness, torque = 1.0, 0.01, 1e7, 5.0
    made = Model("bar on a bushing")
    made.add_body("bar", rod(side, length, 10, 6), deformation="quasi-static")
    made.add_marker("ground.far", position=[length, 0, 0])
    made.add_joint("hub", "revolute", between=["ground", "bar.root"], axis="z")
    made.add_force("bushing", "bushing", between=["ground.far", "bar.tip"],
                   stiffness=[0, stiffness, 0])  # fmt: skip
    made.add_force("motor", "torque", at="bar.root", value=[0, 0, f"{torque}*step5(t, 0, 0, 2, 1)"])
    made.add_sensor("turn", "angle", joint="hub")
    run = flexmb.simulate(made, duration=2.5, outputs=50, accuracy=1e-5)
    bends = length / (3 * STEEL["E"] * side**4 / 12) + 1 / (length**2 * stiffness)
    assert run["turn"][-1] == pytest.approx(torque * bends, rel=2e-3)


def test_a_mass_on_a_spring_that_is_as_stiff_as_the_quasi_static_bar_below_it():
    """Loads and deformation ran away: a heavy mass rests while the bar bends, the spring gives."""
    side, length, mass, force, w = 0.01, 1.0, 200.0, 1.0, 0.9
    bar = 3 * STEEL["E"] * side**4 / 12 / length**3
    made = Model("mass on a bar")
    made.add_body("bar", rod(side, length, 10, 6), deformation="quasi-static")
    made.add_body("mass", mass=mass, inertia=[1e-6] * 3, position=[length, 0, 0])
    made.add_joint("clamp", "fixed", between=["ground", "bar.root"])
    made.add_joint("guide", "prismatic", between=["bar.tip", "mass"], axis="y")
    made.add_force("spring", "translational-spring-damper", joint="guide", stiffness=0.95 * bar)
    made.add_force("push", "force", at="mass", value=[0, f"{force}*sin({w}*t)", 0])
    made.add_sensor("mass", "position", of="mass")
    run = flexmb.simulate(made, duration=10.0, outputs=100, accuracy=1e-6)
    own = np.sqrt(bar / (1 + 1 / 0.95) / mass)  # of both springs, one behind the other
    exact = np.sin(w * run.time) - w / own * np.sin(own * run.time)
    exact *= force / mass / (own**2 - w**2)
    np.testing.assert_allclose(run["mass.y"], exact, atol=2e-3 * np.ptp(exact))
