"""Natural frequencies that are off for want of modes, in machines.

Truth: runs of the same scene with all modes that matter.
"""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from frequencykit import OMEGA, STEEL, L, beam, error, error_told_of, ran, told

from flexmb.analysis.validity.modal_basis import ModalBasisMonitor
from flexmb.analysis.validity.pose_vibrations import FrequencyDrift, PoseVibrations
from flexmb.analysis.validity.unresolved_vibrations import UnresolvedChanges, UnresolvedVibrations
from flexmb.engine.compile import compile_system
from flexmb.flexbody import load
from flexmb.model import Model
from flexmb.results.output_block import OutputBlock


def crank_from_dead_centre(modes):
    """A slider-crank that starts where the slider does not see its crank bend, and shakes it."""
    made = Model("slider-crank", gravity="none")
    rate = 0.97 * OMEGA[0]
    end = 50 * np.pi / rate
    beam(made, "crank", modes, damping=0.01, residual="none")
    made.add_body("hub", mass=1.0, inertia=[1.0] * 3)
    made.add_joint("pin", "revolute", between=["ground", "hub"], axis="z")
    made.add_joint("clamp", "fixed", between=["hub", "crank.root"])
    made.add_body("rod", mass=0.001, inertia=[1e-6, 1e-4, 1e-4], position=[2.0, 0, 0])
    made.add_marker("rod.a", position=[-1.0, 0, 0])
    made.add_marker("rod.b", position=[1.0, 0, 0])
    made.add_body("slider", mass=0.001, inertia=[1e-5] * 3, position=[3.0, 0, 0])
    made.add_joint("ab", "spherical", between=["crank.tip", "rod.a"])
    made.add_joint("bc", "revolute", between=["rod.b", "slider"], axis="z")
    made.add_marker("ground.s", position=[3.0, 0, 0])
    made.add_joint("guide", "prismatic", between=["ground.s", "slider"], axis="x")
    made.add_driver("motor", joint="pin", angle=f"0.5*t/{end}+0.004*sin({rate}*t)")
    made.add_sensor("slider", "position", of="slider")
    made.set_dynamics(duration=end, outputs=500, accuracy=1e-5)
    return made


@pytest.mark.seconds
def test_what_no_sensor_sees_in_the_first_pose_is_told_in_later_ones(tmp_path):
    few, notes = ran(crank_from_dead_centre(0), tmp_path / "few")
    full, _ = ran(crank_from_dead_centre(8), tmp_path / "full")
    (note,) = notes
    assert 0.06 < error(few, full, "slider") < told(note)
    assert told(note) == pytest.approx(error_told_of(note, few, full), rel=0.3)


def hung(modes, pull, drive="0", side=0.002):
    """A thin bar between a base and a ring that is pulled along it."""
    model = Model("string", gravity=[0, -0.5, 0])
    sections = {"all": {"type": "rectangle", "y": side, "z": side}}
    model.add_body("string", mesh={"type": "beam", "length": L, "divisions": 24}, modes=modes,
                   material=STEEL, sections=sections, geometric_stiffening="full",
                   interfaces={"root": "start", "tip": "end"})  # fmt: skip
    for name, at, axis in (("base", 0.0, "y"), ("ring", L, "x")):
        model.add_body(name, mass=0.05, inertia=[1e-5] * 3, position=[at, 0, 0])
        model.add_joint(f"{name}_rail", "prismatic", between=["ground", name], axis=axis)
    model.add_joint("root", "spherical", between=["base", "string.root"])
    model.add_joint("tip", "spherical", between=["string.tip", "ring"])
    model.add_driver("shake", joint="base_rail", stroke=drive)
    pulled = {"type": "step5", "t0": 0.0, "t1": 0.15, "y0": 0.0, "y1": pull}
    model.add_force("pull", "force", at="ring", value=[pulled, 0, 0])
    return model


