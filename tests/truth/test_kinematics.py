"""Kinematic analyses against closed forms and published values.

A kinematic analysis integrates nothing, so the tolerances are those of arithmetic: 1e-12 of the
largest value for positions, and a few digits less where poses amplify round-off.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from enginekit import executed
from femeshes import line
from linkages import four_bar_angles
from quickreturn import ram_motion
from truthkit import Memory

from flexmb.analysis.kinematics import kinematics
from flexmb.engine.compile import compile_system
from flexmb.fe import rectangle, reduce
from flexmb.model import Model

BARS = ("coupler", "rocker")
R, E, CAM_SPEED = 0.05, 0.02, 10.0  # of the cam in test_curves
TRUTH = Path(__file__).parent
NORTON = Path(__file__).parents[1] / "references" / "norton_fourbar.json"

PLANAR = """
import json
import numpy as np
from linkages import four_bar, four_bar_angles, slider_crank, swept
from quickreturn import quick_return

def keep(name, ran):
    outcome, rows, channels = ran
    assert outcome.status == "finished", outcome.message
    assert rows["drift"].max() < 1e-11
    found[name + ".t"], found[name + ".reactions"] = rows["t"], rows["reactions"]
    for channel, values in channels.items():
        found[f"{name}.{channel}"] = values

made = slider_crank(0.15, 0.45)
made.add_driver("motor", joint="main", angle="3*t + 0.5*t**2")
for kind in ("position", "velocity", "acceleration"):
    made.add_sensor(kind, kind, of="slider")
made.add_sensor("angle", "angle", joint="main")
keep("slider", swept(made, duration=2.5, outputs=6))

for kind in "ABC":
    keep(kind, swept(quick_return(kind, outputs=5)))

lengths = (1.0, 2.0, 1.5, 2.2)
for branch in (1, -1):
    coupler, rocker = four_bar_angles(lengths, 0.6, branch)
    made = four_bar(lengths, (0.6, coupler, rocker))
    made.add_driver("motor", joint="left", angle="2*pi*t")
    for name in ("left", "right"):
        made.add_sensor(name, "angle", joint=name)
    made.add_sensor("pin", "position", of="coupler.end")
    keep(f"bar{branch}", swept(made, duration=1.3, outputs=6))

from test_curves import cam
made = cam("cam-flat", axis="y", gravity=(0, -9.81, 0))
keep("cam", swept(made, duration=1.3, outputs=5))

from flexmb.model import Model

train, radii, at = Model("train", plane="xy"), [0.2, 0.1, 0.3], [0.0, 0.3, 0.7]
for k in range(3):
    train.add_body(f"w{k}", mass=1.0, inertia=[1, 1, 1], position=[at[k], 0, 0])
    train.add_marker(f"ground.p{k}", position=[at[k], 0, 0])
    train.add_joint(f"p{k}", "revolute", between=[f"ground.p{k}", f"w{k}"], axis="z")
    train.add_sensor(f"a{k}", "angle", joint=f"p{k}")
train.add_coupler("first", "gear", joints=["p0", "p1"], radii=radii[:2])
train.add_coupler("second", "gear", joints=["p1", "p2"], radii=radii[1:])
train.add_driver("motor", joint="p0", angle="8*t")
keep("train", swept(train, duration=1.0, outputs=2))

norton = json.loads(open(NORTON).read())
lengths = tuple(norton["lengths"][name] for name in ("crank", "coupler", "rocker", "ground"))
for branch, word in ((1, "open"), (-1, "crossed")):
    placed = four_bar_angles(lengths, 0.5, branch)
    made = four_bar(lengths, (0.5, *placed), units="mm-t-s")
    turn = np.radians(norton["crank"]["angle"]) - 0.5
    w, a = norton["crank"]["speed"], norton["crank"]["acceleration"]
    made.add_driver("motor", joint="left", angle=f"{turn} + {w}*t + 0.5*{a}*t**2")
    outcome, rows, _ = swept(made, duration=1e-3, outputs=1)
    q, v, vd = rows["q"][0], rows["v"][0], rows["vd"][0]
    angles = [2 * np.arctan2(q[7 * b + 6], q[7 * b + 3]) for b in (1, 2)]
    found[word] = np.array([*np.degrees(angles), v[11], v[17], vd[11], vd[17]])
