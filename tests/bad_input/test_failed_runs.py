"""Runs that fail on the way: one sentence with time, place and a cure; results until then."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from femeshes import line
from linkages import slider_crank
from typer.testing import CliRunner

import flexmb
from flexmb.analysis.dynamics.dynamics import n_closed
from flexmb.analysis.failure_messages import open_joint
from flexmb.cli import app
from flexmb.engine.compile import compile_system
from flexmb.errors import AssemblyError, SolverError
from flexmb.fe import rectangle, reduce
from flexmb.results.output_block import OutputBlock

R, L = 0.2, 0.5  # m, crank and rod


def arm(angle: str) -> flexmb.Model:
    """One arm, turned as told."""
    model = flexmb.Model("arm")
    model.add_body("arm", mass=1, inertia=[1, 1, 1], markers={"tip": {"position": [R, 0, 0]}})
    model.add_joint("bearing", "revolute", between=["ground", "arm"], axis="z")
    model.add_driver("motor", joint="bearing", angle=angle)
    model.add_sensor("tip", "position", of="arm.tip")
    model.set_dynamics(duration=0.2, step=1e-3, outputs=40)
    return model


def pulled_slider(x: float, height: float) -> flexmb.Model:
    """A crank and a rod that a slider pulls straight from `x`, the pin placed at a height."""
    model = flexmb.Model("pulled slider-crank")
    pin = [np.sqrt(R**2 - height**2), height, 0]
    turn = {"axis": "z", "angle": np.arctan2(-height, x - pin[0])}
    model.add_body("crank", mass=1, inertia=[1, 1, 1], markers={"pin": {"position": pin}})
    model.add_body("rod", mass=1, inertia=[1, 1, 1], position=pin, orientation=turn)
    model.add_marker("rod.end", position=[L, 0, 0])
    model.add_body("slider", mass=1, inertia=[1, 1, 1], position=[x, 0, 0])
    model.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    model.add_joint("crank_pin", "spherical", between=["crank.pin", "rod"])
    model.add_joint("wrist_pin", "cylindrical", between=["rod.end", "slider"], axis="z")
    model.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    model.add_driver("pull", joint="guide", stroke=f"{x!r} + 0.5*t")
    model.add_sensor("slider", "position", of="slider")
    model.set_dynamics(duration=1, step=1e-3, outputs=200)
    return model


def test_a_function_that_leaves_its_domain_is_named(tmp_path: Path) -> None:
    """One of a channel, whose values are not known before the run."""
    model = arm("2*t")
    model.add_sensor("turn", "angle", joint="bearing")
    model.add_force("brake", "torque", at="arm", value=[0, 0, "log(0.299 - turn)"])
    with pytest.raises(SolverError) as caught:
        flexmb.simulate(model, output=tmp_path)
    text = str(caught.value)
    assert text.startswith("at t = 0.1495 s forces.brake.value"), text
    assert '"log(0.299 - turn)"' in text and "not finite" in text
    run = flexmb.load_result(tmp_path / "result.h5")
    assert (run.status, len(run.time)) == ("failed", 30)
    assert run.message in text
    np.testing.assert_allclose(run["tip.x"], R * np.cos(2 * run.time), atol=1e-9)


def test_a_failed_run_says_how_it_was_assembled(tmp_path: Path) -> None:
    """A driver that begins elsewhere moves bodies: that may be why the run fails."""
    model = arm("0.5 + 2*t")
    model.add_sensor("turn", "angle", joint="bearing")
    model.add_force("brake", "torque", at="arm", value=[0, 0, "log(0.799 - turn)"])
    with pytest.raises(SolverError) as caught:
        flexmb.simulate(model, output=tmp_path)
    first, *others = str(caught.value).splitlines()
    assert first.startswith("at t = 0.1495 s forces.brake.value"), first
    assert any(one.startswith("note: assembled with least change; moved: arm") for one in others)


@pytest.mark.seconds
def test_the_command_ends_in_2_and_says_what_is_kept(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(
        "[bodies.arm]\nmass = 1\ninertia = [1, 1, 1]\nmarkers.tip = { position = [0.2, 0, 0] }\n"
        '[joints.bearing]\ntype = "revolute"\nbetween = ["ground", "arm"]\naxis = "z"\n'
        '[drivers.motor]\njoint = "bearing"\nangle = "2*t"\n'
        '[sensors.turn]\ntype = "angle"\njoint = "bearing"\n[forces.brake]\ntype = "torque"\n'
        'at = "arm"\nvalue = [0, 0, "sqrt(0.1995 - turn)"]\n'
        '[sensors.tip]\ntype = "position"\nof = "arm.tip"\n'
        "[dynamics]\nduration = 0.2\nstep = 1e-3\noutputs = 40\n[view]\ntime = 0.15\n"
    )
    out = tmp_path / "out"
    done = CliRunner().invoke(app, ["run", str(scene), "-o", str(out)])
    assert done.exit_code == 2, done.output
    assert "Traceback" not in done.output
    message = done.stderr.partition("error: ")[2].strip()
    assert len(message.splitlines()) == 1
    assert "forces.brake.value" in message and '"sqrt(0.1995 - turn)" is nan' in message
    assert f"{out / 'result.h5'} keeps the 20 outputs until then" in message
    assert (out / "picture.png").exists()


def test_a_mechanism_pulled_beyond_its_reach(tmp_path: Path) -> None:
    x = np.sqrt(L**2 - R**2)
    with pytest.raises(SolverError, match="joints.crank_pin|joints.wrist_pin|body") as caught:
        flexmb.simulate(pulled_slider(float(x), R), output=tmp_path)
    assert "Newton's method does not converge" in str(caught.value)
    run = flexmb.load_result(tmp_path / "result.h5")
    stretched = (R + L - x) / 0.5
    assert stretched - 0.02 < run.time[-1] < stretched
    assert run.drift[:, 0].max() < 1e-6


@pytest.mark.parametrize("accuracy", [1e-4, 1e-6])
@pytest.mark.parametrize("method", ["auto", "radau", "explicit-rk"])
@pytest.mark.parametrize(
    ("angle", "when"),
    [
        ("3*t", lambda turn: turn / 3.0),
        ("t**2/2", lambda turn: np.sqrt(2.0 * turn)),
        ("1.2*sin(2*t)", lambda turn: np.arcsin(turn / 1.2) / 2.0),
    ],
    ids=["even", "faster and faster", "swing"],
)
def test_a_driver_beyond_the_reach_is_named(angle, when, method, accuracy) -> None:
    """A rod of 0.4 m lets a crank of 0.5 m turn until it stands upright upon the guide.

    Speeds are without bounds there, like (t* - t)^(-1/2). With 1e-6 the steps shrank until the time
    stood still, 99 999 of them, and were told by their number.
    """
    model = slider_crank(0.5, 0.4, crank=0.3)
    model.add_driver("motor", joint="main", angle=angle)
    model.add_sensor("slider", "position", of="slider")
    model.set_dynamics(duration=2, outputs=50, accuracy=accuracy, method=method)
    with pytest.raises(SolverError) as caught:
        flexmb.simulate(model)
    text = str(caught.value)
    reached = when(np.arcsin(0.4 / 0.5) - 0.3)
    assert float(text.split()[3]) == pytest.approx(reached, abs=1e-4)
    assert "the mechanism reaches a singular pose (a dead point, or the limit of its reach)" in text
    assert "beyond which drivers.motor cannot lead it" in text


def test_a_gap_that_no_small_motion_narrows_is_no_assembly() -> None:
    """All links in line and the slider too near: the mechanism must buckle, but either way."""
    with pytest.raises(AssemblyError, match="cannot be assembled") as caught:
        model = pulled_slider(R + L, 0.0)
        model.drivers.clear()
        model.add_driver("pull", joint="guide", stroke=R + L - 0.05)
        flexmb.simulate(model)
    assert "stays open by 0.01667 m" in str(caught.value)


def test_rows_of_a_mechanism_that_came_apart_are_left_out() -> None:
    compiled = compile_system(arm("t"))
    layout = compiled.layout
    rows = OutputBlock(
        np.zeros(5), np.zeros((5, layout.nq)), np.zeros((5, layout.nv)),
        *(np.zeros((5, 1)) for _ in range(6)),
    )  # fmt: skip
    rows.q[:, 3] = 1.0
    assert n_closed(compiled, rows) == 5
    rows.q[3:, 0] = 2e-3 * compiled.length
    rows.drift[3:] = 2e-3 * compiled.length
    assert n_closed(compiled, rows) == 3
    assert len(rows.part(0, 3).t) == 3
    gaps = np.zeros(compiled.layout.nc)
    gaps[1] = -0.02
    text = open_joint(compiled, gaps, 0.5)
    assert "at t = 0.5 s" in text and "joints.bearing: place y is off by 0.02 m or rad" in text


def test_forces_of_a_flexible_body_that_overflow_find_no_equilibrium(tmp_path: Path) -> None:
    """Of the stiffness that they have at the first pose no frequency can be told."""
    beam = reduce(
        line(4, end=(1, 0, 0)), modes=2, interfaces={"root": "root", "tip": "tip"},
        material="steel", sections={"all": rectangle(0.02, 0.01)},
    )  # fmt: skip
    model = flexmb.Model("beam")
    model.add_body("beam", beam)
    model.add_joint("root", "fixed", between=["ground", "beam.root"])
    model.add_force("push", "force", at="beam.tip", value=[0, "1/(t + 1e-300)", 0])
    with pytest.raises(AssemblyError, match=r"no elastic equilibrium .* or begin slower$"):
        flexmb.simulate(model, duration=0.01, start="quasi-static", output=tmp_path)
