"""How near a column is to buckling, and what it does there: Euler's four cases.

Timoshenko & Gere, Theory of Elastic Stability, §2.2: π², π²/4, 4π² and 20.1907 EI/L²; the same
square root of the load in the frequency, f = f₀ √(1 − P/P_cr), is exact between pins and within
2 % for the others.
"""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes import beside_a_large_motion
from femeshes import block, line, solid_box
from flexiblescenes import rod
from numpy.polynomial import Polynomial
from scipy.linalg import eigh
from scipy.optimize import brentq

import flexmb
from flexmb.analysis.validity.load_factor import _EULER, LoadFactorMonitor
from flexmb.fe import Mesh, general, part, rectangle, reduce
from flexmb.model import Model
from flexmb.workflow.neighbours import ModelVariants
from tests.accuracyscenes.judging import judged

HEIGHT = 0.01
UNIT = {"E": 12.0 / HEIGHT**4, "nu": 0.0, "density": 1.0 / HEIGHT**2}  # EI = ρA = L = 1
EULER = {"pinned": np.pi**2, "cantilever": np.pi**2 / 4, "clamped": 4 * np.pi**2,
         "propped": 20.190729}  # fmt: skip


def column(stiffening=True, kind="line", size=1.0, modes=8, plane=None):
    options = {"modes": modes, "plane": plane, "interfaces": {"root": "root", "tip": "tip"}}
    if kind == "line":
        mesh = line(16, end=(size, 0, 0))
        material = UNIT
        options["sections"] = {"all": rectangle(HEIGHT * size, HEIGHT * size)}
    else:
        thickness = 0.02
        mesh = solid_box("hexahedron20", (16, 1, 1), (1.0, thickness, thickness))
        material = {"E": 12.0 / thickness**4, "nu": 0.0, "density": 1.0 / thickness**2}
        options["interfaces"] = {"root": "x0", "tip": "x1"}
    return reduce(
        mesh, material=material, geometric_stiffening="full" if stiffening else "none", **options
    )


def loaded(ends, load, place=(0.0, 0.0, 0.0), size=1.0, scene_plane=None, **options):
    plane = options.get("plane", scene_plane)
    model = Model("column", **({} if plane is None else {"plane": plane}))
    body = column(size=size, **options)
    middle = body.interface("root").position
    model.add_marker("ground.root", position=np.add(place, middle))
    model.add_marker("ground.tip", position=np.add(place, body.interface("tip").position))
    model.add_body("column", body, position=list(place))
    hinge = {"axis": "y", "second_axis": "z"}
    if ends == "pinned":
        model.add_joint("root", "universal", between=["ground.root", "column.root"], **hinge)
    else:
        model.add_joint("root", "fixed", between=["ground.root", "column.root"])
    if ends in ("pinned", "propped"):
        model.add_joint("tip", "in-line", between=["ground.tip", "column.tip"], axis="x")
    elif ends == "clamped":
        model.add_joint("tip", "prismatic", between=["ground.tip", "column.tip"], axis="x")
    model.add_force("load", "force", at="column.tip", value=[-load, 0, 0])
    return model


def outcome(model, **knobs):
    return judged(model, accuracy=1e-4, verify=False, **knobs)


def load_factor(model, duration=0.02, **knobs):
    """As the run tells it: the bounds are away, and the level of warning too."""
    model.set_validity(load_factor="any", deflection="any")
    found = outcome(model, duration=duration, outputs=4, start="quasi-static", **knobs)
    (told,) = [note for note in found.notes if "of those that buckle it" in note]
    return float(told.split(" are ")[1].split()[0])


@pytest.fixture
def all_are_told(monkeypatch):
    monkeypatch.setattr("flexmb.analysis.validity.load_factor.NEAR_BUCKLING", 1e-3)


@pytest.fixture
def exactly_told(all_are_told, monkeypatch):
    monkeypatch.setattr(LoadFactorMonitor, "_sentence", lambda self, name, value, t:
                        f"{name} are {value:.6f} of those that buckle it")  # fmt: skip


@pytest.mark.parametrize("ends", EULER)
@pytest.mark.parametrize("share", [0.2, 0.9])
def test_the_load_factor_is_the_share_of_eulers_load(ends, share, exactly_told):
    assert load_factor(loaded(ends, share * EULER[ends])) == pytest.approx(share, rel=0.01)


