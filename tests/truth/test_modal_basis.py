"""Guards of a basis: loads beside the interfaces and modes that were left out, against full models.

Full models by sparse LU of the whole mesh (SciPy), by reductions that leave nothing out, and by
Timoshenko & Young, Vibration Problems in Engineering, §5.12: a cantilever's frequencies.
"""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from flexmb.analysis.validity.body_accelerations import OmittedOscillators
from flexmb.analysis.validity.modal_basis import ModalBasisMonitor
from flexmb.engine.compile import compile_system
from flexmb.errors import SolverError
from flexmb.fe import assemble, mesh_from, reduce
from flexmb.fe.sections.section_tables import resolve, sections_from
from flexmb.flexbody import load
from flexmb.model import Model
from flexmb.results import Result
from flexmb.results.output_block import OutputBlock
from flexmb.workflow.run import run_single

E, RHO, H, L = 2.1e11, 7850.0, 0.02, 1.0
STEEL = {"E": E, "nu": 0.3, "density": RHO}
SQUARE = {"all": {"type": "rectangle", "y": H, "z": H}}
SHELL = {"all": {"type": "shell", "thickness": 0.004}}
PLATE = {"type": "plate", "length": 0.4, "width": 0.3, "divisions": [8, 6]}
THIRD = 7.8547574**2 * np.sqrt(E * H**2 / 12 / RHO) / L**2 / (2 * np.pi)  # Hz, of a cantilever


def full_compliance(node):
    """(3, 3) of the plate, clamped at x = 0, by its whole stiffness."""
    fe = assemble(mesh_from(PLATE), resolve("steel"), sections_from(SHELL))
    edge = np.flatnonzero(fe.mesh.points[:, 0] < 1e-9)
    free = np.setdiff1d(np.arange(fe.numbering.n), fe.numbering.table[edge].ravel())
    F = np.zeros((fe.numbering.n, 3))
    F[fe.numbering.table[node, :3], np.arange(3)] = 1.0
    return F[free].T @ spsolve(fe.K.tocsc()[free][:, free], F[free])


def reduced_compliance(body, node):
    """(3, 3) of the body with its interface at rest: its frame and eta move, K holds eta."""
    edge, row = body.interface("edge"), body.nodes.row(node)

    def motion(position, Phi_t, Phi_r):
        turn = np.cross(np.eye(3), position)  # row a: e_a x position
        return np.block(
            [[np.eye(3), turn.T @ np.eye(3), Phi_t], [np.zeros((3, 3)), np.eye(3), Phi_r]]
        )

    G = motion(edge.position, edge.Phi_t, edge.Phi_r)
    B = motion(body.nodes.position[row], body.nodes.Phi_t[row], body.nodes.Phi_r[row])[:3]
    n = 6 + body.m
    A = np.zeros((n + 6, n + 6))
    A[6:n, 6:n], A[:n, n:], A[n:, :n] = body.K, G.T, G
    right = np.vstack([B.T, np.zeros((6, 3))])
    return B @ np.linalg.solve(A, right)[:n]


@pytest.mark.parametrize("reduction", ["craig-bampton", "free-interface"])
@pytest.mark.parametrize("node", [31, 62])
def test_what_is_missing_under_a_load_is_that_of_the_full_model(reduction, node):
    """Out of the plate's plane, where modes answer at all, and within it, where four do not."""
    body = reduce(
        PLATE, material="steel", sections=SHELL, interfaces={"edge": "x0"}, reduction=reduction,
        load_points=[node], modes=4,
    )  # fmt: skip
    full, reduced = full_compliance(node), reduced_compliance(body, node)
    answer = body.load_response
    np.testing.assert_allclose(answer.energy[:3, :3], full, rtol=1e-6, atol=1e-9 * full.max())
    if reduction == "free-interface":  # its modes answer in part what the interface would hold
        assert (np.diag(answer.missing)[:3] <= np.diag(full) * (1 + 1e-9)).all()
        return
    missing = full - reduced
    np.testing.assert_allclose(answer.missing[:3, :3], missing, rtol=1e-6, atol=1e-8 * full.max())


