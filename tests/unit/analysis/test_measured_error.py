"""The measured error: spans of sensors, what is judged, its growth in time, what is kept of it."""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes import beside_a_large_motion

from flexmb.analysis import monitors
from flexmb.analysis.dynamics.compared_quantities import RowComparison, by_part, compared
from flexmb.analysis.dynamics.measured_error import MeasuredError
from flexmb.engine.bodies.flexible_body import modal_reach
from flexmb.engine.compile import compile_system
from flexmb.flexbody import FlexBody, Interface
from flexmb.model import Model
from flexmb.results.output_block import OutputBlock

RATIO = 33.0  # of the errors of both runs: 1/32 of their difference is left


def model(*sensors):
    """Two bodies on hinges, with sensors (name, type, what)."""
    made = Model("two")
    for name in ("a", "b"):
        made.add_body(name, mass=1, inertia=[1, 1, 1])
        made.add_joint(f"hinge_{name}", "revolute", between=["ground", name], axis="z")
    for name, kind, of in sensors:
        made.add_sensor(name, kind, **({"joint": of} if kind == "angle" else {"of": of}))
    return made


BOTH = (("left", "position", "a"), ("right", "position", "b"))


class Rows:
    """Rows of a run of a model: all zero but what is set."""

    def __init__(self, made, t):
        self.layout = compile_system(made).layout
        n, layout = len(t), self.layout
        widths = (layout.nq, layout.nv, layout.nv, layout.nc, 12 * len(layout.reactions),
                  len(layout.channels), 7, 2)  # fmt: skip
        self.block = OutputBlock(np.array(t), *(np.zeros((n, width)) for width in widths))

    def set(self, channel, values):
        self.block.sensors[:, self.layout.channels.index(channel)] = values
        return self


def fed(made, coarse, fine, chunks=1):
    """The measured error of two runs, in so many chunks."""
    error = MeasuredError(RowComparison(fine.layout, made))
    n = len(fine.block.t)
    ends = np.linspace(0, n, chunks + 1).astype(int)
    for start, end in zip(ends[:-1], ends[1:], strict=True):
        error.add(coarse.block.part(start, end), fine.block.part(start, end))
    return error


def runs(made, t, **apart):
    """(coarse, fine): each channel a ramp of 2 m but that it is as much apart as told."""
    names = {name.replace("_", "."): values for name, values in apart.items()}
    fine, coarse = Rows(made, t), Rows(made, t)
    for name, values in names.items():
        ramp = 2.0 * np.array(t) / t[-1]
        fine.set(name, ramp)
        coarse.set(name, ramp + values)
    return coarse, fine


T = np.linspace(0.0, 10.0, 101)


@pytest.mark.parametrize("chunks", [1, 7, 101])
def test_the_error_is_the_difference_over_the_ratio_less_one_and_the_span(chunks):
    made = model(*BOTH)
    coarse, fine = runs(made, T, left_x=1e-3 * np.sin(T), right_y=-2e-3 * (T == 4.0))
    worst = fed(made, coarse, fine, chunks).largest(RATIO)["positions"]
    assert (worst.name, worst.time) == ("right", 4.0)
    assert worst.error == pytest.approx(2e-3 / 32 / 2.0, rel=1e-12)


def test_the_span_of_a_sensor_is_that_of_its_largest_component():
    """A component that hardly moves is judged by the one that does."""
    made = model(*BOTH)
    coarse, fine = runs(made, T, left_x=0.0 * T, right_x=0.0 * T)
    fine.set("left.y", 1e-7 * np.sin(T))
    coarse.set("left.y", 1e-7 * np.sin(T) + 1e-4)
    worst = fed(made, coarse, fine).largest(RATIO)["positions"]
    assert worst.name == "left"
    assert worst.error == pytest.approx(1e-4 / 32 / 2.0)


