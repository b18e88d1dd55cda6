"""Plates that stretch as they bend: what runs tell of it, against plates with large deflections.

Truths: a clamped square under pressure (Levy, Square plate with clamped edges under normal pressure
producing large deflections, NACA TN 847, 1942, nu = 0.316, edges that do not move); a strip between
clamped edges, as a beam with the tension of its own bow (Timoshenko & Woinowsky-Krieger, Theory of
Plates and Shells, §4); a clamped circle by von Karman's equations (the same, §100).
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from typer.testing import CliRunner

import flexmb
from flexmb import Model
from flexmb.cli import app
from flexmb.fe.meshes.mesh_shapes import mesh_from
from flexmb.flexbody import load, save
from flexmb.flexbody.effects import frame_at_interface, rigid_twin
from flexmb.flexbody.planar_body import combine_modes

E, H = 70e9, 0.002
LEFT_OUT = "membrane forces are left out"
LEVY = {38.3: 0.471, 95.0: 0.912, 184.0: 1.323}  # q a^4/(E h^4): deflection over the thickness


def square(kind, size=1.0):
    """A square plate, its edge, and where its middle is."""
    if kind == "hexahedron27":
        mesh = {"type": "box", "size": [size, size, size * H], "divisions": [12, 12, 1]}
        x, y, _ = mesh_from({**mesh, "elements": kind}, "mesh").points.T
        nodes = np.flatnonzero(np.isin(x, [0, size]) | (np.abs(y) > 0.4999 * size))
        return {**mesh, "elements": kind}, {"nodes": nodes.tolist()}
    return {
        "type": "plate", "length": size, "width": size, "divisions": [16, 16], "elements": kind
    }, "edges"  # fmt: skip


def plate(mesh, interfaces, nu=0.316, size=1.0, **options):
    solid = isinstance(mesh, dict) and mesh["type"] == "box"
    top, section = "z1" if solid else "surface", {"type": "shell", "thickness": H * size}
    return flexmb.reduce(
        mesh, material={"E": E, "nu": nu, "density": 2700},
        sections=None if solid else {"surface": section}, interfaces=interfaces, modes=10,
        loads={"wind": {"type": "pressure", "group": top, "pressure": 1.0}}, name="plate",
        **options,
    )  # fmt: skip


def loaded(body, pressure, joints, place=0.0, middle=(0.5, 0, 0)):
    """Equilibria under a growing pressure: the run, and the deflection of its middle."""
    model = Model("plate")
    model.add_body("plate", body, position=[place, 0, 0])
    for name, (joint, more) in joints.items():
        position = body.interface(name).position + [place, 0, 0]
        model.add_marker(f"ground.{name}", position=position)
        model.add_joint(name, joint, between=[f"ground.{name}", f"plate.{name}"], **more)
    model.add_force("wind", "body-load", body="plate", load="wind", value=f"{pressure}*t")
    near = np.linalg.norm(body.nodes.position - middle, axis=1).argmin()
    model.add_marker("plate.middle", node=int(body.nodes.ids[near]))
    model.add_sensor("middle", "position", of="plate.middle")
    result = flexmb.statics(model, duration=1.0, outputs=2)
    return result, float(np.ptp(result["middle.z"]))


def told(result):
    """Change of the deflection that a run tells, and the cure."""
    notes = [note for note in result.notes if LEFT_OUT in note]
    if not notes:
        return None
    (note,) = notes
    words = note.split("reduce its deflection by about ")[1]
    return float(words.split(" %")[0]) / 100, note.rpartition("; ")[2]


FIXED = ("fixed", {})


@pytest.mark.parametrize("kind", ["quad", "triangle", "hexahedron27"])
@pytest.mark.parametrize("load", LEVY)
def test_a_clamped_square_deflects_less_by_what_is_told(kind, load):
    mesh, edge = square(kind)
    pressure = load * E * H**4
    result, linear = loaded(plate(mesh, {"rim": edge}), pressure, {"rim": FIXED})
    assert linear == pytest.approx(0.00126532 * pressure * 12 * (1 - 0.316**2) / (E * H**3), 0.045)
    # w + c w^3 is proportional to the load; solids are 4 % too stiff here
    thin, w = 0.00126532 * load * 12 * (1 - 0.316**2), LEVY[load]
    exact = brentq(lambda x: x + (thin - w) / w**3 * x**3 - linear / H, 0, 3)
    assert told(result)[0] == pytest.approx(1 - exact * H / linear, rel=0.1)


def circle(pressure, nu, rise=0.0):
    """Deflection over the thickness of a clamped circle of radius 1, or a cap (Marguerre)."""
    D, C = E * H**3 / (12 * (1 - nu**2)), E * H / (1 - nu**2)

    def rates(r, y, push):  # u, N_r, w, w', w''
        u, N, _, slope, bent = y
        around, first = nu * N + (1 - nu**2) * C * u / r, -2 * rise * r
        stretch = N / C - nu * u / r - 0.5 * slope**2 - slope * first
        third = N * (slope + first) / D + 0.5 * push * r / D - bent / r + slope / r**2
        return np.array([stretch, (around - N) / r, slope, bent, third])

    def ends(a, b):
        return np.array([a[0], a[3], b[0], b[2], b[3]])

    r, y = np.linspace(1e-4, 1, 200), np.zeros((5, 200))
    for push in np.linspace(0, pressure, 6)[1:]:
        solution = solve_bvp(partial(rates, push=push), ends, r, y, tol=1e-6, max_nodes=20000)
        assert solution.success
        r, y = solution.x, solution.y
    return y[2][0] / H


@pytest.mark.seconds
@pytest.mark.parametrize("linear", [0.3, 0.7, 1.2])
def test_a_clamped_circle_deflects_less_by_what_is_told(linear):
    mesh = {"type": "disk", "radius": 1.0, "divisions": [16, 48]}
    body = plate(mesh, {"rim": "outer"}, nu=0.3)
    pressure = linear * E * (16 / 3) / (1 - 0.3**2) * H**4
    result, deflection = loaded(body, pressure, {"rim": FIXED}, middle=(0, 0, 0))
    assert deflection == pytest.approx(linear * H, 0.02)
    exact = abs(circle(pressure, 0.3))
    assert told(result)[0] == pytest.approx(1 - exact / linear, rel=0.05, abs=0.002)


def tense_strip(pressure, length, thickness):
    """Deflection of a clamped strip, nu = 0, with and without the tension of its own bow."""
    EI, EA, x = E * thickness**3 / 12, E * thickness, np.linspace(0, length, 4001)

    def bow(T):
        k = np.sqrt(T / EI)
        ends = [
            [1, 0, 1, 0], [0, 1, 0, k], [1, length, np.cosh(k * length), np.sinh(k * length)],
            [0, 1, k * np.sinh(k * length), k * np.cosh(k * length)],
        ]  # fmt: skip
        c = np.linalg.solve(ends, [0, 0, pressure * length**2 / (2 * T), pressure * length / T])
        curved = c[2] * np.cosh(k * x) + c[3] * np.sinh(k * x)
        return c[0] + c[1] * x + curved - pressure * x**2 / (2 * T)

    def excess(T):
        slope = np.gradient(bow(T), x, edge_order=2)
        return T * length / EA - 0.5 * np.trapezoid(slope**2, x)

    T = brentq(excess, 1e-2 * EI / length**2, 900 * EI / length**2)
    return bow(T).max(), pressure * length**4 / (384 * EI)


STRIP = {"type": "plate", "length": 1.0, "width": 0.8, "divisions": [16, 12]}


@pytest.mark.parametrize(("size", "place"), [(1.0, 0.0), (1.0, 1000.0), (1e-6, 0.0), (1e3, 0.0)])
def test_a_strip_between_clamped_edges_deflects_less_by_what_is_told(size, place):
    mesh = {**STRIP, "length": size, "width": 0.8 * size}
    body = plate(mesh, {"a": "x0", "b": "x1"}, nu=0.0, size=size)
    pressure = 20 * E * H**4
    joints = {"a": FIXED, "b": FIXED}
    result, linear = loaded(body, pressure, joints, place * size, (0.5 * size, 0, 0))
    exact, straight = tense_strip(pressure, size, H * size)
    assert linear == pytest.approx(straight, 0.01)
    change, cure = told(result)
    assert change == pytest.approx(1 - exact / straight, abs=0.008)
    assert cure == 'reduce it with geometric_stiffening = "full"'


def test_the_middle_of_a_long_plate_deflects_less_by_what_is_told():
    """Held all round, four times as long as wide: it bends as a strip across its width."""
    mesh = {"type": "plate", "length": 2.0, "width": 0.5, "divisions": [32, 16]}
    body = plate(mesh, {"rim": "edges"}, nu=0.0, residual="inertia")
    pressure = 20 * E * H**4 * 16
    result, linear = loaded(body, pressure, {"rim": FIXED}, middle=(1.0, 0, 0))
    exact, straight = tense_strip(pressure, 0.5, H)
    assert linear == pytest.approx(straight, 0.03)
    assert told(result)[0] == pytest.approx(1 - exact / straight, rel=0.1)


def test_geometric_stiffening_has_the_forces_between_interfaces():
    pressure, joints = 20 * E * H**4, {"a": FIXED, "b": FIXED}
    body = plate(STRIP, {"a": "x0", "b": "x1"}, nu=0.0, geometric_stiffening="full")
    result, deflection = loaded(body, pressure, joints)
    assert deflection == pytest.approx(tense_strip(pressure, 1.0, H)[0], 1e-3)
    assert told(result) is None


def test_geometric_stiffening_has_no_forces_within_one_interface():
    mesh, edge = square("quad")
    body = plate(mesh, {"rim": edge}, geometric_stiffening="full")
    result, linear = loaded(body, 38.3 * E * H**4, {"rim": FIXED})
    change, cure = told(result)
    assert change == pytest.approx(1 - LEVY[38.3] * H / linear, rel=0.1)
    small = float(cure.removesuffix(" m").rpartition(" ")[2])
    # w + c w^3 is proportional to the load
    assert 0.01 / (linear / H / LEVY[38.3] ** 3 - 1 / LEVY[38.3] ** 2) == pytest.approx(
        (small / H) ** 2, rel=0.1
    )


@pytest.mark.slow
def test_a_plate_that_turns_without_stiffening_is_told_to_lack_membrane_forces():
    """A square plate clamped along an edge and pushed at a corner, at the unit of its speed."""
    unit = 0.01 * np.sqrt(70e9 / (12 * 2700 * (1 - 0.3**2)))
    changes = {}
    for stiffening in ("none", "full"):
        body = flexmb.reduce(
            {"type": "plate", "length": 1.0, "width": 1.0, "divisions": [8, 8]},
            material={"E": 70e9, "nu": 0.3, "density": 2700}, modes=10,
            sections={"surface": {"type": "shell", "thickness": 0.01}},
            interfaces={"root": "x0", "corner": "x1y1"}, residual="inertia",
            geometric_stiffening=stiffening,
        )  # fmt: skip
        model = Model("plate")
        model.add_body("plate", body)
        model.add_joint("axis", "revolute", between=["ground", "plate.root"], axis="z")
        model.add_driver("motor", joint="axis", angle=f"{2 * unit}*t")
        push = [0, 0, "20*step5(t, 0, 0, 0.4, 1)"]
        model.add_force("push", "force", at="plate.corner", value=push)
        seen_from = {"relative_to": "plate.root", "axes": "plate.root"}
        model.add_sensor("corner", "position", of="plate.corner", **seen_from)
        result = flexmb.simulate(model, duration=0.5, accuracy=1e-4, verify=False)
        changes[stiffening] = result["corner.z"][-1], told(result)
    (soft, (change, cure)), (stiff, none) = changes.values()
    assert none is None
    assert 0.5 < change / (1 - stiff / soft) < 2  # its frame turns, and with it the loads
    assert "geometric_stiffening" in cure


RELEASED = {
    "prismatic": {"a": FIXED, "b": ("prismatic", {"axis": "x"})},
    "in-line": {"a": FIXED, "b": ("in-line", {"axis": "x"})},
    "free": {"a": FIXED},
}


@pytest.mark.parametrize("joints", RELEASED.values(), ids=RELEASED)
def test_a_plate_that_may_shorten_is_not_told_to_stretch(joints):
    mesh = {"type": "plate", "length": 1.0, "width": 0.8, "divisions": [16, 12]}
    body = plate(mesh, {"a": "x0", "b": "x1"}, nu=0.0)  # nothing bends across
    result, deflection = loaded(body, 20 * E * H**4 / (20 if len(joints) == 1 else 1), joints)
    assert deflection > 0.49 * H
    assert told(result) is None


def pushed_at_a_corner(force, nu, degree=6):
    """Deflection there of a square clamped along x = 0: von Karman's plate by Ritz' method."""
    at, weight = np.polynomial.legendre.leggauss(2 * degree)
    x, y = (one.ravel() for one in np.meshgrid(0.5 * (at + 1), at, indexing="ij"))
    area = np.outer(0.5 * weight, 0.5 * weight).ravel()
    D, C = E * H**3 / (12 * (1 - nu**2)), E * H / (1 - nu**2)
    law = np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])

    def terms(lowest, x, y):
        """Derivatives (x, y), (1, 0) ..., of x^i P_j(2 y)."""
        legendre = [np.polynomial.Legendre.basis(j) for j in range(degree + 1)]
        powers = range(lowest, lowest + degree)

        def of(a, b):
            return np.stack([
                (np.polynomial.Polynomial.basis(i).deriv(a)(x) if a else x**i) *
                (2**b * one.deriv(b)(y) if b else one(y)) for i in powers for one in legendre
            ], axis=-1)  # fmt: skip

        return of

    w, u = terms(2, x, y), terms(1, x, y)
    n, zero = u(0, 0).shape[1], np.zeros_like(u(0, 0))
    slopes = np.stack([w(1, 0), w(0, 1)])
    bent = np.stack([w(2, 0), w(0, 2), 2 * w(1, 1)])
    plane = np.stack([
        np.hstack([u(1, 0), zero]), np.hstack([zero, u(0, 1)]), np.hstack([u(0, 1), u(1, 0)])
    ])  # fmt: skip
    bending = np.einsum("agi,ab,bgj,g->ij", bent, D * law, bent, area, optimize=True)
    corner = terms(2, 1.0, 1.0)(0, 0)
    load = force * np.concatenate([np.zeros(2 * n), corner])
    found = np.zeros(3 * n)
    for share in np.linspace(0.25, 1, 4):
        for _ in range(30):
            wx, wy = slopes @ found[2 * n :]
            strain = plane @ found[: 2 * n] + np.stack([0.5 * wx**2, 0.5 * wy**2, wx * wy])
            N = C * law @ strain
            both = np.stack([wx[:, None] * slopes[0], wy[:, None] * slopes[1],
                             wx[:, None] * slopes[1] + wy[:, None] * slopes[0]])  # fmt: skip
            rows = np.concatenate([plane, both], axis=2)
            rest = np.einsum("agi,ag,g->i", rows, N, area) - share * load
            K = np.einsum("agi,ab,bgj,g->ij", rows, C * law, rows, area, optimize=True)
            for a, b, of in ((0, 0, 0), (1, 1, 1), (0, 1, 2), (1, 0, 2)):
                K[2 * n :, 2 * n :] += slopes[a].T @ ((N[of] * area)[:, None] * slopes[b])
            rest[2 * n :] += bending @ found[2 * n :]
            K[2 * n :, 2 * n :] += bending
            size = 1 / np.sqrt(K.diagonal())
            step = size * np.linalg.lstsq(size[:, None] * K * size, size * rest, 1e-13)[0]
            found = found - step
            if np.linalg.norm(step / size) < 1e-9 * np.linalg.norm(found / size):
                break
    return float(corner @ found[2 * n :])


@pytest.mark.parametrize("force", [0.3, 1.6])
def test_a_plate_that_is_pushed_at_a_corner_deflects_less_by_what_is_told(force):
    """It bends and twists: its Gaussian curvature alone stretches it."""
    body = plate(square("quad")[0], {"root": "x0", "corner": "x1y1"}, nu=0.3)
    model = Model("plate")
    model.add_body("plate", body)
    model.add_joint("root", "fixed", between=["ground", "plate.root"])
    model.add_force("push", "force", at="plate.corner", value=[0, 0, f"{force}*t"])
    model.add_sensor("corner", "position", of="plate.corner")
    result = flexmb.statics(model, duration=1.0, outputs=2)
    linear = np.ptp(result["corner.z"])
    assert linear == pytest.approx(1e3 * pushed_at_a_corner(1e-3 * force, 0.3), 0.02)
    change = 1 - pushed_at_a_corner(force, 0.3) / linear
    if change < 0.01:
        assert told(result) is None
    else:
        assert told(result)[0] == pytest.approx(change, rel=0.5)


@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_forces_are_the_derivatives_of_the_energy_in_every_frame(size):
    mesh, edge = square("quad", size)
    body = plate(mesh, {"rim": edge}, size=size)
    stiffness, rng = body.membrane_stiffness, np.random.default_rng(3)
    eta = rng.standard_normal(body.m) * 1e-3 / np.sqrt(np.diag(body.K))
    steps = 1e-5 / np.sqrt(np.diag(body.K)) * np.eye(body.m) * 1e-3
    forces, tangent = stiffness.forces(eta)
    slopes = [stiffness.energy(eta + d) - stiffness.energy(eta - d) for d in steps]
    assert np.array(slopes) / (2 * steps.max(axis=1)) == pytest.approx(
        forces, abs=1e-6 * np.abs(forces).max()
    )
    curvatures = [stiffness.forces(eta + d)[0] - stiffness.forces(eta - d)[0] for d in steps]
    assert np.array(curvatures) / (2 * steps.max(axis=1))[:, None] == pytest.approx(
        tangent, abs=1e-6 * np.abs(tangent).max()
    )
    other = frame_at_interface(body, "rim").membrane_stiffness
    assert other.energy(eta) == pytest.approx(float(stiffness.energy(eta)), rel=1e-12)
    Z = rng.standard_normal((body.m, 4))
    some = combine_modes(body, Z).membrane_stiffness
    assert some.energy(eta[:4]) == pytest.approx(float(stiffness.energy(Z @ eta[:4])), rel=1e-9)
    assert rigid_twin(body).membrane_stiffness is None


def test_a_body_file_keeps_the_membrane_stiffness(tmp_path):
    mesh, edge = square("quad")
    body = plate(mesh, {"rim": edge})
    save(body, tmp_path / "plate.flexbody.h5")
    stored = load(tmp_path / "plate.flexbody.h5").membrane_stiffness
    for name in ("shapes", "linear", "quadratic"):
        assert np.array_equal(getattr(stored, name), getattr(body.membrane_stiffness, name))


def test_bars_and_compact_bodies_have_no_membrane_stiffness():
    bar = {"type": "plate", "length": 1.0, "width": 0.05, "divisions": [20, 1]}
    assert plate(bar, {"a": "x0", "b": "x1"}).membrane_stiffness is None
    block = {"type": "box", "size": [1, 1, 0.5], "divisions": [3, 3, 2]}
    assert plate(block, {"a": "x0", "b": "x1"}).membrane_stiffness is None


@pytest.mark.parametrize(("stiffening", "verdict"), [("none", "missing"), ("full", "may stay off")])
def test_an_audit_has_a_row_for_membrane_forces(tmp_path, stiffening, verdict):
    coarse = {**STRIP, "divisions": [8, 6]}
    body = plate(coarse, {"a": "x0", "b": "x1"}, nu=0.0, geometric_stiffening=stiffening)
    model = Model("plate", gravity=[0, 0, -20 * E * H**3 / 2700])
    model.add_body("plate", body)
    for name, place in (("a", 0), ("b", 1)):
        model.add_marker(f"ground.{name}", position=[place, 0, 0])
        model.add_joint(name, "fixed", between=[f"ground.{name}", f"plate.{name}"])
    model.add_marker("plate.middle", node=int(body.nodes.ids[len(body.nodes.ids) // 2]))
    model.add_sensor("middle", "position", of="plate.middle")
    result = flexmb.simulate(
        model, duration=0.03, accuracy=1e-3, verify=False, outputs=20, output=tmp_path
    )
    (row,) = [one for one in flexmb.audit(result).effects if one.effect == "membrane forces"]
    assert row.verdict == verdict
    assert (row.share > 0.1) == (stiffening == "none")


def solved(mesh, supports, pressure, nu=0.316, thickness=H):
    """Notes of a part by itself, and its largest displacement."""
    result = flexmb.part(
        mesh, material={"E": E, "nu": nu, "density": 2700}, supports=supports,
        sections={"surface": {"type": "shell", "thickness": thickness}},
        loads={"wind": {"type": "pressure", "group": "surface", "pressure": pressure}},
    )  # fmt: skip
    return result.notes, np.linalg.norm(result.displacements(), axis=1).max()


ALL = ["ux", "uy", "uz", "rx", "ry", "rz"]


@pytest.mark.parametrize("load", LEVY)
def test_a_part_tells_what_linear_theory_leaves_out(load):
    mesh, edge = square("quad")
    notes, linear = solved(mesh, {"rim": {"group": edge, "hold": ALL}}, load * E * H**4)
    (note,) = [one for one in notes if "membrane forces" in one]
    change, share = (float(note.split(" about ")[k].split()[0]) for k in (1, 2))
    assert change == pytest.approx(100 * (1 - LEVY[load] * H / linear), rel=0.15)
    # w + c w^3 is proportional to the load
    small = np.sqrt(0.01 / (linear / H / LEVY[load] ** 3 - 1 / LEVY[load] ** 2))
    assert share == pytest.approx(small * H / linear, rel=0.15)


def test_a_part_that_bends_in_one_direction_has_no_membrane_forces():
    """A strip clamped at one end: w = q L^4/(8 D), 0.2 of its length, 90 times its thickness."""
    mesh = {"type": "plate", "length": 1.0, "width": 0.2, "divisions": [20, 4]}
    pressure = 0.18 * 8 * E * H**3 / 12
    notes, linear = solved(mesh, {"root": {"group": "x0", "hold": ALL}}, pressure, nu=0.0)
    assert linear == pytest.approx(0.18, rel=0.01)
    (note,) = notes
    assert note.startswith("the largest displacement is 0.18 of the size of the part")


def test_a_part_whose_supports_move_as_one_is_not_told_to_stretch():
    mesh, edge = square("quad")
    rim = {"group": edge, "hold": ALL, "displacement": [0.0, 0.0, 0.5]}
    notes, _ = solved(mesh, {"rim": rim}, 2 * E * H**4)
    assert not notes


CANTILEVER = """
title = "A long cantilever"
gravity = [0, 0, "-g"]
parameters = { g = 100 }
[bodies.beam]
mesh = { type = "beam", length = 2, divisions = 10 }
material = { E = 210e9, nu = 0.3, density = 7850 }
sections = { leg1 = { type = "rectangle", y = 0.01, z = 0.01 } }
interfaces = { a = "start", b = "end" }
modes = 4
[joints.root]
type = "fixed"
between = ["ground", "beam.a"]
[sensors.tip]
type = "position"
of = "beam.b"
"""


def test_equilibria_tell_which_limits_they_exceed(tmp_path):
    """`flexmb statics`: w q L^4/(8 EI), 1.1 of the length of the beam."""
    scene = tmp_path / "beam.toml"
    scene.write_text(CANTILEVER)
    shown = CliRunner().invoke(app, ["statics", str(scene), "--starts", "1"]).output
    note = " ".join(shown.split()).partition("note: equilibrium 1: bodies.beam is deflected by ")[2]
    exact = 7850 * 1e-4 * 100 * 2**4 / (8 * 210e9 * 0.01**4 / 12) / 2
    assert float(note.split()[0]) == pytest.approx(exact, rel=0.06)
    shown = CliRunner().invoke(app, ["statics", str(scene), "--vary", "g=0..40:5"]).output
    assert "note: g = 30: bodies.beam is deflected by 0.13" in " ".join(shown.split())
    assert shown.count("is deflected") == 1
