"""What the texts of cases say of their variants: one word changed, and another answer."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import flexmb
from flexmb.errors import FlexmbError

CASES = Path(__file__).parents[2] / "cases"


@pytest.mark.slow
def test_the_four_bar_without_geometric_stiffening_bows_otherwise(tmp_path: Path) -> None:
    change = {"bodies.coupler.geometric_stiffening": "none"}
    scene = CASES / "flexible_four_bar/scene.toml"
    report = flexmb.run_scene(scene, output=tmp_path, overrides=change, pictures=False)
    bow = np.array(
        [check.value - check.expected for check in report.checks if check.sensor == "bow"]
    )
    assert np.abs(bow).max() / 4.9e-3 == pytest.approx(0.15, abs=0.02)


@pytest.mark.seconds
def test_the_misaligned_four_bar_locks_when_it_is_rigid(tmp_path: Path) -> None:
    rigid = {f"bodies.{name}.deformation": "rigid" for name in ("crank", "coupler", "rocker")}
    with pytest.raises(FlexmbError, match=r"locked|nothing to drive"):
        flexmb.run_scene(CASES / "misaligned_four_bar/scene.toml", output=tmp_path, overrides=rigid)


@pytest.mark.seconds
def test_the_excavator_with_a_rigid_boom_is_the_one_of_kinematics(tmp_path: Path) -> None:
    change = {"bodies.boom.deformation": "rigid", "dynamics.outputs": "11"}
    folder = CASES / "excavator"
    dynamics = flexmb.run_scene(
        folder / "flexible.toml", output=tmp_path / "a", overrides=change, pictures=False
    )
    kinematics = flexmb.run_scene(folder / "scene.toml", output=tmp_path / "b", pictures=False)
    a, b = (flexmb.load_result(report.result) for report in (dynamics, kinematics))
    for axis in "xyz":
        expected = b[f"tooth.{axis}"][::20]
        np.testing.assert_allclose(a[f"tooth.{axis}"], expected, atol=1e-9)


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("scene", "missing"),
    [
        pytest.param("slow.toml", False, marks=pytest.mark.slow),
        ("medium.toml", False),
        pytest.param("scene.toml", True, marks=pytest.mark.slow),
    ],
)
def test_the_audit_says_at_which_speed_a_rigid_rod_is_wrong(scene, missing, tmp_path: Path) -> None:
    """Its estimate against the share by which a rigid rod's middle is off (`exact.py`)."""
    folder = CASES / "slider_crank_speeds"
    change = {"bodies.rod.deformation": "rigid"}
    report = flexmb.run_scene(folder / scene, output=tmp_path, overrides=change, pictures=False)
    audit = flexmb.audit(report.result)
    exact = runpy.run_path(str(folder / "exact.py"))
    true = exact["rigid_share"](exact["SPEEDS"][scene])
    (deformation,) = (one for one in audit.effects if one.effect == "deformation")
    assert deformation.shares["middle"] == pytest.approx(true, rel=0.1)
    assert audit.passed is not missing


def test_the_singular_pose_of_the_platform_is_found_at_a_yaw_of_90_degrees(tmp_path: Path) -> None:
    folder = CASES / "parallel_manipulator"
    exact = runpy.run_path(str(folder / "exact.py"))
    lines = exact["leg_lines"](np.array([0, 0, 1.2]), exact["turned"](np.pi / 2, 0, 0))[1]
    assert abs(np.linalg.det(lines)) < 1e-15
    for outputs in ("105", "37", "260"):  # none at t = 1
        report = flexmb.run_scene(
            folder / "singular.toml", output=tmp_path, pictures=False,
            overrides={"kinematics.outputs": outputs},
        )  # fmt: skip
        [note] = [n for n in report.notes if "singular pose" in n]
        before, after = (
            float(word) for word in re.findall(r"t = ([\d.]+) s and ([\d.]+)", note)[0]
        )
        assert before < 1.0 < after < before + 0.1
    with pytest.raises(FlexmbError, match=r"at t = (0\.999|1)\d* .* singular pose .*drivers\.leg0"):
        flexmb.run_scene(
            folder / "singular.toml", output=tmp_path, pictures=False,
            overrides={"kinematics.outputs": "120"},
        )  # fmt: skip


def test_the_loss_of_contact_is_found_when_the_force_of_the_cam_is_zero(tmp_path: Path) -> None:
    folder = CASES / "cam_valve"
    lost = runpy.run_path(str(folder / "exact.py"))["time_of_loss"]()
    report = flexmb.run_scene(
        folder / "contact_loss.toml", output=tmp_path, pictures=False,
        overrides={"kinematics.outputs": "1000"},
    )  # fmt: skip
    [note] = [n for n in report.notes if "pulls its follower" in n]
    first = float(re.findall(r"first at t = ([\d.e-]+) s", note)[0])
    assert lost <= first < lost + 0.0125 / 1000
    slow = flexmb.run_scene(
        folder / "contact_loss.toml", output=tmp_path, pictures=False,
        overrides={"speed": "2*pi*60"},
    )  # fmt: skip
    assert not any("pulls" in note for note in slow.notes)


def test_the_planar_manipulator_names_its_stretched_pose() -> None:
    """Both links in line reach 1.8 m: at the height of 0.7 m the tip gets to x = 1.6583 m."""
    model = flexmb.load_scene(CASES / "planar_manipulator/scene.toml")
    del model.drivers["path"]
    model.dynamics = None
    model.checks.clear()
    model.add_driver("path", marker="forearm.tip", x="1.3 + 0.6*t", y="0.7")
    model.set_kinematics(duration=1.0, outputs=50)
    with pytest.raises(FlexmbError, match=r"singular pose") as caught:
        flexmb.kinematics(model)
    found = re.search(r"t = ([0-9.]+) s", str(caught.value))
    assert found is not None
    assert float(found[1]) == pytest.approx((np.sqrt(1.8**2 - 0.7**2) - 1.3) / 0.6, abs=2e-3)


def test_a_cylinder_of_two_bodies_moves_as_a_driven_distance(tmp_path: Path) -> None:
    folder = CASES / "planar_manipulator"
    made = flexmb.compare(folder / "cylinder.toml", folder / "distance.toml", output=tmp_path)
    moves = [one for one in made.differences if one.moves]
    assert moves and max(one.largest for one in moves) < 1e-9