def test_a_sensor_of_small_motion_counts_by_its_own_span():
    """0.2 mm beside 2 m; not what is at rest but for round-off."""
    made = model(*BOTH)
    coarse, fine = runs(made, T, left_x=1e-6 * (T > 5))
    fine.set("right.x", 1e-4 * np.sin(T))
    coarse.set("right.x", 1e-4 * np.sin(T) + 1e-7 * (T > 7))
    worst = fed(made, coarse, fine).largest(RATIO)["positions"]
    assert worst.name == "right"
    assert worst.error == pytest.approx(1e-7 / 32 / np.ptp(1e-4 * np.sin(T)))
    at_rest = runs(made, T, left_x=1e-6 * (T > 5))
    at_rest[1].set("right.x", 1e-13 * (T > 5))
    at_rest[0].set("right.x", 9e-13 * (T > 7))
    assert fed(made, *at_rest).largest(RATIO)["positions"].name == "left"


def test_angles_are_no_lengths():
    """An angle that moves by 1e-10 rad is at rest beside another angle, not beside a length."""
    made = model(("left", "position", "a"), ("turn", "angle", "hinge_b"))
    coarse, fine = runs(made, T, left_x=1e-9 * T)
    fine.set("turn", 1e-10 * T)
    coarse.set("turn", 1.1e-10 * T)
    worst = fed(made, coarse, fine).largest(RATIO)["positions"]
    assert worst.name == "turn"
    assert worst.error == pytest.approx(0.1 / 32)


def test_bodies_are_judged_where_nothing_is_sensed():
    made = model()
    coarse, fine = Rows(made, T), Rows(made, T)
    layout = fine.layout
    b = layout.bodies[1]
    fine.block.q[:, b.iq] = T
    coarse.block.q[:, b.iq] = T + 1e-3
    fine.block.v[:, b.iv + 1] = np.cos(T)
    coarse.block.v[:, b.iv + 1] = np.cos(T) + 1e-2
    at = 12 * layout.reactions.index("joints.hinge_b")
    fine.block.reactions[:, at + 2] = 5 * np.sin(T)
    coarse.block.reactions[:, at + 2] = 5 * np.sin(T) + 0.3
    found = fed(made, coarse, fine).largest(RATIO)
    assert {name: one.name for name, one in found.items()} == {
        "positions": "bodies.b", "velocities": "bodies.b", "reactions": "joints.hinge_b",
    }  # fmt: skip
    assert found["positions"].error == pytest.approx(1e-3 / 32 / 10)
    assert found["velocities"].error == pytest.approx(1e-2 / 32 / np.ptp(np.cos(T)))
    assert found["reactions"].error == pytest.approx(0.3 / 32 / np.ptp(5 * np.sin(T)))


def test_nothing_that_moves_has_no_error():
    made = model(*BOTH)
    found = fed(made, Rows(made, T), Rows(made, T)).largest(RATIO)
    assert all(one.error == 0.0 for one in found.values())
    assert np.isfinite(fed(made, *runs(made, T, left_x=1e-3 * T)).largest(1.0)["positions"].error)


@pytest.mark.parametrize("n", [51, 255, 256, 257, 512, 513, 1000, 5001])
@pytest.mark.parametrize("chunks", [1, 13])
def test_it_is_told_until_when_the_accuracy_holds(n, chunks):
    """Errors grow by e every second: never after the time by hand, by two kept times at most."""
    made, t = model(*BOTH), np.linspace(0.0, 10.0, n)
    error = fed(made, *runs(made, t, right_x=1e-6 * np.exp(t), left_x=1e-9 * t), chunks)
    for accuracy in (1e-5, 1e-4):
        wanted = np.log(accuracy * 2.0 / 1e-6)  # when the two runs are so far apart
        found = error.reached_until(accuracy)
        assert 0.0 <= wanted - found < 2 * 10.0 / min(n - 1, 128)
    assert error.reached_until(0.5) == np.inf