@pytest.mark.parametrize("outputs", [15, 25])
def test_rare_rows_do_not_lag_behind_a_load_that_rises(outputs, all_are_told):
    """Over 50 periods up to 0.9, in a mean of eight rows 0.6."""
    model, load = loaded("cantilever", 0.0), 0.9 * EULER["cantilever"]
    model.forces.clear()
    model.add_force(
        "load", "force", at="column.tip", value=[f"-{load}*step5(t, 0, 0, 90, 1)", 0, 0]
    )
    model.set_validity(load_factor="any", deflection="any")
    found = outcome(model, duration=90.0, outputs=outputs)
    (told,) = [note for note in found.notes if "of those that buckle it" in note]
    assert float(told.split(" are ")[1].split()[0]) == pytest.approx(0.9, rel=0.05)


@pytest.mark.parametrize(
    "variant", [{"place": (1000.0, -200.0, 300.0)}, {"size": 1e-6}, {"kind": "solid"}],
    ids=["1 km away", "of a micrometre", "of solids"],
)  # fmt: skip
def test_wherever_it_stands_and_of_any_size(variant, exactly_told):
    size = variant.get("size", 1.0)
    model = loaded("cantilever", 0.5 * EULER["cantilever"] * size**2, **variant)
    assert load_factor(model, 0.02 * size) == pytest.approx(0.5, rel=0.01)


def test_a_thin_column_beside_a_flywheel(exactly_told):
    """A thin rod on a ball joint turns about itself by nothing, beside the heaviest of bodies."""
    model = loaded("cantilever", 0.5 * EULER["cantilever"])
    model.add_marker("ground.ball", position=[0, 5, 0])
    model.add_body("rod", rod(0.002, 0.3), position=[0, 5, 0])
    model.add_joint("ball", "spherical", between=["ground.ball", "rod.root"])
    assert load_factor(beside_a_large_motion(model)) == pytest.approx(0.5, rel=0.01)


