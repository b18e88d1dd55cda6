"""Damping of flexible bodies: time runs and linearised scenes against closed forms.

A bar of steel, 1 m long, 20 mm wide along y and 10 mm along z, bends at β² sqrt(EI/ρA)/2πL² with
β = 1.87510 (clamped), π (pinned), 4.73004 (free): Blevins, Formulas for Natural Frequency and Mode
Shape, 1979, table 8-1. Shear and rotary inertia take 2e-4 of them away. A ratio is measured on the
sensor as a run has it: σ and ω of c + exp(−σt)(a cos ωt + b sin ωt), ζ = σ/sqrt(σ² + ω²).
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, rotation
from femeshes import line
from flexiblescenes import STEEL, flexible_crank, rod
from scipy.optimize import least_squares

import flexmb
from flexmb.fe import rectangle, reduce
from flexmb.flexbody import save
from flexmb.flexbody.natural_modes import natural_frequencies
from flexmb.model import Model

L, WIDTH, HEIGHT = 1.0, 0.02, 0.01
CLAMPED, PINNED, FREE = 1.87510, np.pi, 4.73004
pytestmark = pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")


def bending(beta, length=L):
    """Frequency of the first bending mode along z [Hz]."""
    return (
        beta**2 * np.sqrt(STEEL["E"] * HEIGHT**2 / 12 / STEEL["density"]) / (2 * np.pi * length**2)
    )


def bar(damping=None, **options):
    return reduce(
        line(12, end=(L, 0, 0)), material=STEEL, interfaces={"root": "root", "tip": "tip"},
        sections={"all": rectangle(WIDTH, HEIGHT)}, modes=6, damping=damping, **options,
    )  # fmt: skip


def clamped(damping, at=(0.0, 0.0, 0.0)):
    model = Model("clamped")
    model.add_marker("ground.wall", position=at)
    model.add_body("bar", bar(damping), position=at)
    model.add_joint("wall", "fixed", between=["ground.wall", "bar.root"])
    model.add_force("push", "force", at="bar.tip", value=[0, 0, 1])
    model.add_sensor("seen", "position", of="bar.tip", relative_to="ground.wall")
    return model


def pinned(damping):
    model = Model("pinned")
    model.add_body("bar", bar(damping))
    model.add_marker("ground.end", position=[L, 0, 0])
    model.add_joint("left", "revolute", between=["ground", "bar.root"], axis="y")
    model.add_joint("right", "revolute", between=["ground.end", "bar.tip"], axis="y")
    model.add_force("push", "torque", at="bar.tip", value=[0, 1, 0])
    model.add_sensor("seen", "angular_velocity", of="bar.tip")
    return model


def free(damping):
    model = Model("free")
    model.add_body("bar", bar(damping))
    for end, sign in (("root", 1), ("tip", -1)):
        model.add_force(f"push_{end}", "torque", at=f"bar.{end}", value=[0, sign, 0])
    model.add_sensor("seen", "angular_velocity", of="bar.tip")
    return model


def on_a_free_hub(damping):
    """A panel on a spacecraft: its mode moves the hub."""
    model = Model("hub")
    model.add_body("hub", mass=2.0, inertia=[0.02, 0.03, 0.04])
    model.add_marker("hub.edge", position=[0.1, 0, 0])
    model.add_body("bar", bar(damping), position=[0.1, 0, 0])
    model.add_joint("weld", "fixed", between=["hub.edge", "bar.root"])
    model.add_force("push", "torque", at="bar.tip", value=[0, 1, 0])
    model.add_force("hold", "torque", at="hub", value=[0, -1, 0])
    model.add_sensor("seen", "angular_velocity", of="bar.tip")
    return model


def slider_crank(damping, driven=True, angle=0.7):
    """A rod between a crank, driven or free, and a slider that its bending along y moves."""
    r = 0.2
    phi = -np.arcsin(r * np.sin(angle) / L)
    pin = np.array([r * np.cos(angle), r * np.sin(angle), 0])
    model = Model("slider-crank")
    model.add_body("crank", mass=1.0, center=[r / 2, 0, 0], inertia=[0.01] * 3,
                   orientation={"axis": "z", "angle": angle})  # fmt: skip
    model.add_marker("crank.pin", position=[r, 0, 0])
    model.add_body("bar", bar(damping), position=pin, orientation={"axis": "z", "angle": phi})
    slider = pin + [np.cos(phi), np.sin(phi), 0]
    model.add_body("slider", mass=0.5, inertia=[0.01] * 3, position=slider)
    model.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    model.add_joint("pin", "revolute", between=["crank.pin", "bar.root"], axis="z")
    model.add_joint("wrist", "revolute", between=["bar.tip", "slider"], axis="z")
    model.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    if driven:
        model.add_driver("motor", joint="bearing", angle=angle)
    model.add_force("push", "torque", at="bar.tip", value=[0, 0, 1])
    model.add_sensor("seen", "angular_velocity", of="bar.tip")
    return model


def told(result, name="bar"):
    """Frequencies [Hz] and ratios of the modes as joined."""
    damping = result.damping[name]
    return np.array(damping.frequencies), np.array(damping.ratios)


def measured(t, x, f, z):
    """Frequency [Hz] and ratio of the vibration of a signal, sought from f and z on."""
    w = 2 * np.pi * f

    def rest(p):
        waves = [np.exp(-p[0] * t) * wave(p[1] * t) for wave in (np.cos, np.sin)]
        A = np.column_stack([np.ones_like(t), *waves])
        return (A @ np.linalg.lstsq(A, x, rcond=None)[0] - x) / np.std(x)

    sigma, w = least_squares(rest, [1.5 * z * w, 1.01 * w], x_scale=[z * w, w]).x
    return np.hypot(sigma, w) / (2 * np.pi), sigma / np.hypot(sigma, w)


def mode_in(result, f):
    """Number of the mode as joined that is nearest to a frequency [Hz]."""
    return int(np.abs(told(result)[0] - f).argmin())


# A scene, the channel of its first bending mode along z (of the rod along y), the frequency of that
# mode by a closed form or None.
SCENES = {
    "clamped": (clamped, "seen.z", bending(CLAMPED)),
    "pinned": (pinned, "seen.y", bending(PINNED)),
    "free": (free, "seen.y", bending(FREE)),
    "on a free hub": (on_a_free_hub, "seen.y", None),
    "slider-crank, driven": (slider_crank, "seen.z", None),
}


@pytest.mark.seconds
@pytest.mark.parametrize(
    "name", [*list(SCENES)[:4], pytest.param("slider-crank, driven", marks=pytest.mark.slow)]
)
def test_a_run_decays_as_told(name):
    make, channel, expected = SCENES[name]
    z = 0.03
    model = make(z)
    lin = flexmb.linearize(model, about="undeformed")
    f = expected or lin.frequencies[lin.frequencies > 1.0].min()
    run = flexmb.simulate(
        model, duration=20 / f, outputs=1000, accuracy=1e-5, method="radau", start="undeformed"
    )
    frequencies, ratios = told(run)
    np.testing.assert_allclose(ratios, z, rtol=1e-9)
    k = mode_in(run, f)
    if expected is not None:
        assert frequencies[k] == pytest.approx(expected, rel=1e-3)
    late = slice(500, None)  # higher modes have decayed
    found, ratio = measured(run.time[late], run[channel][late], frequencies[k], z)
    assert found == pytest.approx(frequencies[k], rel=2e-3)
    assert ratio == pytest.approx(z, rel=0.01)


LAWS = {
    "number": (0.02, lambda f: np.full_like(f, 0.02)),
    "adams": ("adams", lambda f: np.select([f < 100, f < 1000], [0.01, 0.1], 1.0)),
    "bands": (
        {"bands": [{"above": 90, "ratio": 0.2}, {"below": 90, "ratio": 0.04}]},
        lambda f: np.where(f < 90, 0.04, 0.2),
    ),
    "table": (
        {"table": {"frequencies": [10, 100], "ratios": [0.01, 0.04]}},
        lambda f: np.clip(0.01 + 0.03 * (f - 10) / 90, 0.01, 0.04),
    ),
    "alpha and beta": (
        {"rayleigh": {"alpha": 2.0, "beta": 1e-4}}, lambda f: 1 / (2 * np.pi * f) + np.pi * 1e-4 * f
    ),
    "two frequencies": (
        {"rayleigh": {"frequencies": [10, 200], "ratios": [0.02, 0.05]}},
        # ζ = a/f + b f through both points
        lambda f: (0.05 * 200 - 0.02 * 10) / (200**2 - 10**2) * f
        + (0.02 / 10 - 0.05 / 200) / (1 / 10**2 - 1 / 200**2) / f,
    ),
    "critical above": (
        {"ratio": 0.01, "critical_above": 90}, lambda f: np.where(f > 90, 1.0, 0.01)
    ),
    "by mode": (
        {"ratio": 0.01, "modes": {1: 0.05, 3: 0}},
        lambda f: np.where(np.arange(len(f)) == 0, 0.05, np.where(np.arange(len(f)) == 2, 0, 0.01)),
    ),
}  # fmt: skip


@pytest.mark.parametrize("law", LAWS)
def test_all_modes_of_the_linearised_scene_have_the_ratios_of_the_law(law):
    """The eigenvalues of the linearised equations of motion, which know nothing of the law."""
    words, expected = LAWS[law]
    frequencies, ratios = told(flexmb.simulate(clamped(words), duration=1e-3, outputs=2))
    np.testing.assert_allclose(ratios, expected(frequencies), rtol=1e-9, atol=1e-12)
    lin = flexmb.linearize(clamped(words), about="undeformed")
    found = np.sort_complex(lin.eigenvalues[lin.eigenvalues.imag >= 0])
    omega = 2 * np.pi * frequencies
    s = -ratios * omega + 1j * omega * np.sqrt(np.maximum(1 - ratios**2, 0))
    for value in s[ratios < 0.999]:
        assert np.abs(found - value).min() < 1e-6 * np.abs(value)
    for value in s[ratios > 0.999]:  # double eigenvalues: off by the root of round-off
        assert np.abs(found - value).min() < 2e-2 * np.abs(value)


@pytest.mark.seconds
@pytest.mark.parametrize("law", ["adams", "bands", "table", "alpha and beta", "critical above"])
def test_a_run_decays_by_each_law(law):
    model = clamped(LAWS[law][0])
    f = bending(CLAMPED)
    z = float(LAWS[law][1](np.array([f]))[0])
    run = flexmb.simulate(
        model, duration=10 / f, outputs=500, accuracy=1e-5, method="radau", start="undeformed"
    )
    assert told(run)[1][mode_in(run, f)] == pytest.approx(z, rel=2e-3)
    assert measured(run.time, run["seen.z"], f, z)[1] == pytest.approx(z, rel=0.01)


@pytest.mark.seconds
@pytest.mark.parametrize("of", ["free", "clamped"])
def test_ratios_of_other_modes_are_other_ratios_as_joined(of):
    """Told are those of the linearised scene; in a scene of their own kind they are the law."""
    words = {"ratio": 0.02, "of": of}
    frequencies, ratios = told(flexmb.simulate(clamped(words), duration=1e-3, outputs=2))
    lin = flexmb.linearize(clamped(words), about="undeformed")
    np.testing.assert_allclose(np.sort(lin.damping_ratios), np.sort(ratios), rtol=1e-6)
    assert ratios[0] < 0.1 * 0.02  # MECHANICS: a free body's ratio is 1/14 of itself when clamped
    if of == "free":
        own = free(words)
    else:
        own = clamped(words)
        own.add_marker("ground.end", position=[L, 0, 0])
        own.add_joint("end", "fixed", between=["ground.end", "bar.tip"])
    frequencies, ratios = told(flexmb.simulate(own, duration=1e-3, outputs=2))
    held = ["root", "tip"] if of == "clamped" else []
    np.testing.assert_allclose(
        frequencies, natural_frequencies(own.bodies["bar"].flexbody, held), rtol=1e-6
    )
    np.testing.assert_allclose(ratios, 0.02, rtol=1e-9)


@pytest.mark.parametrize("driven", [True, False])
def test_all_modes_of_a_slider_crank_have_the_ratio(driven):
    """The crank free: rigid motion is left, and is not damped."""
    model = slider_crank(0.02, driven)
    lin = flexmb.linearize(model, about="undeformed")
    vibrates = lin.frequencies > 1.0
    assert np.sum(~vibrates) == (0 if driven else 1)
    np.testing.assert_allclose(lin.damping_ratios[vibrates], 0.02, rtol=1e-5)
    np.testing.assert_allclose(lin.damping_ratios[~vibrates], 0.0, atol=1e-9)


def test_rayleigh_damping_is_beta_times_the_stiffness():
    body, beta = bar(), 1e-5
    model = clamped({"rayleigh": {"beta": beta}})
    D = flexmb.linearize(model, about="undeformed").D[-body.m :, -body.m :]
    np.testing.assert_allclose(D, beta * body.K, atol=1e-9 * beta * body.K.max())


def thrown(damping, couple):
    """A bar on a hub, spinning about y, its axis of the largest moment; a couple may bend it."""
    model = on_a_free_hub(damping)
    if not couple:
        model.forces.clear()
    model.bodies["hub"] = model.bodies["hub"].model_copy(
        update={"velocity": (1.0, 2.0, 3.0), "angular_velocity": (0.0, 5.0, 0.0)}
    )
    model.add_sensor("turn", "angular_velocity", of="hub")
    return model


@pytest.mark.slow
def test_a_spinning_body_keeps_its_spin_and_its_momentum():
    """Critically damped, after four turns: of its 60 J the stretch is 1e-5, and nothing is lost."""
    run = flexmb.simulate(
        thrown(1.0, False),
        duration=38.0,
        outputs=50,
        accuracy=1e-6,
        method="radau",
        start="quasi-static",
    )
    kinetic = run.energy["kinetic"]
    np.testing.assert_allclose(kinetic, kinetic[0], rtol=3e-6)
    assert np.abs(run.energy["damper_work"]).max() < 3e-6 * kinetic[0]


@pytest.mark.seconds
def test_damping_takes_energy_but_no_momentum():
    """Thrown undeformed, bent by torques that cancel: half of their work is lost within 0.5 s."""
    model = thrown(0.05, True)
    run = flexmb.simulate(
        model, duration=0.5, outputs=20, accuracy=1e-7, method="radau", start="undeformed"
    )
    bench, momenta = Bench(model), []
    for q, v in zip(run.q, run.v, strict=True):
        bench.q[:], bench.v[:] = q, v
        p, total = bench.at().mass_matrix() @ v, np.zeros(6)
        for body in run.layout.bodies:
            force, moment = p[body.iv : body.iv + 3], p[body.iv + 3 : body.iv + 6]
            arm = np.cross(q[body.iq : body.iq + 3], force)
            total += np.append(force, arm + rotation(q[body.iq + 3 : body.iq + 7]) @ moment)
        momenta.append(total)
    np.testing.assert_allclose(momenta, [momenta[0]] * 21, atol=1e-5)
    assert run.energy["damper_work"][-1] == pytest.approx(-run.energy["strain"][-1], rel=0.05)


@pytest.mark.seconds
def test_what_is_lost_is_the_work_of_damping():
    f = bending(CLAMPED)
    run = flexmb.simulate(
        clamped(0.05), duration=20 / f, outputs=400, accuracy=1e-6, method="radau",
        start="undeformed",
    )  # fmt: skip
    energy = run.energy
    stored = energy["kinetic"] + energy["strain"] - energy["applied_work"]
    lost = energy["damper_work"]
    assert np.all(np.diff(lost) <= 0.0)
    np.testing.assert_allclose(stored - stored[0], lost, atol=2e-4 * np.abs(lost).max())
    # at last half of the work of the push is stored, the other half is lost
    assert lost[-1] == pytest.approx(-energy["strain"][-1], rel=0.01)


@pytest.mark.parametrize("scale", ["1 km away", "micrometres"])
def test_ratios_do_not_depend_on_place_and_size(scale):
    if scale == "1 km away":
        model = clamped(0.02, at=(600.0, -800.0, 300.0))
        f, z = told(flexmb.simulate(model, duration=1e-3, outputs=2))
    else:
        micron = 1e-6
        body = reduce(
            line(12, end=(L * micron, 0, 0)), material=STEEL, interfaces={"root": "root"},
            sections={"all": rectangle(WIDTH * micron, HEIGHT * micron)}, modes=6,
        )  # fmt: skip
        model = Model("small")
        model.add_body("bar", body, damping=0.02)
        model.add_joint("wall", "fixed", between=["ground", "bar.root"])
        f, z = told(flexmb.simulate(model, duration=1e-12, outputs=2))
        f = f * micron
    np.testing.assert_allclose(z, 0.02, rtol=1e-6)
    assert f[0] == pytest.approx(bending(CLAMPED), rel=1e-3)


def test_a_planar_scene_has_the_ratio_in_its_plane():
    model = Model("plane", plane="zx")
    model.add_body("bar", bar(0.02))
    model.add_joint("wall", "fixed", between=["ground", "bar.root"])
    frequencies, ratios = told(flexmb.simulate(model, duration=1e-3, outputs=2))
    assert frequencies[0] == pytest.approx(bending(CLAMPED), rel=1e-3)
    np.testing.assert_allclose(ratios, 0.02, rtol=1e-9)


def test_in_a_large_scene_other_bodies_are_at_rest():
    """101 bodies: more than 600 coordinates; the bar hangs on a heavy ball that hangs on others."""
    model = Model("many")
    for k in range(101):
        model.add_body(f"ball{k}", mass=1.0, inertia=[1.0] * 3, position=[0, k, 0])
    model.add_body("bar", bar(0.02))
    model.add_joint("weld", "fixed", between=["ball0", "bar.root"])
    run = flexmb.simulate(model, duration=1e-4, outputs=1, step=1e-4)
    frequencies, ratios = told(run)
    assert "at rest" in run.damping["bar"].words
    assert frequencies[0] == pytest.approx(bending(CLAMPED), rel=1e-3)
    np.testing.assert_allclose(ratios, 0.02, rtol=1e-9)


@pytest.mark.seconds
def test_the_scene_has_the_last_word(tmp_path):
    """A file has damping; the scene may say otherwise, and a matrix is told as it is."""
    file = save(bar(0.02), tmp_path / "bar.flexbody.h5")

    def ratios(body, **words):
        model = clamped(None)
        del model.bodies["bar"]
        model.add_body("bar", **({"flexbody": body} | words))
        return flexmb.simulate(model, duration=1e-3, outputs=2).damping["bar"]

    assert ratios(str(file)).words == "2 % of the modes as joined"
    assert ratios(str(file), damping=0.0).ratios == (0.0,) * 12
    np.testing.assert_allclose(ratios(str(file), damping=0.07).ratios, 0.07, rtol=1e-9)
    body = bar()
    matrix = flexmb.flexbody.FlexBody(**{**vars(body), "D": 1e-5 * body.K})
    one = ratios(matrix)
    np.testing.assert_allclose(one.ratios, np.pi * 1e-5 * np.array(one.frequencies), rtol=1e-6)
    assert ratios(body).words == "none"


def test_a_resumed_run_has_the_same_damping(tmp_path):
    model = clamped({"ratio": 0.05, "of": "clamped"})
    knobs = {"duration": 0.2, "outputs": 40, "step": 1e-3}
    whole = flexmb.simulate(model, output=tmp_path / "whole", **knobs)
    flexmb.simulate(model, output=tmp_path / "part", **(knobs | {"duration": 0.1, "outputs": 20}))
    again = flexmb.resume(tmp_path / "part", duration=0.2)
    np.testing.assert_array_equal(again["seen.z"], whole["seen.z"])
    assert again.damping == whole.damping


@pytest.mark.seconds
def test_critically_damped_modes_save_steps_and_move_a_slider_little():
    """A rod with 18 modes from 35 Hz to 14 kHz in a slider-crank, for one turn."""
    runs = []
    for damping in (0.01, {"ratio": 0.01, "critical_above": 500}):
        model = flexible_crank()
        del model.bodies["rod"]
        model.add_body("rod", rod(0.012, modes=12), position=[0.15, 0, 0], damping=damping)
        runs.append(
            flexmb.simulate(model, duration=0.04, outputs=200, accuracy=1e-4, method="radau")
        )
    some, few = runs
    assert few.statistics["steps"] < 0.6 * some.statistics["steps"]
    moved = few["slider.x"] - some["slider.x"]
    assert np.abs(moved).max() < 5e-4 * np.ptp(some["slider.x"])


def test_modes_with_a_residual_flexibility_have_their_ratios():
    def damping(deformation):
        model = clamped(0.02)
        flexbody = model.bodies.pop("bar").flexbody
        model.add_body("bar", flexbody, damping=0.02, deformation=deformation)
        knobs = {"outputs": 1, "step": 1e-4, "method": "generalized-alpha"}
        return flexmb.simulate(model, duration=1e-3, **knobs).damping["bar"]

    assert damping("quasi-static").words == "none: all modes are quasi-static"
    some = damping({"quasi_static": [10, 11]})
    assert len(some.ratios) == 12  # ten, and the rigid body on the compliance of the others
    np.testing.assert_allclose(some.ratios, 0.02, rtol=1e-9)
