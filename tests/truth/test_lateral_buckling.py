"""Slender beams that buckle sideways and twist: the geometric stiffness of moments at interfaces.

Prandtl and Michell, 1899: a cantilever under a force at its tip, 4.0126 √(EI GJ)/L², with EI that
of bending sideways; a beam between forks under equal moments, π √(EI GJ)/L; a cantilever under the
moment of a pair of dead forces at its tip half of that. A moment of constant axis, or one that
turns with the tip, has no equilibrium beside the straight one: M v' twists the beam and M φ bends
it, each without the other at its root (Timoshenko & Gere, Theory of Elastic Stability, §6.1-6.4).
Frequencies are those of Ritz' method with polynomials of deflection v and twist φ, of the energy
∫ (EI v''² + GJ φ'² + 2 M φ v'')/2. As the beam bends in its plane before, loads that buckle it are
larger by 1/√((1 - EI/EI_y)(1 - GJ/EI_y)).
"""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line, solid_box
from numpy.polynomial import Polynomial
from scipy.linalg import eigh
from shellkit import sheet

import flexmb
from flexmb.analysis.validity.load_factor import LoadFactorMonitor
from flexmb.engine.algebra.forms import bend_with_axis
from flexmb.fe import Mesh, part, rectangle, reduce, shell
from flexmb.model import Model
from tests.accuracyscenes.judging import judged

HIGH, THICK, LENGTH = 0.04, 0.003, 1.0
E, NU, DENSITY = 2.1e11, 0.3, 7850.0
STEEL = {"E": E, "nu": NU, "density": DENSITY}
EI, EI_PLANE = (E * a * b**3 / 12 for a, b in ((HIGH, THICK), (THICK, HIGH)))
ODD = np.arange(1, 60, 2)
TORSION = 1 / 3 - 64 / np.pi**5 * THICK / HIGH * np.sum(
    np.tanh(ODD * np.pi * HIGH / 2 / THICK) / ODD**5
)
GJ = E / (2 + 2 * NU) * TORSION * HIGH * THICK**3
BENT = np.sqrt((1 - EI / EI_PLANE) * (1 - GJ / EI_PLANE))
FORCE, MOMENT = 4.0126 * np.sqrt(EI * GJ) / LENGTH**2, np.sqrt(EI * GJ) / LENGTH


def ritz(force, terms=8):
    """Two lowest frequencies [Hz] of the cantilever under a force at its tip."""
    powers = [Polynomial([0] * k + [1]) for k in range(terms + 2)]
    sway, twist, arm = powers[2:], powers[1:-1], Polynomial([LENGTH, -1]) * force * BENT

    def products(first, second, factor=1.0):
        return np.array([[(a * b * factor).integ()(LENGTH) for b in second] for a in first])

    bent, turned = [one.deriv(2) for one in sway], [one.deriv() for one in twist]
    both, none = products(bent, twist, arm), np.zeros((terms, terms))
    K = np.block([[EI * products(bent, bent), both], [both.T, GJ * products(turned, turned)]])
    mass, polar = DENSITY * HIGH * THICK, DENSITY * HIGH * THICK * (HIGH**2 + THICK**2) / 12
    M = np.block([[mass * products(sway, sway), none], [none, polar * products(twist, twist)]])
    return np.sqrt(eigh(K, M, eigvals_only=True)[:2]) / (2 * np.pi)


