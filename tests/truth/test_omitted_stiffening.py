"""What geometric stiffening would change, told by runs without it, against closed forms."""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

import flexmb
from flexmb import Model
from flexmb.errors import FlexmbWarning
from tests.accuracyscenes.judging import judged

E, H, B = 210e9, 0.002, 0.02  # of a strip of 1 m, pulled along x, bent along y
EI, EA = E * B * H**3 / 12, E * B * H
LEFT_OUT = "geometric stiffening is left out"


def strip(stiffening="none", kind="beam", **options):
    mesh = {
        "beam": {"type": "beam", "length": 1.0, "divisions": 20},
        "plate": {"type": "plate", "length": 1.0, "width": B, "divisions": [20, 1]},
    }[kind]
    sections = {
        "beam": {"type": "rectangle", "y": H, "z": B},
        "plate": {"type": "shell", "thickness": H},
    }[kind]
    ends = {"beam": ("start", "end"), "plate": ("x0", "x1")}[kind]
    middle = {"beam": {"node": 10}, "plate": {"center": [0.5, 0, 0], "radius": 0.02}}[kind]
    return flexmb.reduce(
        mesh, material={"E": E, "nu": 0.0, "density": 7850}, sections={"all": sections},
        interfaces={"a": ends[0], "middle": middle, "b": ends[1]}, modes=8,
        geometric_stiffening=stiffening, name="strip", **options,
    )  # fmt: skip


def between(first, last, force=1.0, pull=0.0, place=0.0, across=1, **options):
    """A strip with these joints at its ends, pushed at its middle, and pulled at its end before."""
    model = Model("strip")
    model.add_marker("ground.first", position=[place, 0, 0])
    model.add_marker("ground.last", position=[place + 1.0, 0, 0])
    model.add_body("strip", strip(**options), position=[place, 0, 0])
    for name, joint in (("a", first), ("b", last)):
        place = {"a": "ground.first", "b": "ground.last"}[name]
        axis = {"axis": "x"} if joint in AXIAL else {}
        model.add_joint(name, joint, between=[place, f"strip.{name}"], **axis)
    push = [0, 0, 0]
    push[across] = f"{force}*step5(t, 1, 0, 2, 1)"
    model.add_force("push", "force", at="strip.middle", value=push)
    model.add_force("pull", "force", at="strip.b", value=[f"{pull}*step5(t, 0, 0, 0.5, 1)", 0, 0])
    model.add_sensor("middle", "position", of="strip.middle")
    return model


AXIAL = ("prismatic", "in-line")


def outcome(model):
    return judged(model, duration=2.2, accuracy=1e-4, verify=False)


def told(found):
    """Changes of the deflection and of a sensor, as the run tells them."""
    notes = [note for note in (*found.notes, found.message) if LEFT_OUT in note]
    if not notes:
        return None
    (note,) = notes
    words = note.split("deflection by about ")[1].split(" %")
    return float(words[0]) / 100, float(words[1].rpartition(" ")[2]) / 100


def bow(force):
    """The middle of a clamped strip with held ends: beam-column theory with its own tension."""

    def slopes(N):
        k, x = np.sqrt(N / EI), np.linspace(0, 0.5, 2001)
        return x, force / (2 * N) * (1 - np.cosh(k * (x - 0.25)) / np.cosh(k / 4))

    def excess(N):
        x, slope = slopes(N)
        return np.trapezoid(slope**2, x) - N / EA

    x, slope = slopes(brentq(excess, 1e-6, 1e7))
    return np.trapezoid(slope, x)


@pytest.mark.parametrize(("kind", "place"), [("beam", 0.0), ("beam", 1000.0), ("plate", 0.0)])
def test_a_bow_whose_ends_are_held(kind, place):
    """It may be a five-hundredth of the length, and yet be wrong by a third."""
    across = 1 if kind == "beam" else 2
    found = outcome(between("fixed", "fixed", 1.0, kind=kind, place=place, across=across))
    change = 1.0 - bow(1.0) / (1.0 / (192 * EI))
    assert change == pytest.approx(0.26, abs=0.01)
    assert told(found) == pytest.approx((change, change), rel=0.1)


