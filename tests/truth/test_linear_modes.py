"""Linearised modes against closed forms: pendulums, oscillators, tops, rotors, rotating blades.

Each scene stands at the origin and a kilometre away, in SI and in micrometres where it says so.
"""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from femeshes import line
from restscenes import FAR, G, chain, pendulum

import flexmb
from flexmb.analysis.linear.linearization import ModeSweep
from flexmb.analysis.linear.state_eigenmodes import eigenmodes
from flexmb.analysis.linear.state_equations import StateEquations
from flexmb.fe import rectangle, reduce
from flexmb.model import Model

BLADE = json.loads(
    (Path(__file__).parents[1] / "references" / "geometric_stiffening.json").read_text()
)["rotating_cantilever"]["flap"]


def rates(made):
    """|Im λ| [rad/s]."""
    return np.abs(made.eigenvalues.imag)


@pytest.mark.parametrize("place", [(0, 0, 0), FAR])
@pytest.mark.parametrize("plane", [None, "xy"])
@pytest.mark.parametrize("spin", [0.0, 3.0])
def test_pendulum_at_rest_and_in_the_middle_of_its_swing(place, plane, spin):
    """(J + m l²) θ̈ + m g l cos θ θ = 0 does not know the speed."""
    place = place if plane is None else (*place[:2], 0.0)
    with pytest.warns() if spin else _nothing():
        made = flexmb.linearize(pendulum(spin, place, plane=plane))
    assert rates(made) == pytest.approx([np.sqrt(2.0 * G * 0.5 / (0.3 + 2.0 * 0.25))], rel=1e-9)
    assert np.abs(made.eigenvalues.real).max() < 1e-9


class _nothing:
    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None


def test_inverted_pendulum_grows():
    made = Model("inverted", gravity=[0, -G, 0])
    made.add_body("bar", mass=2.0, center=[0, 0.5, 0], inertia=[0.2, 0.2, 0.3])
    made.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    made = flexmb.linearize(made)
    rate = np.sqrt(2.0 * G * 0.5 / 0.8)
    assert not made.stable
    assert made.eigenvalues.real.max() == pytest.approx(rate, rel=1e-9)


@pytest.mark.parametrize("redundant", [False, True])
def test_coupled_oscillators_with_damping(redundant):
    """ω_j = 2 √(k/m) sin(jπ/(2n + 2)); damping in proportion to stiffness: ζ_j = ω_j c/(2k)."""
    n, k, c, m = 4, 300.0, 1.5, 2.0
    made = flexmb.linearize(chain(n, k, c, m, redundant))
    wanted = 2.0 * np.sqrt(k / m) * np.sin(np.arange(1, n + 1) * np.pi / (2 * n + 2))
    np.testing.assert_allclose(np.abs(made.eigenvalues), wanted, rtol=1e-10)
    ratios = wanted * c / (2 * k)
    np.testing.assert_allclose(made.damping_ratios, ratios, rtol=1e-9)
    damped = wanted * np.sqrt(1 - ratios**2) / (2 * np.pi)
    np.testing.assert_allclose(made.frequencies, damped, rtol=1e-10)
    shape = made.shapes[[6 * i for i in range(n)], 0]
    wanted = np.sin(np.arange(1, n + 1) * np.pi / (n + 1))
    np.testing.assert_allclose(np.abs(shape / shape[0]), wanted / wanted[0], rtol=1e-9)