@pytest.mark.seconds
@pytest.mark.parametrize("pull", [50.0, 400.0])
def test_tension_stiffens_modes_that_are_left_out(pull, tmp_path):
    """A string of 36 and 150 times Euler's load, pulled after its start: 5 and 15 Hz become 56."""
    runs = []
    for modes in (4, 20):
        model = hung(modes, pull)
        model.add_marker("string.middle", position=[L / 2, 0, 0])
        model.add_sensor("middle", "position", of="string.middle")
        model.set_dynamics(duration=0.4, outputs=800, accuracy=1e-4, method="radau", verify=False)
        runs.append(ran(model, tmp_path / str(modes)))
    (few, notes), (every, _) = runs
    error = np.abs(few["middle.y"] - every["middle.y"]).max() / np.ptp(every["middle.y"])
    assert error < 0.02
    for note in notes:
        off = error_told_of(note, few, every)
        assert 0.5 * off < told(note) < 3 * off


@pytest.mark.seconds
def test_reactions_to_a_start_are_told_their_phase(tmp_path):
    """A crank begins to turn at once, and its rod vibrates along itself: its frequency is too
    high, so that its phase is lost. Nothing was told for 8 % of a force."""

    def made(modes):
        model = Model("start", gravity=[0, -9.81, 0])
        model.add_body("crank", mass=1.0, inertia=[1e-3] * 3)
        model.add_body("slider", mass=0.5, inertia=[1e-3] * 3, position=[0.25, 0, 0])
        model.add_marker("crank.pin", position=[0.05, 0, 0])
        model.add_body(
            "rod", mesh={"type": "box", "size": [0.2, 0.01, 0.01], "divisions": [10, 2, 2]},
            material=STEEL, interfaces={"root": "x0", "tip": "x1"}, modes=modes, stress="none",
            position=[0.05, 0, 0],
        )  # fmt: skip
        model.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
        model.add_joint("pin", "revolute", between=["crank.pin", "rod.root"], axis="z")
        model.add_joint("wrist", "spherical", between=["rod.tip", "slider"])
        model.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
        model.add_driver("motor", joint="bearing", angle="300*t")
        model.add_sensor("slider", "position", of="slider")
        model.set_dynamics(duration=0.02, outputs=400, accuracy=1e-5, start="undeformed",
                           verify=False)  # fmt: skip
        return model

    few, (note,) = ran(made(6), tmp_path / "few")
    full, none = ran(made(16), tmp_path / "full")
    off = error_told_of(note, few, full)
    assert error(few, full, "slider") < 0.005 and off > 0.05
    assert 0.5 * off < told(note) < 1.5 * off


@pytest.mark.seconds
def test_modes_under_tension_do_not_depend_on_where_chunks_end(tmp_path):
    """Their frequencies had the mean tension of each chunk: 0.018 was told row by row for
    0.042 at once."""
    model = hung(4, 50.0)
    model.add_marker("string.middle", position=[L / 2, 0, 0])
    model.add_sensor("middle", "position", of="string.middle")
    model.set_dynamics(duration=0.4, outputs=800, accuracy=1e-4, method="radau", verify=False)
    result, _ = ran(model, tmp_path)
    compiled = compile_system(model, {"string": load(tmp_path / "string.flexbody.h5")})
    tables = [result.part(name, slice(None)) for name in ("q", "v", "vd", "lam")]
    sensors = np.column_stack([result[name] for name in compiled.layout.channels])
    none = np.zeros((len(result.time), 0))
    rows, values = OutputBlock(result.time, *tables, none, sensors, none, none), []
    for size in (1, 70, len(result.time)):
        basis = ModalBasisMonitor(compiled, model)
        for first in range(0, len(result.time), size):
            basis.add(rows.part(first, min(first + size, len(result.time))))
        values.append([one.value for one in basis.indicators() if one.quantity == "truncation"])
    assert values[0][0] > 1e-3
    np.testing.assert_allclose(values[0], values[2], rtol=1e-6)
    np.testing.assert_allclose(values[1], values[2], rtol=1e-6)


