"""Loads of a body in a run: pressure, traction and line loads against their loads on all nodes.

Truths: virtual work of the nodal forces at a random state, Newton's and Euler's laws, the static
solution of the full mesh, modal superposition of a beam between pins (Timoshenko, Young & Weaver,
Vibration Problems in Engineering, 4th ed., §5.9) and the column that its own weight buckles,
q L³ = 7.8373 EI (Timoshenko & Gere, Theory of Elastic Stability, §2.12).
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, rotation, slope
from femeshes import line
from scipy.linalg import eigvalsh
from scipy.optimize import brentq
from truthkit import run

import flexmb
from flexmb.errors import SceneError
from flexmb.fe import Mesh, assemble, make_loads, part, rectangle, reduce, resolve
from flexmb.fe.meshes.mesh_shapes import mesh_from
from flexmb.flexbody.effects import frame_at_interface, rigid_twin
from flexmb.model import Model
from tests.accuracyscenes.judging import judged

STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7850.0}
LOADS = {
    "wind": {"type": "pressure", "group": "z1", "pressure": 2e5},
    "drag": {"type": "traction", "group": "x1", "traction": [3e5, -2e5, 1e5]},
    "pinch": {"type": "force", "group": "y1", "force": [0, 50, 80], "moment": [4, 5, 6]},
}


def box(size=1.0):
    return {"type": "box", "size": [0.4 * size, 0.1 * size, 0.02 * size], "divisions": [4, 2, 1]}


def slab(size=1.0, loads=LOADS, interfaces=("root",), **options):
    ends = {"root": "x0"} if "root" in interfaces else {}
    return reduce(box(size), material=STEEL, interfaces=ends, modes=4, loads=loads, **options)


def free(body, load, value=1.7, plane=None):
    model = Model("free", plane=plane)
    model.add_body("slab", body)
    model.add_force("push", "body-load", body="slab", load=load, value=value)
    return model


def nodal_forces(load):
    """(k, 3) work-equivalent forces on all nodes of the mesh, as the FE model has them."""
    fe = assemble(mesh_from(box(), "mesh"), resolve(STEEL))
    f = make_loads(fe, {load: LOADS[load]})[0].f
    return f[fe.numbering.table[fe.numbering.nodes, :3]]


BODIES = {"mean axes": {}, "stiffened": {"geometric_stiffening": "full"}}


@pytest.fixture(scope="module", params=[*BODIES, "interface"])
def body(request):
    made = slab(**BODIES.get(request.param, BODIES["stiffened"]))
    return frame_at_interface(made, "root") if request.param == "interface" else made


@pytest.mark.parametrize("load", LOADS)
def test_it_does_the_work_of_its_forces_on_all_nodes(body, load):
    """Of f_i at r + A (s_i + Φ_i η) with f_i fixed in the body frame; and its power is Q·v."""
    on, off = Bench(free(body, load)), Bench(free(body, load, value=0.0))
    for bench in (on, off):
        bench.randomise(5, eta=1e-4 if body.centrifugal_stiffness is None else 0.0)
        bench.at()
    found = off.residual - on.residual
    q, f = on.q, 1.7 * nodal_forces(load)
    A, eta = rotation(q[3:7]), q[7:]
    s, Phi = body.nodes.position, body.nodes.Phi_t
    x = s + Phi @ eta
    wanted = np.concatenate([
        A @ f.sum(axis=0), np.cross(x, f).sum(axis=0), np.einsum("kdm,kd->m", Phi, f)
    ])  # fmt: skip
    weights = np.concatenate([np.ones(6), np.abs(Phi).max(axis=(0, 1))])
    np.testing.assert_allclose(found / weights, wanted / weights, atol=1e-6 * np.abs(f).sum())
    assert on.powers[2] - off.powers[2] == pytest.approx(found @ on.v, rel=1e-9)


@pytest.mark.parametrize("load", LOADS)
def test_its_tangent_is_the_difference_of_its_forces(body, load):
    bench = Bench(free(body, load, value=1e4))  # loads rule the stiffness
    bench.randomise(3, eta=1e-3)
    n, q = bench.layout.nv, bench.q.copy()
    tangent = (bench.matrix(cp=1.0) - bench.matrix())[:n, :n]
    wanted = [slope(lambda h, d=d: bench.at(q=bench.moved(q, h * d)).residual) for d in np.eye(n)]
    np.testing.assert_allclose(tangent, np.transpose(wanted), atol=1e-8 * np.abs(wanted).max())


@pytest.mark.parametrize("load", LOADS)
def test_a_rigid_body_feels_its_resultant(load):
    """m a = A F and J α + ω × J ω = M about the centre."""
    body = rigid_twin(slab(loads={load: LOADS[load]}))
    bench = Bench(free(body, load))
    bench.randomise(1)
    bench.accelerations()
    A, w, a, e = rotation(bench.q[3:7]), bench.v[3:6], bench.vd[:3], bench.vd[3:6]
    f, x = 1.7 * nodal_forces(load), body.nodes.position - body.center
    of_center = A.T @ a + np.cross(e, body.center) + np.cross(w, np.cross(w, body.center))
    J = body.inertia_about_center
    np.testing.assert_allclose(body.mass * of_center, f.sum(axis=0), atol=1e-8 * np.abs(f).sum())
    moment = np.cross(x, f).sum(axis=0)
    gyration = np.cross(w, J @ w)
    np.testing.assert_allclose(J @ e + gyration, moment, atol=1e-8 * np.abs(gyration).max())


HALF = [0.6, 0.0, 0.8, 0.0]
PLACES = [(1.0, (0, 0, 0), [1, 0, 0, 0]), (1e-3, (7e3, -3e3, 5e3), HALF), (1e3, (0, 2, 0), HALF)]


@pytest.mark.parametrize(("size", "place", "turn"), PLACES, ids=["m", "mm", "km"])
@pytest.mark.parametrize("load", ["wind", "drag"])
def test_a_held_slab_is_as_the_full_mesh_has_it(load, size, place, turn):
    """Displacement and stress at all nodes, with no mode but the static ones."""
    words = {load: LOADS[load] | {"group": LOADS[load]["group"]}}
    body = reduce(box(size), material=STEEL, interfaces={"root": "x0"}, modes=0, loads=words)
    model = Model("held")
    model.add_marker("ground.wall", position=place, orientation=turn)
    model.add_body("slab", body, position=place, orientation=turn)
    model.add_joint("weld", "fixed", between=["ground.wall", "slab.root"])
    value = 1e-3
    model.add_force("push", "body-load", body="slab", load=load, value=value)
    model.set_gravity([0, 0, 0])
    found = run(model, duration=1e-5 * size, outputs=2, start="quasi-static", accuracy=1e-6)
    truth = part(box(size), material=STEEL, interfaces={"root": "x0"}, loads=words,
                 supports={"root": {"interface": "root", "type": "clamped"}})  # fmt: skip
    eta = found.q[-1, 7:]
    root = body.interface("root")
    arms = body.nodes.position - root.position
    moved = body.nodes.Phi_t @ eta - root.Phi_t @ eta - np.cross(root.Phi_r @ eta, arms)
    wanted = value * truth.nodes.Phi_t[:, :, 0]
    np.testing.assert_allclose(moved, wanted, atol=1e-5 * np.abs(wanted).max())
    stress, fe = np.tensordot(body.stress.modes.astype(float), eta, (2, 0)), truth.stress.modes
    fe = value * fe[np.isin(truth.stress.ids, body.stress.ids), :, 0].astype(float)
    np.testing.assert_allclose(stress, fe, atol=1e-4 * np.abs(fe).max())


SLENDER = 0.01
UNIT = {"E": 12.0 / SLENDER**4, "nu": 0.0, "density": 1.0 / SLENDER**2}  # EI = ρA = L = 1


def beam(force, frame=None, modes=8, **options):
    mesh = line(16)
    mesh = Mesh(mesh.points, mesh.blocks, mesh.node_sets, {"axis": {"line": np.arange(16)}})
    body = reduce(
        mesh, material=UNIT, sections={"all": rectangle(SLENDER, SLENDER)}, modes=modes,
        interfaces={"root": "root", "tip": "tip"}, name="beam",
        loads={"line": {"type": "line", "group": "axis", "force": force}}, **options,
    )  # fmt: skip
    return body if frame is None else frame_at_interface(body, frame)


@pytest.mark.parametrize("ratio", [0.3, 2.2])
def test_a_harmonic_line_load_excites_a_beam_between_pins(ratio):
    """w(L/2) = Σ 4 p (±1)/(nπ) [sin Ωt − (Ω/ω) sin ω t]/(ω² − Ω²), n odd, from rest."""
    first, p = np.pi**2, 1e-3
    speed = ratio * first
    model = Model("pins")
    model.add_marker("ground.tip", position=[1, 0, 0])
    model.add_body("beam", beam([0, 0, p]))
    model.add_marker("beam.middle", node=8)
    hinge = {"axis": "y", "second_axis": "z"}
    model.add_joint("root", "universal", between=["ground", "beam.root"], **hinge)
    model.add_joint("tip", "in-line", between=["ground.tip", "beam.tip"], axis="x")
    model.add_force("hum", "body-load", body="beam", load="line", value=f"sin({speed}*t)")
    model.add_sensor("middle", "position", of="beam.middle")
    found = run(model, duration=2.0, outputs=100, accuracy=1e-5, start="undeformed")
    t, wanted = found.t, 0.0
    for n, sign in ((1, 1), (3, -1), (5, 1), (7, -1)):
        w = n**2 * first
        part_ = np.sin(speed * t) - speed / w * np.sin(w * t)
        wanted = wanted + sign * 4 * p / (n * np.pi) * part_ / (w**2 - speed**2)
    np.testing.assert_allclose(found["middle.z"], wanted, atol=2e-3 * np.abs(wanted).max())
    assert found.mismatch() < 1e-4 * found.stored("strain").max()


@pytest.mark.seconds
def test_its_own_weight_buckles_a_column():
    """The lowest eigenvalue of the modes that its root holds is zero at q = 7.8373."""
    body = beam([-1, 0, 0], frame="root", geometric_stiffening="full")

    def lowest(weight):
        model = free(body, "line", value=weight)
        model.add_joint("root", "fixed", between=["ground", "slab.root"])
        model.set_validity(load_factor="any", deflection="any")
        held = run(model, duration=1e-3, outputs=2, start="quasi-static", verify=False)
        bench, modes = Bench(model), slice(6, 6 + body.m)
        bench.at(q=held.q[0], v=0.0, vd=0.0, lam=held.lam[0])
        tangent, M = bench.matrix(cp=1.0)[modes, modes], bench.matrix()[modes, modes]
        return eigvalsh(tangent - M, M)[0]

    assert lowest(0.0) == pytest.approx(3.5160**2, rel=1e-3)
    assert brentq(lowest, 5.0, 9.0) == pytest.approx(7.8373, rel=2e-3)


def test_a_run_tells_how_near_a_line_load_brings_a_column_to_buckling():
    body = beam([-1, 0, 0], frame="root", geometric_stiffening="full")
    model = free(body, "line", value=0.9 * 7.8373)
    model.add_joint("root", "fixed", between=["ground", "slab.root"])
    model.set_validity(load_factor="any", deflection="any")
    found = judged(model, duration=0.02, outputs=4, start="quasi-static", verify=False)
    (told,) = [one for one in found.notes if "of those that buckle it" in one]
    assert float(told.split(" are ")[1].split()[0]) == pytest.approx(0.9, abs=0.02)


@pytest.mark.seconds
def test_a_value_may_follow_a_sensor():
    """A damper over all nodes of a face is that over their interface."""
    speeds = []
    for kind in ("force", "body-load"):
        loads = {"pull": {"type": "force", "group": "x1", "force": [0, 0, 1.0]}}
        ends = {"root": "x0", "tip": {"group": "x1", "type": "rbe3"}}
        body = reduce(box(), material=STEEL, interfaces=ends, modes=4, loads=loads)
        model = Model("damped")
        model.add_body("slab", body, position=[0, 0, 0])
        model.add_joint("weld", "fixed", between=["ground", "slab.root"])
        model.add_sensor("tip", "velocity", of="slab.tip")
        value = "10*sin(300*t) - 20*tip.z"
        if kind == "force":
            fields = {"at": "slab.tip", "axes": "ground", "value": [0, 0, value]}
        else:
            fields = {"body": "slab", "load": "pull", "value": value}
        model.add_force("push", kind, **fields)
        speeds.append(run(model, duration=0.05, outputs=50, accuracy=1e-6)["tip.z"])
    assert np.abs(speeds[0]).max() > 5e-3
    np.testing.assert_allclose(*speeds, atol=1e-3 * np.abs(speeds[0]).max())


def test_its_tangent_is_the_slope_of_its_forces():
    """Each of its forces follows the sensor by its own factor, along its own axis."""
    model = free(slab(), "drag", value="-3*root.x + 2*root.y")
    model.add_sensor("root", "velocity", of="slab.root")
    bench = Bench(model)
    bench.randomise(3, eta=1e-6)
    n, v = bench.layout.nv, bench.v.copy()
    tangent = (bench.matrix(cv=1.0) - bench.matrix())[:n, :n]
    columns = [slope(lambda s, d=d: bench.at(v=v + s * d).residual) for d in np.eye(n)]
    np.testing.assert_allclose(tangent.T, columns, atol=1e-8 * np.abs(columns).max())


def test_a_linearised_model_takes_it_as_an_input():
    """The static gain w(L) = q L⁴/8 of a clamped beam, and Σ φ² at its frequencies."""
    model = free(beam([0, 0, 1.0]), "line", value=0.0)
    model.add_joint("root", "fixed", between=["ground", "slab.root"])
    model.add_sensor("tip", "position", of="slab.tip")
    model.set_dynamics(duration=1.0)
    made = flexmb.linearize(model)
    assert "push" in made.inputs
    (gain,) = made.frequency_response("push", "tip.z", [1e-4])
    assert gain.real == pytest.approx(1 / 8, rel=1e-3)


@pytest.mark.parametrize("method", ["radau", "explicit-rk"])
def test_quasi_static_modes_follow_it(method):
    """w(L) = s(t) q L⁴/8 without vibration."""
    model = Model("slow")
    q, speed = 1e-3, 0.5
    model.add_body("slab", beam([0, 0, q]), deformation="quasi-static")
    model.add_force("push", "body-load", body="slab", load="line", value=f"sin({speed}*t)")
    model.add_joint("root", "fixed", between=["ground", "slab.root"])
    model.add_sensor("tip", "position", of="slab.tip")
    found = run(model, duration=4.0, outputs=40, method=method, accuracy=1e-4)
    wanted = q / 8 * np.sin(speed * found.t)
    np.testing.assert_allclose(found["tip.z"], wanted, atol=2e-3 * np.ptp(wanted))


def test_a_planar_scene_moves_as_a_spatial_one():
    motions = []
    for plane in ("xy", None):
        words = {"side": {"type": "pressure", "group": "y1", "pressure": 1e4}}
        body = slab(loads=words, plane=plane)
        model = Model("planar", plane=plane)
        model.add_body("slab", body)
        model.add_marker("ground.root", position=body.interface("root").position)
        model.add_joint("pin", "revolute", between=["ground.root", "slab.root"], axis="z")
        model.add_force("push", "body-load", body="slab", load="side", value="sin(200*t)")
        model.add_marker("slab.tip", node=int(np.argmax(body.nodes.position[:, 0])))
        model.add_sensor("tip", "position", of="slab.tip")
        motions.append(run(model, duration=0.03, outputs=30, accuracy=1e-5)["tip.y"])
    np.testing.assert_allclose(*motions, atol=1e-4 * np.ptp(motions[0]))


def test_a_load_that_leads_out_of_the_plane_is_refused():
    loads = {"wind": LOADS["wind"] | {"residual": False}}
    model = free(slab(loads=loads, plane="xy"), "wind", plane="xy")
    with pytest.raises(SceneError, match=r"forces.push.load: has a resultant that leads out of"):
        run(model, duration=0.1)


def test_a_load_that_the_modes_lack_is_told_with_its_share():
    """Half of the energy of a uniform load is that of one that its modes do not know."""
    loads = {"wind": LOADS["wind"] | {"residual": False}}
    body = slab(loads=loads)
    model = free(body, "wind", value=1e-3)
    model.add_marker("ground.wall", position=body.interface("root").position)
    model.add_joint("weld", "fixed", between=["ground.wall", "slab.root"])
    found = judged(model, duration=1e-4, outputs=4, start="quasi-static")
    share = body.load("wind").missing_share
    ends = {"root": {"interface": "root", "type": "clamped"}}
    truth = part(box(), material=STEEL, interfaces={"root": "x0"}, loads=loads, supports=ends)
    f = nodal_forces("wind")
    full = np.sum(f * truth.nodes.Phi_t[:, :, 0])
    load = frame_at_interface(body, "root").load("wind").modal
    basis = load @ np.linalg.solve(body.K, load)
    assert share == pytest.approx(1.0 - basis / full, rel=1e-4)
    assert any(f"lack {100 * share:.2g} %" in note for note in found.notes) == (share > 0.1)


def test_errors_name_what_there_is():
    body = slab(loads={"wind": LOADS["wind"]})
    with pytest.raises(SceneError, match='bodies.slab has no load "wnd".*nearest.*wind') as error:
        run(free(body, "wnd"), duration=0.1)
    assert "forces.push.load" in str(error.value)
