"""What linearised modes of bodies that turn tell of stiffening and inertia coupling left out.

Truth is Ritz' method with polynomials w(x) of a rotating Bernoulli blade, of the energies
∫ EI w''² + N w'² dx and ∫ ρA w² dx with N = ρA Ω² (L² - x²)/2, less ρA Ω² w² in the plane of
rotation: 13.1702 and 5.4271 at speed 12 (Wright et al., J. Appl. Mech. 49 (1982) 197).
"""

from __future__ import annotations

import re
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from femeshes import line
from flexiblescenes import STEEL, rod
from numpy.polynomial import Polynomial
from scipy.linalg import eigh
from shellkit import sheet

import flexmb
from flexmb.analysis.assembly.initial_state import StartValues
from flexmb.analysis.linear.linearization import ModeSweep
from flexmb.analysis.validity.validity_monitor import _without_vibrations
from flexmb.engine.compile import compile_system
from flexmb.fe import rectangle, reduce, shell
from flexmb.model import Model
from flexmb.workflow.linearize import sweep_modes

E, DENSITY = 7e10, 2700.0
FLAT, SQUARE = (0.05, 0.01), (0.02, 0.02)  # in the plane of rotation, and across
FORCES = "Coriolis and centrifugal forces"


def ritz(section, speed, terms=10):
    """Natural frequencies [Hz] of a blade of unit length at a speed over √(EI/ρA)/L²."""
    wide, thick = section
    powers = [Polynomial([0] * k + [1]) for k in range(2, terms + 2)]
    spin = unit_speed(section) * speed
    pull = DENSITY * wide * thick * spin**2

    def products(order, factor):
        return np.array([
            [(a.deriv(order) * b.deriv(order) * factor).integ()(1.0) for b in powers]
            for a in powers
        ])  # fmt: skip

    M = products(0, DENSITY * wide * thick)
    every = []
    for height, width, softens in ((thick, wide, 0.0), (wide, thick, 1.0)):
        K = products(2, E * width * height**3 / 12) + products(1, Polynomial([0.5, 0, -0.5]) * pull)
        squares = eigh(K - softens * spin**2 * M, M, eigvals_only=True)
        every += list(np.sqrt(squares[:3]) / (2 * np.pi))
    return np.array(every)


def unit_speed(section):
    return float(np.sqrt(E * section[1] ** 2 / 12 / DENSITY))


def rotor(section, speed, blades=1, modes=12, body=None, **words):
    """Blades on a hub that turns with a speed over √(EI/ρA)/L²."""
    stiffening = words.setdefault("geometric_stiffening", "none")
    model = Model("rotor", gravity=[0, 0, 0])
    model.add_body("hub", mass=5.0, inertia=[1.0, 1.0, 1.0])
    model.add_joint("axle", "revolute", between=["ground", "hub"])
    for k in range(blades):
        turn = 2 * np.pi * k / blades
        part = body or reduce(
            line(16, end=(np.cos(turn), np.sin(turn), 0.0)), modes=modes,
            material={"E": E, "nu": 0.3, "density": DENSITY},
            sections={"all": rectangle(*section, shear=False)},
            interfaces={"root": "root", "tip": "tip"}, geometric_stiffening=stiffening,
        )  # fmt: skip
        model.add_body(f"blade{k}", part, **words)
        model.add_joint(f"weld{k}", "fixed", between=["hub", f"blade{k}.root"])
    model.add_driver("spin", joint="axle", angle=f"{float(unit_speed(section) * speed)!r} * t")
    return model


def linearized(model):
    """Frequencies, and what is told of them: words, frequency [Hz], error."""
    with warnings.catch_warnings(record=True) as every:
        warnings.simplefilter("always")
        made = flexmb.linearize(model)
    return made.frequencies, sentences(str(one.message) for one in every)


