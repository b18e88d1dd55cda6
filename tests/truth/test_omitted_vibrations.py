"""What vibrations would do beside quasi-static modes, or across the line of a sensor: shock
spectra, and runs that have them."""

from __future__ import annotations

import re

import numpy as np
import pytest
from flexiblescenes import BEAM_PERIOD, flexible_crank, four_bar_with_a_beam, rod
from truth.test_effects import cantilever

import flexmb
from flexmb.analysis.validity.omitted_vibrations import OmittedVibrationMonitor, VibrationResponse
from flexmb.errors import FlexmbWarning, SolverError
from flexmb.model import Model
from flexmb.model.flexible_body import DeformationSpec
from flexmb.model.scenes.effects import with_words

pytestmark = pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")


def omitted(made, **knobs):
    """What a run says that vibrations would change of the deformation, as a share; 0: nothing."""
    with pytest.warns(FlexmbWarning) as told:
        flexmb.simulate(made, accuracy=1e-3, verify=False, **knobs)
    texts = [str(one.message) for one in told if "leave out vibrations" in str(one.message)]
    share = re.search(r"the deformation would differ by (\d+)%", "".join(texts))
    return float(share[1]) / 100 if share else 0.0, "".join(texts)


def pushed(load, deformation):
    made = cantilever(deformation=deformation)
    del made.forces["load"]
    made.add_force("load", "force", at="beam.tip", value=[0, load, 0])
    return made


def difference(load, duration):
    """Of all deformation with and without vibrations, in the energy norm, over the largest."""
    shapes = []
    for deformation in ("dynamic", "quasi-static"):
        made = pushed(load, deformation)
        knobs = {"duration": duration, "outputs": 400, "method": "radau", "verify": False}
        result = flexmb.simulate(made, accuracy=1e-4, **knobs)
        shapes.append(result.q[:, 7:])
    K = rod(0.01, 1.0, 20, 16).K
    size = [np.einsum("ti,ij,tj->t", e, K, e).max() for e in (shapes[0] - shapes[1], shapes[1])]
    return np.sqrt(size[0] / size[1])


@pytest.mark.seconds
@pytest.mark.parametrize("load", ["10*sin(30*t)", "10*sin(6*t)"])
def test_a_run_says_what_vibrations_are_missing(load):
    """Forces at 0.57 and 0.11 of the first frequency that come at once, with a slope."""
    share, text = omitted(pushed(load, "quasi-static"), duration=0.6, outputs=60)
    assert f"from {1 / BEAM_PERIOD:.2f}" in text and 'deformation = "automatic"' in text
    assert share == pytest.approx(min(difference(load, 0.6), 1.0), rel=0.1, abs=0.01)
    assert omitted(pushed(load, "automatic"), duration=0.6, outputs=60) == (0, "")


@pytest.mark.parametrize("periods", [0.1, 0.5, 0.9, 1.0, 1.3, 2.0, 3.4, 5.0])
def test_what_a_ramp_leaves_out_is_its_shock_spectrum(periods):
    """Of one vibration; 1/(ωT) while a ramp rises, 2 sin(ωT/2)/(ωT) behind it."""
    omega, x = np.array([7.0]), 2 * np.pi * periods
    h = x / 7.0
    for pieces in (1, 40):
        made, most = VibrationResponse(omega), 0.0
        line = np.array([1.0 / h])
        for k in range(pieces):
            ends = np.array([k / pieces]), np.array([(k + 1) / pieces])
            most = max(most, abs(made.follow(h / pieces, *ends, (line, line))[0]))
        one = np.array([1.0])
        most = max(most, abs(made.follow(1.0, one, one, (0 * line, 0 * line))[0]))
        exact = max(2 * abs(np.sin(x / 2)) / x, 1.0 / x if x > np.pi / 2 else 0.0)
        assert most == pytest.approx(exact, rel=0.05, abs=0.005)