@pytest.mark.parametrize("n", [51, 256, 257, 514, 1000, 1023, 5001])
def test_what_is_missed_in_the_last_row_only_is_told(n):
    made, t = model(*BOTH), np.linspace(0.0, 10.0, n)
    error = fed(made, *runs(made, t, right_x=1e-3 * (t == t[-1])))
    assert error.largest(RATIO)["positions"].time == 10.0
    assert error.reached_until(1e-6) <= 10.0


def test_a_sensor_at_rest_holds_no_accuracy_up():
    made = model(*BOTH)
    coarse, fine = runs(made, T, right_x=0.0 * T)
    coarse.set("left.x", 1e-12 * T)
    assert fed(made, coarse, fine).reached_until(1e-9) == np.inf


@pytest.mark.parametrize("n", [40, 300, 1500])
def test_it_goes_on_from_its_arrays(n):
    """As one that was fed everything, to the bit; the arrays are those that it fills."""
    made, t = model(*BOTH), np.linspace(0.0, 10.0, n)
    coarse, fine = runs(made, t, right_x=1e-6 * np.exp(t), left_x=1e-5 * np.sin(t))
    whole, half = fed(made, coarse, fine), n // 2 + 3
    first = fed(made, *(Cut(one, 0, half) for one in (coarse, fine)))
    again = MeasuredError(RowComparison(fine.layout, made))
    for name, array in again.arrays().items():
        array[...] = first.arrays()[name].copy()
    again.add(coarse.block.part(half, n), fine.block.part(half, n))
    for name, array in again.arrays().items():
        assert array.tobytes() == whole.arrays()[name].tobytes(), name
    assert again.largest(RATIO) == whole.largest(RATIO)
    assert again.reached_until(1e-6) == whole.reached_until(1e-6)


class Cut:
    """Some rows of a run."""

    def __init__(self, rows, start, end):
        self.layout, self.block = rows.layout, rows.block.part(start, end)


def test_no_more_samples_of_the_growth_are_kept_than_there_is_room_for():
    made, t = model(*BOTH), np.linspace(0.0, 10.0, 4321)
    growth = fed(made, *runs(made, t, right_x=1e-3 * t)).arrays()["error_growth"]
    kept = growth[np.isfinite(growth[:, 0])]
    assert monitors._MAX_SAMPLES // 2 <= len(kept) <= monitors._MAX_SAMPLES
    np.testing.assert_allclose(np.diff(kept[:, 0]), kept[1, 0] - kept[0, 0])
    assert (np.diff(kept[:, 1:], axis=0) >= 0.0).all()


def test_amplified_round_off_of_three_runs_counts_whatever_two_runs_differ_by():
    """Standard deviation 1 µm, 19 of 20 errors below 4.3 µm: a third of that is stated, of 2 m."""
    made = model(*BOTH)
    error = fed(made, *runs(made, T, left_x=1e-9))
    scouts = []
    for apart in (0.0, 1e-6, 2e-6):
        coarse, _ = runs(made, T, left_x=apart)
        scouts.append(error.comparison.values(coarse.block))
    error.set_round_off(scouts, 1.0)
    told = error.largest(RATIO)["positions"]
    assert told.name == "left" and told.error == pytest.approx(4.30 / 3 * 1e-6 / 2, rel=1e-3)


def test_no_rows_change_nothing():
    made = model(*BOTH)
    coarse, fine = runs(made, T, left_x=1e-3 * T)
    error = fed(made, coarse, fine)
    before = {name: array.copy() for name, array in error.arrays().items()}
    error.add(coarse.block.part(0, 0), fine.block.part(0, 0))
    for name, array in error.arrays().items():
        assert array.tobytes() == before[name].tobytes(), name


