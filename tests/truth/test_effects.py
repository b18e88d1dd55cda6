"""Effects of flexible bodies as switches, against statics, mass properties and the full model."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from flexiblescenes import BEAM_PERIOD, STEEL, rod
from truth.test_simeon_crank import L1, L2, P
from truth.test_simeon_crank import rod as simeon_rod

import flexmb
from flexmb.errors import FlexmbWarning, ReductionError, SceneError
from flexmb.flexbody.effects import frame_at_interface
from flexmb.flexbody.natural_modes import natural_frequencies
from flexmb.model import Model

pytestmark = pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")
METHODS = ("generalized-alpha", "radau", "explicit-rk", "newmark")


def simeon(speed, **words):
    """Simeon's slider-crank with a turning crank."""
    made = Model("slider-crank")
    J = P["J1"] - P["m1"] * L1**2 / 4
    made.add_body("crank", mass=P["m1"], center=[L1 / 2, 0, 0], inertia=[J, J, J])
    made.add_marker("crank.pin", position=[L1, 0, 0])
    made.add_body("rod", simeon_rod(), position=[L1, 0, 0], **words)
    made.add_body("slider", mass=P["m3"], inertia=[1e-4] * 3, position=[L1 + L2, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "spherical", between=["crank.pin", "rod.big_end"])
    made.add_joint("wrist", "cylindrical", between=["rod.small_end", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_driver("motor", joint="bearing", angle=f"{speed}*t")
    made.add_sensor("slider", "position", of="slider")
    return made


def bending(speed, **words):
    """First bending coordinate over one turn from undeformed rest, and the steps it took."""
    result = flexmb.simulate(
        simeon(speed, **words), duration=2 * np.pi / speed, accuracy=1e-6, outputs=200,
        method="explicit-rk",
    )  # fmt: skip
    return result["rod.eta.0"], result.statistics["steps"]


# Errors of the bending that an own program of the same problem gave (DOP853, from rest, one turn):
# without Coriolis and centrifugal terms 0.13, 0.92, 2.5 %; with them and a constant mass matrix
# 0.00, 0.01, 0.02 %; without the axial modes 0.43, 0.40, 0.40 %.
@pytest.mark.seconds
@pytest.mark.parametrize(
    ("speed", "of_constant"), [(150, 0.0092), pytest.param(300, 0.025, marks=pytest.mark.slow)]
)
def test_the_ladder_of_couplings_on_a_slider_crank(speed, of_constant):
    full, steps = bending(speed)
    size = np.abs(full).max()
    error = {c: np.abs(bending(speed, inertia_coupling=c)[0] - full).max() / size
             for c in ("constant", "partial")}  # fmt: skip
    assert error["constant"] == pytest.approx(of_constant, rel=0.1)
    assert error["partial"] < 0.1 * error["constant"]
    without_axial, few = bending(speed, deformation={"quasi_static": [2, 3]})
    assert np.abs(without_axial - full).max() < 0.0043 * size
    assert steps > 5 * few  # by as few as hold that accuracy of the deformation


def pendulum(body, **words):
    made = Model("pendulum", gravity=[0, -9.81, 3.0])
    made.add_body("rod", body, **words)
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip")
    made.add_sensor("force", "reaction", joint="hinge")
    return made


def channels(model, names=("tip.x", "tip.y", "tip.z"), **dynamics):
    result = flexmb.simulate(model, **{"duration": 0.3, "accuracy": 1e-6, "outputs": 30} | dynamics)
    return np.array([result[name] for name in names]), result


def test_rigid_is_the_body_of_its_mass_properties():
    body = rod(0.012)
    words = {"deformation": "rigid", "inertia_coupling": "partial"}
    rigid, _ = channels(pendulum(body, **words), step=1e-3, accuracy=None)
    made = Model("pendulum", gravity=[0, -9.81, 3.0])
    made.add_body("rod", mass=body.mass, center=body.center.tolist(),
                  inertia=body.inertia_about_center.tolist())  # fmt: skip
    for end in body.interfaces:
        made.add_marker(f"rod.{end.name}", position=end.position.tolist())
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip")
    same, _ = channels(made, step=1e-3, accuracy=None)
    np.testing.assert_allclose(rigid, same, rtol=0, atol=1e-12)


def cantilever(**words):
    made = Model("cantilever")
    made.add_body("beam", rod(0.01, 1.0, 20, 16), **words)
    made.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    made.add_force("load", "force", at="beam.tip", value=[0, "t", 0])
    made.add_sensor("tip", "position", of="beam.tip")
    made.add_sensor("force", "reaction", joint="clamp")
    return made


@pytest.mark.parametrize("method", METHODS)
def test_quasi_static_modes_have_the_deflection_of_statics(method):
    """F (L³/3EI + L/κGA) at each time, however fast it is loaded; and the joint stays closed."""
    made = cantilever(deformation="quasi-static")
    made.add_sensor("speed", "velocity", of="beam.tip")
    (y, v), result = channels(
        made, ("tip.y", "speed.y"), duration=1.0, accuracy=1e-4, method=method
    )
    E, nu = STEEL["E"], STEEL["nu"]
    shear = 10 * (1 + nu) / (12 + 11 * nu) * E / (2 * (1 + nu)) * 0.01**2
    compliance = 1 / (3 * E * 0.01**4 / 12) + 1 / shear
    assert y == pytest.approx(compliance * result.time, rel=5e-6, abs=1e-11)
    assert result.statistics["largest_position_drift"] < 1e-10
    assert result["force.y"][1:] == pytest.approx(-result.time[1:], rel=1e-6)
    assert v[5:] == pytest.approx(compliance, rel=1e-5)
    work = result.energy["applied_work"]  # ½ C F², all of which is strain energy
    assert work == pytest.approx(compliance / 2 * result.time**2, rel=1e-3, abs=1e-4 * work[-1])
    assert result.statistics["energy_balance_error"] < 1e-3


@pytest.mark.seconds
def test_quasi_static_modes_are_the_limit_of_slow_motion():
    """The difference to dynamic modes falls at least with the square of the speed."""
    errors = []
    for speed in (4.0, 2.0):
        knobs = {"duration": 6.0 / speed, "accuracy": 1e-7, "start": "quasi-static", "outputs": 60}
        tips = []
        for deformation in ("dynamic", "quasi-static"):
            made = Model("turning")
            made.add_body("beam", rod(0.01, 1.0, 10, 6), deformation=deformation)
            made.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
            made.add_driver("motor", joint="hub", angle=f"sin({speed}*t)-{speed}*t")
            made.add_sensor("tip", "position", of="beam.tip", relative_to="beam.root")
            tips.append(channels(made, ("tip.y",), method="radau", **knobs)[0][0])
        errors.append(np.abs(tips[0] - tips[1]).max() / np.abs(tips[0]).max())
    assert errors[0] < 0.02
    assert errors[0] / errors[1] > 3.5


@pytest.mark.seconds
def test_quasi_static_modes_do_not_restrict_the_step():
    many, few = (
        channels(cantilever(deformation=word), duration=5 * BEAM_PERIOD, accuracy=1e-3,
                 method="explicit-rk")[1].statistics["steps"]
        for word in ("dynamic", "quasi-static")
    )  # fmt: skip
    assert many > 50 * few


@pytest.mark.slow
def test_both_frames_differ_with_the_square_of_the_deformation():
    """A beam on a hinge that is let go, then the same one twice as stiff."""
    errors, sizes = [], []
    for stiffer in (100.0, 200.0):
        body = rod(0.002)
        body = replace(body, K=stiffer * body.K)
        knobs = {"accuracy": 1e-9, "duration": 0.02, "method": "explicit-rk"}
        mean, held = (channels(pendulum(body, frame=frame), **knobs)[0]
                      for frame in ("mean axis", "interface root"))  # fmt: skip
        rigid = channels(pendulum(body, deformation="rigid"), **knobs)[0]
        sizes.append(np.abs(mean - rigid).max())
        errors.append(np.abs(mean - held).max())
    assert errors[0] < 1e-3 * sizes[0]
    assert sizes[0] / sizes[1] == pytest.approx(2.0, rel=0.1)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


def test_a_frame_at_an_interface_has_the_same_frequencies():
    body = rod(0.012)
    clamped = frame_at_interface(body, "root")
    assert np.abs(clamped.interface("root").Phi_t).max() < 1e-12
    assert np.abs(clamped.interface("root").Phi_r).max() < 1e-10
    for held in (("root",), ("tip",), ("root", "tip")):
        before, after = natural_frequencies(body, held), natural_frequencies(clamped, held)
        np.testing.assert_allclose(after[-6:], before[-6:], rtol=1e-8)


_MEAN, _ROOT = "mean axis", "interface root"


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("coupling", "plane", "frame", "stiffening"),
    [
        *((coupling, None, _MEAN, "none") for coupling in ("constant", "partial", "full")),
        *(pytest.param(coupling, "xy", _MEAN, "none", marks=pytest.mark.slow)
          for coupling in ("constant", "partial", "full")),
        *((coupling, None, _ROOT, "full") for coupling in ("partial", "full")),
        ("full", "xy", _ROOT, "full"), ("partial", None, _ROOT, "none"),
    ],
)  # fmt: skip
def test_energy_holds_to_the_order_of_the_coupling(coupling, plane, frame, stiffening):
    made = Model("pendulum", gravity=[0, -9.81, 0], plane=plane)
    body = rod(0.004, geometric_stiffening=stiffening)
    made.add_body("rod", body, inertia_coupling=coupling, frame=frame)
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip")
    _, result = channels(made, ("tip.x",), method="explicit-rk", accuracy=1e-9)
    bound = 1e-6 if coupling == "partial" else 1e-11
    assert result.statistics["energy_balance_error"] < bound


def test_an_energy_balance_that_partial_coupling_spoils_names_it():
    """A soft rod that swings with deflections of half its length."""
    made = Model("pendulum", gravity=[0, -9.81, 0])
    made.add_body("rod", rod(0.00012), inertia_coupling="partial")
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.set_validity(**dict.fromkeys(("deflection", "rotation", "speed", "load_factor"), "any"))
    made.set_dynamics(duration=1.0, accuracy=1e-3)
    with pytest.warns(FlexmbWarning):
        result = flexmb.simulate(made)
    (note,) = [note for note in result.notes if "energy balance is off" in note]
    assert "partial coupling of bodies.rod" in note and 'inertia_coupling = "full"' in note


SWITCHES = {
    "deformation": ("dynamic", {"dynamic": [0, 1]}, {"band": [0, 300]}, "quasi-static"),
    "inertia_coupling": ("constant", "partial", "full"),
    "damping": (0.0, 0.02, "adams"),
    "geometric_stiffening": ("none", "full"),
    "frame": (_MEAN, _ROOT),
}
OF_ALL = list(itertools.product(*SWITCHES.values()))


@pytest.mark.slow
@pytest.mark.parametrize("driven", [False, True])
def test_switches_go_together(driven):
    """Every seventh of 144 sets, in which all pairs are, on a pendulum that swings or is driven.

    A set differs from all effects in the same frame by the order of what it leaves out, over what
    deformation does at all: a driven one by vibrations that are damped or without inertia, 3 %, any
    by constant coupling in a frame of an interface, 5 %. Energy is balanced but for the latter.
    """
    bodies = {s: rod(0.012, geometric_stiffening=s) for s in ("none", "full")}

    def tip(geometric_stiffening, **words):
        made = pendulum(bodies[geometric_stiffening], **words)
        if driven:
            made.add_driver("motor", joint="hinge", angle={"type": "step5", "t1": 0.3, "y1": 0.8})
        values, result = channels(made, start="quasi-static", method="radau")
        return values, result.statistics["energy_balance_error"]

    every = {"geometric_stiffening": "full", "inertia_coupling": "full"}
    full = {frame: tip(**every, frame=frame)[0] for frame in (_MEAN, _ROOT)}
    size = np.abs(full[_MEAN] - tip("none", deformation="rigid")[0]).max()
    for chosen in OF_ALL[::7]:
        words = dict(zip(SWITCHES, chosen, strict=True))
        place, unbalanced = tip(**words)
        off = np.abs(place - full[words["frame"]]).max() / size
        uneven = words["inertia_coupling"] == "constant" and words["frame"] == _ROOT
        other = words["damping"] or words["deformation"] in ("quasi-static", {"band": [0, 300]})
        most = 0.01 if words["deformation"] == "quasi-static" else 0.0025
        assert off < (0.06 if uneven else 0.04 if driven and other else most), words
        assert unbalanced < (1e-3 if uneven and driven else 5e-5), words


@pytest.mark.slow
def test_partial_coupling_spins_with_stiffening_like_full_coupling():
    """At twice the first frequency, where a beam without stiffening folds."""
    body = rod(0.01, 1.0, 20, 8, geometric_stiffening="full")
    tips = {}
    for coupling in ("partial", "full", "rigid"):
        made = Model("blade")
        rigid = coupling == "rigid"
        words = {"deformation": "rigid"} if rigid else {"inertia_coupling": coupling}
        made.add_body("beam", body, **words)
        made.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
        speed = 2 * 2 * np.pi / BEAM_PERIOD
        made.add_driver("motor", joint="hub", angle=f"{speed / 2}*(t - sin(pi*t)/pi)")
        made.add_sensor("tip", "position", of="beam.tip")
        tips[coupling] = channels(made, duration=1.0, accuracy=1e-6, method="radau")[0]
    size = np.abs(tips["full"] - tips["rigid"]).max()
    assert 1e-3 < size < 0.1
    assert np.abs(tips["partial"] - tips["full"]).max() < 0.01 * size


def test_words_without_their_data_say_how_to_get_it():
    made = pendulum(rod(0.012), geometric_stiffening="full")
    with pytest.raises(ReductionError, match="flexmb reduce --geometric-stiffening full"):
        flexmb.simulate(made, duration=0.1)
    made = pendulum(rod(0.012), deformation={"dynamic": [0, 99]})
    with pytest.raises(ReductionError, match=r"rod.deformation.dynamic: .* no mode 99.* 0 to 9"):
        flexmb.simulate(made, duration=0.1)
    made = pendulum(rod(0.012), frame="interface rot")
    with pytest.raises(ReductionError, match='no interface "rot"; nearest: root'):
        flexmb.simulate(made, duration=0.1)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ({"geometric_stiffening": True}, 'write geometric_stiffening = "full"'),
        ({"inertia_coupling": "parcial"}, "nearest: partial"),
        ({"deformation": "static"}, "unknown choice"),
        ({"deformation": {"band": [5, 2]}}, "the lower one first"),
        ({"deformation": {"band": [0, 2], "dynamic": [1]}}, "exactly one of"),
        ({"frame": "tip"}, "interface NAME"),
    ],
)
def test_wrong_words(words, text):
    with pytest.raises(SceneError, match=text):
        Model("wrong").add_body("rod", rod(0.012), **words)


