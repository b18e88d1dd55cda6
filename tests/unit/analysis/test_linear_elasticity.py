"""What a run says where linear elasticity about a rigid motion ends; closed forms of beams."""

from __future__ import annotations

import numpy as np
import pytest
from flexiblescenes import STEEL, flexible_crank, rod
from shellkit import sheet

from flexmb.analysis.assembly.jacobian import ConstraintRows
from flexmb.analysis.validity.linear_elasticity import LinearElasticityMonitor, joined_modes
from flexmb.analysis.validity.load_factor import loads_without_stiffening
from flexmb.analysis.validity.modal_basis import ModalBasisMonitor
from flexmb.engine.compile import compile_system
from flexmb.fe import reduce, shell
from flexmb.flexbody import rigid_body
from flexmb.model import Model
from tests.accuracyscenes.judging import judged

HEIGHT, LENGTH = 0.01, 1.0
BENDING = np.sqrt(STEEL["E"] * HEIGHT**2 / 12 / STEEL["density"]) / LENGTH**2  # rad/s, over (βL)²
STIFFNESS = 3 * STEEL["E"] * HEIGHT**4 / 12 / LENGTH**3  # N/m, of the tip of a cantilever


def beam(stiffening="none", **changes):
    model = Model("beam", **changes)
    model.add_body("beam", rod(HEIGHT, LENGTH, 10, 8, geometric_stiffening=stiffening))
    return model


def clamped():
    model = beam()
    model.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    return model


def on_a_hub(speed=1.0, axis="z", **changes):
    """It turns with an angular velocity that rises to `speed` within a second."""
    model = beam(**changes)
    model.add_joint("hub", "revolute", between=["ground", "beam.root"], axis=axis)
    model.add_driver("motor", joint="hub", angle=f"{speed}*t*t/2")
    return model


def between_pins():
    model = beam()
    model.add_marker("ground.end", position=[LENGTH, 0, 0])
    model.add_joint("left", "spherical", between=["ground", "beam.root"])
    model.add_joint("right", "universal", between=["ground.end", "beam.tip"], axis="y",
                    second_axis="z")  # fmt: skip
    return model


def lowest(model):
    compiled = compile_system(model)
    pose = ConstraintRows(compiled).evaluate(compiled.initial_q)
    (columns,) = compiled.layout.bodies
    frequencies, _ = joined_modes(compiled.flexbodies["beam"], columns, compiled.initial_q, pose.Cq)
    return frequencies[0]


@pytest.mark.parametrize(
    ("model", "number"),
    [
        (clamped(), 1.8751041**2),
        (on_a_hub(), 1.8751041**2),
        (on_a_hub(plane="xy"), 1.8751041**2),
        (between_pins(), np.pi**2),
        (beam(), 4.7300407**2),
    ],
    ids=["clamped", "on a hub", "on a hub, planar", "between pins", "free"],
)
def test_the_lowest_frequency_is_that_of_the_body_as_it_is_joined(model, number):
    assert lowest(model) == pytest.approx(number * BENDING, rel=2e-3)


def test_placed_anywhere_and_turned_the_frequency_is_the_same():
    model = beam()
    model.bodies.clear()
    model.add_body("beam", rod(HEIGHT, LENGTH, 10, 8), position=[1000, 2, 3],
                   orientation=[0.8, 0.2, -0.4, 0.4])  # fmt: skip
    model.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    assert lowest(model) == pytest.approx(lowest(clamped()), rel=1e-6)


def sentences(model, **knobs):
    found = judged(model, accuracy=1e-3, verify=False, **knobs)
    return [note for note in found.notes if "elasticity" in note or "centrifugal" in note]


