"""What the summary of a run says, in words and numbers."""

from __future__ import annotations

from flexmb.results.run_summary import summary_sentence, time_rows, work_rows

SWEEP = {
    "points": 1001,
    "increments": 1010,
    "halved_increments": 3,
    "newton_iterations": 2002,
    "factorisations": 1001,
    "singular_poses_passed": 0,
    "largest_position_drift": 1e-14,
    "largest_velocity_drift": 1e-13,
    "energy_balance_error": 1e-6,
    "seconds_kinematics": 0.02002,
}


def test_a_kinematic_analysis_is_told_by_points():
    rows = {name: (value, meaning) for name, value, meaning in work_rows(SWEEP)}
    assert rows["points"] == (
        "1 001", "9 more between them; 3 increments failed and were halved",
    )  # fmt: skip
    assert rows["Newton iterations"] == ("2 002", "2 per point")
    assert rows["velocity drift"][1] == "m/s or rad/s, the largest of any constraint"
    assert not any("singular" in name or "increments" in name for name in rows)
    assert time_rows(SWEEP) == [("kinematics", "0.02", "20 µs per point")]
    assert summary_sentence(SWEEP) == ("1 001 points in 0.02 s: energy balance 1e-06, drift 1e-14")


def test_steps_are_told_as_before():
    rows = {name: meaning for name, _, meaning in work_rows({"steps": 10, "factorisations": 5})}
    assert rows["factorisations"] == "0.5 per step"
