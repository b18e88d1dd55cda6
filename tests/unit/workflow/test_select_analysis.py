"""Which analysis a scene runs."""

from __future__ import annotations

import pytest
from linkages import four_bar
from quickreturn import quick_return, ram_motion

import flexmb
from flexmb.errors import ResultFileError, SceneError
from flexmb.model import Model
from flexmb.workflow.run import Task, select_analysis


def scene(*analyses):
    made = Model("scene")
    for name in analyses:
        getattr(made, f"set_{name}")(duration=1)
    return made


def test_a_scene_runs_what_it_has():
    assert select_analysis(scene("dynamics"), None) == "dynamics"
    assert select_analysis(scene("kinematics"), None) == "kinematics"
    assert select_analysis(scene("dynamics", "kinematics"), "kinematics") == "kinematics"


@pytest.mark.parametrize(
    ("analyses", "asked", "elsewhere", "words"),
    [
        ((), None, False, "no [dynamics] and no [kinematics]"),
        (("dynamics",), "kinematics", False, "no [kinematics]: give its duration"),
        (("dynamics", "kinematics"), None, False, "--analysis dynamics or --analysis kinematics"),
        (("dynamics",), "kinematic", False, 'unknown analysis "kinematic"; nearest: kinematics'),
        (("kinematics",), None, True, "begins where its drivers say"),
    ],
)
def test_what_cannot_be_run_is_told(analyses, asked, elsewhere, words):
    with pytest.raises(SceneError) as caught:
        select_analysis(scene(*analyses), asked, elsewhere)
    assert words in str(caught.value)


def test_a_result_keeps_the_section_of_its_own_analysis():
    kept = Task("kinematics", 1, lambda sink: None).scene({"kinematics": 1, "dynamics": 2, "a": 3})
    assert kept == {"kinematics": 1, "a": 3}


def test_times_after_the_end_are_mistakes():
    made = four_bar((1.0, 2.0, 1.5, 2.2), (0.7, 0.3, 1.9))
    made.set_kinematics(duration=1)
    made.add_sensor("pin", "position", of="crank.end")
    made.add_check(sensor="pin.x", time=2, value=0, tolerance=1, source="none")
    with pytest.raises(SceneError, match="lies after the end of the run, 1 s"):
        made.validate()


def test_a_kinematic_analysis_leaves_a_result_that_cannot_be_resumed(tmp_path):
    """Compiled: the same motion as in closed form at every point."""
    found = flexmb.kinematics(quick_return(), outputs=100, output=tmp_path)
    assert found.status == "finished" and len(found.time) == 101
    position, velocity, acceleration = ram_motion(found.time)
    assert found["ram_position.x"] == pytest.approx(position, abs=1e-12)
    assert found["ram_velocity.x"] == pytest.approx(velocity, abs=1e-11)
    assert found["ram_acceleration.x"] == pytest.approx(acceleration, abs=1e-10)
    assert found.statistics["points"] == 101
    assert found.statistics["energy_balance_error"] < 1e-3
    with pytest.raises(ResultFileError, match="nothing to resume"):
        flexmb.resume(found)
