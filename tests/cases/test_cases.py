"""Every case runs from its scene file and gives the answers that the file itself names."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import flexmb
from flexmb.workflow.reduction import reduce_scene

FOLDER = Path(__file__).parents[2] / "cases"
CASES = sorted(FOLDER.glob("*/*.toml"))
EXACT = sorted(FOLDER.glob("*/exact.py"))  # Solutions that take seconds by themselves.
LONG = {"excavator", "flexible_manipulator", "hub_beam", "misaligned_four_bar",
        "parallel_manipulator", "rotating_beam_spin_up", "slider_crank_speeds",
        "spacecraft_panels", "test_set_crank"}  # fmt: skip

# Runs of seconds.
SLOWER = {"cam_valve/contact_loss", "diaphragm", "excavator/flexible", "flexible_four_bar",
          "flexible_manipulator", "hub_beam", "misaligned_four_bar", "rotating_beam_frequencies",
          "rotating_beam_spin_up/zeroth_order", "rotating_plate", "spacecraft_panels",
          "spinning_disc", "tapered_box", "tuning_fork", "wheel"}  # fmt: skip

# Changes that shorten a run without leaving the tolerances of its checks.
SHORTER = {
    "slider_crank": {"dynamics.step": "4e-5", "dynamics.outputs": "80", "bodies.rod.modes": "4"}
}


def case_name(path: Path) -> str:
    """Folder and file, the file alone left out where it is the usual one."""
    return path.relative_to(FOLDER).with_suffix("").as_posix().removesuffix("/scene")


def runs(scene: Path) -> bool:
    """Whether the case is a run, or flexible bodies alone."""
    return any(
        f"[{a}]" in scene.read_text(encoding="utf-8") for a in ("dynamics", "kinematics", "statics")
    )


def run(scene: Path, folder: Path, overrides: dict[str, str]) -> None:
    """Run a scene without pictures and compare with its checks."""
    report = flexmb.run_scene(scene, output=folder, overrides=overrides, pictures=False)
    assert flexmb.load_result(report.result).status == "finished"
    assert report.checks, "a case without a check proves nothing"
    for check in report.checks:
        assert check.passed, check
    assert report.statistics["largest_position_drift"] < 1e-8
    asked = report.statistics.get("accuracy_asked", 0.0)  # stiff modes are damped
    assert report.statistics.get("energy_balance_error", 0.0) < max(1e-4, asked)


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(path, marks=pytest.mark.seconds) if case_name(path) in SLOWER else path
        for path in CASES
        if runs(path)
    ],
    ids=case_name,
)
def test_a_case_gives_its_known_answers(scene: Path, tmp_path: Path) -> None:
    run(scene, tmp_path, SHORTER.get(case_name(scene), {}))


def is_part(scene: Path) -> bool:
    """Whether the case is a part by itself."""
    return "[part]" in scene.read_text(encoding="utf-8")


@pytest.mark.parametrize("scene", [path for path in CASES if is_part(path)], ids=case_name)
def test_a_part_by_itself_gives_its_known_answers(scene: Path, tmp_path: Path) -> None:
    report = flexmb.run_part(scene, output=tmp_path, pictures=False)
    assert report.checks, "a case without a check proves nothing"
    for check in report.checks:
        assert check.passed, check


BODIES = [path for path in CASES if not runs(path) and not is_part(path)]


@pytest.mark.seconds
@pytest.mark.parametrize("scene", BODIES, ids=case_name)
def test_bodies_alone_have_their_known_frequencies(scene: Path, tmp_path: Path) -> None:
    found = reduce_scene(scene, output=tmp_path)
    assert found.checks, "a case without a check proves nothing"
    for check in found.checks:
        assert check.passed, check


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SHORTER))
def test_a_case_as_it_stands_gives_its_known_answers(name: str, tmp_path: Path) -> None:
    run(FOLDER / name / "scene.toml", tmp_path, {})


def test_every_case_says_where_its_answers_come_from() -> None:
    for scene in CASES:
        model = flexmb.load_scene(scene)
        of_bodies = (*model.frequency_checks, *model.mode_checks)
        for check in (*model.checks, *of_bodies, *model.part_checks):
            assert check.source, scene


@pytest.mark.seconds
@pytest.mark.parametrize(
    "script",
    [
        pytest.param(path, marks=pytest.mark.slow) if path.parent.name in LONG else path
        for path in EXACT
    ],
    ids=lambda path: path.parent.name,
)
def test_expected_values_are_those_of_the_exact_solution(script: Path) -> None:
    """`exact.py` prints `[scene] sensor time value`; it uses nothing of flexmb.

    Of linearised modes `linear_mode=1,name=2 value`, with the parameters in their order; of
    parts `quantity value`.
    """
    assert "flexmb" not in script.read_text(encoding="utf-8")
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, check=True, env=environment
    )
    rows = [line.split() for line in done.stdout.splitlines()]
    scenes = {path.name: flexmb.load_scene(path).checks for path in script.parent.glob("*.toml")}
    sought = {
        (scene, check.sensor, check.time): check
        for scene, checks in scenes.items()
        for check in checks
        if "exact.py" in check.source
    }
    exact: dict[tuple[str, str, float], float] = {}
    for mode, value in (row for row in rows if len(row) == 2):
        exact["", mode, 0.0] = float(value)
    for path in script.parent.glob("*.toml"):
        for check in flexmb.load_scene(path).mode_checks:
            words = [f"{name}={number:g}" for name, number in check.parameters.items()]
            mode = ",".join([f"linear_mode={check.linear_mode}", *words])
            if "exact.py" in check.source:
                assert check.value == pytest.approx(
                    exact["", mode, 0.0], abs=0.05 * check.tolerance
                )
        for known in flexmb.load_scene(path).part_checks:
            if "exact.py" in known.source:
                value = exact["", known.part, 0.0]
                assert known.value == pytest.approx(value, abs=0.05 * known.tolerance)
    for *scene, sensor, time, value in (row for row in rows if len(row) > 2):
        for name in scene or scenes:
            exact[name, sensor, round(float(time), 9)] = float(value)
    assert sought or exact
    for (scene, sensor, time), check in sought.items():
        value = exact[scene, sensor, round(time, 9)]
        assert check.value == pytest.approx(value, abs=0.05 * check.tolerance), check
