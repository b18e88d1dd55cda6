"""The audit's estimates against the motion that the omitted effect really makes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from flexiblescenes import BEAM_PERIOD, STEEL, flexible_crank, rod

import flexmb
from flexmb.errors import FlexmbError
from flexmb.model import Model
from flexmb.model.flexible_body import DeformationSpec
from flexmb.model.scenes.effects import with_words
from flexmb.workflow.audit import Audit
from flexmb.workflow.effect_estimates import Estimates
from flexmb.workflow.neighbours import ModelVariants

SECTION = {"type": "rectangle", "y": 0.01, "z": 0.01}


def beam_fields(length=1.0, modes=4, **options):
    """A square bar of steel from a mesh, so that it can be reduced in other ways."""
    return {
        "mesh": {"type": "beam", "length": length, "divisions": 20}, "material": STEEL,
        "sections": {"all": SECTION}, "interfaces": {"root": "start", "tip": "end"},
        "modes": modes, "stress": "none", **options,
    }  # fmt: skip


def spinning(share, stiffening="none"):
    """A bar that turns with a share of its first frequency, pushed sideways from the start."""
    speed = share * 2 * np.pi / BEAM_PERIOD
    model = Model("spinning bar")
    model.add_body("bar", angular_velocity=[0, 0, speed], geometric_stiffening=stiffening,
                   **beam_fields())  # fmt: skip
    model.add_joint("hub", "revolute", between=["ground", "bar.root"], axis="z")
    model.add_driver("motor", joint="hub", angle=f"{speed}*t")
    model.add_force("push", "force", at="bar.tip", axes="bar.root", value=[0, 5.0, 0])
    model.add_sensor("tip", "position", of="bar.tip", relative_to="bar.root", axes="bar.root")
    model.set_dynamics(duration=2.5 * BEAM_PERIOD, outputs=250, accuracy=1e-5)
    return model


def find(made, effect, body="bar"):
    return next(one for one in made.effects if (one.effect, one.body) == (effect, body))


def share_between(run, other, sensor):
    """Largest difference of a sensor over its peak-to-peak."""
    names = [name for name in run.channels() if name.split(".")[0] == sensor]
    size = max(np.ptp(other[name]) for name in names)
    return max(np.abs(run[name] - other[name]).max() for name in names) / size


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.05, 0.3, 0.7])
def test_stiffening_left_out_of_a_spinning_bar(share, tmp_path):
    run = flexmb.simulate(spinning(share), output=tmp_path)
    true = share_between(run, flexmb.simulate(spinning(share, "full")), "tip")
    one = find(flexmb.audit(run), "geometric stiffening")
    assert not one.on
    assert 1 / 3 < one.share / true < 3
    assert (one.verdict == "missing") == (true > 0.01)
    assert Audit.from_text(run.texts["audit"]).effects[0].effect == "deformation"


@pytest.mark.slow
def test_a_bar_taken_for_rigid_deforms_as_its_rotation_stiffens_it(tmp_path):
    """Beyond its first frequency it would fold without; stiffened it bends less than at rest."""
    model = spinning(2.0)
    model.add_force("lift", "force", at="bar.tip", axes="bar.root", value=[0, 0, 5.0])
    words = {"geometric_stiffening": "full"}
    complete = flexmb.simulate(with_words(model, {"bar": words}))
    run = flexmb.simulate(with_words(model, {"bar": {"deformation": "rigid"}}), output=tmp_path)
    true = share_between(run, complete, "tip")
    assert find(flexmb.audit(run), "deformation").shares["tip"] == pytest.approx(true, rel=0.1)


def rotor_on_a_mast():
    """A blade on a driven hub at the top of a mast, in front of it, under its weight and a gust."""
    model, speed, height = Model("rotor on a mast", gravity=[-9.81, 0, 0]), 1.5, 60.0

    def bar(length, y, z, E, density):
        mesh = {"type": "beam", "length": length, "divisions": 8}
        return beam_fields(length, mesh=mesh, material={"E": E, "nu": 0.3, "density": density},
                           sections={"all": {"type": "rectangle", "y": y, "z": z}},
                           geometric_stiffening="full")  # fmt: skip

    model.add_body("mast", **bar(height, 2.5, 2.5, 3e10, 2500.0))
    model.add_body("head", mass=5e4, inertia=[2e5] * 3, position=[height, 0, 0])
    model.add_marker("head.shaft", position=[0, 0, 4.0])
    model.add_body("hub", mass=1e4, inertia=[2e4] * 3, position=[height, 0, 4.0],
                   angular_velocity=[0, 0, speed])  # fmt: skip
    model.add_marker("hub.seat", position=[1.5, 0, 0])
    model.add_body("blade", **bar(30.0, 1.2, 0.6, 4e10, 1500.0), position=[height + 1.5, 0, 4.0],
                   velocity=[0, 1.5 * speed, 0], angular_velocity=[0, 0, speed])  # fmt: skip
    model.add_joint("foot", "fixed", between=["ground", "mast.root"])
    model.add_joint("top", "fixed", between=["mast.tip", "head"])
    model.add_joint("shaft", "revolute", between=["head.shaft", "hub"], axis="z")
    model.add_joint("root", "fixed", between=["hub.seat", "blade.root"])
    model.add_driver("motor", joint="shaft", angle=f"{speed}*t")
    model.add_force("gust", "force", at="blade.tip", value=[0, 0, "3000*(1 - cos(3*t))"])
    model.add_sensor("top", "position", of="mast.tip")
    model.add_sensor("bearing", "reaction", joint="shaft")
    model.set_dynamics(duration=0.6, outputs=120, accuracy=1e-4, start="quasi-static")
    model.set_validity(truncation="any", load_factor="any", deflection="any")
    return model


@pytest.mark.seconds
@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
@pytest.mark.parametrize(
    ("body", "word", "effect", "within"),
    [
        ("mast", "rigid", "deformation", 0.02),
        pytest.param("blade", "quasi-static", "vibration", 0.01, marks=pytest.mark.slow),
    ],
)
def test_stiff_modes_follow_bodies_that_turn_against_one_another(
    body, word, effect, within, tmp_path
):
    """They rang with each row by which the blade turns; forces of a vibration were 5 times true."""
    run = flexmb.simulate(rotor_on_a_mast(), output=tmp_path)
    other = flexmb.simulate(with_words(rotor_on_a_mast(), {body: {"deformation": word}}))
    neighbours = ModelVariants.of(run, 400)
    one = next(one for one in neighbours.effects() if (one.name, one.body) == (effect, body))
    for found in Estimates(neighbours).estimate(one)[0]:
        true = min(share_between(*runs, found.sensor) for runs in ((run, other), (other, run)))
        assert found.share == pytest.approx(true, rel=within)


@pytest.mark.parametrize("word", ["full", "none"])
def test_a_bar_that_bends_comes_shorter(word, tmp_path):
    """Under moments M at both ends by M² L³/24 (E I)², which is of the second order in them.

    It is slow: without stiffening in the scene it was made flexible without its shortening.
    """
    model, moment, length = Model("bar on a roller"), 30.0, 1.0
    model.add_body("bar", deformation="rigid", **beam_fields(geometric_stiffening=word))
    model.add_body("roller", mass=0.01, inertia=[1e-5] * 3, position=[length, 0, 0])
    model.add_joint("pin", "revolute", between=["ground", "bar.root"], axis="z")
    model.add_joint("end", "revolute", between=["bar.tip", "roller"], axis="z")
    model.add_joint("guide", "prismatic", between=["ground", "roller"], axis="x")
    for end, sign in (("root", -1), ("tip", 1)):
        ramp = f"{sign * moment}*step5(t, 0, 0, 2, 1)"
        model.add_force(end, "torque", at=f"bar.{end}", value=[0, 0, ramp])
    model.add_sensor("roller", "position", of="roller")
    model.add_sensor("rate", "velocity", of="roller")
    run = flexmb.simulate(model, output=tmp_path, duration=2.5, outputs=100, accuracy=1e-5)
    one = find(flexmb.audit(run), "deformation")
    shorter = moment**2 * length**3 / (24 * (STEEL["E"] * 0.01**4 / 12) ** 2)
    assert one.verdict == "missing" and one.shares["rate"] == pytest.approx(1.0, rel=0.05)
    assert one.sensor == "roller"
    assert float(one.value.split()[0]) == pytest.approx(shorter, rel=0.05)


def mast_with_a_boom():
    """A load at the end of a boom on a mast; the sensor sits where only the mast yields."""
    model = Model("mast with a boom")
    model.add_body("mast", **beam_fields())
    model.add_body("boom", position=[1.0, 0, 0], **beam_fields())
    model.add_body("load", mass=2.0, inertia=[1e-3] * 3, position=[2.0, 0, 0])
    for name, ends in {"foot": "ground mast.root", "top": "mast.tip boom.root",
                       "hook": "boom.tip load"}.items():  # fmt: skip
        model.add_joint(name, "fixed", between=ends.split())
    model.add_force("push", "force", at="load", value=[0, "20*sin(20*t)", 0])
    model.add_sensor("head", "position", of="mast.tip")
    model.set_dynamics(duration=0.5, outputs=150, accuracy=1e-5)
    return model


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("word", "other", "effect"),
    [
        ("rigid", "dynamic", "deformation"),
        pytest.param("dynamic", "rigid", "deformation", marks=pytest.mark.slow),
        pytest.param("dynamic", "quasi-static", "vibration", marks=pytest.mark.slow),
        pytest.param("quasi-static", "dynamic", "vibration", marks=pytest.mark.slow),
    ],
)
def test_a_body_beside_a_flexible_one_is_judged_along_the_motion_of_that(
    word, other, effect, tmp_path
):
    """With both rigid nothing moves at the mast; on massless springs the load vibrates as well."""
    runs = [
        flexmb.simulate(
            with_words(mast_with_a_boom(), {"boom": {"deformation": deformation}}),
            output=tmp_path / deformation,
        )
        for deformation in (word, other)
    ]
    true = share_between(*runs, "head")
    one = find(flexmb.audit(runs[0]), effect, "boom")
    assert true > (0.05 if effect == "deformation" else 2e-3)
    assert one.on == (word == "dynamic")
    assert one.share == pytest.approx(true, rel=0.1)


@pytest.mark.slow
def test_two_bodies_on_which_nothing_vibrates_are_judged_as_two(tmp_path):
    """The load would vibrate on either, as soon as one of them has inertia."""
    words = dict.fromkeys(("mast", "boom"), {"deformation": "quasi-static"})
    model = with_words(mast_with_a_boom(), words)
    model.dynamics = model.dynamics.model_copy(update={"start": "quasi-static"})
    complete = with_words(model, dict.fromkeys(words, {"deformation": "dynamic"}))
    run = flexmb.simulate(model, output=tmp_path)
    other = flexmb.simulate(complete)
    true = min(share_between(*runs, "head") for runs in ((run, other), (other, run)))
    made = flexmb.audit(run)
    both = sum(find(made, "vibration", body).share for body in words)
    assert true > 0.1
    assert both == pytest.approx(true, rel=0.1)


@pytest.mark.slow
def test_a_run_of_a_neighbour_may_leave_the_bounds_of_the_scene(tmp_path):
    """With a rigid mast the boom resonates; the head of the mast, which all is about, rests."""
    model = mast_with_a_boom()
    model.set_validity(deflection=0.05)
    one = find(flexmb.audit(flexmb.simulate(model, output=tmp_path)), "deformation", "mast")
    assert one.share == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize(
    "deformation", ["rigid", pytest.param("quasi-static", marks=pytest.mark.slow)]
)
def test_a_force_in_resonance_with_a_bar_that_does_not_vibrate(deformation):
    """Its amplitude grows with every cycle, far beyond the static deflection F L³/3EI."""
    model = Model("struck bar")
    model.add_body("bar", deformation=deformation, **beam_fields())
    model.add_joint("clamp", "fixed", between=["ground", "bar.root"])
    model.add_force(
        "push", "force", at="bar.tip", value=[0, f"sin({2 * np.pi / BEAM_PERIOD}*t)", 0]
    )
    model.add_sensor("tip", "position", of="bar.tip")
    cycles = 12
    run = flexmb.simulate(model, duration=cycles * BEAM_PERIOD, outputs=480, accuracy=1e-4)
    made = flexmb.audit(run)
    static = 1.0 / (3 * STEEL["E"] * 0.01**4 / 12)
    grown = np.pi * cycles * static  # of an oscillator under sin ωt; the other modes: 3 % less
    for effect in ("deformation", "vibration"):
        one = find(made, effect)
        assert float(one.value.split()[0]) == pytest.approx(grown, rel=0.1)
        assert one.verdict == ("needed" if one.on else "missing")


@pytest.mark.slow
def test_a_start_from_a_sagging_bar_does_not_stretch_it(tmp_path):
    """Its turned axes shorten it to second order, which rang as an axial vibration in the hub."""
    model = Model("lifted bar", gravity=[0, -9.81, 0])
    model.add_body("bar", **beam_fields())
    model.add_joint("hub", "revolute", between=["ground", "bar.root"], axis="z")
    model.add_driver("motor", joint="hub", angle={"type": "step5", "t1": 0.8, "y1": 0.7})
    model.add_sensor("load", "reaction", joint="hub")
    model.set_dynamics(duration=1.0, outputs=300, accuracy=1e-5, start="quasi-static")
    run = flexmb.simulate(model, output=tmp_path)
    rigid = flexmb.simulate(with_words(model, {"bar": {"deformation": "rigid"}}))
    true = share_between(rigid, run, "load")
    assert find(flexmb.audit(run), "deformation").share == pytest.approx(true, rel=0.1)


@pytest.mark.slow
def test_a_load_with_the_period_of_the_rows_is_seen(tmp_path):
    """It is nought at all of them; a block that moves slowly is resolved by so few."""
    model = Model("bar and block")
    model.add_body("bar", deformation="rigid", **beam_fields(0.35))
    model.add_body("block", mass=1.0, inertia=[0.1] * 3)
    model.add_joint("clamp", "fixed", between=["ground", "bar.root"])
    model.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
    model.add_driver("motor", joint="guide", stroke="0.3*sin(3*t)")
    model.add_force("push", "force", at="bar.tip", value=[0, "20*sin(200*pi*t)", 0])
    model.add_sensor("tip", "position", of="bar.tip")
    run = flexmb.simulate(model, output=tmp_path, duration=0.5, outputs=50, accuracy=1e-5)
    one = find(flexmb.audit(run), "deformation")
    complete = flexmb.simulate(
        with_words(model, {"bar": {"deformation": "dynamic"}}), duration=0.5, outputs=500,
        accuracy=1e-5,
    )  # fmt: skip
    assert float(one.value.split()[0]) == pytest.approx(np.abs(complete["tip.y"]).max(), rel=0.1)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
def test_estimates_do_not_depend_on_the_size_of_a_machine():
    """A bar that turns under its weight, from its quasi-static shape, which small ones lost."""
    tables = []
    for size in (1.0, 1e-6):
        model = Model("turned bar", gravity=[0, -9.81 / size, 0])
        section = {"all": {"type": "rectangle", "y": 0.01 * size, "z": 0.01 * size}}
        model.add_body("bar", **beam_fields(size, sections=section))
        model.add_joint("hub", "revolute", between=["ground", "bar.root"], axis="z")
        model.add_driver("motor", joint="hub", angle=f"{4 / size}*t")
        model.add_sensor("tip", "position", of="bar.tip", relative_to="bar.root", axes="bar.root")
        run = flexmb.simulate(model, duration=0.5 * size, outputs=100, start="quasi-static")
        made = flexmb.audit(run)
        tables.append([find(made, effect).share for effect in ("deformation", "vibration")])
    assert tables[1] == pytest.approx(tables[0], rel=1e-3)


def test_an_effect_that_does_nothing_is_named():
    """A bar so slow that its deformation does not matter."""
    model = spinning(1e-4)
    model.forces.clear()
    model.sensors.clear()
    model.add_sensor("tip", "position", of="bar.tip")
    run = flexmb.simulate(model, duration=1.0 * BEAM_PERIOD)
    made = flexmb.audit(run)
    assert made.passed and find(made, "deformation") in made.wasted
    assert "stays within" in made.sentence()


def test_a_run_without_sensors_is_refused():
    model = Model("bar")
    model.add_body("bar", rod(0.01))
    run = flexmb.simulate(model, duration=0.01)
    with pytest.raises(FlexmbError, match=r"no sensor to judge effects by; add one"):
        flexmb.audit(run)


def slow_or_fast(speed):
    """A crank that swings a bar, whose effects are to be selected."""
    model = Model("swinging bar")
    model.add_body("bar", **beam_fields(modes=4))
    model.add_joint("hub", "revolute", between=["ground", "bar.root"], axis="z")
    model.add_driver("motor", joint="hub", angle=f"0.5*(1 - cos({speed}*t))")
    model.add_sensor("tip", "position", of="bar.tip")
    model.set_dynamics(duration=4 * np.pi / speed, outputs=200, accuracy=1e-5)
    return model


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("share", "deformation"),
    [
        pytest.param(0.002, "rigid", marks=pytest.mark.slow),
        (0.08, "quasi-static"),
        pytest.param(0.3, "dynamic", marks=pytest.mark.slow),
    ],
)
def test_selected_effects_keep_the_budget(share, deformation, tmp_path):
    """Against the model with all effects, of twice as many modes."""
    speed = share * 2 * np.pi / BEAM_PERIOD
    model = slow_or_fast(speed)
    model.set_effects(choice="auto", budget=0.01)
    run = flexmb.simulate(model, output=tmp_path / "auto")
    complete = slow_or_fast(speed)
    complete.bodies["bar"] = complete.bodies["bar"].model_copy(
        update={"geometric_stiffening": "full", "modes": 8}
    )
    true = share_between(run, flexmb.simulate(complete, output=tmp_path / "full"), "tip")
    assert true < 0.01
    chosen = json.loads(run.texts["effects"])
    assert chosen["words"]["bar"]["deformation"] == deformation
    assert "audit" in run.texts


@pytest.mark.slow
def test_a_selection_never_softens_without_stiffening(tmp_path):
    """A bar that turns with 0.7 of its first frequency, where softening alone is 29 % wrong."""
    model = spinning(0.7)
    fields = beam_fields()
    model.bodies.pop("bar")
    model.add_body("bar", angular_velocity=[0, 0, 0.7 * 2 * np.pi / BEAM_PERIOD], **fields)
    model.set_effects(choice="auto")
    run = flexmb.simulate(model, output=tmp_path / "auto")
    words = json.loads(run.texts["effects"])["words"]["bar"]
    assert words["geometric_stiffening"] == "full"
    assert words["inertia_coupling"] in ("partial", "full")
    complete = flexmb.simulate(spinning(0.7, "full"), output=tmp_path / "full")
    assert share_between(run, complete, "tip") < 0.01
    steps = [step[2] for step in json.loads(run.texts["effects"])["steps"]]
    assert not any("partial" in step and "stiffening" not in step for step in steps)


def test_a_selection_without_a_sensor_is_refused():
    model = spinning(0.1)
    model.sensors.clear()
    model.set_effects(choice="auto")
    with pytest.raises(FlexmbError, match="needs a sensor to judge effects by"):
        flexmb.simulate(model)


@pytest.mark.slow
def test_two_panels_that_mirror_each_other_do_not_move_the_craft_between_them(tmp_path):
    """One panel with stiffening would move it by 0.5 um, both do not. The wheel turns by a radian
    from row to row, and still the estimate of the deflection is that of two runs."""
    path = Path(__file__).parents[2] / "cases" / "spacecraft_panels" / "scene.toml"
    words = {"inertia_coupling": "constant", "geometric_stiffening": "none"}

    def made(folder, **words):
        model = flexmb.load_scene(path)
        model.checks = []
        model.dynamics = model.dynamics.model_copy(update={"accuracy": 1e-5, "verify": False})
        for name in ("east", "west"):
            model.bodies[name] = model.bodies[name].model_copy(update=words)
        return flexmb.simulate(model, output=tmp_path / folder)

    run = made("without", **words)
    complete = made("with", inertia_coupling="full", geometric_stiffening="full")
    audit = flexmb.audit(run)
    true = share_between(run, complete, "east")
    assert true < 1e-3
    for body in ("east", "west"):
        one = find(audit, "coupling and stiffening", body)
        assert one.share < 3 * true
        assert one.verdict == "may stay off"
        assert find(audit, "deformation", body).sensor == body


@pytest.mark.slow
def test_coupling_of_a_slow_body_without_data_for_stiffening(tmp_path):
    """A rod from arrays: its coupling alone is estimated while it turns slowly, and switched on."""
    runs = {}
    for coupling in ("constant", "full"):
        model = flexible_crank()
        model.bodies["rod"] = model.bodies["rod"].model_copy(update={"inertia_coupling": coupling})
        model.sensors.clear()
        model.drivers.clear()
        model.add_driver("motor", joint="bearing", angle="75*t")
        model.add_marker("rod.middle", position=[0.225, 0, 0])
        model.add_sensor("middle", "position", of="rod.middle", relative_to="rod", axes="rod")
        model.set_dynamics(duration=0.04, outputs=120, accuracy=1e-5, start="quasi-static")
        runs[coupling] = flexmb.simulate(model, output=tmp_path / coupling)
    made = flexmb.audit(runs["constant"])
    true = share_between(runs["constant"], runs["full"], "middle")
    assert find(made, "inertia coupling", "rod").share == pytest.approx(true, rel=0.2)
    stiffening = find(made, "geometric stiffening", "rod")
    assert stiffening.verdict == "not known" and "flexmb reduce" in stiffening.why


@pytest.mark.parametrize("deformation", ["quasi-static", DeformationSpec(band=(0.0, 30.0))])
@pytest.mark.slow
def test_effects_of_bodies_whose_modes_have_no_inertia(deformation, tmp_path):
    """Gravity bends them, and is not taken for nothing because its modes have no motion."""
    runs = {}
    for gravity in (True, False):
        model = spinning(0.3)
        model.bodies["bar"] = model.bodies["bar"].model_copy(update={"deformation": deformation})
        model.set_gravity([0, 0, -9.81])
        model.set_effects(gravity=gravity)
        model.set_dynamics(duration=BEAM_PERIOD, outputs=60, accuracy=1e-5, start="quasi-static")
        runs[gravity] = flexmb.simulate(model, output=tmp_path / str(gravity))
    one = find(flexmb.audit(runs[True]), "gravity", "")
    true = share_between(runs[False], runs[True], "tip")
    assert one.verdict == "needed"
    assert 1 / 2 < min(one.share, 1.0) / min(true, 1.0) < 2