def clamped(value, modes=4, node=20, residual="auto", **dynamics):
    """A cantilever with a force at a node of its mesh."""
    model = Model("beam")
    model.add_body(
        "beam", mesh={"type": "beam", "length": L, "divisions": 20}, material=STEEL, modes=modes,
        interfaces={"root": "start"}, sections=SQUARE, damping=0.02, **dynamics.pop("body", {}),
    )  # fmt: skip
    model.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    model.add_marker("beam.place", node=node)
    model.add_force("push", "force", at="beam.place", value=value)
    model.add_sensor("place", "position", of="beam.place")
    model.set_dynamics(**{"duration": 0.1, "outputs": 600, **dynamics})
    return model


def ran(model, folder, **options):
    report = run_single(model, folder, pictures=False, **options)
    words = ("modes lack", "would vibrate", "does not tell")
    return Result(report.result), [note for note in report.notes if any(w in note for w in words)]


SLOW = ((0.3, 600), (1.1, 600), (0.95, 40))
RISE = "step(t, 0, 0, 0.09, 50)"


def test_the_share_that_a_run_tells_is_that_of_the_deflection(tmp_path):
    """Two of its bending modes at a quarter of the beam, against Euler-Bernoulli: c = x³/3EI."""
    result, (note,) = ran(clamped([0, 50, 0], modes=4, node=5), tmp_path, analysis="statics")
    assert note.startswith("bodies.beam: its modes lack ")
    assert "forces.push" in note and "name the point as an interface" in note
    wanted = 50 * (L / 4) ** 3 / (3 * E * H**4 / 12)
    loss = 1.0 - result["place.y"][-1] / wanted
    share = float(note.split("modes lack ")[1].split(" %")[0]) / 100
    assert share**2 == pytest.approx(loss, rel=0.05)
    assert float(note.split("by about ")[1].split(" %")[0]) == pytest.approx(100 * loss, rel=0.05)


def test_the_opposite_of_a_force_on_another_body_loads_a_node_as_well(tmp_path):
    """The same deflection, by Euler-Bernoulli, is too small by as much: what acts there is told."""
    model = clamped([0, 1, 0], modes=4, node=5)
    model.add_body("post", mass=1.0, inertia=[1.0] * 3, position=[L / 4, 0, 0])
    model.add_marker("ground.foot", position=[L / 4, 0, 0])
    model.add_joint("foot", "fixed", between=["ground.foot", "post"])
    del model.forces["push"]
    model.add_force("push", "force", at="post", value=[0, -50, 0], reaction="beam.place")
    result, (note,) = ran(model, tmp_path, analysis="statics")
    loss = 1.0 - result["place.y"][-1] / (50 * (L / 4) ** 3 / (3 * E * H**4 / 12))
    assert "forces.push" in note
    assert float(note.split("by about ")[1].split(" %")[0]) == pytest.approx(100 * loss, rel=0.05)


@pytest.mark.parametrize("cure", ["interface", "load", "modes"])
def test_the_cures_that_it_names(cure, tmp_path):
    body = {"loads": {"push": {"type": "force", "node": 5, "force": [0, 1, 0]}}}
    model = clamped([0, RISE, 0], modes=30 if cure == "modes" else 4, node=5,
                    body=body if cure == "load" else {})  # fmt: skip
    if cure == "interface":
        ends = {"root": {"group": "start"}, "place": {"node": 5}}
        mesh = {"type": "beam", "length": L, "divisions": 20}
        del model.bodies["beam"]
        model.add_body("beam", mesh=mesh, material=STEEL, modes=4, interfaces=ends, sections=SQUARE)
    assert ran(model, tmp_path)[1] == []


@pytest.mark.seconds
def test_above_its_bound_a_run_is_refused_unless_asked_for(tmp_path):
    """No mode below 2 kHz stretches: the answer to an axial force is missing as a whole."""
    model = clamped(["step(t, 0, 0, 0.05, 50)", 0, 0])
    with pytest.raises(SolverError, match=r"lack 100 .*forces.push.*\(bound 0.5; node_loads"):
        ran(model, tmp_path)
    model.set_validity(node_loads="any")
    result, notes = ran(model, tmp_path)
    assert result.status == "finished" and len(notes) == 1