def falling(modes, start="undeformed", rows=200):
    """A pendulum of a thin rod with a bob that falls from level."""
    model = Model("pendulum", gravity=[0, -9.81, 0])
    beam(model, "rod", modes, height=0.01, depth=0.01, stress="none")
    model.add_body("bob", mass=1.0, inertia=[0.01] * 3, position=[L, 0, 0])
    model.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    model.add_joint("glue", "fixed", between=["rod.tip", "bob"])
    model.add_sensor("bob", "position", of="bob")
    model.set_dynamics(duration=1.0, outputs=rows, accuracy=1e-5, start=start, verify=False)
    return model


@pytest.mark.seconds
@pytest.mark.parametrize(("modes", "least"), [(2, 0.4), (6, 0.05)])
def test_vibrations_that_rows_do_not_resolve_are_told_their_phase(modes, least, tmp_path):
    """20 % of the moment at a bob were told for 45 % with two modes, and nothing for 6 % with
    six, whose vibrations of 255 Hz turn by 8 rad from row to row."""
    few, (note,) = ran(falling(modes), tmp_path / "few")
    full, _ = ran(falling(14), tmp_path / "full")
    off = error_told_of(note, few, full)
    assert "moment of joints.glue" in note and off > least
    assert 0.6 * off < told(note) < 1.5 * off


def test_what_vibrations_change_does_not_depend_on_the_size_of_a_machine(tmp_path):
    """Lengths and times 1e-5 times as large: masses of coordinates are of very different sizes, and
    a threshold of them made 3138 % of 30 %."""
    every = []
    for size in (1.0, 1e-5):
        made = Model("pendulum", gravity=[0, -9.81 / size, 0])
        made.add_body(
            "rod", mesh={"type": "beam", "length": size, "divisions": 20}, material=STEEL, modes=2,
            sections={"all": {"type": "rectangle", "y": 0.01 * size, "z": 0.01 * size}},
            interfaces={"root": "start", "tip": "end"}, stress="none",
        )  # fmt: skip
        inertia = [0.01 * size**5] * 3
        made.add_body("bob", mass=size**3, inertia=inertia, position=[size, 0, 0])
        made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
        made.add_joint("glue", "fixed", between=["rod.tip", "bob"])
        made.add_sensor("bob", "position", of="bob")
        made.set_dynamics(duration=size, outputs=200, accuracy=1e-5, verify=False)
        _, (note,) = ran(made, tmp_path / str(size))
        every.append(told(note))
    assert 0.7 < every[1] / every[0] < 1.4


@pytest.mark.parametrize("modes", [2, 6])
def test_a_deflection_that_follows_its_load_is_no_vibration(modes, tmp_path):
    assert not ran(falling(modes, "quasi-static"), tmp_path)[1]


class _Mass:
    """A body of one motion and unit mass."""

    class accelerations:
        mass = np.eye(1)

    part = slice(0, 1)


def amplitudes(phase, *motions, rows=200, interval=1e-3):
    """Those of a vibration with a phase between two rows, by functions of time: accelerations,
    rates and places."""
    t, omega, one = interval * np.arange(rows), phase / interval, np.ones((1, 1))
    vibration = UnresolvedVibrations(one, one, np.array([omega]), *[np.zeros(1)] * 2, one, one)
    layout = SimpleNamespace(bodies=(), coordinates=("x",), nq=1, nv=1)
    vd, v, q = (x(t, omega)[:, None] for x in motions)

    def changes(of, at=slice(None)):
        return of.add(layout, SimpleNamespace(t=t[at], q=q[at], vd=vd[at]), v[at], [_Mass()])

    whole, parts = changes(UnresolvedChanges()), UnresolvedChanges()
    chunks = [changes(parts, slice(k, k + 7))[:, -len(t[k : k + 7]) :] for k in range(0, rows, 7)]
    np.testing.assert_array_equal(np.hstack(chunks), whole[:, -rows:])
    return vibration.sizes(whole, interval)[20:, 0]