@pytest.mark.parametrize("frame", ["auto", "ground", "top"])
@pytest.mark.parametrize("spin", [60.0, 20.0])
def test_sleeping_top(frame, spin):
    """A φ̈ − (C n) i φ̇ − m g l φ = 0 seen from the ground; from the top all turns by n less."""
    m, l, A, C = 1.0, 0.2, 0.05, 0.02  # noqa: E741
    made = Model("top", gravity=[0, 0, -G])
    made.add_body("top", mass=m, center=[0, 0, l], inertia=[A - m * l * l] * 2 + [C],
                  angular_velocity=[0, 0, spin])  # fmt: skip
    made.add_joint("pin", "spherical", between=["ground", "top"])
    made = flexmb.linearize(made, frame=frame)
    root = np.sqrt(complex((C * spin) ** 2 - 4 * A * m * G * l))
    whirl = np.array([C * spin - root, C * spin + root]) / (2 * A)  # e^{i whirl t}
    whirl = whirl - spin if frame == "top" else whirl
    wanted = np.sort(np.abs(np.real(whirl)))
    np.testing.assert_allclose(np.sort(rates(made))[-2:], wanted, rtol=1e-8)
    growth = np.abs(np.imag(whirl)).max()
    assert made.eigenvalues.real.max() == pytest.approx(growth, rel=1e-8, abs=1e-9)
    assert made.stable == (spin == 60.0)


def test_free_body_that_spins_about_a_principal_axis():
    """Euler: λ² = −n² (C − A)(C − B)/(A B) in the axes of the body; the middle axis is unstable."""
    for spin, inertia in (((0, 0, 5.0), (2.0, 3.0, 4.0)), ((0, 0, 5.0), (2.0, 4.0, 3.0))):
        A, B, C = inertia
        made = Model("free")
        made.add_body("body", mass=1.0, inertia=list(inertia), angular_velocity=list(spin),
                      velocity=[3.0, 1.0, 2.0], position=list(FAR))  # fmt: skip
        made = flexmb.linearize(made, frame="body")
        square = -25.0 * (C - A) * (C - B) / (A * B)
        found = made.eigenvalues[np.abs(made.eigenvalues) > 1e-6]
        assert np.min(np.abs(found**2 - square)) < 1e-8
        assert made.stable == (square < 0)


def test_rotor_on_soft_bearings_whirls():
    """Ix φ̈ − i Iz n φ̇ + kθ φ = 0 and m z̈ + k z = 0: forward and backward whirl from the ground."""
    m, Ix, Iz, k, kt = 10.0, 0.1, 0.19, 1e6, 2e4
    for n in (0.0, 300.0, 900.0):
        made = Model("rotor")
        made.add_body("rotor", mass=m, inertia=[Ix, Ix, Iz], angular_velocity=[0, 0, n])
        made.add_body("housing", mass=1e-6, inertia=[1e-9] * 3)
        made.add_joint("spin", "revolute", between=["housing", "rotor"], axis="z")
        made.add_force("bearing", "bushing", between=["ground", "housing"],
                       stiffness=[k, k, k], rotational_stiffness=[kt, kt, kt])  # fmt: skip
        made = flexmb.linearize(made)
        assert made.frame == "ground"
        root = np.sqrt((Iz * n) ** 2 + 4 * Ix * kt)
        wanted = [(root - Iz * n) / (2 * Ix), (root + Iz * n) / (2 * Ix), np.sqrt(k / m)]
        for one in wanted:
            assert np.abs(rates(made) / one - 1).min() < 1e-6, (n, one)


def flexible_rotor(turn, place=0.3, section=None):
    """A massless shaft of 0.6 m on two bearings with a disc, which turns."""
    length, made = 0.6, Model("rotor on a flexible shaft")
    spin = {"angular_velocity": [turn, 0, 0]}
    x = place * length
    made.add_body(
        "shaft", mesh={"type": "beam", "points": [[0, 0, 0], [x, 0, 0], [length, 0, 0]],
                       "divisions": [4, 4]},
        material={"E": 2.1e11, "nu": 0.3, "density": 1e-3}, stress="none", modes=2, **spin,
        sections={"all": section or {"type": "circle", "radius": 0.006, "shear": False}},
        interfaces={"a": "start", "disc": "corner1", "b": "end"},
    )  # fmt: skip
    made.add_body("disc", mass=2.0, inertia=[8e-3, 4.2e-3, 4.2e-3], position=[x, 0, 0], **spin)
    made.add_marker("ground.b", position=[length, 0, 0])
    made.add_joint("a", "spherical", between=["ground", "shaft.a"])
    made.add_joint("b", "in-line", between=["ground.b", "shaft.b"], axis="x")
    made.add_joint("seat", "fixed", between=["shaft.disc", "disc"])
    return made