def test_two_bows_in_series_pull_at_one_another():
    """Strips between walls, each pushed at its middle, whose joint may move along them only. It
    stays where it is, so that each has held ends, and a bow of one alone half of that tension."""
    model = between("fixed", "fixed", 1.0)
    model.add_body("slide", mass=0.1, inertia=[1e-3] * 3, position=[1.0, 0, 0])
    model.add_joint("guide", "prismatic", between=["ground.last", "slide"], axis="x")
    del model.joints["b"]
    model.add_body("second", strip(), position=[1.0, 0, 0])
    model.add_marker("ground.end", position=[2.0, 0, 0])
    for name, ends in (
        ("b", ["slide", "strip.b"]), ("c", ["slide", "second.a"]), ("d", ["ground.end", "second.b"])
    ):  # fmt: skip
        model.add_joint(name, "fixed", between=ends)
    push = [0, "1.0*step5(t, 1, 0, 2, 1)", 0]
    model.add_force("other", "force", at="second.middle", value=push)
    model.add_sensor("other", "position", of="second.middle")
    found = outcome(model)
    notes = [note for note in (*found.notes, found.message) if LEFT_OUT in note]
    assert len(notes) == 2
    change = 1.0 - bow(1.0) / (1.0 / (192 * EI))
    assert told(SimpleNamespace(notes=notes[:1], message="")) == pytest.approx(
        (change,) * 2, rel=0.1
    )
    assert told(SimpleNamespace(notes=notes[1:], message="")) == pytest.approx(
        (change,) * 2, rel=0.1
    )


def test_a_bow_that_is_nowhere_near_is_refused_unless_asked_for():
    model = between("fixed", "fixed", 5.0)
    found = outcome(model)
    assert LEFT_OUT in found.message
    assert 'stiffening = "any"' in found.message
    model.set_validity(stiffening="any")
    found = outcome(model)
    assert not found.message
    assert told(found)[1] == pytest.approx(1.0 - bow(5.0) / (5.0 / (192 * EI)), rel=0.1)


@pytest.mark.parametrize("last", ["prismatic", "in-line"])
def test_a_bow_whose_ends_are_free_to_approach_is_right(last):
    assert told(outcome(between("fixed", last, 1.0))) is None


def test_with_stiffening_there_is_nothing_to_tell():
    assert told(outcome(between("fixed", "fixed", 1.0, stiffening="full"))) is None


@pytest.mark.parametrize("share", [-0.05, 0.05, 0.2, 0.6])
def test_a_pulled_strip(share):
    """Its middle deflection is nearly that without the force over 1 + N/P."""
    critical = 4 * np.pi**2 * EI
    found = outcome(between("fixed", "prismatic", 0.3, pull=share * critical))
    change = abs(1.0 / (1.0 + share) - 1.0)
    assert told(found) == pytest.approx((change, change), rel=0.1)