@pytest.mark.parametrize("periods", [0.2, 0.5, 1.0, 1.5, 3.0])
def test_what_a_half_sine_leaves_out_is_its_shock_spectrum(periods):
    """It leaves 2 r cos(π/2r)/(1 − r²), r the frequency of the sine over that of the vibration."""
    omega, length = 7.0, 2 * np.pi * periods / 7.0
    w = np.pi / length
    made, t = VibrationResponse(np.array([omega])), np.linspace(0.0, length, 200)
    u, v = np.sin(w * t), w * np.cos(w * t)
    for k in range(len(t) - 1):
        made.follow(t[1], u[k : k + 1], u[k + 1 : k + 2], (v[k : k + 1], v[k + 1 : k + 2]))
    made.follow(1e-9, np.zeros(1), np.zeros(1), (np.zeros(1), np.zeros(1)))
    r = w / omega
    exact = abs(2 * r * np.cos(np.pi / (2 * r)) / (1 - r * r)) if r != 1.0 else np.pi / 2
    assert abs(made.amplitude[0]) == pytest.approx(exact, rel=0.02, abs=0.02)


def test_smooth_motion_between_rows_far_apart_leaves_nothing_out():
    """Rows a period of the vibration apart, where bends of straight lines would add up."""
    omega, slow = 100.0, 6.0
    made, t = VibrationResponse(np.array([omega])), np.arange(200) * 2 * np.pi / omega
    u, v = np.sin(slow * t) ** 4, 4 * slow * np.sin(slow * t) ** 3 * np.cos(slow * t)
    most = 0.0
    for k in range(len(t) - 1):
        ends, rates = (u[k : k + 1], u[k + 1 : k + 2]), (v[k : k + 1], v[k + 1 : k + 2])
        most = max(most, abs(made.follow(t[1], *ends, rates)[0]))
    assert most < 0.04


def test_vibrations_of_one_frequency_are_added_with_their_phases():
    """A square beam that a step pushes along y, and a slow load along z, where its sensor is. Any
    two perpendicular directions may be those of its modes; in both the step moves it along z, and
    together it does not: 50 % of the sensor's range were told."""
    made = Model("square beam")
    made.add_marker("ground.far", position=[1.0, 0, 1e3])
    made.add_body("beam", rod(0.01, 1.0, 10, 6), deformation="quasi-static")
    made.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    load = [0, "20*t + 2*step5(t, 0.3, 0, 0.301, 1)", "0.2*t"]
    made.add_force("push", "force", at="beam.tip", value=load)
    made.add_sensor("height", "distance", between=["ground.far", "beam.tip"])
    _, text = omitted(made, duration=1.0, outputs=40)
    assert "joints.clamp by about" in text and "sensors.height" not in text


@pytest.mark.seconds
def test_reactions_that_are_round_off_are_not_told():
    """A disc that is shaken along its plane has no lateral force: 50 % of 1e-12 N were told."""
    made = Model("shaken disc")
    disc = {"type": "disk", "radius": 0.1, "inner": 0.03, "thickness": 0.02}
    made.add_body("disc", mesh={**disc, "divisions": [3, 16, 2]}, modes=16, stress="none",
                  material={"E": 3e9, "nu": 0.38, "density": 1200.0}, interfaces={"rim": "outer"},
                  deformation="quasi-static")  # fmt: skip
    made.add_body("sled", mass=2.0, inertia=[0.01] * 3)
    made.add_joint("guide", "prismatic", between=["ground", "sled"], axis="x")
    made.add_joint("weld", "fixed", between=["sled", "disc.rim"])
    made.add_driver("shake", joint="guide", stroke="0.01*sin(800*t)*step5(t, 0, 0, 0.02, 1)")
    run = flexmb.simulate(made, duration=0.06, outputs=500, accuracy=1e-3, verify=False)
    notes = " ".join(run.notes)
    assert "quasi-static" in notes and "of its range with them" not in notes


SUDDEN = {"type": "step", "t0": 0.4, "y0": 0.0, "y1": 10.0}
RAMP = "10*min(max((t - 0.1)/{span}, 0), 1)"


@pytest.mark.parametrize(
    ("load", "start", "share"),
    [
        (10, "undeformed", 1.0), (10, "quasi-static", 0.0),
        ({**SUDDEN, "t1": 0.8}, "undeformed", 0.0),
        ({**SUDDEN, "t1": 0.4001}, "undeformed", 1.0), ({**SUDDEN, "t1": 0.404}, "undeformed", 1.0),
    ],
)  # fmt: skip
def test_a_run_says_what_a_sudden_load_would_excite(load, start, share):
    """A load that comes at once moves a beam twice as far as it does in the end."""
    made = pushed(load, "quasi-static")
    told, text = omitted(made, duration=0.8, outputs=30, start=start)
    assert told == pytest.approx(share, abs=0.03)
    assert ('start = "quasi-static" begins without' in text) == (load == 10 and share > 0)