def strip(bodies=1, modes=12, direction=(1, 0, 0), points=()):
    """A part of the strip, upright."""
    return reduce(
        line(max(20 // bodies, 4), end=np.multiply(direction, LENGTH / bodies)), material=STEEL,
        modes=modes, interfaces={"root": "root", "tip": "tip"}, geometric_stiffening="full",
        sections={"all": rectangle(THICK, HIGH, shear=False)}, load_points=points,
    )  # fmt: skip


def cantilever(force, bodies=1, modes=12, direction=(1, 0, 0), place=(0, 0, 0), points=(), **words):
    model, body = Model("strip", gravity=[0, 0, 0]), strip(bodies, modes, direction, points)
    model.add_marker("ground.clamp", position=list(place))
    for i in range(bodies):
        at = np.add(place, np.multiply(direction, i * LENGTH / bodies))
        model.add_body(
            f"b{i}", body, position=list(at), **{"geometric_stiffening": "full", **words}
        )
        before = f"b{i - 1}.tip" if i else "ground.clamp"
        model.add_joint(f"weld{i}", "fixed", between=[before, f"b{i}.root"])
    if force:
        model.add_force("load", "force", at=f"b{bodies - 1}.tip", value=[0, 0, force])
    return model


@pytest.fixture
def told(monkeypatch):
    """Load factors of the equilibrium of a model."""
    monkeypatch.setattr("flexmb.analysis.validity.load_factor.NEAR_BUCKLING", 1e-3)
    monkeypatch.setattr(LoadFactorMonitor, "_sentence", lambda self, name, value, t:
                        f"factor {value:.6f}")  # fmt: skip

    def factors(model):
        model.set_validity(load_factor="any")
        notes = flexmb.statics(model).notes
        return [float(one.split()[1]) for one in notes if one.startswith("factor")]

    return factors


@pytest.mark.parametrize("words", [
    {}, {"frame": "interface root"}, {"frame": "interface tip"}, {"bodies": 8, "modes": 4},
    {"direction": (0.6, 0.8, 0.0), "place": (500.0, -300.0, 50.0)},
])  # fmt: skip
def test_a_cantilever_tips_over_at_prandtls_force(words, told):
    assert max(told(cantilever(0.5 * FORCE, **words))) == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("words", [{}, {"frame": "interface tip"}, {"bodies": 4, "modes": 4}])
def test_it_vibrates_sideways_as_ritz_says(words, share):
    found = flexmb.linearize(cantilever(share * FORCE, **words), about="static")
    assert np.sort(found.frequencies)[:2] == pytest.approx(ritz(share * FORCE), rel=0.02)


def test_in_a_frame_at_its_root_it_vibrates_as_nearly_so():
    """1.30 Hz; near the load that buckles it the frequency falls steeply."""
    found = flexmb.linearize(cantilever(0.9 * FORCE, frame="interface root"), about="static")
    assert found.frequencies.min() == pytest.approx(ritz(0.9 * FORCE)[0], rel=0.045)


@pytest.mark.parametrize(("modes", "words"), [(18, {}), (30, {}), (18, {"place": (50, -30, 9)})])
def test_its_mass_keeps_its_sign_in_a_frame_at_its_tip(modes, words):
    """It bends down by 0.8 % of its length; 16 modes were right, with 18 "a motion has no inertia"
    was told."""
    model = cantilever(0.9 * FORCE, modes=modes, frame="interface tip", **words)
    found = flexmb.linearize(model, about="static")
    assert np.sort(found.frequencies)[:2] == pytest.approx(ritz(0.9 * FORCE), rel=0.01)
    assert np.linalg.eigvalsh(found.mass)[0] > 0.0


def test_it_is_refused_above_that_force_and_warned_of_before():
    found = flexmb.statics(cantilever(0.9 * FORCE))
    assert "its loads are 0.9 of those that buckle it" in " ".join(found.notes)
    found = judged(cantilever(1.1 * FORCE), start="quasi-static", verify=False, duration=0.5)
    assert "of those that buckle it" in found.message


def too_high(model):
    """How much too high a natural frequency of an equilibrium is, as told [%]; zero: not told."""
    notes = flexmb.linearize(model, about="static").notes
    (told,) = [one for one in notes if "its modes do not answer" in one] or ["by 0 %"]
    return float(told.split("by ")[-1].split(" %")[0])


@pytest.mark.parametrize(("share", "modes", "words"), [
    (0.9, 4, {}), (0.9, 6, {}), (0.9, 8, {}), (0.5, 4, {}), (0.9, 4, {"frame": "interface root"}),
    (0.9, 6, {"direction": (0.6, 0.8, 0.0), "place": (500.0, -300.0, 50.0)}),
])  # fmt: skip
def test_too_few_modes_to_twist_and_sway_are_told(share, modes, words):
    """By Ritz' method; without a word they were 61, 61, 9 and 6 % too high."""
    model = cantilever(share * FORCE, modes=modes, **words)
    frequency = flexmb.linearize(model, about="static").frequencies.min()
    error = 100.0 * (frequency / ritz(share * FORCE)[0] - 1.0)
    assert too_high(model) == pytest.approx(error, rel=0.15)


@pytest.mark.parametrize(("share", "modes"), [(0.9, 12), (0.5, 8), (0.2, 4), (-0.5, 8)])
def test_modes_that_twist_and_sway_enough_are_not(share, modes):
    """At 0.9 with 12 modes they are 0.9 % too high, and the second ones 1.6 %."""
    model = cantilever(share * FORCE, modes=modes)
    found = np.sort(flexmb.linearize(model, about="static").frequencies)[:2]
    assert found == pytest.approx(ritz(share * FORCE), rel=0.02)
    assert too_high(model) == 0.0


@pytest.mark.parametrize("modes", [2, 6])
def test_the_load_factor_counts_motions_that_modes_leave_out(modes, told):
    """With 2 and 6 modes it was 0.66."""
    assert max(told(cantilever(0.9 * FORCE, modes=modes))) == pytest.approx(0.9, rel=0.01)


def between_forks(share, **words):
    """A beam between forks under equal moments."""
    model = Model("strip", gravity=[0, 0, 0])
    model.add_body("b", strip(), **words)
    model.add_marker("ground.end", position=[LENGTH, 0, 0])
    hinge = {"axis": "y", "second_axis": "z"}
    model.add_joint("first", "universal", between=["ground", "b.root"], **hinge)
    model.add_joint("second", "perpendicular", between=["ground.end", "b.tip"], **hinge)
    model.add_joint("line", "in-line", between=["ground.end", "b.tip"], axis="x")
    for name, sign in (("root", 1), ("tip", -1)):
        value = [0, sign * share * np.pi * MOMENT, 0]
        model.add_force(name, "torque", at=f"b.{name}", value=value)
    return model


def test_a_beam_between_forks_buckles_under_equal_moments(told):
    assert told(between_forks(0.5)) == pytest.approx([0.5], rel=0.01)


@pytest.mark.parametrize("words", [
    {"place": (1000.0, -2000.0, 500.0), "frame": "interface root", "inertia_coupling": "full"},
    {"direction": (0.6, 0.8, 0.0)}, {"deformation": "quasi-static"},
])  # fmt: skip
def test_what_is_told_does_not_depend_on_place_frame_or_inertia(words):
    found = flexmb.statics(cantilever(0.7 * FORCE, geometric_stiffening="none", **words))
    (note,) = (one for one in found.notes if "buckles sideways" in one)
    assert float(note.split("it is bent by at least about ")[1].split()[0]) == pytest.approx(
        0.7, abs=0.015
    )


@pytest.mark.seconds
@pytest.mark.parametrize("machine", [cantilever, between_forks])
def test_a_beam_without_stiffening_is_told_how_near_it_is_to_tipping_over(machine):
    """At 0.5 and 0.9 of that load; below 0.32 a stiffness changes by less than a tenth."""
    share = 1.0 if machine is between_forks else FORCE
    for load in (0.5, 0.9):
        found = flexmb.statics(machine(load * share, geometric_stiffening="none"))
        (note,) = (one for one in found.notes if "buckles sideways" in one)
        told = float(note.split("it is bent by at least about ")[1].split()[0])
        assert told == pytest.approx(load, abs=0.015)
    found = flexmb.statics(machine(0.3 * share, geometric_stiffening="none"))
    assert "buckles" not in " ".join(found.notes)
    model = machine(1.1 * share, geometric_stiffening="none")
    found = judged(model, start="quasi-static", verify=False, duration=0.5)
    assert "of the load by which it buckles sideways, yet" in found.message


@pytest.mark.parametrize(("modes", "most_off"), [(2, 0.3), (4, 0.3), (8, 0.04), (20, 0.03)])
def test_few_modes_without_stiffening_tell_a_lower_bound(modes, most_off):
    """Motions that the modes leave out lower the load that tips it over: with 4 it was "about 0.51"
    at 0.7 of that load."""
    found = flexmb.statics(cantilever(0.7 * FORCE, modes=modes, geometric_stiffening="none"))
    (note,) = (one for one in found.notes if "buckles sideways" in one)
    told = float(note.split("it is bent by at least about ")[1].split()[0])
    assert 0.7 * (1 - most_off) < told <= 0.7


def test_a_column_that_is_pushed_aside_a_little_is_not_told_to_be_bent():
    """At 1.2 of Euler's load, with a thousandth of Prandtl's force beside it."""
    model = cantilever(0.001 * FORCE, geometric_stiffening="none")
    euler = np.pi**2 / 4 * EI / LENGTH**2
    model.add_force("weight", "force", at="b0.tip", value=[-1.2 * euler, 0, 0])
    model.set_validity(load_factor="any")
    (note,) = (one for one in flexmb.statics(model).notes if "buckles" in one)
    assert float(note.split("it is compressed by about ")[1].split()[0]) == pytest.approx(1.2, 0.05)


def test_what_a_sideways_push_moves_too_little_without_stiffening_is_told():
    """Its tip is pushed aside by 2 N as it carries 0.31 of Prandtl's force."""
    ends, notes = [], ""
    for words in ({"geometric_stiffening": "none"}, {}):
        model = cantilever(0.0, **words)
        model.add_force("load", "force", at="b0.tip", value=[0, "2*t", f"{0.31 * FORCE}*t"])
        model.add_sensor("tip", "position", of="b0.tip")
        found = flexmb.statics(model, duration=1.0, outputs=10)
        ends.append(np.array([found[f"tip.{axis}"] for axis in "xyz"]))
        notes += " ".join(found.notes)
    change = np.linalg.norm(ends[1][:, -1] - ends[0][:, -1]) / np.ptp(ends[0], axis=1).max()
    told = float(notes.split("a sensor by ")[1].split(" %")[0]) / 100
    assert change > 0.03
    assert told == pytest.approx(change, rel=0.05)


@pytest.mark.parametrize("where", [{"interface": "tip"}, {"node": 20}])
@pytest.mark.parametrize("arm", [(0.05, 0, 0), (0, 0, 0.05)])
def test_a_pair_of_dead_forces_is_a_quasitangential_moment(arm, where, told):
    """At an interface and at a node that carries loads."""
    model = cantilever(0.0, points=[20])
    force = np.cross([0, 0.25 * np.pi * MOMENT, 0], arm) / (2 * 0.05**2)
    for name, sign in (("fore", 1), ("aft", -1)):
        place = [LENGTH, 0, 0] + sign * np.array(arm)
        model.add_marker(f"b0.{name}", position=list(place), **where)
        model.add_force(name, "force", at=f"b0.{name}", value=list(sign * force))
    assert told(model) == pytest.approx([0.5], rel=0.01)


@pytest.mark.parametrize("words", [{}, {"frame": "interface root"}])
def test_a_right_angle_frame_buckles_sideways(words, told):
    """A force at its tip along its first leg, Argyris et al., Comput. Methods Appl. Mech. Engng
    17/18 (1979) 1: 1.088 N; the other way as the part by itself says."""
    legs = np.stack([np.clip(np.arange(21) * 0.024 - at, 0, 0.24) for at in (0, 0.24)])
    points = np.stack([legs[0], 0 * legs[0], legs[1]], axis=1)
    lines = np.stack([np.arange(20), np.arange(1, 21)], axis=1)
    frame = {
        "mesh": Mesh(points, {"line": lines}, {"root": np.array([0]), "tip": np.array([20])}),
        "material": {"E": 71240e6, "nu": 0.31, "density": 2700.0},
        "sections": {"all": rectangle(0.0006, 0.03, shear=False, orientation=(0, 1, 0))},
    }
    body = reduce(**frame, modes=10, interfaces={"root": "root", "tip": "tip"},
                  geometric_stiffening="full")  # fmt: skip
    back = part(
        **frame, supports={"root": {"group": "root", "type": "clamped"}}, buckling=1,
        loads={"tip": {"type": "force", "group": "tip", "force": [-1, 0, 0]}},
    ).load_factors[0]  # fmt: skip
    for load in (1.088, -back):
        for share in (0.97, 1.03):
            model = Model("frame", gravity=[0, 0, 0])
            model.add_body("frame", body, **words)
            model.add_joint("clamp", "fixed", between=["ground", "frame.root"])
            model.add_force("load", "force", at="frame.tip", value=[share * load, 0, 0])
            assert flexmb.linearize(model, about="static").stable == (share < 1)
            assert told(model) == pytest.approx([share], rel=0.01)


@pytest.mark.seconds
def test_moments_count_where_they_buckle_a_body_before_it_is_bent_too_far():
    """Those about the strong axis of a strip, wherever it points and of any size; of a bar none."""
    for size in (1.0, 1e-6):
        for end in ((1, 0, 0), (0.6, 0.8, 0), (0.48, 0.64, 0.6)):
            for high, forms in ((0.04, 4), (0.003, 3)):
                body = reduce(
                    line(8, end=np.multiply(size, end)), material=STEEL, modes=6,
                    interfaces={"root": "root", "tip": "tip"}, geometric_stiffening="full",
                    sections={"all": rectangle(0.003 * size, high * size)},
                )  # fmt: skip
                for one in body.interfaces:
                    found, axis = bend_with_axis(one.bend, np.abs(one.Phi_r).max())
                    assert len(found) == forms
                    assert abs(axis @ end) < 1e-6


@pytest.mark.parametrize("axes", ["global", "b0.tip"])
def test_a_moment_of_constant_or_turning_axis_does_not_tip_it_over(axes, told):
    model = cantilever(0.0)
    model.add_force("moment", "torque", at="b0.tip", value=[0, 2 * np.pi * MOMENT, 0], axes=axes)
    assert told(model) == []


MESHES = {
    "solids": lambda: solid_box("hexahedron20", (24, 1, 3), (LENGTH, THICK, HIGH),
                                shape=lambda x: x - [0, THICK / 2, HIGH / 2]),
    "shells": lambda: sheet((24, 4), shape=lambda x: np.stack(
        [x[:, 0] * LENGTH, 0 * x[:, 0], (x[:, 1] - 0.5) * HIGH], axis=1)),
}  # fmt: skip


@pytest.mark.parametrize("kind", MESHES)
def test_strips_of_solids_and_shells_tip_over_as_the_solid_part_does(kind, told):
    """Rigid ends warp less than those of a beam: it bears 4.6 % more."""
    ends = {"root": "x0", "tip": "x1"}
    factor, = part(
        MESHES["solids"](), material=STEEL, interfaces=ends, buckling=1,
        supports={"clamp": {"interface": "root", "type": "clamped"}},
        loads={"tip": {"type": "interface", "interface": "tip", "force": [0, 0, FORCE]}},
    ).load_factors  # fmt: skip
    assert factor == pytest.approx(1.046, abs=0.01)
    model, sections = Model("strip", gravity=[0, 0, 0]), {"all": shell(THICK)}
    model.add_body("b", reduce(
        MESHES[kind](), material=STEEL, interfaces=ends, modes=12, geometric_stiffening="full",
        sections=sections if kind == "shells" else None,
    ))  # fmt: skip
    model.add_joint("clamp", "fixed", between=["ground", "b.root"])
    model.add_force("load", "force", at="b.tip", value=[0, 0, 0.5 * FORCE])
    assert told(model) == pytest.approx([0.5 / factor], rel=0.01)


@pytest.mark.seconds
@pytest.mark.parametrize("words", [{}, {"frame": "interface root"}])
def test_energy_is_kept_as_it_twists_and_sways(words):
    """On a free hub, after a blow of 0.01 s at its tip, which sways by 6 % of its length."""
    model = cantilever(0.0, modes=2, **words)
    model.joints.clear()
    model.set_validity(inertia_loads="any")
    model.add_sensor("sway", "position", of="b0.tip", relative_to="hub", axes="hub")
    model.add_body("hub", mass=2.0, inertia=[0.02, 0.03, 0.04])
    model.add_joint("weld", "fixed", between=["hub", "b0.root"])
    blow = "step5(t, 0, 1, 0.01, 0)"
    value = [f"10*{blow}", f"40*{blow}", f"300*{blow}"]
    model.add_force("blow", "force", at="b0.tip", value=value)
    found = flexmb.simulate(model, duration=0.06, outputs=30, accuracy=1e-8, method="radau",
                            verify=False)  # fmt: skip
    total = sum(found.energy[kind] for kind in ("kinetic", "strain"))
    total = total[found.time > 0.0101]
    assert np.ptp(found["sway.y"]) > 0.05 * LENGTH
    assert np.ptp(total) < 1e-8 * total[0]


@pytest.mark.parametrize("moment", [1e-5, 0.05, 0.2])
def test_a_torque_does_not_hide_that_a_square_column_buckles(moment, told):
    """Both of its buckling loads, which are equal, become a conjugate pair."""
    side = 0.01
    body = reduce(line(16, end=(1, 0, 0)), material=STEEL, sections={"all": rectangle(side, side)},
                  interfaces={"root": "root", "tip": "tip"}, modes=8,
                  geometric_stiffening="full")  # fmt: skip
    stiffness = E * side**4 / 12
    model = Model("column", gravity=[0, 0, 0])
    model.add_body("column", body)
    model.add_joint("root", "fixed", between=["ground", "column.root"])
    load = 0.5 * np.pi**2 / 4 * stiffness
    model.add_force("load", "force", at="column.tip", value=[-load, 0, 0])
    model.add_force("torque", "torque", at="column.tip", value=[moment * stiffness, 0, 0])
    assert told(model) == pytest.approx([0.5], rel=0.02)


@pytest.mark.seconds
def test_an_audit_tells_what_further_modes_change_in_a_loaded_strip(tmp_path):
    """It is pushed aside as it carries 0.3 of Prandtl's force. Forces that its stiff modes lack
    from row to row are no forces on further modes."""
    ends = []
    for modes in (12, 36):
        model = Model("strip", gravity=[0, 0, 0])
        model.add_body(
            "strip", mesh={"type": "beam", "length": LENGTH, "divisions": 20}, material=STEEL,
            sections={"all": {"type": "rectangle", "y": HIGH, "z": THICK}}, modes=modes,
            interfaces={"root": "start", "tip": "end"}, geometric_stiffening="full",
            inertia_coupling="partial",
        )  # fmt: skip
        model.add_joint("clamp", "fixed", between=["ground", "strip.root"])
        down, aside = f"-{0.3 * FORCE}*step5(t, 0, 0, 0.3, 1)", "0.01*step5(t, 0.3, 0, 0.4, 1)"
        model.add_force("load", "force", at="strip.tip", value=[0, down, aside])
        model.add_sensor("tip", "position", of="strip.tip")
        model.set_dynamics(duration=1.0, outputs=200, accuracy=1e-4)
        found = flexmb.simulate(model, output=tmp_path / str(modes))
        ends.append(np.column_stack([found[f"tip.{axis}"] for axis in "xyz"]))
    change = np.abs(ends[1] - ends[0]).max() / np.ptp(ends[1], axis=0).max()
    (told,) = (
        one for one in flexmb.audit(tmp_path / "12").effects if one.effect == "further modes"
    )
    assert told.share == pytest.approx(change, rel=0.3)


def test_a_body_without_modes_has_no_geometric_stiffness():
    made = reduce(line(4), material=STEEL, sections={"all": rectangle(THICK, HIGH)}, modes=0,
                  interfaces={"root": "root"}, geometric_stiffening="full")  # fmt: skip
    assert made.m == 0 and made.centrifugal_stiffness is None