@pytest.mark.parametrize("phase", [1.5, 2.1, 3.0, 4.5, 8.0, 21.3])
def test_amplitudes_of_vibrations_that_rows_do_not_resolve(phase):
    """Of 2 µm beside a motion of 1 m at 3 rad/s, whose acceleration is up to 1e6 times as large."""

    def acceleration(t, omega):
        return -2e-6 * omega**2 * np.cos(omega * t) - 9.0 * np.cos(3.0 * t)

    def rate(t, omega):
        return -2e-6 * omega * np.sin(omega * t) - 3.0 * np.sin(3.0 * t)

    def place(t, omega):
        return 2e-6 * np.cos(omega * t) + np.cos(3.0 * t)

    sizes = amplitudes(phase, acceleration, rate, place)
    assert np.median(sizes) == pytest.approx(2e-6, rel=0.35)


@pytest.mark.parametrize("phase", [1.5, 3.0, 6.2, 12.6, 21.3])
def test_slow_motions_and_jumps_are_no_vibrations(phase):
    def acceleration(t, omega):
        return -9.0 * np.cos(3.0 * t) - 40.0 * np.cos(20.0 * t) + 5.0 * (t > 0.1)

    def rate(t, omega):
        return -3.0 * np.sin(3.0 * t) - 2.0 * np.sin(20.0 * t) + 5.0 * (t - 0.1).clip(0.0)

    def place(t, omega):
        return np.cos(3.0 * t) + 0.1 * np.cos(20.0 * t) + 2.5 * (t - 0.1).clip(0.0) ** 2

    follows = 40.0 / (phase / 1e-3) ** 2  # static deflection by the largest acceleration
    assert amplitudes(phase, acceleration, rate, place).max() < 0.01 * follows


@pytest.mark.parametrize("turns", [0.23, 0.47, 0.5, 0.83])
def test_a_forced_motion_that_rows_do_not_resolve_is_no_vibration(turns):
    """Rows that meet its ends see accelerations that alternate, and no velocities."""
    omega = 2.0 * np.pi * turns / 1e-3
    motions = [partial(_forced, omega, n) for n in (2, 1, 0)]
    assert not amplitudes(2.1 * omega * 1e-3, *motions).any()


def _forced(omega, derivative, t, _):
    return omega**derivative * np.cos(omega * t + derivative * np.pi / 2.0)


@pytest.mark.seconds
def test_a_driver_that_rows_meet_twice_in_a_period_excites_no_vibration(tmp_path):
    """983 % of a reaction's range were told for an error of 0.004 %."""
    made = falling(3, "quasi-static", 100)
    made.add_driver("motor", joint="hinge", angle="0.002*sin(2*pi*47*t)*step5(t, 0, 0, 0.3, 1)")
    assert not ran(made, tmp_path)[1]


@pytest.mark.parametrize("phase", [0.05, 0.3, 1.0, 1.9])
def test_slow_motions_in_another_pose_are_no_resolved_vibrations(phase):
    """Of 2 µm beside 1 mm at 3 rad/s, a motion that the vibration has in another pose: the weight
    of a trebuchet was told 11 % of its pivot's force for 2 %."""
    interval = 1e-3
    omega, t = phase / interval, interval * np.arange(-1, 400)
    values, ones = omega * np.array([1j, -1j]), np.ones((1, 2))
    inverse = 0.5 * np.column_stack([np.ones(2), 1.0 / values])
    drift = FrequencyDrift(values, ones, inverse, np.abs(values), np.full(2, 0.1), ones)
    one = np.ones((1, 1))
    pose = PoseVibrations(one, one, one, drift, values, ones, ones, ones, one, np.array([omega]))
    v = -2e-6 * omega * np.sin(omega * t) - 3e-3 * np.sin(3.0 * t)
    changes = v[1:-1] - 0.5 * (v[2:] + v[:-2])
    steps = np.full(len(t) - 2, interval)
    motions = np.array([changes, v[1:-1]])[..., None]
    limits = pose.phase_limits(steps, motions, np.zeros((2, 2)))[-1]
    np.testing.assert_allclose(limits.sum(), 0.1 * 0.399 * 2e-6, rtol=0.5)