@pytest.mark.filterwarnings("ignore:shaft. density")
def test_flexible_rotor_whirls():
    """m z̈ + k11 z + k12 θ = 0, J θ̈ − i Jp n θ̇ + k12 z + k22 θ = 0 from the ground, as from its
    bearings; seen from the shaft each is off by the turn."""
    length, EI, m, Jp, J, place = 0.6, 2.1e11 * np.pi * 0.006**4 / 4, 2.0, 8e-3, 4.2e-3, 0.3
    a, b = place * length, (1 - place) * length
    flexibility = [[a * a * b * b, a * b * (b - a)], [a * b * (b - a), a * a - a * b + b * b]]
    K = np.linalg.inv(np.array(flexibility) / (3 * EI * length))
    Mi, zero, one = np.diag([1 / m, 1 / J]), np.zeros((2, 2)), np.eye(2)
    for turn in (100.0, 600.0):
        G = np.diag([0, -1j * Jp * turn])
        whirls = np.linalg.eigvals(np.block([[zero, one], [-Mi @ K, -Mi @ G]])).imag
        made = flexmb.linearize(flexible_rotor(turn), frame="ground")
        assert (made.frame, made.whirl.mixed) == ("ground", [])
        for whirl in whirls:
            sense = "forward" if whirl > 0 else "backward"
            k = np.abs(rates(made) / abs(whirl) - 1).argmin()
            assert abs(rates(made)[k] / abs(whirl) - 1) < 1e-5
            assert made.whirl.senses[k] == sense
        seen = flexmb.linearize(flexible_rotor(turn))
        assert seen.frame == "shaft"
        assert all(np.abs(rates(seen) / abs(w - turn) - 1).min() < 1e-5 for w in whirls)


@pytest.mark.seconds
@pytest.mark.filterwarnings("ignore:shaft. density")
def test_a_campbell_diagram_follows_whirl():
    sweep = flexmb.sweep_modes(flexible_rotor, "turn", [0, 150, 300, 450], frame="ground")
    assert sweep.frames == ("ground",)
    lowest = sweep.frequencies[:, 1:5]
    assert (np.abs(np.diff(lowest, axis=0)) < 0.15 * lowest[:-1]).all()
    assert (np.diff(lowest[:, lowest[-1] > lowest[0]], axis=0) > 0).all()
    assert (lowest[-1] > lowest[0]).sum() == 2  # forward; the others are backward


@pytest.mark.filterwarnings("ignore:shaft. density")
def test_a_flat_shaft_has_two_frequencies_from_the_ground():
    flat = {"type": "rectangle", "y": 0.012, "z": 0.006, "shear": False}
    with pytest.warns(match="have more than one frequency each"):
        flexmb.linearize(flexible_rotor(100.0, section=flat), frame="ground")


@pytest.mark.parametrize("place", [(0, 0, 0), FAR])
@pytest.mark.parametrize("speed", [2.0, 5.0, 12.0])
def test_blade_on_a_hub_that_turns(speed, place):
    """Flap frequencies of the reference; lag has ω² − Ω², less what its Coriolis force takes."""
    height = 0.01
    blade = reduce(
        line(20, end=(1, 0, 0)), modes=10, interfaces={"root": "root", "tip": "tip"},
        material={"E": 12.0 / height**4, "nu": 0.3, "density": 1.0 / height**2},
        sections={"all": rectangle(height, height)}, geometric_stiffening="full",
    )  # fmt: skip
    made = Model("blade")
    made.add_marker("ground.axle", position=list(place))
    made.add_body("hub", mass=1.0, inertia=[1, 1, 1], position=list(place))
    made.add_body("blade", blade, position=list(place))
    made.add_joint("bearing", "revolute", between=["ground.axle", "hub"], axis="z")
    made.add_joint("root", "fixed", between=["hub", "blade.root"])
    made.add_driver("motor", joint="bearing", angle=f"{speed}*t")
    made = flexmb.linearize(made, about="quasi-static")
    flap = np.array(BLADE[f"{speed:g}"], float)
    lag = np.sqrt(flap**2 - speed**2)
    for wanted, error in ((flap[0], 1e-3), (lag[0], 2e-3), (flap[1], 2e-3), (lag[1], 2e-3)):
        assert np.abs(rates(made) / wanted - 1).min() < error
    assert np.abs(made.eigenvalues.real).max() < 1e-6