def sentences(notes):
    """What notes tell of frequencies."""
    told = []
    for text in notes:
        pattern = r"frequency(?:, (\S+) Hz,)? is too (low|high) by about (\S+) %"
        match = re.search(pattern, text)
        if "is left out" in text and "deflection" not in text:
            hertz, sign, percent = match.groups()
            error = float(percent) / (100 if sign == "high" else -100)
            told.append((text, float(hertz or np.nan), error))
    return told


def shaken(model, duration=0.5):
    """What a run tells of frequencies as the tip of a blade is shaken in both directions."""
    push = "step(t, 0, 0, 0.02, 1)"
    model.add_force("push", "force", at="blade0.tip", value=[0, push, push])
    model.set_validity(speed="any", load_factor="any", inertia_loads="any")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = flexmb.simulate(model, duration=duration, outputs=100, accuracy=1e-3, verify=False)
    return sentences(run.notes)


def nearest(values, one):
    return values[np.abs(values / one - 1).argmin()]


@pytest.mark.parametrize(("share", "frame"), [
    (0.2, "interface root"), (0.5, "mean axis"), (0.5, "interface root"), (0.5, "interface tip"),
    (0.85, "mean axis"), (0.85, "interface root"),
])  # fmt: skip
def test_a_blade_without_stiffening_tells_its_frequency(share, frame):
    """Shares of the first frequency at rest; nothing was told."""
    speed = share * 1.8751**2
    hertz, [(text, own, error)] = linearized(rotor(FLAT, speed, frame=frame))
    assert "geometric stiffening is left out" in text and FORCES not in text
    true = ritz(FLAT, speed)
    corrected = own / (1 + error)
    assert corrected == pytest.approx(nearest(true, corrected), rel=0.01)
    low = np.sort(true)[:3] / np.sort(hertz)[:3] - 1  # it is the largest of the low ones
    assert abs(error) == pytest.approx(np.max(1 - 1 / (1 + low)), rel=0.1, abs=2e-3)


CONSTANT = {"geometric_stiffening": "full", "inertia_coupling": "constant"}