@pytest.mark.parametrize("outputs", [10, 20, 50])
@pytest.mark.parametrize("share", [0.3, -0.08])
def test_rare_rows_do_not_lag_behind_a_slow_force(outputs, share):
    """The pull rises over the whole run: a mean of eight rows was half of it with ten."""
    critical = 4 * np.pi**2 * EI
    model = between("fixed", "prismatic")
    model.forces.clear()
    ramp = "step5(t, 0, 0, 2, 1)"
    model.add_force("pull", "force", at="strip.b", value=[f"{share * critical}*{ramp}", 0, 0])
    model.add_force("push", "force", at="strip.middle", value=[0, f"0.02*{ramp}", 0])
    found = judged(model, duration=2.0, accuracy=1e-4, verify=False, outputs=outputs)
    change = abs(1.0 / (1.0 + share) - 1.0)
    assert told(found) == pytest.approx((change, change), rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("outputs", [
    11, 23, 130,
])  # fmt: skip
def test_rare_rows_of_a_fast_force_tell_its_mean(outputs):
    """Half of the buckling load at 61.7 Hz, a slow beat in 130 rows: none on average."""
    model, pull = between("fixed", "prismatic"), 0.5 * 4 * np.pi**2 * EI
    model.forces.clear()
    model.add_force("pull", "force", at="strip.b", value=[f"{pull}*sin(2*pi*61.7*t)", 0, 0])
    push = "0.02*step5(t, 0, 0, 2, 1)"
    model.add_force("push", "force", at="strip.middle", value=[0, push, 0])
    model.set_validity(load_factor="any", stiffening="any")
    found = judged(model, duration=2.0, accuracy=1e-4, verify=False, outputs=outputs)
    buckled = [note for note in found.notes if "of the load that buckles it" in note]
    assert all(float(note.split("by about ")[1].split(" of")[0]) < 0.3 for note in buckled)


def test_a_small_force_changes_nothing_that_shows():
    assert told(outcome(between("fixed", "prismatic", 0.3, pull=0.005 * 4 * np.pi**2 * EI))) is None


@pytest.mark.parametrize("share", [-0.08, 0.5, 3.0, 10.0])
def test_a_cantilever_whose_frame_turns_as_it_bends(share):
    """The engine has what the turn of the mean axes makes of a force: a part of the stiffening."""
    pull = share * np.pi**2 * EI / 4
    model = Model("cantilever")
    model.add_body("strip", strip())
    model.add_joint("root", "fixed", between=["ground", "strip.a"])
    ramp = "step5(t, 4, 0, 19, 1)"
    model.add_force(
        "load", "force", at="strip.b", value=[f"{pull}*step5(t, 0, 0, 4, 1)", f"0.2*{ramp}", 0]
    )
    model.add_sensor("tip", "position", of="strip.b")
    knobs = {"duration": 20, "accuracy": 1e-5, "verify": False}
    with pytest.warns(FlexmbWarning, match=LEFT_OUT):
        moved = flexmb.simulate(model, **knobs)["tip.y"][-1]
    k = np.sqrt(complex(pull / EI))
    true = abs(1.0 - 0.2 * ((k - np.tanh(k)) / k**3 / EI).real / moved)
    assert told(judged(model, **knobs)) == pytest.approx((true, true), rel=0.1)


@pytest.mark.seconds
def test_the_largest_change_is_that_of_all_rows():
    """A pull that lets go: the largest change is not where the force is largest."""
    model = Model("cantilever")
    model.add_body("strip", strip())
    model.add_joint("root", "fixed", between=["ground", "strip.a"])
    pull = 8 * np.pi**2 / 4 * EI
    along = f"{pull}*step5(t, 0, 0, 4, 1) - {pull}*step5(t, 10, 0, 38, 1)"
    model.add_force("load", "force", at="strip.b", value=[along, "0.2*step5(t, 4, 0, 9, 1)", 0])
    model.add_sensor("tip", "position", of="strip.b")
    knobs = {"duration": 36.0, "accuracy": 1e-5, "verify": False, "outputs": 1000}
    with pytest.warns(FlexmbWarning, match=LEFT_OUT):
        run = flexmb.simulate(model, **knobs)
    s = np.clip((run.time - 10) / 28, 0, 1)
    k = np.sqrt(pull * (1 - s**3 * (10 - 15 * s + 6 * s**2)) / EI)
    changes = np.abs(run["tip.y"] - 0.2 * (k - np.tanh(k)) / k**3 / EI)[run.time > 10]
    true = changes.max() / np.ptp(run["tip.y"])
    assert told(judged(model, **knobs))[1] == pytest.approx(true, rel=0.1)


def ritz(radius, speed, n=10):
    """Stiffness and geometric stiffness across the plane of rotation of a blade of 1 m."""
    x, w = np.polynomial.legendre.leggauss(40)
    s, w = (x + 1) / 2, w / 2
    N = 7850 * B * H * speed**2 * (radius * (1 - s) + (1 - s**2) / 2)
    slopes = np.array([(k + 2) * s ** (k + 1) for k in range(n)])
    bends = np.array([(k + 2) * (k + 1) * s**k for k in range(n)])
    return EI * (bends * w) @ bends.T, (slopes * w * N) @ slopes.T


def blade(radius, ratio):
    """A blade that a force at its tip bends across its plane of rotation, and its speed."""
    speed = ratio * 3.516 * np.sqrt(EI / (7850 * B * H))
    model = Model("blade")
    model.add_body("hub", mass=1.0, inertia=[1, 1, 1])
    turned = {"orientation": {"axis": "x", "angle": np.pi / 2}}  # it bends along z
    model.add_marker("hub.rim", position=[radius, 0, 0], **turned)
    model.add_body("strip", strip(), position=[radius, 0, 0], **turned)
    model.add_joint("axle", "revolute", between=["ground", "hub"], axis="z")
    model.add_joint("root", "fixed", between=["hub.rim", "strip.a"])
    model.add_driver("motor", joint="axle", angle=f"{speed}*t")
    model.add_force("push", "force", at="strip.b", value=[0, 0, "0.1*step5(t, 0, 0, 2, 1)"])
    model.add_sensor("tip", "position", of="strip.b", relative_to="hub", axes="hub")
    return model, speed


@pytest.mark.parametrize(("radius", "ratio"), [(5.0, 0.12), (20.0, 0.12)])
def test_a_blade_far_from_its_axis(radius, ratio):
    """Its speed alone is harmless, and yet the first frequency of the last is 17 % too low."""
    model, speed = blade(radius, ratio)
    run = flexmb.simulate(model, duration=2.2, start="quasi-static", verify=False)
    K, Kg = ritz(radius, speed)
    true = 1.0 - 0.1 * np.linalg.solve(K + Kg, np.ones(len(K))).sum() / run["tip.z"][-1]
    assert true > 0.03
    assert told(outcome(model))[1] == pytest.approx(true, rel=0.5)


def test_a_blade_on_its_axis_is_slow_enough():
    assert told(outcome(blade(0.0, 0.06)[0])) is None


def test_a_blade_that_points_to_its_axis_is_compressed():
    """By the loads along all of it, which buckle it at more than a force at its end would do."""
    model, speed = blade(-20.0, 0.12)
    K, Kg = ritz(-20.0, speed)
    true = np.linalg.eigvals(np.linalg.solve(K, -Kg)).real.max()
    (note,) = [one for one in outcome(model).notes if "compressed" in one]
    assert float(note.split("by about ")[1].split()[0]) == pytest.approx(true, rel=0.05)


FIXED = {"cantilever": np.pi**2 / 4, "clamped": 4 * np.pi**2, "propped": 20.190729}


@pytest.mark.parametrize("ends", FIXED)
def test_eulers_loads(ends):
    """The estimate by the lowest frequency was up to twice as large, or half."""
    last = {"clamped": "prismatic", "propped": "in-line", "cantilever": None}[ends]
    model = between("fixed", last or "prismatic", 0.0, pull=-0.5 * FIXED[ends] * EI)
    if last is None:
        del model.joints["b"]
    (note,) = [one for one in outcome(model).notes if "compressed" in one]
    assert float(note.split("by about ")[1].split()[0]) == pytest.approx(0.5, rel=0.03)


def test_a_wide_plate_far_from_its_axis():
    """Half as wide as long: its axial force is that of a bar."""
    width, h, radius, speed = 0.5, 0.004, 6.0, 2.0
    plate = flexmb.reduce(
        {"type": "plate", "length": 1.0, "width": width, "divisions": [12, 6]},
        material={"E": E, "nu": 0.0, "density": 7850}, interfaces={"a": "x0", "b": "x1"},
        modes=6, residual="inertia",
        sections={"all": {"type": "shell", "thickness": h}}, name="plate",
    )  # fmt: skip
    model = Model("plate")
    model.add_body("hub", mass=1.0, inertia=[1, 1, 1])
    model.add_marker("hub.rim", position=[radius, 0, 0])
    model.add_body("plate", plate, position=[radius, 0, 0])
    model.add_joint("axle", "revolute", between=["ground", "hub"], axis="z")
    model.add_joint("root", "fixed", between=["hub.rim", "plate.a"])
    model.add_driver("motor", joint="axle", angle=f"{speed}*t")
    model.add_force("push", "force", at="plate.b", value=[0, 0, "step5(t, 0, 0, 2, 1)"])
    model.add_sensor("tip", "position", of="plate.b", relative_to="hub", axes="hub")
    knobs = {"duration": 2.2, "start": "quasi-static", "verify": False}
    without = flexmb.simulate(model, **knobs)["tip.z"][-1]
    # a strip of unit width has the same bending stiffness and tension over its mass
    scale = E * h**3 / 12 / EI * B  # of EI per width
    K, Kg = ritz(radius, speed)
    K, Kg = K * scale / B * width, Kg * (h * width) / (B * H)
    true = 1.0 - np.linalg.solve(K + Kg, np.ones(len(K))).sum() / without
    assert true > 0.03
    assert told(outcome(model))[1] == pytest.approx(true, rel=0.5)


def test_a_sensor_on_what_is_joined_to_the_strip():
    """As on the strip itself; one elsewhere that no strip moves has nothing to tell."""
    pull, push = 0.5 * np.pi**2 / 4 * EI, 0.2
    for seen in (True, False):
        model = between("fixed", "prismatic", 0.0, pull=pull)
        del model.joints["b"]
        model.sensors.clear()
        model.add_body("lump", mass=0.01, inertia=[1e-5] * 3, position=[1, 0, 0])
        model.add_body("other", mass=1.0, inertia=[1, 1, 1], velocity=[1, 0, 0])
        model.add_joint("glue", "fixed", between=["strip.b", "lump"])
        aside = [0, f"{push}*step5(t, 1, 0, 2, 1)", 0]
        model.add_force("aside", "force", at="lump", value=aside)
        model.add_sensor("place", "position", of="lump" if seen else "other")
        found = told(outcome(model))
        assert (found is not None) == seen
        if found:
            run = flexmb.simulate(model, duration=2.2, verify=False)
            u = np.sqrt(pull / EI)
            true = 1.0 - push / EI * (u - np.tanh(u)) / u**3 / run["place.y"][-1]
            assert true > 0.03
            assert found[1] == pytest.approx(true, rel=0.6)


def test_a_distance_along_the_strip_does_not_change_with_its_bending():
    """It changes by the stretch, which is a thousandth of the deflection: no sensor is told."""
    model = between("fixed", "fixed", 0.0, pull=3 * np.pi**2 / 4 * EI)
    del model.joints["b"]
    model.sensors.clear()
    model.add_force("aside", "force", at="strip.b", value=[0, "0.02*step5(t, 1, 0, 2, 1)", 0])
    model.add_sensor("length", "distance", between=["ground", "strip.b"])
    (note,) = [one for one in outcome(model).notes if LEFT_OUT in one]
    assert "sensor" not in note


@pytest.mark.parametrize("frame", ["mean axis", "interface a"])
def test_moments_in_a_frame_at_an_interface(frame):
    """They lack N times the deflection there: that of the lump was off by half, without a word."""
    model = Model("pendulum", gravity=[0, -9.81, 0])
    body = {
        "mesh": {"type": "beam", "length": 1.2, "divisions": 12}, "modes": 6,
        "material": {"E": 70e9, "nu": 0.3, "density": 2700},
        "sections": {"all": {"type": "rectangle", "y": 0.006, "z": 0.02}},
        "interfaces": {"a": "start", "b": "end"},
    }  # fmt: skip
    model.add_body("rod", **body, frame=frame)
    model.add_body("bob", mass=1.5, inertia=[2e-3] * 3, position=[1.2, 0, 0])
    model.add_joint("pivot", "revolute", between=["ground", "rod.a"], axis="z")
    model.add_joint("glue", "fixed", between=["rod.b", "bob"])
    model.add_sensor("bob", "position", of="bob")
    knobs = {"duration": 1.5, "start": "quasi-static", "accuracy": 1e-5}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlexmbWarning)
        run = flexmb.simulate(model, **knobs)
        model.bodies.pop("rod")
        model.add_body("rod", **body, frame=frame, geometric_stiffening="full")
        true = flexmb.simulate(model, **knobs)
    moments = [one.reaction("glue", on="bob").moment[:, 2] for one in (true, run)]
    off = np.abs(moments[1] - moments[0]).max() / np.ptp(moments[0])
    assert (off > 0.3) == (frame != "mean axis")
    assert any(LEFT_OUT in note for note in run.notes) == (frame != "mean axis")