def test_free_beam_has_the_modes_of_its_reduction():
    beam = reduce(
        line(20, end=(1, 0, 0)), modes=8, interfaces={"root": "root", "tip": "tip"},
        material="steel", sections={"all": rectangle(0.02, 0.01)},
    )  # fmt: skip
    model = Model("beam")
    model.add_body("beam", beam, position=list(FAR), orientation={"axis": [1, 2, 3], "angle": 0.7})
    made = flexmb.linearize(model)
    wanted = np.sqrt(np.linalg.eigvals(np.linalg.solve(beam.M_eta, beam.K)).real)
    found = rates(made)
    assert np.sum(found == 0.0) == 6
    np.testing.assert_allclose(found[6:], np.sort(wanted), rtol=1e-8)


def test_tangents_are_the_differences_of_the_residual():
    """On a spinning, loaded, flexible scene, at its state."""
    from flexmb.workflow.compiled_model import compile_source
    from flexmb.workflow.linearize import state_of

    beam = reduce(
        line(6, end=(1, 0, 0)), modes=3, interfaces={"root": "root", "tip": "tip"},
        material="steel", sections={"all": rectangle(0.02, 0.01)}, geometric_stiffening="full",
    )  # fmt: skip
    model = Model("arm", gravity=[0, -G, 0])
    model.add_body("arm", beam)
    model.add_joint("pin", "revolute", between=["ground", "arm.root"], axis="z")
    model.add_sensor("turn", "angle", joint="pin")
    model.add_force("servo", "torque", at="arm.root", value=[0, 0, "-3*turn - 0.1*turn**2"])
    model.add_force("push", "force", at="arm.tip", value=[1.0, 2.0, "5*t"], axes="body")
    system = compile_source(model)
    state = state_of(system, None, "initial").state
    state.v[:] = 0.3 * np.random.default_rng(3).standard_normal(len(state.v))
    at = StateEquations(system.compiled, state)
    tangents, q, v = at.tangents(), state.q.copy(), state.v.copy()
    h = 1e-5
    for k in range(len(v)):
        d = h * (np.arange(len(v)) == k)
        sides = []
        for sign in (1.0, -1.0):
            state.q[:] = at.moved(q, sign * d)
            sides.append(at.residual())
        state.q[:] = q
        scale = np.abs(tangents.K[:, k]).max() + 1.0
        np.testing.assert_allclose(
            (sides[0] - sides[1]) / (2 * h), tangents.K[:, k], atol=2e-7 * scale
        )
        sides = []
        for sign in (1.0, -1.0):
            state.v[:] = v + sign * d
            sides.append(at.residual())
        state.v[:] = v
        scale = np.abs(tangents.D[:, k]).max() + 1.0
        np.testing.assert_allclose(
            (sides[0] - sides[1]) / (2 * h), tangents.D[:, k], atol=2e-7 * scale
        )


def test_soft_motion_beside_stiff_modes_keeps_its_digits():
    """A pendulum of steel: 5 rad/s beside modes above 2e4."""
    beam = reduce(
        line(8, end=(1, 0, 0)), modes=10, interfaces={"root": "root"}, material="steel",
        sections={"all": rectangle(0.05, 0.05)},
    )  # fmt: skip
    model = Model("pendulum", gravity=[G, 0, 0])
    model.add_body("bar", beam)
    model.add_joint("pin", "revolute", between=["ground", "bar.root"], axis="z")
    made = flexmb.linearize(model)
    assert rates(made)[-1] > 2e4
    inertia = 1 / 3 + 0.05**2 / 12
    assert rates(made)[0] == pytest.approx(np.sqrt(G * 0.5 / inertia), rel=1e-5)