def test_the_speed_of_a_rotor_is_judged_by_the_speed_and_not_by_its_round_off():
    """400 rad/s to 1e-8 of it; a body at rest but for its creep is judged by that."""
    made = model()
    coarse, fine = Rows(made, T), Rows(made, T)
    spun, still = fine.layout.bodies
    for rows, off in ((coarse, 4e-6), (fine, 0.0)):
        rows.block.v[:, spun.iv + 5] = 400.0 + 1e-7 * np.cos(T) + off * np.sin(T)
        rows.block.q[:, still.iq] = 1e-6 * (T > 0)
        rows.block.v[:, still.iv] = 1e-14 * (T == T[1]) + 1e-9 * off * np.cos(T)
    error = MeasuredError(RowComparison(fine.layout, made, duration=10.0))
    error.add(coarse.block, fine.block)
    worst = error.largest(RATIO)["velocities"]
    assert worst.name == "bodies.a" and "0.001 of its largest" in worst.over
    assert worst.error == pytest.approx(4e-6 * np.abs(np.sin(T)).max() / 32 / 0.4, rel=1e-6)
    assert fed(made, coarse, fine).largest(RATIO)["velocities"].name == "bodies.b"


def test_the_frame_of_a_flexible_body_is_judged_by_the_motion_of_its_points():
    """A jitter of 1 um of the frame of a body of 0.5 m about it that turns by 2."""
    made = model()
    coarse, fine = Rows(made, T), Rows(made, T)
    body = fine.layout.bodies[0]
    for rows, off in ((coarse, 1e-6), (fine, 0.0)):
        rows.block.q[:, body.iq] = 1e-6 * np.sin(T) + off * np.cos(T)
        rows.block.q[:, body.iq + 3] = 0.1 * T  # Euler parameter: half the angle
    told = {}
    for reach in ({}, {"a": 0.5}):
        error = MeasuredError(RowComparison(fine.layout, made, gyration=reach))
        error.add(coarse.block, fine.block)
        told[len(reach)] = error.largest(RATIO)["positions"]
    assert told[0].error > 0.1
    assert told[1].error == pytest.approx(1e-6 / (RATIO - 1) / (0.5 * 2.0), rel=1e-3)
    assert "points" in told[1].over


def test_velocities_of_modes_count_with_the_motion_of_the_points():
    """A frame at rest, and a mode that moves a point by 0.1 m for each unit, off by 1e-3."""
    shape = np.zeros((3, 3, 1, 1))
    shape[1, 1] = 0.01
    end = Interface("end", [1, 0, 0], [[0], [0.1], [0]], np.zeros((3, 1)))
    body = FlexBody("a", 1.0, np.zeros(3), np.diag([1.0, 0.1, 0.1]), np.zeros((3, 1)),
                    np.zeros((3, 3, 1)), shape, [[4.0]], None, (end,))  # fmt: skip
    made = Model("one")
    made.add_body("a", body)
    coarse, fine = Rows(made, T), Rows(made, T)
    for rows, off in ((coarse, 1e-3), (fine, 0.0)):
        rows.block.v[:, 6] = np.sin(T) + off * (T == 5.0)
    error = MeasuredError(
        RowComparison(fine.layout, made, gyration={"a": 0.5}, reach={"a": modal_reach(body)})
    )
    error.add(coarse.block, fine.block)
    worst = error.largest(RATIO)["velocities"]
    assert (worst.name, worst.time) == ("bodies.a.deformation", 5.0)
    assert worst.error == pytest.approx(1e-3 / (RATIO - 1) / np.ptp(np.sin(T)), rel=1e-6)


def test_a_reaction_that_is_zero_but_for_errors_does_not_make_two_runs_different_motions():
    """Apart by half a thousandth of the largest: less by the order; by half of it: not."""
    made = model()
    for apart, share in ((0.5e-3, 0.5 / (RATIO - 1)), (0.5, 500.0)):
        coarse, fine = Rows(made, T), Rows(made, T)
        for rows, off in ((coarse, apart), (fine, 0.0)):
            rows.block.reactions[:, 0] = np.sin(T) ** 2
            rows.block.reactions[:, 12] = off * (T == 5.0)
        worst = fed(made, coarse, fine).largest(RATIO)["reactions"]
        assert "hinge_b" in worst.name
        assert worst.error == pytest.approx(share, rel=1e-2)