@pytest.mark.seconds
@pytest.mark.parametrize(("share", "what"), [(0.7, ""), (0.85, "note"), (1.1, "refusal")])
@pytest.mark.parametrize("stiffening", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_run_warns_before_the_column_buckles_and_stops_where_it_does(share, what, stiffening):
    """Without stiffening it is told from a tenth of the load on."""
    model = loaded("pinned", share * np.pi**2, stiffening=stiffening)
    found = outcome(model, duration=2.0)
    words = "of those that buckle it" if stiffening else "its forces do not soften it"
    told = [note for note in found.notes if words in note]
    assert bool(told) == (what == "note" or (not stiffening and share < 1))
    assert (words in found.message) == (what == "refusal")
    tensile = loaded("pinned", -share * np.pi**2, stiffening=stiffening)
    assert not [note for note in outcome(tensile, duration=0.1).notes if "buckle" in note]


def test_a_mast_with_a_mass_on_top_is_a_cantilever_under_its_weight(exactly_told):
    """The mass moves with the tip; held there, the load factor would be a sixteenth."""
    load, mass = 0.5 * EULER["cantilever"], 100.0
    model = Model("mast", gravity=[-load / mass, 0, 0])
    model.add_body("column", column())
    model.add_body("top", mass=mass, inertia=[1e-9] * 3, position=[1, 0, 0])
    model.add_joint("root", "fixed", between=["ground", "column.root"])
    model.add_joint("tip", "fixed", between=["column.tip", "top"])
    # its own weight of 1 % of that on top: 7.837 EI/L² buckle a column by its weight alone
    own = 0.01 * load / 7.837
    assert load_factor(model) == pytest.approx(0.5 + own, rel=0.01)


@pytest.mark.parametrize(("share", "what"), [(0.7, ""), (0.85, "note"), (1.1, "refusal")])
def test_a_load_on_a_plate_on_top(share, what):
    """No load was noticed here: with the plate at rest the column would bear sixteen times more."""
    model = loaded("cantilever", 0.0)
    del model.forces["load"]
    model.add_body("plate", mass=1e-3, inertia=[1e-6] * 3, position=[1, 0, 0])
    model.add_joint("glue", "fixed", between=["column.tip", "plate"])
    model.add_force("load", "force", at="plate", value=[-share * EULER["cantilever"], 0, 0])
    found = outcome(model, duration=2.0, outputs=20, start="quasi-static")
    words = f"its loads are {share:.2g} of those that buckle it"
    told = [note for note in found.notes if words in note]
    assert bool(told) == (what == "note")
    assert ("that buckle it" in found.message) == (what == "refusal")


def test_a_strut_of_rigid_bodies_pushes_on_a_column(all_are_told):
    """Their ball joint was no number. The strut, as long as the column, is guided: tan x = 2 x."""
    model = loaded("cantilever", 0.0)
    del model.forces["load"]
    for name, place in (("cap", 1.0), ("strut", 2.0)):
        model.add_body(name, mass=1e-6, inertia=[1e-6] * 3, position=[place, 0, 0])
    model.add_marker("cap.ball", orientation={"axis": [1, 0, 0], "angle": 0.5})  # of its own
    model.add_marker("strut.ball", position=[-1.0, 0, 0])
    model.add_marker("ground.guide", position=[2.0, 0, 0])
    model.add_joint("glue", "fixed", between=["column.tip", "cap"])
    model.add_joint("ball", "spherical", between=["cap.ball", "strut.ball"])
    model.add_joint("guide", "in-line", between=["ground.guide", "strut"], axis="x")
    critical = brentq(lambda x: np.tan(x) - 2 * x, 1.0, 1.5) ** 2
    model.add_force("load", "force", at="strut", value=[-0.5 * critical, 0, 0])
    assert load_factor(model) == pytest.approx(0.5, rel=0.01)


def test_the_estimate_without_stiffening_is_eulers_load() -> None:
    """pi^2 EI/L^2 of pins over w1^2 m L with w1 = pi^2 sqrt(EI/(m L^3)): 1/pi^2."""
    assert _EULER == pytest.approx(1 / np.pi**2, rel=0.02)


def test_a_blade_that_points_to_the_axis_is_buckled_by_its_own_centrifugal_load(exactly_told):
    """∫q dx = 16.1 EI/L² of loads q = q₀ (1 − x/L) along a cantilever buckle it (Timoshenko & Gere,
    §2.12, of the powers n of 1 − x/L that of n = 1). Here q₀ = ρA Ω² L."""
    speed = np.sqrt(0.5 * 2 * 16.1)
    model = Model("blade")
    model.add_body("hub", mass=1.0, inertia=[1, 1, 1])
    model.add_marker("hub.rim", position=[-1, 0, 0])
    model.add_body("column", column(), position=[-1, 0, 0])
    model.add_joint("axle", "revolute", between=["ground", "hub"], axis="z")
    model.add_joint("root", "fixed", between=["hub.rim", "column.root"])
    model.add_driver("motor", joint="axle", angle=f"{speed}*t")
    assert load_factor(model) == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("load", ["traction", "pressure"])
def test_a_load_on_a_tied_face_buckles_the_column_behind_it(load):
    """On a face tied to the end of a beam, a behind it: tan kL = 1/(k a), P = EI k^2."""
    h, a, E = 0.02, 0.3, 2e11
    solid = block((1, 1, 1), (0.1, h, h))
    bar = line(20, end=(1.0, 0, 0))
    first = len(solid.points)
    mesh = Mesh(
        np.vstack([solid.points + [1.0 + a, -h / 2, -h / 2], bar.points]),
        {**solid.blocks, "line": bar.blocks["line"] + first},
        {"root": np.array([first])},
        solid.element_sets,
    )
    loads = {
        "traction": {"group": "x0", "traction": [-1 / h**2, 0, 0]},
        "pressure": {"group": "x0", "pressure": -1 / h**2},
    }
    factors = part(
        mesh, material={"E": E, "nu": 0.0, "density": 7800.0},
        sections={"all": rectangle(h, h, shear=False)},
        ties={"t": {"type": "rbe2", "reference": first + 20, "nodes": "x0"}},
        supports={"root": {"group": "root", "type": "clamped"}},
        loads={"p": {"type": load, **loads[load]}}, buckling=1,
    ).load_factors  # fmt: skip
    k = brentq(lambda k: np.cos(k) - k * a * np.sin(k), 0.1, np.pi / 2)
    assert factors[0] == pytest.approx(E * h**4 / 12 * k**2, rel=1e-4)  # strain P/EA: 5e-5


@pytest.mark.slow
def test_the_load_factors_of_many_rows_are_those_of_each(monkeypatch):
    """A load that grows: row by row its share of Euler's load, whichever rows are asked for."""
    model = loaded("pinned", 0.0)
    model.forces.clear()
    model.add_force("load", "force", at="column.tip", value=["-9*t", 0, 0])
    run = flexmb.simulate(model, duration=1.0, outputs=20, start="quasi-static")
    at = ModelVariants.of(run, 21)
    monitor, rows = LoadFactorMonitor(at.compiled, model, at.motion.q[0]), at.rows()
    values = monitor._values(rows, np.arange(len(at.motion.t)))[0][:, 0]
    np.testing.assert_allclose(values, 9 * at.motion.t / np.pi**2, atol=0.01)
    monkeypatch.setattr("flexmb.analysis.validity.load_factor._MAX_ENTRIES", 400)
    some = np.array([20, 3, 11])
    np.testing.assert_allclose(monitor._values(rows, some)[0][:, 0], values[some], rtol=1e-9)


@pytest.mark.seconds
def test_equal_columns_of_a_frame_buckle_together(exactly_told):
    """Row by row one or the other was named, and the mean of each was half of the load factor."""
    model, middle = Model("frame"), column().interface("root").position
    model.add_body("beam", mass=0.1, inertia=[0.01] * 3, position=[1, 0.4, 0])
    for name, place in (("left", 0.0), ("right", 0.8)):
        model.add_marker(f"ground.{name}", position=np.add([0, place, 0], middle))
        model.add_marker(f"beam.{name}", position=[0, place - 0.4, 0])
        model.add_body(name, column(), position=[0, place, 0])
        model.add_joint(name, "fixed", between=[f"ground.{name}", f"{name}.root"])
        model.add_joint(f"top_{name}", "revolute", between=[f"{name}.tip", f"beam.{name}"],
                        axis="z")  # fmt: skip
    load = 2 * 0.6 * EULER["cantilever"]
    model.add_force("load", "force", at="beam", value=[f"-{load}*step5(t, 0, 0, 2, 1)", 1e-3, 0])
    model.set_validity(load_factor="any", deflection="any")
    found = outcome(model, duration=4.0, outputs=120, start="quasi-static")
    told = [note.split(" are ") for note in found.notes if "of those that buckle it" in note]
    assert [name for name, _ in told] == ["left", "right"]
    for _, words in told:
        assert float(words.split()[0]) == pytest.approx(0.6, rel=0.02)


def clamped_frequency(load):
    """Of a unit column between clamps [rad/s]: v⁗ + P v″ = ω² v (Timoshenko, §5.11)."""

    def determinant(omega):
        root = np.sqrt(load**2 / 4 + omega**2)
        a, b = np.sqrt(root + load / 2), np.sqrt(root - load / 2)
        return 2 * a * b * (1 - np.cos(a) * np.cosh(b)) + (b * b - a * a) * np.sin(a) * np.sinh(b)

    return brentq(determinant, 1.0, 42.0)


@pytest.mark.parametrize("words", [{}, {"plane": "xy"}, {"scene_plane": "xy"}])
@pytest.mark.parametrize(("share", "modes"), [(0.9, 1), (0.9, 2), (0.5, 2), (0.9, 8), (-2.0, 2)])
def test_modes_that_cannot_bow_under_a_load_are_told(share, modes, words):
    """At 0.9 of Euler's load the lowest frequency is 10.3 % too high with one or two modes, of
    which nothing was told in a planar scene of a body that was reduced in space."""
    load = share * EULER["clamped"]
    found = flexmb.linearize(loaded("clamped", load, modes=modes, **words), about="static")
    error = found.frequencies.min() * 2 * np.pi / clamped_frequency(load) - 1.0
    told = [note for note in found.notes if "its modes do not answer" in note]
    assert bool(told) == (error > 0.02)
    for note in told:
        words = note.split("by ")[-1].split(" %")[0]
        assert float(words) / 100 == pytest.approx(error, rel=0.15)


@pytest.mark.parametrize("stiffening", [True, False])
def test_each_equilibrium_of_statics_has_its_own_load_factor(stiffening):
    """They were averaged as rows of a motion, so that the last of six had 0.4 of its own."""
    model = loaded("cantilever", 0.0, stiffening=stiffening)
    del model.forces["load"]
    model.add_force("load", "force", at="column.tip", value=[f"-{EULER['cantilever']}*t", 0, 0])
    run = flexmb.statics(model, duration=0.9, outputs=6)
    words = "its loads are " if stiffening else "compressed by about "
    (note,) = [note for note in run.notes if words in note]
    assert float(note.split(words)[1].split()[0]) == pytest.approx(0.9, rel=0.03)


def test_a_body_that_only_follows_its_loads_has_a_load_factor():
    """On bushings, with all its modes quasi-static, nothing vibrates; the ball is light."""
    made = flexmb.Model("bar on bushings", gravity=[0, 0, -9.81])
    words = {"deformation": "quasi-static", "geometric_stiffening": "full"}
    made.add_body("bar", rod(0.01, 1.0, 10, 4, geometric_stiffening="full"), **words)
    made.add_body("ball", mass=1.0, inertia=[0.01] * 3, position=[1, 0, 0])
    for name, ends in (("one", ["ground", "bar.root"]), ("two", ["bar.tip", "ball"])):
        made.add_force(
            name, "bushing", between=ends, stiffness=[1e6] * 3, rotational_stiffness=[1e3] * 3
        )
    made.add_sensor("ball", "position", of="ball")
    run = flexmb.simulate(made, duration=0.05, accuracy=1e-3, verify=False)
    assert run.status == "finished" and not [note for note in run.notes if "buckle" in note]


@pytest.mark.parametrize("on_column", [True, False])
def test_a_column_under_a_plane_that_turns_or_not(on_column, exactly_told):
    """A slider pushes on a plane across the tip, or with its own plane: then it is a cantilever.

    On the plane of the tip, with deflection w and slope θ there, the slider moves by w θ − ∫w′²/2.
    """
    w = [Polynomial([0] * k + [1]) for k in range(2, 10)]
    both = [[(a.deriv() * b.deriv()).integ()(1) for b in w] for a in w]
    tip = [[a(1) * b.deriv()(1) + b(1) * a.deriv()(1) for b in w] for a in w]
    bent = [[(a.deriv(2) * b.deriv(2)).integ()(1) for b in w] for a in w]
    lost = np.array(both) - np.array(tip) * on_column
    critical = 1.0 / eigh(lost, bent, eigvals_only=True)[-1]  # 7.83, or a quarter of π²
    model = loaded("cantilever", 0.0)
    del model.forces["load"]
    model.add_body("slider", mass=1e-3, inertia=[1e-3] * 3, position=[1, 0, 0])
    model.add_joint("guide", "prismatic", between=["ground.tip", "slider"], axis="x")
    ends = ["column.tip", "slider"] if on_column else ["slider", "column.tip"]
    model.add_joint("plane", "in-plane", between=ends, axis="x")
    model.add_force("load", "force", at="slider", value=[-0.5 * critical, 0, 0])
    assert load_factor(model) == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("length", [0.5, 1.0, 3.0])
def test_a_column_that_a_rod_pulls_down(length, exactly_told):
    """A rod of length a from its tip to the line of the column: − ∫w′²/2 + w²/(2 a) by its pull."""
    w = [Polynomial([0] * k + [1]) for k in range(2, 10)]
    lost = [[(a.deriv() * b.deriv()).integ()(1) - a(1) * b(1) / length for b in w] for a in w]
    bent = [[(a.deriv(2) * b.deriv(2)).integ()(1) for b in w] for a in w]
    critical = 1.0 / eigh(lost, bent, eigvals_only=True)[-1]
    model = loaded("cantilever", 0.0)
    del model.forces["load"]
    model.add_body("slider", mass=1e-3, inertia=[1e-3] * 3, position=[1 - length, 0, 0])
    model.add_marker("ground.low", position=[1 - length, 0, 0])
    model.add_joint("guide", "prismatic", between=["ground.low", "slider"], axis="x")
    model.add_joint("rod", "distance", between=["column.tip", "slider"])
    model.add_force("load", "force", at="slider", value=[-0.5 * critical, 0, 0])
    assert load_factor(model) == pytest.approx(0.5, rel=0.01)


def tip_forms(factor):
    """Forms of w = x², x³, ... on the column: bending, shortening, and with values at its tip."""
    w = [factor * Polynomial([0] * k + [1]) for k in range(2, 10)]
    bent, both = (
        np.array([[(a.deriv(n) * b.deriv(n)).integ()(1) for b in w] for a in w]) for n in (2, 1)
    )
    way, slope = np.array([a(1) for a in w]), np.array([a.deriv()(1) for a in w])
    return w, bent, both, way, slope


def pushed(place, axis, kind, **words):
    """A slider at a place beyond or before the tip pushes on it by a joint."""

    def model(force):
        made = loaded("cantilever", 0.0)
        del made.forces["load"]
        made.add_body("slider", mass=1e-3, inertia=[1e-3] * 3, position=[place, 0, 0])
        made.add_marker("ground.rail", position=[place, 0, 0])
        made.add_joint("guide", "prismatic", between=["ground.rail", "slider"], axis="x")
        made.add_joint("push", kind, between=["slider", "column.tip"], axis=axis, **words)
        made.add_force("load", "force", at="slider", value=[-force, 0, 0])
        return made

    return model


@pytest.mark.parametrize("radius", [0.5, 2.0, -2.0])
def test_a_column_under_a_round_bar(radius, exactly_told):
    """Its tip, which slides on a bar across it, is pushed along the bar, too: ∫w′² + w²/r is lost;
    under a bar in front of the tip less, and it bows along the bar by a quarter of π²."""
    _, bent, both, way, _ = tip_forms(1.0)
    across = 1.0 / eigh(both + np.outer(way, way) / radius, bent, eigvals_only=True)[-1]
    critical = min(across, np.pi**2 / 4) if radius < 0 else across
    model = pushed(1.0 + radius, "y", "cylindrical-spherical")(0.3 * critical)
    assert load_factor(model) == pytest.approx(0.3, rel=0.01)


@pytest.mark.parametrize("apart", [-0.3, -0.1, 0.1])
def test_a_column_that_slides_along_its_own_axis_on_a_hinge(apart, exactly_told):
    """The hinge is y on the slider, the slide is z on the tip, at a distance d: the slider moves by
    w θ - d θ²/2 - ∫w′²/2 with the tip."""
    _, bent, both, way, slope = tip_forms(1.0)
    lost = both - np.outer(way, slope) - np.outer(slope, way) - apart * np.outer(slope, slope)
    critical = 1.0 / eigh(lost, bent, eigvals_only=True)[-1]
    model = pushed(1.0 + apart, "y", "revolute-cylindrical", second_axis="z")(0.5 * critical)
    assert load_factor(model) == pytest.approx(0.5, rel=0.01)


def test_a_shaft_that_a_joint_of_constant_velocity_turns(exactly_told):
    """Its moment lies along the bisector of both axes: half of it turns with the shaft
    (semitangential), and ∫ T (v′w″ - w′v″)/2 dx is lost, of a shaft that is clamped and pinned.
    Its section is stiff in torsion: others turn by radians before."""
    w, bent, *_ = tip_forms(Polynomial([1, -1]))
    mixed = np.array([[(b.deriv() * a.deriv(2) - a.deriv() * b.deriv(2)).integ()(1) for b in w]
                      for a in w])  # fmt: skip
    none = np.zeros_like(bent)
    lost = 0.5 * np.block([[none, mixed], [mixed.T, none]])
    critical = 1.0 / eigh(lost, np.kron(np.eye(2), bent), eigvals_only=True)[-1]
    inertia = HEIGHT**4 / 12
    section = general(HEIGHT**2, inertia, inertia, 50 * inertia)
    body = reduce(line(16), material=UNIT, sections={"all": section}, modes=8,
                  interfaces={"root": "root", "tip": "tip"}, geometric_stiffening="full",
                  )  # fmt: skip
    model = Model("shaft")
    model.add_marker("ground.tip", position=[1, 0, 0])
    model.add_body("shaft", body, geometric_stiffening="full")
    model.add_body("drive", mass=1.0, inertia=[1.0] * 3, position=[1, 0, 0])
    model.add_joint("root", "fixed", between=["ground", "shaft.root"])
    model.add_joint("bearing", "revolute", between=["ground.tip", "drive"], axis="x")
    model.add_joint("joint", "constant-velocity", between=["drive", "shaft.tip"], axis="x")
    model.add_force("load", "torque", at="drive", value=[0.3 * critical, 0, 0])
    assert load_factor(model) == pytest.approx(0.3, rel=0.01)