def test_a_body_whose_file_does_not_say(tmp_path):
    model = clamped([0, 1.0, 0])
    body = reduce({"type": "beam", "length": L, "divisions": 20}, material=STEEL, modes=4,
                  interfaces={"root": "start"}, sections=SQUARE)  # fmt: skip
    other = Model("beam")
    other.add_body("beam", body)
    for name in ("joints", "forces", "sensors", "dynamics"):
        setattr(other, name, getattr(model, name))
    other.add_marker("beam.place", node=20)
    _, (note,) = ran(other, tmp_path)
    assert "does not tell whether its modes answer" in note and "load_points" in note


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("ratio", "outputs"),
    [(0.95, 600), *(pytest.param(*one, marks=pytest.mark.slow) for one in SLOW)],
)
def test_a_load_near_an_omitted_mode_is_told(ratio, outputs, tmp_path):
    """The third bending mode is left out; with it the tip swings by so much more."""
    value = [0, f"20*sin(2*pi*{ratio * THIRD}*t)", 0]
    model = clamped(value, outputs=outputs)
    model.set_validity(truncation="any")
    _, notes = ran(model, tmp_path / "truncated")
    full, none = ran(clamped(value, modes=12), tmp_path / "full")
    assert not none
    if ratio < 0.5:
        assert not notes
        return
    (note,) = notes
    assert "a mode of 292 Hz that it does not have" in note and "more modes" in note
    few, all_ = (load(tmp_path / name / "beam.flexbody.h5") for name in ("truncated", "full"))
    assert all_.m > few.m
    K, eta = all_.K, full.q[:, 7 : 7 + all_.m]
    fields = [body.nodes.Phi_t.reshape(-1, body.m) for body in (all_, few)]
    A = np.linalg.lstsq(fields[0], fields[1], rcond=None)[0]  # the few modes, in coordinates of all
    inside = eta @ (A @ np.linalg.solve(A.T @ K @ A, A.T @ K)).T
    energy, rest = (np.einsum("ti,ij,tj->t", x, K, x).max() for x in (inside, eta - inside))
    share = float(note.split("vibrate with ")[1].split(" %")[0]) / 100
    assert share == pytest.approx(np.sqrt(rest / energy), rel=0.4 if outputs > 100 else 0.7)


@pytest.mark.seconds
def test_a_run_is_refused_by_what_its_sensors_miss(tmp_path):
    """A beam let go: a mode that it lacks is most of its deformation, and little of its way."""

    def swing(modes, **sensors):
        made = Model("swing", gravity=[0, -9.81, 0])
        made.add_body(
            "beam", mesh={"type": "beam", "length": L, "divisions": 20}, material="steel",
            sections={"all": {"type": "rectangle", "y": 0.002, "z": 0.002}}, modes=modes,
            interfaces={"root": "start", "tip": "end"}, stress="none",
        )  # fmt: skip
        made.add_joint("hinge", "revolute", between=["ground", "beam.root"], axis="z")
        for name, kind in sensors.items():
            made.add_sensor(name, kind, of="beam.tip")
        made.set_dynamics(duration=0.6, outputs=120, accuracy=1e-5)
        return made

    few, notes = ran(swing(2, tip="position", kick="acceleration"), tmp_path / "few")
    all_, none = ran(swing(12, tip="position", kick="acceleration"), tmp_path / "all")
    assert not none
    (note,) = (note for note in notes if "would vibrate" in note)
    error = np.abs(few["kick.y"] - all_["kick.y"]).max() / np.ptp(all_["kick.y"])
    said = float(note.split("change sensors by up to ")[1].split(" %")[0]) / 100
    assert 0.2 < error < 0.3 and error / 2 < said < 2 * error
    _, notes = ran(swing(2, tip="position"), tmp_path / "place")
    (note,) = (note for note in notes if "would vibrate" in note)
    error = np.abs(few["tip.y"] - all_["tip.y"]).max() / np.ptp(all_["tip.y"])
    assert error < 1e-3 and "change sensors" not in note  # less than is told
    strict = swing(2, tip="position", kick="acceleration")
    strict.set_validity(truncation=0.2)
    with pytest.raises(SolverError, match=r"bound 0.2; truncation = \"any\""):
        ran(strict, tmp_path / "kick")


