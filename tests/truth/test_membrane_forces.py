"""Plates with membrane forces in their equations, beside von Kármán's and a beam between walls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from truthkit import Memory

import flexmb
from flexmb.analysis.assembly import initial_state
from flexmb.analysis.dynamics.dynamics import dynamics
from flexmb.engine.compile import compile_system
from flexmb.errors import SceneError
from flexmb.fe.meshes.mesh_shapes import mesh_from
from flexmb.flexbody import MembraneStiffness
from flexmb.model import Model
from tests.truth.test_membrane_stiffness import (
    LEVY,
    STRIP,
    E,
    H,
    circle,
    plate,
    square,
    tense_strip,
)

DISK = {"type": "disk", "radius": 1.0, "divisions": [16, 48]}


def held(body, middle=(0.5, 0, 0), place=0.0, **words):
    """With all interfaces fixed, and a sensor in the middle."""
    model, words = Model("plate"), words or {"membrane_forces": "full"}
    model.add_body("plate", body, position=[place, 0, 0], **words)
    for end in body.interfaces:
        model.add_marker(f"ground.{end.name}", position=end.position + [place, 0, 0])
        model.add_joint(end.name, "fixed", between=[f"ground.{end.name}", f"plate.{end.name}"])
    near = np.linalg.norm(body.nodes.position - middle, axis=1).argmin()
    model.add_marker("plate.middle", node=int(body.nodes.ids[near]))
    model.add_sensor("middle", "position", of="plate.middle")
    model.add_sensor("strain", "energy", quantity="strain", body="plate")
    return model


def deflection(model, pressure):
    model.add_force("wind", "body-load", body="plate", load="wind", value=f"{pressure}*t")
    result = flexmb.statics(model, duration=1.0, outputs=4)
    return abs(float(result["middle.z"][-1])), result


@pytest.fixture(scope="module")
def disk():
    return plate(DISK, {"rim": "outer"}, nu=0.3)


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("linear", "error"), [(0.3, 2e-3), (1.0, 2e-3), (2.0, 2e-3), (5.0, 2e-3), (20.0, 8e-3)]
)
def test_a_clamped_circle_stretches_as_it_bends(disk, linear, error):
    pressure = linear * E * (16 / 3) / (1 - 0.3**2) * H**4
    model = held(disk, (0, 0, 0))
    model.set_validity(deflection="any")
    found, result = deflection(model, pressure)
    assert found / H == pytest.approx(abs(circle(pressure, 0.3)), rel=error)
    assert not [note for note in result.notes if "for want of others" in note]
    assert any("lack the stress of its membrane forces" in note for note in result.notes)


@pytest.mark.seconds
def test_a_motion_that_is_in_none_of_the_shapes_is_told(disk, monkeypatch):
    """Four forces bend a circle as cos 2 θ, the fourth mode; three and round ones are shapes."""
    monkeypatch.setattr("flexmb.fe.reduction.membrane_stiffness._LOWEST", 10)
    found, notes = {}, ()
    for name, body in (("few", disk), ("all", plate(DISK, {"rim": "outer"}, nu=0.3))):
        model = held(body, (0, 0, 0))
        for k, (x, y) in enumerate(((0.5, 0), (0, 0.5), (-0.5, 0), (0, -0.5))):
            near = np.linalg.norm(body.nodes.position - [x, y, 0], axis=1).argmin()
            model.add_marker(f"plate.at{k}", node=int(body.nodes.ids[near]))
            force = (-1) ** k * 40 * E * H**4
            model.add_force(f"push{k}", "force", at=f"plate.at{k}", value=[0, 0, f"{force}*t"])
        model.add_sensor("side", "position", of="plate.at0")
        model.set_validity(node_loads="any")
        result = flexmb.statics(model, duration=1.0, outputs=4)
        found[name] = float(result["side.z"][-1])
        notes = notes or [note for note in result.notes if "for want of others" in note]
    told = float(notes[0].split("off by about ")[1].split()[0]) / 100
    true = found["few"] / found["all"] - 1
    assert true > 0.01 and 1 / 3 < told / true < 3


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("kind", "error"), [("quad", 0.01), ("triangle", 0.02), ("hexahedron27", 0.035)]
)
def test_a_clamped_square_as_levy_says(kind, error):
    """Solids of this mesh are 4 % too stiff in the linear deflection."""
    mesh, edge = square(kind)
    load = 95.0
    found, _ = deflection(held(plate(mesh, {"rim": edge})), load * E * H**4)
    assert found / H == pytest.approx(LEVY[load], rel=error)


@pytest.mark.seconds
@pytest.mark.parametrize("stiffening", ["none", "full"])
@pytest.mark.parametrize(("size", "place"), [(1.0, 0.0), (1.0, 1000.0), (1e-6, 0.0)])
def test_a_strip_between_walls(size, place, stiffening):
    """With geometric stiffening, which has the forces between interfaces, nothing counts twice."""
    mesh = {**STRIP, "length": size, "width": 0.8 * size}
    body = plate(mesh, {"a": "x0", "b": "x1"}, nu=0.0, size=size, geometric_stiffening=stiffening)
    pressure = 20 * E * H**4
    found, _ = deflection(held(body, (0.5 * size, 0, 0), place * size), pressure)
    assert found == pytest.approx(tense_strip(pressure, size, H * size)[0], rel=0.01)


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("rise", "share", "error"), [(1, -0.5, 6e-3), (1, 0.6, 6e-3), (2, -0.3, 0.01), (2, 0.5, 0.015)]
)
def test_a_shallow_cap_softens_or_stiffens_as_it_is_pushed(rise, share, error):
    """In thicknesses, and over the pressure that buckles a sphere; it snaps through at 0.6."""
    made = mesh_from(DISK, "mesh")
    points = made.points.copy()
    points[:, 2] = rise * H * (1 - points[:, 0] ** 2 - points[:, 1] ** 2)
    body = plate(replace(made, points=points), {"rim": "outer"}, nu=0.3)
    critical = 2 * E * (2 * rise * H * H) ** 2 / np.sqrt(3 * (1 - 0.3**2))
    found, result = deflection(held(body, (0, 0, rise * H)), -share * critical)
    moved = float(result["middle.z"][-1] - result["middle.z"][0]) / H
    assert moved == pytest.approx(circle(-share * critical, 0.3, rise * H), rel=error)


def beam_between_walls(pressure, length, duration, modes=4):
    """Middle of a clamped beam of unit width, ν = 0, pushed at once, by Ritz' method.

    Powers of x (1 − x) as shapes; the tension EA/(2 L) ∫ w'² dx is the same along the beam.
    """
    nodes, weights = np.polynomial.legendre.leggauss(30)
    x, weight = 0.5 * (nodes + 1), 0.5 * weights
    bump, middle = np.polynomial.Polynomial([0, 0, 1, -2, 1]), np.polynomial.Polynomial([-0.5, 1])
    shapes = [bump * middle ** (2 * k) for k in range(modes)]
    w, w1, w2 = (np.array([one.deriv(k)(x) if k else one(x) for one in shapes]) for k in range(3))
    M = 2700 * H * length * (w * weight) @ w.T
    K = E * H**3 / 12 / length**3 * (w2 * weight) @ w2.T
    G = (w1 * weight) @ w1.T / length
    load = pressure * length * w @ weight

    def rates(t, y):
        a, v = y[:modes], y[modes:]
        tension = E * H / (2 * length) * (a @ G @ a)
        return np.concatenate([v, np.linalg.solve(M, load - K @ a - tension * (G @ a))])

    t = np.linspace(0, duration, 401)
    made = solve_ivp(rates, (0, duration), np.zeros(2 * modes), t_eval=t, rtol=1e-9, atol=1e-15)
    return t, np.array([one(0.5) for one in shapes]) @ made.y[:modes]


@pytest.mark.seconds
@pytest.mark.parametrize("method", ["auto", "explicit-rk", "generalized-alpha"])
def test_a_strip_that_is_pushed_at_once_swings_as_a_beam_between_walls(method):
    """Its period is 0.85 of that of small vibrations; all methods keep its energy."""
    body = plate(STRIP, {"a": "x0", "b": "x1"}, nu=0.0)
    model, pressure = held(body), 15 * E * H**4
    model.add_force("wind", "body-load", body="plate", load="wind", value=pressure)
    period = 2 * np.pi / (22.373 * np.sqrt(E * H**2 / 12 / 2700))
    model.set_dynamics(
        duration=1.5 * period, outputs=400, accuracy=1e-3, method=method, start="undeformed",
        verify=False,
    )  # fmt: skip
    found = flexmb.simulate(model)
    _, exact = beam_between_walls(pressure, 1.0, 1.5 * period)
    sign = np.sign(found["middle.z"][np.abs(found["middle.z"]).argmax()])
    assert sign * found["middle.z"] == pytest.approx(exact, abs=0.02 * np.ptp(exact))
    assert found.statistics["energy_balance_error"] < 1e-3
    assert found["strain"].max() > 0.0


@pytest.mark.parametrize(
    ("words", "where", "what"),
    [({"deformation": "quasi-static"}, "deformation", "constant stiffness"),
     ({"membrane_forces": "some"}, "membrane_forces", "full")],
)  # fmt: skip
def test_what_membrane_forces_cannot_be_with_is_told(disk, words, where, what):
    words = {"membrane_forces": "full", **words}
    model = Model("plate")
    with pytest.raises(SceneError, match=what) as told:
        model.add_body("plate", disk, **words)
        model.validate()
    assert where in str(told.value)


def test_a_body_without_their_data_is_refused():
    beam = flexmb.reduce(
        {"type": "beam", "length": 1.0, "divisions": 8}, material="steel", modes=4,
        sections={"all": {"type": "rectangle", "y": 0.01, "z": 0.01}}, interfaces={"root": "start"},
    )  # fmt: skip
    model = Model("beam")
    with pytest.raises(flexmb.FlexmbError, match="no data for them"):
        model.add_body("beam", beam, membrane_forces="full")
        flexmb.statics(model)


@pytest.mark.seconds
@pytest.mark.parametrize("load", [3.0, pytest.param(30.0, marks=pytest.mark.slow)])
def test_auto_has_them_where_they_matter(load, tmp_path):
    """Where a run without is refused, and where the audit tells what it lacks."""
    mesh, edge = square("quad")
    scene = held(plate(mesh, {"rim": edge}), inertia_coupling="constant")
    pressure = load * 20 * E * H**4 / 3
    scene.add_force("wind", "body-load", body="plate", load="wind",
                    value=f"{pressure}*step5(t, 0, 0, 0.05, 1)")  # fmt: skip
    scene.set_dynamics(duration=0.06, accuracy=1e-3, outputs=60)
    scene.set_effects(choice="auto")
    found = flexmb.simulate(scene, output=tmp_path)
    assert any("membrane forces" in note and "effects" in note for note in found.notes)
    (row,) = [one for one in flexmb.audit(found).effects if one.effect == "membrane forces"]
    assert row.on and row.verdict == "needed"


@pytest.mark.seconds
@pytest.mark.parametrize(("linear", "most"), [(1.0, 600), (20.0, 600), (20.0, 1)])
def test_a_start_in_equilibrium_has_them(disk, linear, most, monkeypatch):
    """And so a run from there stays at rest, and its frequency is that of the stretched plate;
    also in a scene of more coordinates than other stiffening is counted in."""
    pressure = linear * E * (16 / 3) / (1 - 0.3**2) * H**4
    model = held(disk, (0, 0, 0))
    model.set_validity(deflection="any")
    model.add_force("wind", "body-load", body="plate", load="wind", value=pressure)
    model.set_dynamics(duration=0.01, outputs=10, accuracy=1e-3, start="quasi-static")
    monkeypatch.setattr(initial_state, "MAX_COORDINATES", most)
    found = flexmb.simulate(model)["middle.z"] / H
    assert np.abs(found) == pytest.approx(abs(circle(pressure, 0.3)), rel=8e-3)
    rate = flexmb.linearize(model).frequencies[0]
    at_rest = 10.2158 * np.sqrt(E * H**2 / (12 * 2700 * (1 - 0.3**2))) / (2 * np.pi)
    assert rate > (1.3 if linear == 1.0 else 2.0) * at_rest


@pytest.mark.seconds
def test_a_file_that_was_reduced_in_space_stretches_in_a_plane_too():
    body = plate(STRIP, {"a": "x0", "b": "x1"}, nu=0.0)
    made = held(body)
    made.plane = "zx"
    found, _ = deflection(made, 20 * E * H**4)
    assert found == pytest.approx(tense_strip(20 * E * H**4, 1.0, H)[0], rel=0.01)


@pytest.mark.seconds
def test_each_of_two_plates_begins_in_its_own_equilibrium(disk):
    """Whatever the order in which their bodies are given."""
    strip = plate(STRIP, {"a": "x0", "b": "x1"}, nu=0.0)
    model, pressure = held(strip), 20 * E * H**4
    model.add_body("disk", disk, position=[0, 5, 0], membrane_forces="full")
    model.add_marker("ground.disk", position=[0, 5, 0])
    model.add_joint("disk", "fixed", between=["ground.disk", "disk.rim"])
    for name in ("plate", "disk"):
        model.add_force(name, "body-load", body=name, load="wind", value=pressure)
    near = np.linalg.norm(disk.nodes.position, axis=1).argmin()
    model.add_marker("disk.middle", node=int(disk.nodes.ids[near]))
    model.add_sensor("round", "position", of="disk.middle")
    model.set_dynamics(duration=0.01, outputs=2, accuracy=1e-3, start="quasi-static")
    model.set_validity(deflection="any")
    compiled = compile_system(model, {"disk": disk, "plate": strip})
    memory = Memory()
    assert dynamics(compiled, model, memory).status == "finished"
    first = dict(zip(compiled.layout.channels, memory.tables()[6][0], strict=True))
    assert abs(first["middle.z"]) == pytest.approx(tense_strip(pressure, 1.0, H)[0], rel=0.01)
    assert abs(first["round.z"]) / H == pytest.approx(abs(circle(pressure, 0.3)), rel=0.01)


def test_more_shapes_than_modes_are_refused():
    """Files may come from anywhere, and the engine has room for as many as there are modes."""
    with pytest.raises(flexmb.FlexmbError, match="are 3, more than the 2 modes"):
        MembraneStiffness(np.ones((3, 2)), np.zeros((2, 6)), np.eye(6))


@pytest.fixture(scope="module")
def sheet():
    """A steel sheet between two clamps, with a load at the middle of a free edge."""
    mesh = {"type": "plate", "length": 0.4, "width": 0.3, "divisions": [16, 12]}
    x, y, _ = mesh_from(mesh, "mesh").points.T
    node = int(np.hypot(x - 0.2, y - y.max()).argmin())
    push = {"type": "force", "node": node, "force": [0, 0, 1.0]}
    return flexmb.reduce(
        mesh, material="steel", sections={"surface": {"type": "shell", "thickness": 0.001}},
        interfaces={"a": "x0", "b": "x1"}, modes=24, loads={"push": push}, name="sheet",
        geometric_stiffening="full", residual="inertia", load_points=[(0.2, y.max(), 0)],
    )  # fmt: skip


BOTH = {"membrane_forces": "full", "geometric_stiffening": "full"}
ALONE = {"membrane_forces": "full", "geometric_stiffening": "none"}


@pytest.mark.parametrize("words", [ALONE, BOTH, {**BOTH, "frame": "interface a"}])
def test_a_sheet_that_is_pushed_at_an_edge_bends_in_its_surface(sheet, words):
    """Its edges would turn in the surface; by Ritz' method with 14 x 14 Legendre polynomials, von
    Kármán, 2.245 mm, and 2.23 with 10 x 10."""
    middle = (0.2, sheet.nodes.position[:, 1].max(), 0)
    model = held(sheet, middle, **words)
    model.add_force("push", "force", at="plate.middle", value=[0, 0, "20*t"])
    found = float(flexmb.statics(model, duration=1.0, outputs=4)["middle.z"][-1])
    assert found == pytest.approx(2.25e-3, rel=0.01)


def test_what_is_left_out_beside_stiffening_has_moments_in_the_surface(sheet):
    middle = (0.2, sheet.nodes.position[:, 1].max(), 0)
    model = held(sheet, middle, geometric_stiffening="full")
    model.add_force("push", "force", at="plate.middle", value=[0, 0, "20*t"])
    result = flexmb.statics(model, duration=1.0, outputs=4)
    (note,) = [one for one in result.notes if "membrane forces are left out" in one]
    told = float(note.split("by about ")[1].split()[0]) / 100
    assert told == pytest.approx(1 - 2.25e-3 / float(result["middle.z"][-1]), rel=0.1)


@pytest.mark.parametrize("gravity", [[0, 2000, 0], [2000, 0, 0]])
def test_inertia_in_the_surface_stiffens_a_sheet_once(sheet, gravity):
    """Clamps take it by moments too. Without stiffening all of it is in the membrane stiffness."""
    rates = []
    stiffened = {"geometric_stiffening": "full"}
    for words in (ALONE, BOTH, {**BOTH, "frame": "interface b"}, stiffened):
        model = held(sheet, **words)
        model.gravity = gravity
        rates.append(flexmb.linearize(model).frequencies[:2])
    for rate in rates[1:]:
        assert rate == pytest.approx(rates[0], rel=0.01)


def test_a_frame_at_an_interface_needs_stiffening_too(sheet):
    """A pulled cantilever deflected five times too far; by both alike with all effects."""
    found = []
    for words in (ALONE, {**BOTH, "frame": "interface a"}, {**ALONE, "frame": "interface a"}):
        model = Model("plate")
        model.add_body("plate", sheet, **words)
        model.add_marker("ground.a", position=sheet.interface("a").position)
        model.add_joint("a", "fixed", between=["ground.a", "plate.a"])
        model.add_force("pull", "force", at="plate.b", value=[1000, 0, "t"])
        model.add_sensor("tip", "position", of="plate.b")
        if len(found) == 2:
            with pytest.raises(flexmb.FlexmbError, match="frame: at an interface membrane forces"):
                flexmb.statics(model)
        else:
            found.append(float(flexmb.statics(model, duration=1.0, outputs=2)["tip.z"][-1]))
    assert found[1] == pytest.approx(found[0], rel=0.01)


def test_a_body_that_is_prepared_twice_is_the_same(sheet):
    model = held(sheet, **BOTH)
    once = model.bodies["plate"].simulated(sheet)
    again = model.bodies["plate"].simulated(once)
    left = [one.membrane_stiffness.quadratic for one in (once, again, sheet)]
    assert np.array_equal(left[0], left[1])
    assert not np.array_equal(left[0], left[2])
    for words in ({}, {"membrane_forces": "full", "geometric_stiffening": "none"}):
        other = held(once, **(words or {"geometric_stiffening": "full"}))
        with pytest.raises(flexmb.FlexmbError, match="take the file of its reduction"):
            flexmb.statics(other)