@pytest.mark.parametrize("outputs", [10, 100])
@pytest.mark.parametrize("periods", [0.5, 1.0, 1.5, 2.5, 5.0])
def test_a_run_says_what_a_ramp_would_excite(periods, outputs):
    """Nine tenths and more of the deflection are the first mode's; below 4 % nothing is told."""
    span, x = periods * BEAM_PERIOD, 2 * np.pi * periods
    knobs = {"duration": 0.1 + span + 3 * BEAM_PERIOD, "outputs": outputs}
    share, _ = omitted(pushed(RAMP.format(span=span), "quasi-static"), **knobs)
    exact = max(2 * abs(np.sin(x / 2)), 1.0) / x
    assert share == pytest.approx(exact if exact > 0.04 else 0.0, rel=0.1)


@pytest.mark.parametrize("t0", [0.5, 0.0])
@pytest.mark.parametrize(("kind", "share"), [("step", 1.0), ("step5", 0.0985)])
def test_a_driver_whose_acceleration_jumps_or_bends_leaves_vibrations_out(kind, share, t0):
    """Loads go with θ̈, which jumps to its largest value, or begins with 60/T³ over 5.77/T² ω₁."""
    made = Model("turned beam")
    made.add_body("beam", rod(0.01, 1.0, 10, 6), deformation="quasi-static")
    made.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
    made.add_driver("motor", joint="hub", angle={"type": kind, "t0": t0, "t1": t0 + 2.0, "y1": 1.0})
    told, _ = omitted(made, duration=t0 + 2.5, outputs=200)
    assert 0.95 * share < told < 2.0 * share + 0.01  # at both ends of the motion


def changed_most(made, truth):
    """Largest difference of reactions and sensors of vectors, over its range in the truth."""
    vectors = {name.rpartition(".")[0] for kind in ("reactions", "sensors")
               for name in truth.channels(kind)}  # fmt: skip
    rows = [[np.transpose([run[f"{one}.{axis}"] for axis in "xyz"]) for run in (made, truth)]
            for one in vectors]  # fmt: skip
    sizes = np.array([np.linalg.norm(np.ptp(b, axis=0)) for _, b in rows])
    apart = np.array([np.linalg.norm(a - b, axis=1).max() for a, b in rows])
    return (apart / sizes)[sizes > 1e-2 * sizes.max()].max()


@pytest.mark.parametrize(("start", "speed"), [("undeformed", 150), ("quasi-static", 150)])
def test_modes_above_a_band_leave_out_vibrations_of_reactions(start, speed):
    """The slider on the rod's stretch, begun at once; mixed modes are no kinetostatic ones."""
    knobs = {"duration": 0.042, "outputs": 1000, "start": start, "verify": False}
    runs = []
    for deformation, accuracy in (({"band": [0.0, 700.0]}, 1e-4), ("dynamic", 1e-6)):
        made = flexible_crank(deformation=deformation)
        runs.append(flexmb.simulate(made, accuracy=accuracy, method="radau", **knobs))
    apart, text = changed_most(*runs), " ".join(runs[0].notes)
    told = re.search(r"(\S+) (?:would differ )?by about ([\d.]+) % of its range with them", text)
    if start == "quasi-static":
        assert apart < 0.04 and not told
    else:
        assert apart / 2 < float(told[2]) / 100 < 2 * apart and 'start = "quasi-static"' in text


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("kind", "outputs"),
    [("step", 300), ("step5", 300), pytest.param("step", 60, marks=pytest.mark.slow)],
)
def test_vibrations_that_rows_do_not_show_are_told(kind, outputs):
    """The rocker on a coupler's stretch, 905 Hz, as the crank begins to turn at once: 4.4 % of a
    force were told for 34 %."""
    runs = []
    for word, accuracy in ((DeformationSpec(band=(0.0, 40.0)), 1e-4), ("dynamic", 1e-6)):
        made = with_words(four_bar_with_a_beam(), {"beam": {"deformation": word}})
        del made.drivers["motor"]
        made.add_driver("motor", joint="left", angle={"type": kind, "t1": 1.2, "y1": 2 * np.pi})
        runs.append(flexmb.simulate(made, accuracy=accuracy, method="radau", verify=False,
                                    duration=1.4, outputs=outputs))  # fmt: skip
    apart, text = changed_most(*runs), " ".join(runs[0].notes)
    told = re.search(r"by about ([\d.]+) % of its range with them", text)
    if kind == "step5":
        assert apart < 0.01 and not told
    else:
        assert apart / 2 < float(told[1]) / 100 < 2 * apart