def hitting(modes):
    """A beam on a hinge turns against a stop."""
    made = Model("hit")
    made.add_body(
        "beam", mesh={"type": "beam", "length": L, "divisions": 20}, material=STEEL, modes=modes,
        interfaces={"root": "start", "tip": "end"}, sections=SQUARE, stress="none", damping=0.01,
        angular_velocity=[0, 0, 2.0],
    )  # fmt: skip
    made.add_joint("hinge", "revolute", between=["ground", "beam.root"], axis="z")
    made.add_force("stop", "rotational-stop", joint="hinge", upper=0.5, stiffness=2e4, damping=20.0,
                   depth=1e-3)  # fmt: skip
    made.add_sensor("pull", "reaction", joint="hinge", quantity="force")
    made.add_sensor("tip", "velocity", of="beam.tip")
    made.set_dynamics(duration=0.5, outputs=1000, accuracy=1e-4)
    return made


@pytest.mark.seconds
@pytest.mark.parametrize("modes", [0, 2])
def test_what_a_shock_changes_at_joints_and_interfaces(modes, tmp_path):
    """The stop excites modes that are left out: their force at a hinge is that of their inertia."""
    model = hitting(modes)
    model.set_validity(truncation="any")
    report = run_single(model, tmp_path / "few", pictures=False)
    few, notes = Result(report.result), report.notes
    all_, none = ran(hitting(20), tmp_path / "all")
    assert not none
    error = max(
        np.abs(few[name] - all_[name]).max() / np.ptp(all_[name])
        for name in ("pull.x", "pull.y", "tip.x", "tip.y")
    )
    words = r"(?:change sensors by up to|is off by about) ([\d.]+) %"
    said = max(float(x) for x in re.findall(words, " ".join(notes))) / 100
    assert error / 3 < said < 3 * error


@pytest.mark.seconds
@pytest.mark.parametrize("modes", [1, 2])
def test_what_acts_back_has_no_more_energy_than_it_is_given(modes, tmp_path):
    """A stick on a hinge beats a drum: its second clamped mode resonates with the motion of the run
    unless it acts back on it, and the plane of its motion is one of a pair."""

    def beating(modes):
        made = Model("drum")
        made.add_body(
            "stick", mesh={"type": "beam", "length": 0.4, "divisions": 20}, modes=modes,
            sections={"all": {"type": "rectangle", "y": 0.014, "z": 0.014}}, stress="none",
            material={"E": 1.2e10, "nu": 0.3, "density": 700.0}, damping=0.01,
            interfaces={"root": "start"}, angular_velocity=[0, 0, -10.0],
        )  # fmt: skip
        made.add_marker("stick.tip", position=[0.4, 0, 0])
        made.add_joint("hinge", "revolute", between=["ground", "stick.root"], axis="z")
        made.add_force("head", "force", at="stick.tip", value=[0, "5e4*max(0, -0.1 - tip.y)", 0])
        made.add_sensor("tip", "position", of="stick.tip")
        made.add_sensor("rate", "velocity", of="stick.tip")
        made.add_sensor("pull", "reaction", joint="hinge", quantity="force")
        made.set_dynamics(duration=0.2, outputs=800, accuracy=1e-4)
        made.set_validity(truncation="any", node_loads="any")
        return made

    few, notes = ran(beating(modes), tmp_path / "few")
    all_, _ = ran(beating(24), tmp_path / "all")
    (note,) = (note for note in notes if "would vibrate" in note)
    names = [f"{name}.{axis}" for name in ("pull", "rate") for axis in "xy"]
    error = max(np.abs(few[one] - all_[one]).max() / np.ptp(all_[one]) for one in names)
    said = float(note.split("change sensors by up to ")[1].split(" %")[0]) / 100
    assert error / 2 < said < 2 * error


