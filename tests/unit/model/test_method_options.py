"""Options of integrators: what only some methods have is refused with others, not ignored."""

from __future__ import annotations

import pytest

import flexmb
from flexmb.engine.method_selection import make_integrator
from flexmb.errors import SceneError
from flexmb.model import Model
from flexmb.model.scenes.dynamics import METHODS, OPTIONS
from flexmb.model.scenes.study import override

VALUES = {
    "order": 5, "spectral_radius": 0.9, "newton_tolerance": 1e-9, "alpha": -0.2, "beta": 0.3,
    "gamma": 0.5, "baumgarte_alpha": 5.0, "baumgarte_beta": 5.0,
}  # fmt: skip


def set_dynamics(**fields):
    return Model("m").set_dynamics(duration=1.0, **fields)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "steps", [{"step": 1e-3}, {"accuracy": 1e-3}], ids=lambda steps: [*steps][0]
)
def test_options_act_or_are_refused(method, steps):
    """And what is left out is never refused."""
    set_dynamics(method=method, **steps)
    has = "generalized-alpha" if method == "auto" and "step" in steps else method
    for option, value in VALUES.items():
        if has in OPTIONS[option]:
            set_dynamics(method=method, **{option: value}, **steps)
            continue
        with pytest.raises(SceneError) as caught:
            set_dynamics(method=method, **{option: value}, **steps)
        text = str(caught.value)
        assert f"dynamics.{option}" in text and f'"{method}"' in text
        assert all(owner in text for owner in OPTIONS[option])


def test_every_option_is_tried():
    assert set(VALUES) == set(OPTIONS)


@pytest.mark.parametrize("steps", [{"step": 1e-3}, {"accuracy": 1e-3}, {}])
@pytest.mark.parametrize("verify", [True, False, None])
def test_fixed_and_controlled_steps_can_be_verified(steps, verify):
    model = Model("m")
    model.set_dynamics(duration=1.0, verify=verify, **steps)
    assert model.dynamics.verify is verify


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"method": "hht", "alpha": -0.5}, "must lie between -0.3333 and 0, is -0.5"),
        ({"method": "generalized-alpha", "spectral_radius": 1.1}, "must lie between 0 and 1"),
        ({"method": "newmark", "gamma": 0.4}, "must lie between 0.5 and 1"),
        ({"method": "newmark", "gamma": 0.8, "beta": 0.3, "step": 0.1}, "at least gamma/2 = 0.4"),
        ({"method": "newmark", "gamma": 0.6}, "give a fixed step, or gamma = 0.5"),
        ({"method": "baumgarte", "baumgarte_beta": -1}, "must be zero or positive"),
    ],
)
def test_values_that_no_method_can_use(fields, sentence):
    with pytest.raises(SceneError, match=sentence):
        set_dynamics(**fields)


def test_a_change_of_the_method_drops_what_the_new_one_does_not_have():
    """From the command line and from Python; what is changed together with it is refused."""
    scene = {"dynamics": {"duration": 1.0, "step": 1e-3, "spectral_radius": 0.9}}
    changed, problems = override(scene, {"dynamics.method": "radau"})
    assert not problems and changed["dynamics"] == {
        "duration": 1.0, "step": 1e-3, "method": "radau",
    }  # fmt: skip
    changed, _ = override(scene, {"dynamics.accuracy": 1e-3})
    assert "spectral_radius" not in changed["dynamics"]
    both, _ = override(scene, {"dynamics.method": "radau", "dynamics.spectral_radius": 0.7})
    assert both["dynamics"]["spectral_radius"] == 0.7  # and reading it tells why not
    assert override(scene, {"dynamics.duration": 2.0})[0]["dynamics"]["spectral_radius"] == 0.9

    model = Model("falling", gravity=[0, 0, -9.81])
    model.add_body("b", mass=1, inertia=[1, 1, 1])
    model.add_sensor("b", "position", of="b")
    model.set_dynamics(duration=0.1, step=1e-2, spectral_radius=0.9, outputs=2)
    assert flexmb.simulate(model, method="trapezoidal").status == "finished"
    with pytest.raises(SceneError, match="has no spectral_radius"):
        flexmb.simulate(model, method="trapezoidal", spectral_radius=0.9)


def test_cases_of_generalized_alpha():
    """The trapezoidal rule is what Newmark's, HHT's and the undamped method have in common."""
    names = {
        "trapezoidal": {}, "newmark": {}, "hht": {"alpha": 0.0},
    }  # fmt: skip
    made = [
        make_integrator(set_dynamics(method=name, step=1e-3, **options))
        for name, options in names.items()
    ]
    assert len({one.coefficients for one in made}) == 1
    (alpha,) = made[0].coefficients
    assert (alpha.beta, alpha.gamma, alpha.project) == (0.25, 0.5, 1)
    damped = make_integrator(set_dynamics(method="newmark", step=1e-3, gamma=0.7))
    assert damped.order == 1 and damped.coefficients[0].beta == pytest.approx(0.36)
    assert damped.coefficients[0].project == 0


def test_a_field_of_dynamics_without_its_table_is_told_with_it():
    _, (problem,) = override({"dynamics": {"duration": 1.0}}, {"duration": 2.0})
    assert problem.what == 'unknown parameter "duration"'
    assert problem.nearest == ("dynamics.duration",)