def test_a_yoke_on_a_crank_that_turns():
    """Of T = m θ̇²/2 with m(θ) = J + M r² sin²θ and V = k r² (cos θ − cos θ₀)²/2 a small change has
    m ÿ + m' θ̇ ẏ + (m' θ̈ + m'' θ̇²/2 + V'') y = 0: what the joint leaves free changes on the way."""
    J, M, r, k, angle, rate = 0.3, 2.0, 0.4, 50.0, 0.9, 3.0
    model = Model("yoke", plane="xy")
    model.add_body("crank", mass=1.0, inertia=[1, 1, J], angular_velocity=[0, 0, rate],
                   orientation={"axis": "z", "angle": f"{angle} rad"})  # fmt: skip
    model.add_marker("crank.pin", position=[r, 0, 0])
    model.add_body("yoke", mass=M, inertia=[1, 1, 1], position=[r * np.cos(angle), 0, 0],
                   velocity=[-r * rate * np.sin(angle), 0, 0])  # fmt: skip
    model.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    model.add_joint("guide", "prismatic", between=["ground", "yoke"], axis="x")
    model.add_joint("slot", "in-plane", between=["yoke", "crank.pin"], axis="x")
    model.add_force("spring", "bushing", between=["ground", "yoke"], stiffness=[k, 0, 0])
    model.add_sensor("yoke", "acceleration", of="yoke")
    with pytest.warns(match="not steady"):
        made = flexmb.linearize(model, frame="ground")
    s, c = np.sin(angle), np.cos(angle)
    m, slope, bend = J + M * r * r * s * s, M * r * r * 2 * s * c, 2 * M * r * r * (c * c - s * s)
    faster = -0.5 * slope * rate**2 / m
    stiffness = slope * faster + 0.5 * bend * rate**2 + k * r * r * s * s
    assert made.coordinates == ("crank.rotation.z",)
    np.testing.assert_allclose(
        [made.mass[0, 0], made.damping[0, 0], made.stiffness[0, 0]], [m, slope * rate, stiffness],
        rtol=1e-7,
    )  # fmt: skip
    space = made.state_space([], ["yoke.x"])  # ẍ = −r (s θ̈ + c θ̇²)
    rates = -r * (s * space.A[1] + np.array([c * faster - s * rate**2, 2 * c * rate]))
    np.testing.assert_allclose(space.C[0], rates, rtol=1e-6)