@pytest.mark.parametrize("share", [0.12, 0.14, 1.2])
def test_speeds_that_stiffening_counts_at_are_told(share):
    """Of a square plate, whose speed tells it: 0.6 (Ω/ω₁)² is one per cent at 0.129."""
    body = reduce(sheet((6, 6)), modes=4, material=STEEL, sections={"all": shell(HEIGHT)},
                  interfaces={"root": "x0", "tip": "x1"})  # fmt: skip
    model = Model("plate")
    model.add_body("beam", body, position=[0, -0.5, 0])
    model.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
    speed = share * lowest(model)
    model.add_driver("motor", joint="hub", angle=f"{speed}*t")
    model.add_force("kick", "force", at="beam.tip", value=[0, 0, "sin(50*t)"])
    model.set_validity(speed="any", deflection="any", inertia_loads="any")
    told = sentences(model, duration=0.05)
    if share < 0.129:
        assert not told
        return
    (sentence,) = told
    assert f"{share:g} of its lowest natural frequency" in sentence
    assert ("too low by about" in sentence) == (share < 1)


def test_a_shaft_that_turns_about_its_axis_needs_no_stiffening():
    assert not sentences(on_a_hub(2.0 * 1.8751041**2 * BENDING, axis="x"), duration=0.5)


def test_a_stiffened_body_is_told_nothing_of_its_speed():
    model = on_a_hub(0.9 * 1.8751041**2 * BENDING, stiffening="full")
    assert not sentences(model, duration=0.3)


def test_modes_that_the_motion_does_not_contain_do_not_count():
    """The rod of this crank could bend across the plane with 217 rad/s, yet does not."""
    assert not sentences(flexible_crank(), duration=0.02)


@pytest.mark.parametrize("deflection", [0.05, 0.09, 0.11, 0.2])
def test_deflections_beyond_a_tenth_of_the_length_are_told(deflection):
    """A force that is there from the first moment on deflects twice as far as at rest."""
    model = clamped()
    model.add_force("load", "force", at="beam.tip", value=[0, deflection / 2 * STIFFNESS, 0])
    told = sentences(model, duration=0.13)
    if deflection < 0.1:
        assert not told
        return
    (sentence,) = told
    assert sentence.startswith("bodies.beam is deflected by ")
    assert float(sentence.split()[4]) == pytest.approx(deflection, rel=0.06)


def test_a_body_without_modes_is_not_watched():
    model = Model("rigid")
    model.add_body("one", rigid_body(1.0, inertia=1.0))
    compiled = compile_system(model)
    for monitor in (
        LinearElasticityMonitor(compiled, model, compiled.initial_q),
        ModalBasisMonitor(compiled, model),
    ):
        assert not list(monitor.indicators())


def test_a_force_beside_the_interfaces_is_told_not_to_stiffen():
    model = beam(stiffening="full")
    model.add_marker("beam.middle", node=5)
    model.add_marker("beam.end", interface="tip")
    model.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    model.add_force("inside", "force", at="beam.middle", value=[0, 1, 0])
    model.add_force("outside", "force", at="beam.end", value=[0, 1, 0])
    compiled = compile_system(model)
    (told,) = loads_without_stiffening(compiled, model)
    assert told.startswith("forces.inside: its force does not stiffen bodies.beam, because")


def test_many_forces_beside_the_interfaces_are_told_in_one_sentence():
    model = beam(stiffening="full")
    model.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    for k in range(2, 9):
        model.add_marker(f"beam.p{k}", node=k)
        model.add_force(f"w{k}", "force", at=f"beam.p{k}", value=[0, 1, 0])
    (sentence,) = loads_without_stiffening(compile_system(model), model)
    assert sentence == (
        "forces.w2, forces.w3, forces.w4 and 4 more: their forces do not stiffen bodies.beam, "
        "because beam.p2, beam.p3, beam.p4 and 4 more are no interfaces of it; make them "
        "interfaces, or reduce the body with its load_points"
    )


def outcome(model, **knobs):
    return judged(model, accuracy=1e-3, verify=False, **knobs)


def test_a_blade_without_stiffening_beyond_its_first_frequency_is_refused():
    """The moment is that at which Ω = Ω_end t passes ω₁, and the set of equations is named."""
    model = on_a_hub(1.2 * 1.8751041**2 * BENDING)
    found = outcome(model, duration=1.0, outputs=400)
    assert "1 of its lowest natural frequency" in found.message
    assert "an inconsistent set of equations" in found.message
    assert 'speed = "any" under [validity] runs on' in found.message