def test_effects_of_a_scene_are_switched_off():
    """A weight on a stop, with friction at its guide: each switch lets it move as without."""
    made = Model("block", gravity=[0, 0, -9.81])
    made.add_body("block", mass=2.0, inertia=[0.1] * 3)
    made.add_joint("guide", "prismatic", between=["ground", "block"], axis="z")
    made.add_force("floor", "translational-stop", joint="guide", lower=-1e-3, stiffness=1e5,
                   depth=1e-4, damping=2e2)  # fmt: skip
    made.add_sensor("place", "position", of="block")
    made.set_dynamics(duration=0.2, outputs=20)
    on = flexmb.simulate(made)["place.z"]
    assert on.min() > -0.01
    made.set_effects(stops=False)
    falling = flexmb.simulate(made)
    assert falling["place.z"] == pytest.approx(-0.5 * 9.81 * falling.time**2, abs=1e-9)
    made.set_effects(gravity=False)
    assert np.abs(flexmb.simulate(made)["place.z"]).max() < 1e-12
    made.add_sensor("push", "reaction", force="floor")
    made.set_effects(stops=False)
    with pytest.raises(SceneError, match="effects.stops = false leaves out: remove the sensor"):
        flexmb.simulate(made)


def test_friction_of_joints_and_contacts_is_switched_off():
    """A sliding ball keeps its speed and does not roll; a block on a guide keeps its own."""
    made = Model("ball and block", gravity=[0, 0, -9.81])
    made.add_body("ball", mass=2.0, inertia=[0.008] * 3, position=[0, 0, 0.0999],
                  velocity=[3.0, 0, 0])  # fmt: skip
    made.add_force("floor", "contact", between=["ball", "ground"], stiffness=1e7, exponent=1.5,
                   shapes=[{"type": "sphere", "radius": 0.1}, {"type": "plane"}], restitution=0.5,
                   friction={"static": 0.3, "dynamic": 0.3, "stiffness": 1e5,
                             "damping": 500.0})  # fmt: skip
    made.add_body("block", mass=1.0, inertia=[0.1] * 3, position=[0, 5, 0], velocity=[2.0, 0, 0])
    made.add_marker("ground.rail", position=[0, 5, 0])
    made.add_joint("guide", "prismatic", between=["ground.rail", "block"], axis="x")
    made.add_force("rub", "joint-friction", joint="guide", dynamic=0.2, length=0.4, stiffness=1e5,
                   damping=800.0)  # fmt: skip
    for name in ("ball", "block"):
        made.add_sensor(name, "velocity", of=name)
    made.set_dynamics(duration=0.3, outputs=10, accuracy=1e-4)
    rubbed = flexmb.simulate(made)
    assert rubbed["ball.x"][-1] == pytest.approx(3.0 - 0.3 * 9.81 * 0.3, rel=0.02)
    assert rubbed["block.x"][-1] == pytest.approx(2.0 - 0.2 * 9.81 * 0.3, rel=0.02)
    made.set_effects(friction=False)
    smooth = flexmb.simulate(made)
    assert smooth["ball.x"] == pytest.approx(3.0, abs=1e-9)
    assert smooth["block.x"] == pytest.approx(2.0, abs=1e-9)
    made.set_effects(contact=False, friction=False)
    falling = flexmb.simulate(made)
    assert falling["ball.z"] == pytest.approx(-9.81 * falling.time, abs=1e-9)