def test_a_bead_on_springs_in_a_frame_that_speeds_up():
    """m (ẍ + 2 ω × ẋ + α × x − ω² x) + k x = 0 in the axes of what turns, with Euler's force."""
    m, k, w, a = 2.0, 300.0, 5.0, 40.0
    model = Model("bead", plane="xy")
    model.add_body("table", mass=1.0, inertia=[1, 1, 1])
    model.add_body("bead", mass=m, inertia=[1, 1, 1], angular_velocity=[0, 0, w])
    model.add_joint("bearing", "revolute", between=["ground", "table"], axis="z")
    model.add_driver("motor", joint="bearing", angle=f"{w}*t + {a / 2}*t**2")
    model.add_force("springs", "bushing", between=["table", "bead"], stiffness=[k, k, k])
    with pytest.warns(match="not steady"):
        made = flexmb.linearize(model, frame="table")
    J = np.array([[0.0, -1.0], [1.0, 0.0]])
    at = [made.coordinates.index(f"bead.r.{axis}") for axis in "xy"]
    block = np.ix_(at, at)
    np.testing.assert_allclose(made.mass[block], m * np.eye(2), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(made.damping[block], 2 * m * w * J, atol=1e-9)
    wanted = (k - m * w * w) * np.eye(2) + m * a * J
    np.testing.assert_allclose(made.stiffness[block], wanted, atol=1e-6)


def test_a_sweep_has_the_damping_of_its_modes():
    """ζ = c/(2 √(k m)) of one mass, for several dampers."""
    sweep = ModeSweep.of("c", [0.5, 2.0], [flexmb.linearize(chain(1, 300.0, c, 2.0, False))
                                           for c in (0.5, 2.0)])  # fmt: skip
    wanted = np.array([[0.5], [2.0]]) / np.sqrt(2 * 300.0 * 2.0)  # two springs, two dampers
    np.testing.assert_allclose(sweep.damping_ratios, wanted, rtol=1e-9)


def test_a_state_at_rest_that_is_no_equilibrium_says_how_to_take_one():
    made = Model("hook", plane="xy", gravity=[0, -G, 0])
    made.add_body("bar", mass=1.0, inertia=[1, 1, 1], center=[1.0, 0, 0])
    made.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    made.add_force("stay", "rotational-spring-damper", joint="pin", stiffness=5.0)
    with pytest.warns(
        match='not steady.*nothing moves yet: about = "static" takes the equilibrium'
    ):
        flexmb.linearize(made)


@pytest.mark.parametrize("about", ["undeformed", "quasi-static", "static"])
@pytest.mark.parametrize("stiffening", ["none", "full"])
def test_a_shaft_that_opposite_torques_twist_is_at_rest(about, stiffening):
    """Between balls it turns freely, with accelerations of round-off: "cannot be assembled" by
    1e17 m was told of one that is straight, and "not steady" of others. ω = π² √(EI/ρA)/L²."""
    body = reduce(line(16), modes=12, sections={"all": rectangle(0.02, 0.02)},
                  material={"E": 2e11, "nu": 0.3, "density": 7800.0},
                  interfaces={"root": "root", "tip": "tip"}, geometric_stiffening=stiffening,
                  )  # fmt: skip
    made = Model("shaft", gravity=[0, 0, 0])
    made.add_body("shaft", body, geometric_stiffening=stiffening)
    made.add_marker("ground.tip", position=[1, 0, 0])
    for ground, end, torque in (("ground", "root", -100.0), ("ground.tip", "tip", 100.0)):
        made.add_joint(end, "spherical", between=[ground, f"shaft.{end}"])
        made.add_force(end, "torque", at=f"shaft.{end}", value=[torque, 0, 0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hertz = flexmb.linearize(made, about=about).frequencies
    bend = 0.5 * np.pi * np.sqrt(2e11 * 0.02**2 / 12 / 7800.0)
    np.testing.assert_allclose(hertz[hertz > 1e-3][:2], bend, rtol=2e-3)


def test_a_stiffness_below_any_round_off_is_a_rigid_motion():
    """Products of round-off leave such numbers beside a spring of 18.6 N/m."""
    none = np.zeros((2, 2))
    made = eigenmodes(np.eye(2), none, np.diag([18.6, 1e-280]), np.zeros(2, bool))
    np.testing.assert_allclose(made.values, [0.0, 1j * np.sqrt(18.6)], atol=0.0, rtol=1e-12)


@pytest.mark.parametrize("damping", [0.0, 0.02])
def test_a_free_body_has_rigid_motions_beside_stiff_modes(damping):
    """Six of a bar in free flight with a rigid body on it; those of 1e-5 Hz were of round-off."""
    made = Model("a craft with a boom")
    bar = reduce(line(8, (0, 0, 0), (2, 0, 0)), material="aluminium", modes=6,
                 sections={"all": rectangle(0.01, 0.02)},
                 interfaces={"root": "root", "tip": "tip"})  # fmt: skip
    made.add_body("boom", bar, position=[0.3, 0, 0], damping=damping)
    made.add_body("bus", mass=100.0, inertia=[8.0, 10.0, 12.0])
    made.add_marker("bus.side", position=[0.3, 0, 0])
    made.add_joint("root", "fixed", between=["bus.side", "boom.root"])
    modes = flexmb.linearize(made)
    assert modes.stable
    assert (modes.eigenvalues == 0.0).sum() == 6
    assert modes.eigenvalues.imag[6] > 1.0
    assert np.linalg.matrix_rank(modes.shapes[:, :6], tol=1e-6) == 6
    lag = modes.damping_ratios[6:]
    assert np.all(lag > 0.9 * damping) if damping else np.all(lag == 0.0)
