"""Contributions of effects to sensors: what is at rest by symmetry is moved by nobody."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from flexmb.analysis.effects.contribution import (
    Contribution,
    contributions,
    fast_shares,
    first_change,
    shared,
)
from flexmb.analysis.effects.independent_coordinates import choose_coordinates
from flexmb.analysis.effects.perturbation import respond
from flexmb.analysis.effects.smooth_pieces import SmoothPieces
from flexmb.analysis.effects.stored_motion import Motion
from flexmb.analysis.effects.variational_equations import VariationalEquations
from flexmb.engine.compile import compile_system
from flexmb.model import Model
from flexmb.units import unit_system
from flexmb.workflow.audit import EffectOutcome, _outcome
from flexmb.workflow.effect import Effect
from flexmb.workflow.effect_selection import Selection, _switch_on


@pytest.mark.parametrize(("sum_of_all", "rests"), [(0.0, True), (0.1, True), (2.0, False)])
def test_a_sensor_rests_by_symmetry_if_all_bodies_together_leave_it(sum_of_all, rests) -> None:
    model = Model("craft")
    model.add_body("bus", mass=1.0, inertia=[1.0] * 3)
    model.add_body("arm", mass=1.0, inertia=[1.0] * 3)
    for name in ("bus", "arm"):
        model.add_sensor(name, "position", of=name)
    names = tuple(f"{name}.{axis}" for name in ("bus", "arm") for axis in "xyz")
    t = np.linspace(0.0, 1.0, 9)
    moves = np.zeros((9, 6))
    moves[:, 3] = t  # the arm; the bus rests
    change = np.zeros((9, 6))
    change[:, 0], change[:, 3] = 1e-3 * t, 0.01 * t
    histories = moves, moves + change
    bus, arm = contributions(model, histories, change, names, sum_of_all * change)
    alone = contributions(model, histories, change, names)
    assert (bus.at_rest, arm.at_rest) == (True, False)
    assert alone[0].share == bus.share == pytest.approx(1.0)
    assert (bus.by_symmetry, arm.by_symmetry, alone[0].by_symmetry) == (rests, False, False)
    assert arm.share == alone[1].share == pytest.approx(0.01 / 1.01)


@pytest.mark.parametrize(("second", "rests"), [(-1.0, True), (-0.1, False), (1.0, False)])
def test_what_grows_without_bounds_rests_by_no_symmetry(second, rests) -> None:
    """Two effects change what hardly moves by far more; together they leave a tenth of it."""
    model = Model("plate")
    model.add_body("plate", mass=1.0, inertia=[1.0] * 3)
    model.add_sensor("plate", "position", of="plate")
    names, t = ("plate.x", "plate.y", "plate.z"), np.linspace(0.0, 1.0, 9)
    moves = np.outer(t, [0.1, 0.0, 0.0])
    changes = [size * np.outer(t, [1e6, 0.0, 0.0]) for size in (1.0, second, 0.1)]
    histories = [(moves, moves + change) for change in changes]
    added = changes[0] + changes[1]
    each = [contributions(model, histories[k], changes[k], names, added) for k in (0, 1)]
    together = contributions(model, histories[2], changes[2], names)
    for own in each:
        (made,) = shared(own, each, together)
        assert (made.by_symmetry, made.share == 0.0) == (rests, rests)
    whole = sum(shared(own, each, together)[0].share for own in each)
    assert whole == pytest.approx(0.0 if rests else 1.0, abs=1e-3)


def test_a_change_that_is_no_number_is_unbounded() -> None:
    model = Model("plate")
    model.add_body("plate", mass=1.0, inertia=[1.0] * 3)
    model.add_sensor("plate", "position", of="plate")
    moves = np.outer(np.linspace(0.0, 1.0, 9), [0.1, 0.0, 0.0])
    change = np.where(moves > 0.05, np.nan, 0.0)
    (made,) = contributions(model, (moves, moves), change, ("plate.x", "plate.y", "plate.z"))
    assert made.share > 10.0


def test_a_change_of_velocity_goes_straight_on_whatever_turns_below_it() -> None:
    """Without forces δr = δv t, also of a body whose axes, in which it is solved, turn."""
    model = Model("spinner")
    model.add_body("disc", mass=2.0, inertia=[1.0, 1.0, 1.0])
    compiled = compile_system(model)
    (columns,), t, w = compiled.layout.bodies, np.linspace(0.0, 2.0, 401), 1.5
    q, v = np.zeros((len(t), 7)), np.zeros((len(t), 6))
    q[:, columns.iq] = 4.0 * t
    q[:, columns.iq + 3], q[:, columns.iq + 6] = np.cos(w * t / 2), np.sin(w * t / 2)
    v[:, columns.iv], v[:, columns.iv + 5] = 4.0, w
    none = np.zeros((len(t), 0))
    motion = Motion(t, q, v, np.zeros_like(v), none, none)
    change = np.array([1e-3, 2e-3, -3e-3, 0.0, 0.0, 0.0])
    found = respond(compiled, motion, np.zeros_like(v), (np.zeros(6), change, np.zeros(6))).dq
    np.testing.assert_allclose(found[:, :3], np.outer(t, change[:3]), atol=1e-7)


def test_joints_that_cannot_be_closed_leave_the_linear_motion(monkeypatch) -> None:
    """Far from any pose rows of a Jacobian are alike to round-off: no closure, and no traceback."""
    model = Model("slide")
    model.add_body("block", mass=2.0, inertia=[1.0] * 3)
    model.add_joint("guide", "prismatic", between=["ground", "block"], axis="y")
    compiled, t = compile_system(model), np.linspace(0.0, 2.0, 41)
    q, v = np.zeros((41, 7)), np.zeros((41, 6))
    q[:, 3] = 1.0
    motion = Motion(t, q, v, v, np.zeros((41, compiled.layout.nc)), np.zeros((41, 0)))
    change = np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0])

    def alike(*_):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(VariationalEquations, "closure", alike)
    found = respond(compiled, motion, v, (0.0 * change, change, 0.0 * change))
    assert found.bounded == 41
    np.testing.assert_allclose(found.dq[:, 1], 0.3 * t, atol=1e-9)


def test_the_first_change_is_how_far_another_model_begins_from_the_motion() -> None:
    """In equilibrium a spring is longer by m g / k than where the motion began."""
    model = Model("scale", gravity=[0.0, -9.81, 0.0])
    model.add_body("pan", mass=2.0, inertia=[1.0] * 3, position=[0.0, -1.0, 0.0])
    model.add_joint("guide", "prismatic", between=["ground", "pan"], axis="y")
    model.add_force(
        "spring", "spring-damper", between=["ground", "pan"], free_length=1.0, stiffness=200.0
    )
    model.set_dynamics(duration=1.0, start="static")
    none, v = np.zeros((1, 0)), np.zeros((1, 6))
    q, v[0, 1] = np.array([[0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0]]), 0.5
    vd = np.array([[0.0, -9.81, 0.0, 0.0, 0.0, 0.0]])  # it fell
    motion = Motion(np.zeros(1), q, v, vd, none, none)
    dq, dv, dvd = first_change(compile_system(model), model, motion)
    np.testing.assert_allclose(dq, [0.0, -2.0 * 9.81 / 200.0, 0.0, 0.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(dv, [0.0, -0.5, 0.0, 0.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(dvd, -vd[0], atol=1e-9)


@pytest.mark.parametrize("phase", [0.3, 1.0, 2.5])
def test_what_rings_faster_than_the_rows_is_what_neighbours_do_not_tell(phase) -> None:
    model = Model("ball")
    model.add_body("ball", mass=1.0, inertia=[1.0] * 3)
    model.add_sensor("ball", "position", of="ball")
    k = np.arange(4001.0)
    moves = np.zeros((4001, 3))
    moves[:, 0] = np.sin(2e-3 * np.pi * k) + 0.01 * np.sin(phase * k)  # slow, and what rings on it
    cubic = (4.0 * np.cos(phase) - np.cos(2.0 * phase)) / 3.0  # of a vibration, through four rows
    told = fast_shares(model, moves, ("ball.x", "ball.y", "ball.z"))["ball"]
    assert told == pytest.approx(0.01 * (1.0 - cubic) / np.sqrt(2.0) / 2.02, rel=0.02)


def test_a_jump_is_no_vibration_and_a_short_vibration_is_one() -> None:
    model = Model("ball")
    model.add_body("ball", mass=1.0, inertia=[1.0] * 3)
    model.add_sensor("ball", "position", of="ball")
    k, names = np.arange(301.0), ("ball.x", "ball.y", "ball.z")
    moves = np.zeros((301, 3))
    moves[:, 0] = np.sin(0.02 * k) + (k > 60) - 0.7 * (k > 200)
    assert fast_shares(model, moves, names)["ball"] < 1e-6
    moves[100:130, 0] += 0.02 * np.sin(1.5 * k[100:130])
    assert fast_shares(model, moves, names)["ball"] > 5e-4


def test_other_coordinates_are_selected_before_one_moves_without_bounds() -> None:
    """A link that comes to lie along a guide: its end cannot be moved by the other coordinate.

    It moves by 90/(300 - k) in row k, whose rate a cubic spline tells until nine rows before the
    pole.
    """
    n = 298
    Cq = np.stack([300.0 - np.arange(n), np.full(n, 90.0)], axis=1)[:, None]
    of = SimpleNamespace(Cq=Cq, C=np.zeros((n, 1)), prefer=np.ones(2))
    Z = choose_coordinates(of, 0, n).Z[:, 0, 0]
    rows = SmoothPieces(np.arange(float(len(Z))), np.zeros(0, int))
    np.testing.assert_allclose(rows.rate(Z), Z**2 / -90.0, rtol=0.02)


def test_round_off_of_a_sensor_at_rest_does_not_ring() -> None:
    model = Model("ball")
    model.add_body("ball", mass=1.0, inertia=[1.0] * 3)
    model.add_sensor("ball", "position", of="ball")
    noise = 1e-12 * np.random.default_rng(1).standard_normal((401, 3))
    names = ("ball.x", "ball.y", "ball.z")
    assert fast_shares(model, noise, names)["ball"] > 0.05
    assert fast_shares(model, noise, names, {"m": 1e-13})["ball"] < 3e-3


def test_effects_that_nothing_switches_wait_until_no_other_one_exceeds_the_budget() -> None:
    """Up to half of the budget may be left out together: 0.5 %."""

    def effect(name: str, share: float, body: str) -> EffectOutcome:
        return EffectOutcome(
            name, body, False, "rigid", share, "", "tip", None, "", "", {"tip": share}
        )

    selection = Selection({"rod": {"deformation": "rigid"}, "bar": {"deformation": "rigid"}})
    found = [effect("deformation", 0.3, "rod"), effect("deformation", 4e-3, "bar")]
    assert _switch_on(selection, found, number="1", budget=0.01)
    assert selection.words["rod"]["deformation"] == "quasi-static"
    assert selection.words["bar"]["deformation"] == "rigid"
    assert not _switch_on(selection, found[1:], number="2", budget=0.01)
    known = [found[1], effect("further modes", 2e-3, "rod")]
    assert _switch_on(selection, known, number="2", budget=0.01)
    assert selection.words["bar"]["deformation"] == "quasi-static"


@pytest.mark.parametrize("rings", [0.0, 0.1])
def test_no_small_number_is_told_where_a_sensor_rings_faster_than_the_rows(rings) -> None:
    of = SimpleNamespace(
        estimate=lambda _: ([Contribution("grip", "N", 1.0, 2e-3, unresolved=rings)], None),
        of=SimpleNamespace(model=SimpleNamespace(units=unit_system("SI"))),
    )
    made = _outcome(of, Effect("vibration", "rod", False, ""), 0.01)
    assert made.share == (None if rings else 2e-3)
    assert made.verdict == ("not known" if rings else "may stay off")
    selection = Selection({"rod": {"deformation": "quasi-static"}})
    assert _switch_on(selection, [made], number="1", budget=0.01) == bool(rings)
    assert selection.words["rod"]["deformation"] == ("dynamic" if rings else "quasi-static")


def test_no_number_is_told_of_what_is_unbounded() -> None:
    of = SimpleNamespace(
        estimate=lambda _: ([Contribution("pin", "m", np.finfo(float).max, 1e3)], None),
        of=SimpleNamespace(model=SimpleNamespace(units=unit_system("SI"))),
    )
    made = _outcome(of, Effect("vibration", "rod", False, ""), 0.01)
    assert (made.verdict, made.value) == ("missing", "")


@pytest.mark.parametrize(
    ("name", "verdict"), [("further modes", "not known"), ("full inertia coupling", "may stay off")]
)
def test_further_modes_ring_more_than_the_rows_show(name, verdict) -> None:
    """Of a double pendulum 0.007 % of a reaction for 1.3 %, with 641 rows that ring by 0.36 %."""
    of = SimpleNamespace(
        estimate=lambda _: ([Contribution("pin", "N", 1e-3, 6.7e-5, unresolved=3.6e-3)], None),
        of=SimpleNamespace(model=SimpleNamespace(units=unit_system("SI"))),
    )
    assert _outcome(of, Effect(name, "rod", False, ""), 0.01).verdict == verdict


@pytest.mark.parametrize("vibration", [0.02, 0.2])
def test_what_vibrates_is_not_made_quasi_static(vibration) -> None:
    """Of a larger deformation than vibration the next run was quasi-static, and one too many."""
    of = SimpleNamespace(
        estimate=lambda one: (
            [Contribution("grip", "N", 1.0, vibration if one.name == "vibration" else 0.1)], None
        ),
        of=SimpleNamespace(model=SimpleNamespace(units=unit_system("SI"))),
    )  # fmt: skip
    made = [
        _outcome(of, Effect(name, "rod", False, "rigid"), 0.01)
        for name in ("deformation", "vibration")
    ]
    selection = Selection({"rod": {"deformation": "rigid"}})
    assert _switch_on(selection, made, number="1", budget=0.01)
    assert selection.words["rod"]["deformation"] == "dynamic"


def test_a_frame_at_an_interface_has_dynamic_modes_and_full_coupling() -> None:
    """With quasi-static ones momentum was lost to a kick, with partial coupling a rod diverged."""
    words = {"deformation": "rigid", "inertia_coupling": "constant"}
    selection = Selection({"rod": words}, frozenset({"rod"}))
    selection.switch("rod", {"deformation": "quasi-static", "inertia_coupling": "partial"}, "1")
    assert selection.words["rod"] == {"deformation": "dynamic", "inertia_coupling": "full"}