def test_a_planar_scene_is_computed_in_space():
    """The same pendulum, with its reactions across the plane."""
    made = Model("pendulum", gravity=[0, -9.81, 0])
    made.plane = "xy"
    made.add_body("bar", mass=2.0, inertia=[0.1, 0.2, 0.3], center=[0.5, 0, 0])
    made.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    made.add_sensor("center", "position", of="bar")
    made.set_dynamics(duration=1.0, outputs=20, accuracy=1e-8)
    planar = flexmb.simulate(made)
    made.set_effects(planar=False)
    spatial = flexmb.simulate(made)
    assert spatial.layout.nc == 5 and planar.layout.nc == 2
    for axis in "xy":
        assert spatial[f"center.{axis}"] == pytest.approx(planar[f"center.{axis}"], abs=1e-7)


def test_bodies_without_vibrations_are_told_of_their_deformation():
    """A beam that follows its load as it turns at half its first frequency has no frequencies."""
    places = []
    for stiffening in ("none", "full"):
        made = Model("spun")
        body = rod(0.01, 1.0, 12, 6, geometric_stiffening=stiffening)
        made.add_body("beam", body, deformation="quasi-static")
        made.add_body("hub", mass=1.0, inertia=[0.1] * 3)
        made.add_joint("spin", "revolute", between=["ground", "hub"], axis="z")
        made.add_joint("clamp", "fixed", between=["hub", "beam.root"])
        made.add_driver("motor", joint="spin", angle="28*t")
        made.add_force("load", "force", at="beam.tip", value=[0, 5.0, 0], axes="hub")
        made.add_sensor("tip", "position", of="beam.tip", seen_from="hub")
        made.set_validity(speed="any")
        knobs = {"duration": 0.1, "outputs": 10, "start": "quasi-static", "verify": False}
        run = flexmb.simulate(made, accuracy=1e-4, method="radau", **knobs)
        places.append((run["tip.y"][-1], " ".join(run.notes)))
    (without, note), (deflection, _) = places
    told = re.search(r"its deformation is too large by about ([\d.]+) %", note)
    assert "natural frequency" not in note and told
    assert float(told[1]) / 100 == pytest.approx(without / deflection - 1.0, rel=0.3)