"""


@pytest.fixture(scope="module")
def planar():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(TRUTH)  # for test_curves
        return executed(PLANAR.replace("NORTON", repr(str(NORTON))))


def test_slider_crank(planar):
    r, l, t = 0.15, 0.45, planar["slider.t"]  # noqa: E741
    a, w, e = 0.5 + 3 * t + 0.5 * t * t, 3 + t, 1.0
    s, c = np.sin(a), np.cos(a)
    root = np.sqrt(l * l - (r * s) ** 2)
    first = -r * s - r * r * s * c / root  # dx/da
    second = -r * c - r * r * (c * c - s * s) / root - (r * r * s * c) ** 2 / root**3
    np.testing.assert_allclose(planar["slider.position.x"], r * c + root, atol=1e-13)
    np.testing.assert_allclose(planar["slider.velocity.x"], first * w, atol=1e-12)
    expected = second * w * w + first * e
    np.testing.assert_allclose(planar["slider.acceleration.x"], expected, atol=1e-11)
    np.testing.assert_allclose(planar["slider.angle"], a - 0.5, atol=1e-12)  # counts turns


@pytest.mark.parametrize("kind", "ABC")
def test_quick_return_has_one_motion_in_three_models(planar, kind):
    position, velocity, acceleration = ram_motion(planar[f"{kind}.t"])
    np.testing.assert_allclose(planar[f"{kind}.ram_position.x"], position, atol=1e-12)
    np.testing.assert_allclose(planar[f"{kind}.ram_velocity.x"], velocity, atol=1e-11)
    np.testing.assert_allclose(planar[f"{kind}.ram_acceleration.x"], acceleration, atol=1e-10)


def test_gears_keep_their_ratio_over_turns(planar):
    turned = np.array([planar[f"train.a{k}"] for k in range(3)])
    np.testing.assert_allclose(turned[0], 8.0 * planar["train.t"], atol=1e-13)
    np.testing.assert_allclose(turned[1], -2.0 * turned[0], atol=1e-12)
    np.testing.assert_allclose(turned[2], turned[0] / 1.5, atol=1e-12)


def test_cam_with_a_flat_follower(planar):
    """y = r + e sin θ; the flat carries m (y'' + g)."""
    a = CAM_SPEED * planar["cam.t"]
    np.testing.assert_allclose(planar["cam.position.y"], R + E * np.sin(a), atol=1e-13)
    np.testing.assert_allclose(planar["cam.velocity.y"], E * CAM_SPEED * np.cos(a), atol=1e-12)
    rise = -E * CAM_SPEED**2 * np.sin(a)
    np.testing.assert_allclose(planar["cam.acceleration.y"], rise, atol=1e-11)
    on_flat = planar["cam.reactions"][:, 26]  # along the axis of the follower's marker
    np.testing.assert_allclose(on_flat, 0.5 * (rise + 9.81), atol=1e-10)


@pytest.mark.parametrize("branch", [1, -1])
def test_four_bar_by_freudenstein(planar, branch):
    lengths, crank = (1.0, 2.0, 1.5, 2.2), 0.6 + 2 * np.pi * planar[f"bar{branch}.t"]
    _, rocker = four_bar_angles(lengths, crank, branch)
    start = four_bar_angles(lengths, 0.6, branch)[1]
    turned = planar[f"bar{branch}.right"] - (rocker - start)
    np.testing.assert_allclose(np.sin(0.5 * turned), 0.0, atol=1e-12)  # whole turns apart
    end = np.array([2.2 + 1.5 * np.cos(rocker), 1.5 * np.sin(rocker)])
    pin = [planar[f"bar{branch}.pin.{axis}"] for axis in "xy"]
    np.testing.assert_allclose(pin, end, atol=1e-12)


@pytest.mark.parametrize("word", ["open", "crossed"])
def test_nortons_four_bar(planar, word):
    """Angles in degrees to two decimals, speeds to three, as printed."""
    reference = json.loads(NORTON.read_text())[word]
    found = planar[word]
    off = found[:2] - [reference["coupler"], reference["rocker"]]
    assert np.abs((off + 180.0) % 360.0 - 180.0).max() < 0.006
    if word == "open":
        printed = [reference[f"{b}_{w}"] for w in ("speed", "acceleration") for b in BARS]
        np.testing.assert_allclose(found[2:], printed, atol=6e-4)


SPATIAL = """
import numpy as np
from flexmb.engine.compile import compile_system
from flexmb.engine.compiled_calls import solve_stage
from flexmb.engine.initial_conditions import ACCELERATIONS
from flexmb.engine.allocation import new_state, new_work
from flexmb.model import Model
from linkages import swept