@pytest.mark.parametrize(("place", "most"), [("end", 4.0), ("middle", 8.0)])
def test_a_column_with_a_mass_of_its_own(place, most):
    """Like one under the weight of a rigid body there, beside its own weight."""
    found = []
    for own in (True, False):
        at = {"middle": ({"node": 10}, 10), "end": ("end", "end")}[place]
        model = Model("column", gravity=[-9.81, 0, 0])
        column = flexmb.reduce(
            {"type": "beam", "length": 1.0, "divisions": 20}, name="column", modes=8,
            material={"E": E, "nu": 0.0, "density": 7850},
            sections={"all": {"type": "rectangle", "y": H, "z": B}},
            interfaces={"a": "start", "m": at[0]},
            masses={"lump": {"at": at[1], "mass": 0.1 * most}} if own else {},
        )  # fmt: skip
        model.add_body("column", column)
        model.add_joint("root", "fixed", between=["ground", "column.a"])
        if not own:
            there = [1.0 if place == "end" else 0.5, 0, 0]
            model.add_body("lump", mass=0.1 * most, inertia=[1e-9] * 3, position=there)
            model.add_joint("glue", "fixed", between=["column.m", "lump"])
        model.set_validity(load_factor="any", stiffening="any")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FlexmbWarning)
            (note,) = [one for one in flexmb.statics(model).notes if "compressed" in one]
        found.append(float(note.split("by about ")[1].split()[0]))
    assert found[0] == pytest.approx(found[1], rel=0.03)
    if (
        place == "end"
    ):  # Euler's load with the share of the own weight that buckles alone, Dunkerley
        weight, tip = 9.81 * 7850 * B * H / (7.837 * EI), 9.81 * 0.4 / (np.pi**2 / 4 * EI)
        assert found[0] == pytest.approx(weight + tip, rel=0.03)