@pytest.mark.parametrize("method", ["radau", "explicit-rk"])
def test_a_blade_that_rotation_softens_until_it_folds_is_told_as_such(method):
    """At rest it bends by less than the bound, with 0.8 of its frequency by more."""
    model = on_a_hub(0.9 * 1.8751041**2 * BENDING)
    push = [0, f"{0.33 * LENGTH * STIFFNESS}*t", 0]  # a push that it would bear at rest
    model.add_force("push", "force", at="beam.tip", value=push, axes="beam.root")
    found = outcome(model, duration=1.0, outputs=100, method=method)
    assert "is deflected by 0.3" in found.message
    assert "an inconsistent set of equations, centrifugal softening" in found.message


@pytest.mark.parametrize(
    ("deflection", "bound"), [(0.25, 0.3), (0.4, 0.3), (0.4, "any"), (0.2, 0.15)]
)
def test_deflections_beyond_the_bound_end_the_run(deflection, bound):
    model = clamped()
    model.set_validity(deflection=bound)
    model.add_force("load", "force", at="beam.tip", value=[0, deflection / 2 * STIFFNESS, 0])
    found = outcome(model, duration=0.13)
    told = [note for note in found.notes if "is deflected by" in note]
    if bound == "any" or deflection < bound:
        assert told and not found.message
    else:
        assert f"(bound {bound:g};" in found.message and not told
        assert float(found.message.split()[4]) == pytest.approx(bound, rel=0.02)


@pytest.mark.parametrize("twist", [0.2, 0.4, 1.2])
def test_a_bar_that_is_twisted_far_is_told_and_refused(twist):
    """A torque that is there from the first moment twists twice as far as at rest."""
    J = 0.1406 * HEIGHT**4  # Roark, Formulas for Stress and Strain, table 10.7: a square
    torque = twist / 2 * STEEL["E"] / (2 * (1 + STEEL["nu"])) * J / LENGTH
    model = clamped()
    model.add_force("load", "torque", at="beam.tip", value=[torque, 0, 0])
    found = outcome(model, duration=2e-3)
    told = [note for note in found.notes if "is turned within itself" in note]
    assert bool(told) == (0.3 < twist < 1.0)
    assert ("is turned within itself" in found.message) == (twist > 1.0)
    if told:
        assert float(told[0].split()[6]) == pytest.approx(twist, rel=0.05)
        longer = float(told[0].split("too long by ")[1].split()[0])  # an arm turned by its sine
        assert longer == pytest.approx(100 * (np.hypot(1, twist) - 1), rel=0.2)


def disc(residual, speed, modes=20):
    body = reduce(
        {"type": "disk", "radius": 0.4, "inner": 0.1, "divisions": [6, 32]}, material="steel",
        sections={"all": {"type": "shell", "thickness": 0.01}}, modes=modes, residual=residual,
        interfaces={"bore": {"group": "inner", "type": "rbe3"}},
    )  # fmt: skip
    model = Model("disc")
    model.add_body("disc", body, angular_velocity=[0, 0, speed])
    model.add_joint("shaft", "revolute", between=["ground", "disc.bore"], axis="z")
    return model


@pytest.mark.parametrize(
    ("residual", "speed"), [("none", 300.0), ("none", 0.1), ("inertia", 300.0)]
)
def test_a_spinning_disc_that_cannot_grow_is_refused(residual, speed):
    """At 0.1 rad/s it grows by 1e-11 of its size: not worth a word."""
    model = disc(residual, speed)
    found = outcome(model, duration=1e-3)
    assert ("its modes lack 100 % of the response" in found.message) == (
        residual == "none" and speed > 1
    )
    assert not [note for note in found.notes if "its modes lack" in note]
    model.set_validity(inertia_loads="any")
    assert not outcome(model, duration=1e-3).message