def shaft(made, name, direction, start):
    x = np.array(direction)
    y = np.array([0.0, 0.0, 1.0])
    made.add_body(name, mass=1.0, inertia=[0.01, 0.02, 0.03], position=start,
                  orientation=np.column_stack([x, y, np.cross(x, y)]).tolist())

made, b = Model("Hooke", gravity=[0, 0, -9.81]), 0.6
shaft(made, "input", [1, 0, 0], [0, 0, 0])
shaft(made, "output", [np.cos(b), np.sin(b), 0], [0, 0, 0])
made.add_joint("first", "revolute", between=["ground", "input"], axis=[1, 0, 0])
made.add_joint("second", "revolute", between=["ground", "output"], axis=[np.cos(b), np.sin(b), 0])
made.add_joint("cross", "universal", between=["input", "output"], axis=[0, 0, 1],
               second_axis=[-np.sin(b), np.cos(b), 0])
made.add_driver("motor", joint="first", angle="2*t")
outcome, rows, _ = swept(made, duration=3.0, outputs=6)
assert outcome.status == "finished", outcome.message
assert any("are redundant" in note for note in outcome.notes)
found["hooke.t"], found["hooke.v"] = rows["t"], rows["v"]

def crank_slider(rod):
    "Crank about z at the origin, slider along the line (x, 0.1, 0.2); the rod of length 0.6."
    made = Model("spatial", gravity=[0, 0, -9.81])
    angle = 0.4
    c, s = np.cos(angle), np.sin(angle)
    made.add_body("crank", mass=1.0, center=[0.1, 0, 0], inertia=[0.01, 0.02, 0.03],
                  orientation=[[c, -s, 0], [s, c, 0], [0, 0, 1]])
    made.add_marker("crank.pin", position=[0.2, 0, 0])
    pin = np.array([0.2 * c, 0.2 * s, 0.0])
    x = pin[0] + np.sqrt(0.36 - (0.1 - pin[1]) ** 2 - 0.04)
    made.add_body("slider", mass=2.0, inertia=[0.01] * 3, position=[x, 0.1, 0.2])
    made.add_marker("ground.guide", position=[0, 0.1, 0.2])
    made.add_joint("main", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground.guide", "slider"], axis="x")
    if rod == "link":
        made.add_joint("rod", "distance", between=["crank.pin", "slider"])
    else:
        along = (np.array([x, 0.1, 0.2]) - pin) / 0.6
        across = np.cross(along, [0, 0, 1])
        across /= np.linalg.norm(across)
        axes = np.column_stack([along, across, np.cross(along, across)])
        made.add_body("rod", mass=0.5, center=[0.3, 0, 0], inertia=[1e-3, 0.015, 0.015],
                      position=pin.tolist(), orientation=axes.tolist())
        made.add_marker("rod.end", position=[0.6, 0, 0])
        made.add_joint("ball", "spherical", between=["crank.pin", "rod"])
        made.add_joint("cross", "universal", between=["rod.end", "slider"],
                       axis=across.tolist(), second_axis=[0, 0, 1])
    made.add_driver("motor", joint="main", angle="5*t")
    for kind in ("position", "velocity", "acceleration"):
        made.add_sensor(kind, kind, of="slider")
    return made

for rod in ("link", "universal"):
    made = crank_slider(rod)
    outcome, rows, channels = swept(made, duration=1.2, outputs=5)
    assert outcome.status == "finished" and not outcome.notes, (outcome.message, outcome.notes)
    found[rod + ".t"] = rows["t"]
    for channel, values in channels.items():
        found[f"{rod}.{channel}"] = values
    compiled = compile_system(made)
    state, work = new_state(compiled.system, 9), new_work(compiled.system, 9)
    lam, vd = [], []
    for k, t in enumerate(rows["t"]):
        state.t[0], state.q[:], state.v[:] = t, rows["q"][k], rows["v"][k]
        solve_stage(compiled.system, state, work, ACCELERATIONS)
        lam.append(state.lam.copy())
        vd.append(state.vd.copy())
    found[rod + ".lam"], found[rod + ".lam_dynamics"] = rows["lam"], lam
    found[rod + ".vd"], found[rod + ".vd_dynamics"] = rows["vd"], vd

made = crank_slider("universal")
outcome, rows, channels = swept(made, duration=7e-3, outputs=7)
kinds = ("position", "velocity", "acceleration")
found["fine"] = np.array([channels[kind + ".x"] for kind in kinds])
found["energy"] = rows["energy"]

made = Model("dwell")  # at rest the speeds fall in each point, to the least number there is
made.add_body("valve", mass=1.0, inertia=[1, 1, 1])
made.add_joint("pin", "revolute", between=["ground", "valve"], axis=[1, 2, -2])
made.add_driver("motor", joint="pin", angle="havsin(t, 0, 0, 0.5, 1)")
for k in range(2):
    made.add_sensor(f"angle{k}", "angle", joint="pin", derivative=k)
outcome, _, channels = swept(made, duration=2.0, outputs=160)
assert outcome.status == "finished", outcome.message
found["dwell"] = np.array([channels["angle0"], channels["angle1"]])
"""


@pytest.fixture(scope="module")
def spatial():
    return executed(SPATIAL)


def test_universal_joint_turns_unevenly(spatial):
    """ω2/ω1 = cos β/(1 − sin²β sin²θ), θ the angle of the first yoke from the normal of the plane
    of both shafts (Hooke's joint; Shigley & Uicker, Theory of Machines and Mechanisms)."""
    theta, b = 2.0 * spatial["hooke.t"], 0.6
    speed = spatial["hooke.v"][:, 9]  # about the output shaft's own x axis
    expected = 2.0 * np.cos(b) / (1.0 - np.sin(b) ** 2 * np.sin(theta) ** 2)
    np.testing.assert_allclose(speed, expected, atol=1e-12)


def test_a_body_dwells_after_its_motion(spatial):
    phase = 2 * np.pi * np.minimum(np.linspace(0.0, 2.0, 161), 0.5)
    expected = [(1 - np.cos(phase)) / 2, np.pi * np.sin(phase)]
    np.testing.assert_allclose(spatial["dwell"], expected, atol=1e-13)


@pytest.mark.parametrize("rod", ["link", "universal"])
def test_spatial_crank_slider_closes_its_loop(spatial, rod):
    """|slider − pin| = 0.6: massless link (S–S), and rod with a spherical and a universal joint."""
    a, w = 0.4 + 5.0 * spatial[f"{rod}.t"], 5.0
    px, py = 0.2 * np.cos(a), 0.2 * np.sin(a)
    ux, uy = -py * w, px * w
    u = np.sqrt(0.36 - 0.04 - (0.1 - py) ** 2)  # x − px
    ud = (0.1 - py) * uy / u
    udd = (-(uy**2) + (0.1 - py) * (-py * w * w) - ud**2) / u
    np.testing.assert_allclose(spatial[f"{rod}.position.x"], px + u, atol=1e-13)
    np.testing.assert_allclose(spatial[f"{rod}.velocity.x"], ux + ud, atol=1e-12)
    np.testing.assert_allclose(spatial[f"{rod}.acceleration.x"], -px * w * w + udd, atol=1e-11)


@pytest.mark.parametrize("rod", ["link", "universal"])
def test_reactions_are_those_of_dynamics(spatial, rod):
    """M v̇ + Cqᵀ λ = Q, Cq v̇ = γ with the mass matrix, at the same positions and velocities."""
    lam, vd = spatial[f"{rod}.lam_dynamics"], spatial[f"{rod}.vd_dynamics"]
    np.testing.assert_allclose(spatial[f"{rod}.vd"], vd, atol=1e-10 * np.abs(vd).max())
    np.testing.assert_allclose(spatial[f"{rod}.lam"], lam, atol=1e-10 * np.abs(lam).max())


def test_rates_are_those_of_differences(spatial):
    """Six-point central rule at h = 1 ms: error h⁶x⁽⁷⁾/140 ~ 1e-15, round-off 1e-16/h."""
    x, v, a = spatial["fine"]
    for values, rates in ((x, v), (v, a)):
        d = [values[k] - values[6 - k] for k in range(3)]
        slope = (-d[0] + 9.0 * d[1] - 45.0 * d[2]) / 60e-3
        assert slope == pytest.approx(rates[3], abs=1e-11 * max(1.0, np.abs(rates).max()))


def test_the_motor_does_the_work(spatial):
    """Energy less work stays: formulas of order four over seven intervals of 0.035 rad leave
    1e-6, but for the first interval, where the trapezoidal rule leaves h³p̈/12."""
    energy = spatial["energy"]
    balance = energy[:, :4].sum(axis=1) - energy[:, 4:].sum(axis=1)
    assert np.abs(energy[-1, 4]) > 1e-3
    assert np.abs(balance - balance[0]).max() < 1e-4 * np.ptp(energy[:, 4])


@pytest.mark.parametrize(("size", "place"), [(1.0, 0.0), (1e-3, 1e3)])
def test_how_far_a_beam_that_is_kept_undeformed_would_bend(size, place):
    """By w = q L⁴/8EI under its weight and 11 p L⁴/120EI under p = ρ A α L, as it is turned."""
    L, h, E, rho, g, alpha = size, 0.02 * size, 2e11, 8000.0, 10.0, 3.0 / size
    body = reduce(
        line(8, end=(L, 0, 0)), material={"E": E, "nu": 0.0, "density": rho}, modes=4,
        interfaces={"root": "root"}, sections={"all": rectangle(h, h)}, name="beam",
    )  # fmt: skip
    model = Model("boom", gravity=[0, -g, 0])
    model.add_marker("ground.pin", position=[place, 0, 0])
    model.add_body("beam", body, position=[place, 0, 0])
    model.add_joint("hinge", "revolute", between=["ground.pin", "beam.root"], axis="z")
    model.add_driver("motor", joint="hinge", angle=f"{0.5 * alpha}*t**2")
    model.set_kinematics(duration=1e-4 * size, outputs=3)
    outcome = kinematics(compile_system(model), model, Memory())
    bending, weight = E * h**4 / 12, rho * h * h
    wanted = weight * g * L**3 / (8 * bending) + 11 * weight * alpha * L * L**3 / (120 * bending)
    shear = 1 + 3e-3
    (note,) = [note for note in outcome.notes if "undeformed" in note]
    assert float(note.split("bend it by ")[1].split()[0]) == pytest.approx(shear * wanted, rel=0.03)
    assert "bodies.beam" in note and "[dynamics]" in note