@pytest.mark.seconds
def test_a_sensor_that_does_not_see_the_bow_has_no_number():
    """A slider at the end of a rod moves with the line between its joints."""
    rod = {
        "mesh": {"type": "beam", "length": 0.4, "divisions": 10}, "material": "steel", "modes": 4,
        "sections": {"all": {"type": "rectangle", "y": 0.004, "z": 0.02}}, "position": [0.1, 0, 0],
        "interfaces": {"a": "start", "b": "end"}, "frame": "interface b",
    }  # fmt: skip
    model = Model("crank", plane="xy")
    model.add_body("crank", mass=1.0, inertia=[0.01] * 3)
    model.add_marker("crank.pin", position=[0.1, 0, 0])
    model.add_body("rod", **rod)
    model.add_body("slider", mass=0.5, inertia=[0.01] * 3, position=[0.5, 0, 0])
    for name, ends in (("bearing", ["ground", "crank"]), ("pin", ["crank.pin", "rod.a"]),
                       ("wrist", ["rod.b", "slider"])):  # fmt: skip
        model.add_joint(name, "revolute", between=ends, axis="z")
    model.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    model.add_driver("motor", joint="bearing", angle="60*t")
    model.add_sensor("slider", "position", of="slider")
    run = flexmb.simulate(model, duration=0.2, accuracy=1e-4, verify=False)
    (note,) = [one for one in run.notes if LEFT_OUT in one]
    assert "sensor" not in note