@pytest.mark.seconds
@pytest.mark.parametrize(("share", "frame", "words"), [
    (0.2, "mean axis", {}), (0.3, "mean axis", {}), (0.5, "mean axis", {}), (1.1, "mean axis", {}),
    (0.1, "interface root", {}), (0.3, "interface root", {}), (0.85, "interface root", {}),
    (0.3, "interface tip", {}),
    (0.14, "interface root", CONSTANT), (0.28, "interface root", CONSTANT),
    (0.57, "interface root", CONSTANT), (0.57, "mean axis", CONSTANT),
    (0.57, "interface root", {**CONSTANT, "inertia_coupling": "partial"}),
])  # fmt: skip
def test_a_run_tells_how_wrong_its_frequencies_are(share, frame, words):
    """In mean axes 2.4 %, 5.4 % and 15 % were told of the first three, for 0.5, 1.2 and 3.3 %, of
    inertia coupling nothing."""
    speed, true = share * 1.8751**2, ritz(SQUARE, share * 1.8751**2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        hertz = flexmb.linearize(rotor(SQUARE, speed, frame=frame, **words)).frequencies
    errors = np.sort(hertz)[:2] / np.sort(true)[:2] - 1
    largest = errors[np.abs(errors).argmax()]
    told = shaken(rotor(SQUARE, speed, frame=frame, **words))
    assert bool(told) == (abs(largest) > 0.01)
    for text, own, error in told:
        assert ("geometric stiffening is left out" in text) == (not words)
        assert (FORCES in text) == bool(words)
        assert own / (1 + error) == pytest.approx(nearest(true, own / (1 + error)), rel=0.015)
        assert error == pytest.approx(largest, rel=0.15)


@pytest.mark.parametrize(("width", "frame", "factor"), [
    (0.6, "mean axis", 1.1), (0.6, "interface root", 1.1), (1.0, "interface root", 1.5),
])  # fmt: skip
def test_a_plate_tells_its_frequency(width, frame, factor):
    """Flap of a blade of shells, which bends as a beam; of a square its speed alone tells it."""
    section, speed = (width, 0.01), 0.6 * 1.8751**2

    def points(st):
        return np.stack([st[:, 0], width * (st[:, 1] - 0.5), 0.0 * st[:, 0]], axis=1)

    body = reduce(sheet((12, 8), shape=points), modes=12, sections={"all": shell(0.01)},
                  material={"E": E, "nu": 0.0, "density": DENSITY},
                  interfaces={"root": "x0", "tip": "x1"})  # fmt: skip
    hertz, [(_, _, error)] = linearized(rotor(section, speed, body=body, frame=frame))
    exact = 1 - hertz.min() / ritz(section, speed).min()
    assert exact / factor < -error < exact * factor


def test_each_blade_of_three_tells_it():
    speed = 0.5 * 1.8751**2
    _, told = linearized(rotor(FLAT, speed, blades=3, modes=8, frame="interface root"))
    assert [text.partition(" ")[0] for text, *_ in told] == [f"bodies.blade{k}" for k in range(3)]
    for _, own, error in told:
        assert own / (1 + error) == pytest.approx(ritz(FLAT, speed).min(), rel=0.01)


def test_a_motion_that_softening_takes_is_told():
    """In a frame at its tip three motions of the blade diverge at 0.85 of its frequency."""
    with pytest.warns(flexmb.FlexmbWarning, match="a motion does not vibrate as it does with all"):
        flexmb.linearize(rotor(FLAT, 0.85 * 1.8751**2, frame="interface tip"))


@pytest.mark.parametrize(("speed", "frame"), [
    (4.0, "mean axis"), (12.0, "mean axis"), (2.0, "interface root"), (4.0, "interface root"),
])  # fmt: skip
def test_constant_coupling_tells_what_coriolis_and_centrifugal_forces_change(speed, frame):
    words = {"geometric_stiffening": "full", "inertia_coupling": "constant", "frame": frame}
    _, [(text, own, error)] = linearized(rotor(SQUARE, speed, **words))
    assert FORCES in text and "stiffening is left out" not in text
    corrected = own / (1 + error)
    assert corrected == pytest.approx(nearest(ritz(SQUARE, speed), corrected), rel=0.015)
    assert abs(error) > 0.02


def test_a_sweep_tells_each_lack_once():
    """Sentences were told apart by what stands before a colon: a speed, or a body alone."""
    bound, error = (f"bodies.blade0: its {what} is too high by " for what in ("load", "frequency"))
    notes = [(f"{bound}0.9",), (f"{bound}0.95", f"{error}3 %")]
    stubs = tuple(SimpleNamespace(notes=one) for one in notes)
    sweep = ModeSweep("load", np.array([1.0, 2.0]), np.zeros((2, 0)), np.zeros(2), stubs)
    assert sweep.notes == (f"load = 1: {bound}0.9", f"load = 2: {error}3 %")
    sweep = sweep_modes(lambda speed: rotor(FLAT, speed), "speed", [0.0, 1.8, 2.2, 2.6])
    (told,) = sweep.notes
    assert told.startswith("speed = 1.8: bodies.blade0 turns with ")


def test_a_frequency_that_is_wrong_altogether_is_told_without_a_number():
    words = {"geometric_stiffening": "full", "inertia_coupling": "constant"}
    model, true = rotor(SQUARE, 12.0, frame="interface root", **words), ritz(SQUARE, 12.0).min()
    with pytest.warns(flexmb.FlexmbWarning, match="more than twice that with all terms"):
        hertz = flexmb.linearize(model).frequencies
    assert hertz.min() > 2.0 * true


def test_both_are_told_where_both_are_left_out():
    words = {"inertia_coupling": "constant", "frame": "interface tip"}
    _, [(text, own, error)] = linearized(rotor(SQUARE, 1.0, **words))
    assert FORCES in text and "geometric stiffening is left out" in text
    corrected = own / (1 + error)
    assert corrected == pytest.approx(nearest(ritz(SQUARE, 1.0), corrected), rel=0.01)


@pytest.mark.parametrize(("speed", "words"), [
    (0.2 * 1.8751**2, {}), (1.0, {"inertia_coupling": "constant"}),
    (1.0, {"inertia_coupling": "partial"}),
    (12.0, {"geometric_stiffening": "full"}),
    (12.0, {"geometric_stiffening": "full", "inertia_coupling": "partial"}),
    (1.0, {"geometric_stiffening": "full", "inertia_coupling": "constant"}),
])  # fmt: skip
def test_nothing_is_told_of_frequencies_that_are_right(speed, words):
    hertz, told = linearized(rotor(SQUARE, speed, **words))
    assert not told
    true = np.sort(ritz(SQUARE, speed))[:4]
    assert np.sort(hertz)[:4] == pytest.approx(true, rel=0.02)


def test_a_free_motion_has_no_frequency_that_could_be_wrong():
    """Of a free body between two wings 3e-6 Hz were "too low by about 16 %" within 0.75 s."""
    made = Model("two wings")
    made.add_body("body", mass=219, inertia=[14.6] * 3)
    for name, sign in (("right", 1.0), ("left", -1.0)):
        turned = {"axis": "z", "angle": 0.0 if sign > 0 else np.pi}
        made.add_body(
            name, mesh={"type": "plate", "length": 2.0, "width": 0.41, "divisions": [8, 3]},
            sections={"surface": {"type": "shell", "thickness": 0.0486}}, material="aluminium",
            interfaces={"root": "x0", "tip": "x1"}, modes=5, inertia_coupling="constant",
            orientation=turned,
        )  # fmt: skip
        made.add_marker(f"body.{name}", orientation=turned)
        made.add_joint(name, "revolute", between=[f"body.{name}", f"{name}.root"], axis="y")
        made.add_driver(name, joint=name, angle=f"{0.5 * sign} * sin(10*t)*step5(t,0,0,0.31,1)")
    made.set_dynamics(duration=0.75, outputs=100, accuracy=1e-4, verify=False)
    assert not [note for note in flexmb.simulate(made).notes if "frequency" in note]


def pulled(*forces):
    """Bars beside each other between pins, each with a force along it."""
    model = Model("bars", gravity=[0, 0, 0])
    body = reduce(
        line(16), modes=12, material={"E": E, "nu": 0.3, "density": DENSITY},
        sections={"all": rectangle(*FLAT, shear=False)}, interfaces={"root": "root", "tip": "tip"},
    )  # fmt: skip
    for k, force in enumerate(forces):
        name = f"bar{k}"
        for end, x in (("root", 0), ("tip", 1)):
            model.add_marker(f"ground.{end}{k}", position=[x, k, 0])
        model.add_body(name, body, position=[0, k, 0])
        ends = ([f"ground.{end}{k}", f"{name}.{end}"] for end in ("root", "tip"))
        model.add_joint(f"left{k}", "universal", between=next(ends), axis="y", second_axis="z")
        model.add_joint(f"right{k}", "in-line", between=next(ends), axis="x")
        model.add_force(f"load{k}", "force", at=f"{name}.tip", value=[force, 0, 0])
    return model


EULER = np.pi**2 * E * FLAT[0] * FLAT[1] ** 3 / 12


@pytest.mark.parametrize("force", [1000.0, -1000.0])
def test_a_bar_under_an_axial_force_tells_its_frequency(force):
    """Between pins frequencies are by √(1 + F L²/(n² π² EI)) those without a force."""
    hertz, [(text, own, error)] = linearized(pulled(force))
    assert "turns" not in text and own == pytest.approx(hertz[0], rel=1e-3)
    assert 1 + error == pytest.approx((1 + force / EULER) ** -0.5, rel=0.01)


def test_a_bar_is_told_beside_one_that_has_no_such_frequency():
    """Of the second one nothing was told as the first was buckled."""
    notes = flexmb.linearize(pulled(-1.2 * EULER, -0.5 * EULER)).notes
    told = {note.partition(":")[0]: note for note in notes if "is left out" in note}
    assert "is none with all terms" in told["bodies.bar0"]
    percent = float(told["bodies.bar1"].split("too high by about ")[1].split(" %")[0])
    assert percent == pytest.approx(100 * (0.5**-0.5 - 1), rel=0.02)


@pytest.mark.parametrize(("share", "modes"), [(3.0, 1), (8.5, 1), (8.5, 2), (8.5, 4), (3.0, 8)])
def test_a_fast_blade_tells_which_modes_it_lacks(share, modes):
    """Fields that were left out had no mass: 7.4, 94, 94 and 12 % were told."""
    speed = share * 1.8751**2
    made = flexmb.linearize(rotor(SQUARE, speed, modes=modes, geometric_stiffening="full"))
    error = 100 * (made.frequencies.min() / ritz(SQUARE, speed).min() - 1)
    told = [note for note in made.notes if "its modes do not answer" in note]
    assert bool(told) == (error > 2.0)
    for note in told:
        assert float(note.split("by ")[-1].split(" %")[0]) == pytest.approx(error, rel=0.2)


def test_a_blade_of_one_mode_runs():
    """In a frame at its root it ended with a traceback, "index 1 is out of bounds"."""
    body = reduce(
        line(16), modes=1, material={"E": E, "nu": 0.3, "density": DENSITY},
        sections={"all": rectangle(*SQUARE, shear=False)}, interfaces={"root": "root"},
        load_points=[16], geometric_stiffening="full",
    )  # fmt: skip
    words = {"geometric_stiffening": "full", "frame": "interface root"}
    made = flexmb.linearize(rotor(SQUARE, 0.2, body=body, **words))
    assert np.abs(made.frequencies / ritz(SQUARE, 0.2)[[0, 3]].max() - 1).min() < 0.01


def test_the_state_without_vibrations_leaves_that_of_the_run():
    """Its modal velocities were set to zero in the rows that the monitor keeps."""
    model = rotor(SQUARE, 1.0, modes=2)
    compiled = compile_system(model)
    v = np.zeros(compiled.layout.nv)
    v[-2:] = 0.1
    begin = StartValues(compiled.initial_q, v.copy())
    made = _without_vibrations(compiled, model, begin, "blade0")
    assert np.abs(made.state.v[-2:]).max() < 1e-6
    np.testing.assert_array_equal(begin.v, v)


@pytest.mark.parametrize("share", [0.25, 0.7])
def test_a_light_arm_with_a_heavy_block_tells_its_frequency(share):
    """Its tip vibrates with ω² + 0.2 Ω², of which ω² - Ω² are left, as 1.2 m Ω² is its tension."""
    L, h, b = 1.0, 0.01, 0.03
    light, E_arm = 0.02, 7e10
    omega = np.sqrt(3 * E_arm * b * h**3 / 12 / (light * 50 * L**3))
    model = Model("arm")
    model.add_body(
        "arm", mesh={"type": "beam", "length": L, "divisions": 10}, modes=4, stress="none",
        material={"E": E_arm, "nu": 0.3, "density": light / (L * h * b)},
        sections={"all": {"type": "rectangle", "y": h, "z": b}},
            interfaces={"root": "start", "tip": "end"}, frame="interface root",
    )  # fmt: skip
    model.add_body("block", mass=light * 50, inertia=[1e-4 * light] * 3, position=[L, 0, 0])
    model.add_joint("hub", "revolute", between=["ground", "arm.root"], axis="z")
    model.add_joint("grip", "fixed", between=["arm.tip", "block"])
    turn = f"{share * omega}*step5(t, 0, 0, {6 / omega}, 1)"
    model.add_driver("motor", joint="hub", angle=turn, prescribes="velocity")
    model.set_validity(deflection="any", rotation="any")
    run = flexmb.simulate(model, duration=20 / omega, outputs=300, accuracy=1e-4, verify=False)
    (note,) = [one for one in run.notes if "stiffening is left out" in one]
    told = float(re.search(r"too low by about ([\d.]+) %", note)[1]) / 100
    assert told == pytest.approx(1 - np.sqrt((1 - share**2) / (1 + 0.2 * share**2)), rel=0.1)


def hung(**sensor):
    """A thin rod that hangs from a ball joint, a load of 5 kg at its end, which is pushed."""
    model = Model("hung", gravity=[9.81, 0, 0])
    model.add_body("rod", rod(0.004, 2.0, 20, 4))
    model.add_body("bob", mass=5.0, inertia=[0.01] * 3, position=[2.0, 0, 0])
    model.add_joint("hang", "spherical", between=["ground", "rod.root"])
    model.add_joint("tip", "fixed", between=["rod.tip", "bob"])
    pushed = {"type": "step5", "t0": 0, "t1": 0.5, "y0": 5.0, "y1": 0.0}
    model.add_force("push", "force", at="bob", value=[0, pushed, 0])
    model.add_sensor("sensor", **sensor)
    model.set_dynamics(duration=3.0, outputs=300, accuracy=1e-4, method="radau", verify=False)
    return model


def test_a_rod_under_tension_tells_its_frequency():
    """Beside the run of its forces, by Ritz' method; its place hardly changes."""
    powers = [Polynomial([0] * k + [1]) for k in range(1, 10)]
    stiff, mass, end = STEEL["E"] * 0.004**4 / 12, STEEL["density"] * 0.004**2, 2.0
    pull = 9.81 * Polynomial([5.0 + mass * end, -mass])

    def matrix(inside, outside):
        made = [[inside(a, b).integ()(end) + outside(a, b) for b in powers] for a in powers]
        return np.array(made)

    K = matrix(
        lambda a, b: stiff * a.deriv(2) * b.deriv(2) + pull * a.deriv() * b.deriv(), lambda *_: 0.0
    )
    M = matrix(
        lambda a, b: mass * a * b,
        lambda a, b: 5.0 * a(end) * b(end) + 0.01 * a.deriv()(end) * b.deriv()(end),
    )
    truth = np.sqrt(eigh(K, M, eigvals_only=True)[1]) / (2 * np.pi)
    model = hung(type="reaction", joint="hang")
    (note,) = [one for one in flexmb.simulate(model).notes if "stiffening is left out" in one]
    hertz, low = map(float, re.search(r"frequency, ([\d.]+) Hz, is too low by about ([\d.]+) %",
                                      note).groups())  # fmt: skip
    assert hertz / (1 - low / 100) == pytest.approx(truth, rel=0.02) and "turns" not in note
    notes = flexmb.simulate(hung(type="position", of="bob")).notes
    assert not [one for one in notes if "stiffening" in one]


def test_modes_keep_their_columns_where_two_rates_become_one_vibration():
    """A free mass that a spring takes hold of, beside one of 2 Hz."""

    def pair(stiffness):
        model = Model("pair")
        for k, (name, spring) in enumerate((("one", stiffness), ("two", (4 * np.pi) ** 2))):
            model.add_body(name, mass=1.0, inertia=[0.1] * 3, position=[0, k, 0])
            model.add_marker(f"ground.{name}", position=[0, k, 0])
            ends = [f"ground.{name}", name]
            model.add_joint(name, "prismatic", between=ends, axis="x")
            if not spring:
                continue
            model.add_force(f"{name}s", "translational-spring-damper", joint=name, stiffness=spring)
        return model

    made = sweep_modes(pair, "stiffness", [0.0, 1.0])
    whole = made.frequencies[:, made.frequencies[0] > 0.0]
    assert whole[:, 0] == pytest.approx([2.0, 2.0])