@pytest.mark.seconds
def test_the_first_moments_of_a_shock_refuse_no_run(tmp_path):
    """A door meets a stop: fast modes answer at first, most of its deformation comes later."""
    made = Model("door")
    made.add_body(
        "door", mesh={"type": "plate", "length": 0.9, "width": 2.0, "divisions": [6, 12]}, modes=4,
        material={"E": 1e10, "nu": 0.3, "density": 600.0}, stress="none", damping=0.01,
        sections={"all": {"type": "shell", "thickness": 0.03}}, angular_velocity=[0, 3.0, 0],
        interfaces={"low": "x0y0", "high": "x0y1", "lock": {"center": [0.9, 0, 0], "radius": 0.05}},
    )  # fmt: skip
    for name, y in (("low", -1.0), ("high", 1.0)):
        made.add_marker(f"ground.{name}", position=[0, y, 0])
    made.add_joint("low", "revolute", between=["ground.low", "door.low"], axis="y")
    made.add_joint("high", "in-line", between=["ground.high", "door.high"], axis="y")
    made.add_force("stop", "rotational-stop", joint="low", upper=0.5, stiffness=2e4, damping=50.0,
                   depth=1e-3)  # fmt: skip
    made.add_sensor("lock", "velocity", of="door.lock")
    made.add_sensor("pull", "reaction", joint="high", quantity="force")
    made.set_dynamics(duration=0.6, outputs=600, accuracy=1e-4)
    _, notes = ran(made, tmp_path)
    assert not notes  # forces of the hinge are 15 % off, all others less than 2 %


@pytest.mark.seconds
def test_a_sensor_that_does_not_move_has_no_change(tmp_path):
    """The distance of two points that are at rest, but for round-off."""
    told = []
    for name in ("without", "with"):
        model = clamped([0, f"20*sin(2*pi*{0.95 * THIRD}*t)", 0])
        model.set_validity(truncation="any")
        if name == "with":
            model.add_marker("ground.far", position=[0.3, 0.4, 0.1])
            model.add_sensor("still", "distance", between=["ground.far", "beam.root"])
        _, (note,) = ran(model, tmp_path / name)
        told.append(note)
    assert told[0] == told[1]


def test_a_neck_that_is_shorter_than_wide_is_no_bar(tmp_path):
    """Between two arms: its nodes do not extend along the longest axis of its mass."""
    made = Model("neck")
    for k, (x, long, high) in enumerate(((0.0, 0.3, 0.03), (0.3, 0.01, 0.0015), (0.31, 0.3, 0.03))):
        made.add_body(
            f"part{k}", mesh={"type": "beam", "length": long, "divisions": 4}, material=STEEL,
            sections={"all": {"type": "rectangle", "y": high, "z": 0.03}}, modes=2, stress="none",
            interfaces={"root": "start", "tip": "end"}, position=[x, 0, 0],
        )  # fmt: skip
        before = f"part{k - 1}.tip" if k else "ground"
        made.add_joint(f"weld{k}", "fixed", between=[before, f"part{k}.root"])
    made.add_force("push", "force", at="part2.tip", value=[0, 3.0, 0])
    made.add_sensor("tip", "position", of="part2.tip")
    made.set_dynamics(duration=1e-3, outputs=3, accuracy=1e-3, start="quasi-static")
    run = run_single(made, tmp_path, pictures=False)
    tip = Result(run.result)["tip.y"][0]
    # by the turn of the neck under the moment at its middle, 0.305 m from the tip
    neck = 3.0 * 0.01 * 0.305**2 / (E * 0.03 * 0.0015**3 / 12)
    assert tip == pytest.approx(neck, rel=0.05)


@pytest.mark.parametrize(("words", "modes"), [({}, 0), ({"deformation": "rigid"}, 0), ({}, 1)])
def test_a_body_without_modes_is_told_to_be_rigid(words, modes, tmp_path):
    """With its first natural frequency, that of a cantilever."""
    model = clamped([0, 1.0, 0], modes=modes, body=words, duration=1e-3, outputs=5)
    model.set_validity(node_loads="any", truncation="any")
    notes = [
        one for one in run_single(model, tmp_path, pictures=False).notes if "rigid body" in one
    ]
    assert len(notes) == (modes == 0 and not words)
    for note in notes:
        hertz = float(note.split("vibrates from ")[1].split(" Hz")[0])
        assert hertz == pytest.approx((1.8751041 / 7.8547574) ** 2 * THIRD, rel=0.005)


@pytest.mark.parametrize("share", [0.9, 0.2])
def test_a_load_faster_than_the_omitted_modes_that_are_known(share, tmp_path):
    """Along the bar, which resonates at c/4L; the lowest omitted modes, of bending, do not."""
    hertz = share * np.sqrt(E / RHO) / (4 * L)
    model = clamped(
        [f"sin(2*pi*{hertz}*t)", 0, 0], duration=0.01 / share, outputs=200, residual="none"
    )
    model.set_validity(node_loads="any")
    report = run_single(model, tmp_path, pictures=False)
    notes = [note for note in report.notes if "is known up to" in note]
    assert len(notes) == (share > 0.5)
    for note in notes:
        assert f"forces.push oscillates with {hertz:.4g} Hz" in note and "frequency = " in note