@pytest.mark.seconds
def test_lateral_modes_move_a_distance_along_its_line_only():
    """A tether whose load hangs still, and whose tension stiffens the modes that it lacks: 21 749 %
    of the range of its length were told for 89 %."""
    runs = []
    for modes in (2, 12):
        made = Model("tether", gravity=[9.81, 0, 0])
        made.add_body("cart", mass=50.0, inertia=[5.0] * 3)
        made.add_body("tether", rod(0.004, 10.0, 20, modes, geometric_stiffening="full"))
        made.add_body("load", mass=20.0, inertia=[0.1] * 3, position=[10.0, 0, 0])
        made.add_joint("rail", "prismatic", between=["ground", "cart"], axis="z")
        made.add_joint("root", "spherical", between=["cart", "tether.root"])
        made.add_joint("tip", "fixed", between=["tether.tip", "load"])
        made.add_driver("shake", joint="rail", stroke="0.01*sin(6*pi*t)*min(1,t)")
        made.add_sensor("length", "distance", between=["cart", "load"])
        made.add_sensor("load", "position", of="load")
        made.set_validity(truncation="any", inertia_loads="any")
        runs.append(flexmb.simulate(made, duration=4.0, outputs=800, accuracy=1e-4, method="radau",
                                    verify=False))  # fmt: skip
    few, every = (run["load.x"] for run in runs)
    error = np.abs(few - every).max() / np.ptp(every)
    notes = " ".join(runs[0].notes)
    told = re.findall(r"(?:sensors by up to|off by about) ([\d.]+) %", notes)
    assert told and error / 3 < max(map(float, told)) / 100 < 3 * error


@pytest.mark.seconds
def test_a_load_that_bounces_on_a_rod_makes_no_growing_error():
    """Foucault's pendulum, hung undeformed, so that its tension rises and falls. Its place is
    right; the moment at its tip, where the rod vibrates with 14 Hz, is not."""
    model = Model("pendulum", gravity=[9.81, 0, 0])
    model.add_body("rod", rod(0.004, 2.0, 20, 4, geometric_stiffening="full"))
    model.add_body("earth", mass=100.0, inertia=[10.0] * 3)
    model.add_body("bob", mass=5.0, inertia=[0.01] * 3, position=[2.0, 0, 0])
    model.add_joint("day", "revolute", between=["ground", "earth"], axis="x")
    model.add_joint("hang", "spherical", between=["earth", "rod.root"])
    model.add_joint("tip", "fixed", between=["rod.tip", "bob"])
    model.add_driver("turn", joint="day", angle="0.2*t")
    pushed = {"type": "step5", "t0": 0, "t1": 0.5, "y0": 5.0, "y1": 0.0}
    model.add_force("push", "force", at="bob", value=[0, pushed, 0])
    model.add_sensor("bob", "position", of="bob", seen_from="earth")
    knobs = {"duration": 15.0, "outputs": 1500, "accuracy": 1e-5, "method": "radau"}
    notes = flexmb.simulate(model, verify=False, **knobs).notes
    assert not [note for note in notes if "for want of modes" in note and "sensors." in note]


def test_an_audit_tells_them_too(tmp_path):
    """Its rows have no reactions: it ended with a traceback."""
    made = pushed(10, "quasi-static")
    run = flexmb.simulate(made, duration=0.8, outputs=30, verify=False, output=tmp_path)
    assert "leave out vibrations" in "".join(flexmb.audit(run).notes)


def test_rows_behind_a_refusal_leave_no_trace(monkeypatch):
    """Poses of rows that are dropped stayed, so that what is told depended on the chunk."""
    monitors, begin = [], OmittedVibrationMonitor.__init__

    def record(self, *of):
        begin(self, *of)
        monitors.append(self)

    monkeypatch.setattr(OmittedVibrationMonitor, "__init__", record)
    made = pushed("100*t", "quasi-static")
    made.set_validity(deflection=0.05)
    with pytest.raises(SolverError, match="deflected") as told:
        flexmb.simulate(made, duration=0.8, outputs=80, accuracy=1e-3, verify=False)
    time = float(re.search(r"at t = ([\d.]+) s", str(told.value))[1])
    assert 0.1 < time < 0.7
    assert 0 <= max(monitors[-1]._changes) <= int(16 * time / 0.8)
