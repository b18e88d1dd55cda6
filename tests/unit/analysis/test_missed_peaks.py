"""Peaks of contact forces between outputs are told; what the rows show is not."""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes import moved
from accuracyscenes.judging import judged

from flexmb.model import Model


def ball(size=1.0):
    """It falls from rest by 0.2 m and bounces once, for some milliseconds."""
    model = Model("ball", gravity=[0, 0, -9.81 * size])
    model.add_body("ball", mass=1.0, inertia=[1e-3 * size**2] * 3, position=[0, 0, 0.3 * size])
    model.add_force(
        "floor", "contact", between=["ground", "ball"], stiffness=1e6, exponent=1.0,
        restitution=1.0,
        shapes=[{"type": "plane", "axis": "z"}, {"type": "sphere", "radius": 0.1 * size}],
    )  # fmt: skip
    model.add_sensor("push", "reaction", force="floor", axes="global")
    return model


def notes(outputs, model=None, **knobs):
    knobs = {"duration": 0.3, "accuracy": 1e-5, **knobs}
    found = judged(ball() if model is None else model, outputs=outputs, **knobs)
    return [note for note in found.notes if "between outputs" in note]


def told(model, size, **knobs):
    """It stops within √(m/k) v: a spring of 1e6 N/m pushes with v √(m k) at most."""
    (note,) = notes(20, model, **knobs)
    peak = size * np.sqrt(2 * 9.81 * 0.2 * 1e6)
    said = float(note.split("up to ")[1].split()[0])
    assert said == pytest.approx(peak, rel=0.1)
    assert note.startswith("sensors.push: its contact pushes with up to ") and " at most" in note


def crate():
    """The ball as a crate that falls flat on its four corners, each with a quarter of the floor."""
    model = ball()
    corners = [[x, y, -0.1] for x in (-0.2, 0.2) for y in (-0.1, 0.1)]
    del model.forces["floor"]
    model.add_force(
        "floor", "contact", between=["ground", "ball"], stiffness=0.25e6, exponent=1.0,
        restitution=1.0,
        shapes=[{"type": "plane", "axis": "z"}, {"type": "points", "points": corners}],
    )  # fmt: skip
    return model


def test_the_peak_of_several_points_together_is_told():
    told(crate(), 1.0)
    assert not notes(3000, crate())


@pytest.mark.parametrize("method", ["auto", "radau", "generalized-alpha"])
def test_a_peak_between_outputs_is_told(method):
    told(ball(), 1.0, method=method)


@pytest.mark.parametrize("size", [1e-6, 1e3])
def test_a_peak_is_told_in_any_size(size):
    told(ball(size), size)


def test_a_peak_is_told_a_kilometre_away():
    told(moved(ball()), 1.0)


def test_what_the_rows_show_is_not_told():
    assert not notes(3000)
    assert not notes(np.linspace(0.0, 0.3, 3001).tolist())


def test_what_rests_on_its_floor_has_no_peak():
    """From equilibrium, and unloaded from the start: m g, and nothing at all."""
    for gravity in (-9.81, 0.0):
        model = ball()
        model.gravity = (0.0, 0.0, gravity)
        model.bodies["ball"] = model.bodies["ball"].model_copy(
            update={"position": (0.0, 0.0, 0.1 + gravity * 1e-6)}
        )
        assert not notes(5, model)


def test_a_contact_that_no_sensor_records_is_not_told():
    model = ball()
    model.sensors.clear()
    model.add_sensor("place", "position", of="ball")
    assert not notes(20, model)


def test_fixed_steps_are_told_too():
    assert len(notes(20, accuracy=None, step=1e-5)) == 1