@pytest.mark.parametrize("joined", [False, True])
def test_reactions_of_a_small_part_are_judged_by_that_part(joined):
    """1e-6 N that are half wrong, beside a rotor of 1e4 N and 1000 rad/s: said, if none joins them.

    A share of the largest force or of all forces of inertia is 10 N.
    """
    made = model(("speed", "velocity", "a"))
    if joined:
        made.add_force("tie", "bushing", between=["a", "b"], stiffness=[1.0] * 3)
    made.add_sensor("pin", "reaction", joint="hinge_b")
    coarse, fine = Rows(made, T), Rows(made, T)
    body = fine.layout.bodies[0]
    for rows, off in ((coarse, 0.5e-6), (fine, 0.0)):
        rows.block.v[:, body.iv + 5] = 1e3
        rows.block.reactions[:, 0] = 1e4 * np.sin(T) ** 2
        pin = 1e-6 * np.sin(T) ** 2 + off * (T == 5.0)
        rows.block.reactions[:, 12] = pin
        rows.set("pin.x", pin)
    compiled = compile_system(made)
    parts = by_part(compared(compiled.layout, made), compiled, made)
    error = MeasuredError(RowComparison(fine.layout, made, {"m": 1e-10}, parts=parts))
    error.add(coarse.block, fine.block)
    worst = error.largest(RATIO)["reactions"]
    assert worst.error < 1e-8 if joined else worst.error == pytest.approx(0.5, rel=1e-2)


def test_moments_of_a_small_part_do_not_know_how_large_the_model_is():
    """0.1 N m that are half wrong at forces of 1 N, beside a flywheel of 1 km: a share of force
    times the size of the whole is 0.02 N m, and of turns and that size more."""
    made = beside_a_large_motion(model(("speed", "velocity", "a")), 1e5)
    coarse, fine = Rows(made, T), Rows(made, T)
    for rows, off in ((coarse, 0.05), (fine, 0.0)):
        rows.block.v[:, fine.layout.bodies[1].iv + 5] = 10.0
        rows.block.reactions[:, 12] = np.sin(T) ** 2
        rows.block.reactions[:, 15] = 0.1 * np.sin(T) ** 2 + off * (T == 5.0)
    compiled = compile_system(made)
    parts = by_part(compared(compiled.layout, made), compiled, made)
    error = MeasuredError(
        RowComparison(fine.layout, made, {"m": 1e-10 * compiled.length}, parts=parts)
    )
    error.add(coarse.block, fine.block)
    worst = error.largest(RATIO)["reactions"]
    assert "hinge_b" in worst.name
    assert worst.error == pytest.approx(0.5, rel=1e-2)


@pytest.mark.parametrize(("newton", "told"), [(1e-14, 0.0), (1e-9, 0.5)])
def test_reactions_that_would_not_move_their_part_are_none(newton, told):
    """Half wrong, and beside a part that is loaded: what nothing loads has only round-off."""
    made = model(("speed", "velocity", "a"))
    made.add_sensor("pin", "reaction", joint="hinge_b")
    coarse, fine = Rows(made, T), Rows(made, T)
    for rows, off in ((coarse, 0.5), (fine, 0.0)):
        rows.block.reactions[:, 0] = np.sin(T) ** 2
        pin = newton * (np.sin(T) ** 2 + off * (T == 5.0))
        rows.block.reactions[:, 12] = pin
        rows.set("pin.x", pin)
    compiled = compile_system(made)
    parts = by_part(compared(compiled.layout, made), compiled, made)
    error = MeasuredError(
        RowComparison(fine.layout, made, {"m": 1e-10}, duration=10.0, parts=parts)
    )
    error.add(coarse.block, fine.block)
    assert error.largest(RATIO)["reactions"].error == pytest.approx(told, rel=1e-2)