@pytest.mark.seconds
def test_rows_may_come_one_by_one(tmp_path):
    """The same as all at once: a run hands them over in chunks."""
    model = clamped([0, f"20*sin(2*pi*{0.95 * THIRD}*t)", 0], duration=0.05, outputs=300)
    model.set_validity(truncation="any")
    result, _ = ran(model, tmp_path)
    compiled = compile_system(model, {"beam": load(tmp_path / "beam.flexbody.h5")})
    none = np.zeros((len(result.time), 0))
    tables = [result.part(name, slice(None)) for name in ("q", "v", "vd", "lam")]
    rows = OutputBlock(result.time, *tables, none, none, none, none)
    values = []
    for size in (1, 7, len(result.time)):
        monitor = ModalBasisMonitor(compiled, model)
        for first in range(0, len(result.time), size):
            monitor.add(rows.part(first, min(first + size, len(result.time))))
        values.append([one.value for one in monitor.indicators()])
    np.testing.assert_allclose(values[0], values[2], rtol=1e-9)
    np.testing.assert_allclose(values[1], values[2], rtol=1e-9)


def test_what_loads_a_body_is_the_acceleration_of_its_centre_in_its_axes():
    """A body that turns about a point P with φ(t): its centre C has α × (C − P) − ω² (C − P)."""
    body = reduce({"type": "beam", "length": L, "divisions": 20}, material=STEEL, modes=2,
                  interfaces={"root": "start"}, sections=SQUARE)  # fmt: skip
    model = Model("beam", gravity=[0, -9.81, 0])
    model.add_body("beam", body)
    compiled = compile_system(model, {"beam": body})
    (one,) = ModalBasisMonitor(compiled, model)._bodies
    (columns,) = compiled.layout.bodies
    angle, w, alpha, pivot = 0.7, 3.0, 5.0, np.array([0.2, -0.3, 0.0])
    A = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    z = np.array([0, 0, 1.0])

    def acceleration(r):
        return alpha * np.cross(z, A @ (r - pivot)) - w**2 * A @ (r - pivot)

    q, v, vd = np.zeros((1, 7 + body.m)), np.zeros((1, 6 + body.m)), np.zeros((1, 6 + body.m))
    q[0, columns.iq + 3 : columns.iq + 7] = np.cos(angle / 2), 0, 0, np.sin(angle / 2)
    v[0, columns.iv + 5], vd[0, columns.iv + 5] = w, alpha
    vd[0, columns.iv : columns.iv + 3] = acceleration(np.zeros(3))
    rows = SimpleNamespace(q=q, v=v, vd=vd)
    factors, _ = one.accelerations.of_joints(rows, one.frame)
    wanted = A.T @ (acceleration(body.center) - model.gravity)
    np.testing.assert_allclose(factors[0, :3], wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("ratio", [0.25, 0.6, 1.5])
@pytest.mark.parametrize("outputs", [41, 4001])
def test_an_omitted_mode_swings_as_an_oscillator_does(ratio, outputs):
    """Beyond x = F/ω² a steady force F e^(iΩt) moves it by x r² / (1 − r² + 2iζr), r = Ω/ω."""
    omega, periods = 50.0, 2000 if outputs < 100 else 100
    body = SimpleNamespace(omitted_modes=SimpleNamespace(frequency=np.array([omega / (2 * np.pi)])))
    oscillators = OmittedOscillators(body, ratio * omega / (2 * np.pi))
    t = np.linspace(0.0, periods * 2 * np.pi / omega * (1 + np.sqrt(2) / 100), outputs)
    force = 3.0 * np.sin(ratio * omega * t)[:, None]
    beyond = oscillators.integrate(t, force, np.full((1, 5), np.nan), 0.0 * t)
    wanted = 3.0 / omega**2 * abs(ratio**2 / (1 - ratio**2 + 0.02j * ratio))
    assert np.abs(beyond[3 * len(t) // 4 :]).max() == pytest.approx(wanted, rel=0.06)
