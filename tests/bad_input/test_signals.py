"""Mistakes in sensors, expressions over channels, states and controllers: each a sentence."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.analysis.monitors import SingularOrientationMonitor, algebraic_loop_notes
from flexmb.engine.tables import Layout
from flexmb.errors import SceneError
from flexmb.model import Model
from flexmb.results.output_block import OutputBlock


def model():
    made = Model("cart", parameters={"k": 3.0})
    made.add_body("cart", mass=1, inertia=[1, 1, 1])
    made.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
    made.add_sensor("x", "position", of="cart")
    made.add_sensor("a", "acceleration", of="cart")
    return made


def push(made, value):
    made.add_force("push", "force", at="cart", value=[value, 0, 0])
    return made


def told(made):
    with pytest.raises(SceneError) as caught:
        made.validate()
    return str(caught.value)


def refused(add, *names, **fields):
    with pytest.raises(SceneError) as caught:
        add(*names, **fields)
    return str(caught.value)


def test_a_channel_that_does_not_exist():
    text = told(push(model(), "-k*x.xx"))
    assert 'forces.push.value[0]: unknown name "x.xx" at character 4; nearest: x.x' in text
    assert text.splitlines()[-1].index("^") == text.splitlines()[-2].index("x.xx")


def test_a_sensor_of_three_channels_is_no_number():
    assert 'unknown name "x" at character' in told(push(model(), "-k*x"))


def test_the_time_is_a_name_in_functions_of_channels():
    assert "allowed: t, x.x" in told(push(model(), "step5(time, 0, 0, 1, 1)"))


def test_a_misspelt_parameter_is_still_told():
    made = push(model(), "-stif*x.x")
    made.parameters["stiff"] = 1.0
    assert 'unknown name "stif"' in told(made) and "nearest: stiff" in told(made)


def test_expressions_in_a_circle():
    made = model()
    made.add_sensor("p", "expression", value="2*q + x.x")
    made.add_sensor("q", "expression", value="c - 1")
    made.add_controller("c", "pid", input="3*p", kp=2)
    text = told(made)
    assert "sensors.p: depends on itself at the same moment: p -> q -> c -> p" in text
    assert text.count("depends on itself") == 1


def test_a_state_or_a_strictly_proper_function_opens_a_circle():
    made = model()
    made.add_sensor("p", "expression", value="x.x - c")
    made.add_controller("c", "transfer-function", input="p", numerator=[1], denominator=[1, 1])
    made.add_state("z", rate="c - z")
    made.validate()


def test_an_improper_transfer_function():
    text = refused(
        model().add_controller, "c", "transfer-function",
        input="x.x", numerator=[0, 1, 2, 3], denominator=[0, 5, 1],
    )  # fmt: skip
    assert "controllers.c.numerator: has degree 2, the denominator 1" in text and "improper" in text


def test_a_transfer_function_over_nothing():
    text = refused(
        model().add_controller, "c", "transfer-function",
        input="x.x", numerator=[1], denominator=[0, 0],
    )  # fmt: skip
    assert "controllers.c.denominator: is zero" in text


@pytest.mark.parametrize(
    "fields, sentence",
    [
        ({}, "needs kp, ki or kd"),
        ({"kd": 1}, "filter: is missing"),
        ({"kp": 1, "filter": 1}, "filter: is that of the rate, but kd is zero"),
        ({"kp": 1, "limits": [2, 1]}, "limits: the lower limit comes first, given [2, 1]"),
        ({"ki": 1, "limits": [1, 2]}, "tracking: is missing"),
        ({"kp": 1, "tracking": 1}, "tracking: has a meaning with ki and limits"),
    ],
)
def test_a_controller_whose_words_do_not_fit(fields, sentence):
    assert sentence in refused(model().add_controller, "c", "pid", input="x.x", **fields)


def test_the_reaction_of_what_is_none():
    made = model()
    made.add_sensor("r", "reaction", joint="rial")
    made.add_sensor("f", "reaction", force="push", on="I")
    push(made, 1)
    text = told(made)
    assert 'sensors.r.joint: unknown joint "rial"; nearest: rail' in text
    assert 'sensors.f.on: "push" acts on one marker' in text


def test_an_energy_leads_no_force():
    made = push(model(), "-k*stored")
    made.add_sensor("stored", "energy")
    assert 'forces.push.value[0]: "stored" is an energy, computed at outputs only' in told(made)


def test_one_name_for_two_things():
    made = push(model(), "-k*x.x")
    made.add_state("k", rate="1")
    made.add_sensor("k", "energy")
    text = told(made)
    assert 'states.k: the name "k" is taken by sensors.k' in text
    assert 'forces.push.value[0]: "k" is a parameter and a channel; rename the channel' in text


def test_a_channel_called_like_a_constant():
    made = push(model(), "-k*x.x*e")
    made.add_sensor("e", "expression", value="a.x")
    assert '"e" is a constant and a channel; rename the channel' in told(made)


@pytest.mark.parametrize(
    ("name", "meaning"), [("pi", "a constant"), ("t", "the time"), ("k", "a parameter")]
)
def test_a_name_of_two_meanings_that_stands_alone(name, meaning):
    """A controller "pi" drove a motor with 3.14159 N m."""
    made = push(model(), name)
    made.add_controller(name, "pid", input="1 - a.x", kp=1.0)
    assert f'push.value[0]: "{name}" is {meaning} and a channel; rename the channel' in told(made)
    made = push(model(), "2")
    made.add_controller(name, "pid", input="1 - a.x", kp=1.0)
    made.validate()


def test_drivers_take_no_channels():
    text = refused(model().add_driver, "d", joint="rail", stroke="x.x")
    assert "drivers.d.stroke" in text and "only numbers, names" in text


@pytest.mark.parametrize("sequence", ["xx", "xxy", "abc", "xyzx"])
def test_a_sequence_that_is_none(sequence):
    text = refused(model().add_sensor, "o", "orientation", of="cart", sequence=sequence)
    assert "sensors.o.sequence: three axes are expected of which no two neighbours" in text


def test_an_observer_has_axes_of_its_own():
    text = refused(model().add_sensor, "p", "position", of="cart", seen_from="ground", axes="cart")
    assert "sensors.p.seen_from: is an observer with axes of its own" in text


def test_axes_that_are_words_are_named_with_the_markers():
    made = model()
    made.add_sensor("p", "position", of="cart", axes="globl")
    made.add_sensor("r", "reaction", joint="rail", axes="J")
    text = told(made)
    assert 'sensors.p.axes: unknown axes "globl"; nearest: global; allowed: global, cart,' in text
    assert 'sensors.r.axes: unknown axes "J"; allowed: joint, global, cart, ground' in text


def test_axes_and_observers_must_exist():
    made = model()
    made.add_sensor("p", "position", of="cart", axes="carte.top")
    made.add_sensor("q", "position", of="cart", seen_from="cart.top")
    text = told(made)
    assert 'sensors.p.axes: unknown body "carte"; nearest: cart' in text
    assert 'sensors.q.seen_from: body "cart" has no marker "top"' in text


def test_a_unit_is_that_of_si():
    text = refused(model().add_sensor, "d", "expression", value="x.x", unit="mm")
    assert 'sensors.d.unit: names the quantity by its SI unit, given "mm"' in text


def test_a_line_force_without_length():
    made = model()
    made.add_force("line", "line-force", between=["ground", "cart"], value="-x.x")
    assert "the direction of the force along a line is undefined (zero length)" in told(made)


def test_a_force_that_follows_accelerations_is_noted():
    made = push(model(), "-k*inertia")
    made.add_sensor("inertia", "expression", value="a.x")
    (note,) = algebraic_loop_notes(made)
    assert note.startswith("forces.push.value[0] depends on a.x") and "algebraic loop" in note
    assert algebraic_loop_notes(push(model(), "-k*x.x")) == []


@pytest.mark.parametrize(("most", "told_off"), [(89.95, 0.05), (101.0, 0)])
def test_a_singular_pose_is_noted_and_so_is_one_that_was_gone_through(most, told_off):
    """Between two rows: beta leaves its range by that pose alone."""
    made = model()
    made.add_sensor("o", "orientation", of="cart")
    channels = made.channels()
    layout = Layout((), (), 0, 0, 0, (), (), channels, (), "")
    beta = np.zeros((3, len(channels)))
    beta[1, channels.index("o.beta")] = np.radians(most)
    rows = OutputBlock(
        np.array([0.0, 0.5, 1.0]), *[np.zeros((3, 0))] * 5, beta, *[np.zeros((3, 0))] * 2
    )
    poses = SingularOrientationMonitor(layout, made)
    poses.add(rows)
    (note,) = poses.notes()
    assert f"sensors.o: at t = 0.5 s within {told_off} deg of the singular pose" in note
