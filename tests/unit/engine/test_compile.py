"""From the model to the tables: bytes, markers, rows, names, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench
from generators import ROWS, Mechanism, cloud, interface

from flexmb.engine.bodies.flexible_body import modal_block
from flexmb.engine.compile import compile_system, fingerprint
from flexmb.engine.joints import ANGLE, DOT2, POINT
from flexmb.engine.tables import FLEX_LAYOUT
from flexmb.errors import SceneError
from flexmb.flexbody import load, save
from flexmb.model import Model


def test_write_read_compile_gives_the_same_bytes(tmp_path):
    made = Mechanism(1, "loop", "mixed")
    wanted = compile_system(made.model).layout
    files, bodies = {}, {}
    for name, points in made.clouds.items():
        if points.m:
            files[name] = tmp_path / f"{name}.flexbody.h5"
            save(made.model.bodies[name].flexbody, files[name])
            bodies[name] = load(files[name])
    scene = made.model.to_scene_dict(tmp_path, {k: v.name for k, v in files.items()})
    again = compile_system(Model.from_scene_dict(scene, tmp_path), bodies)
    assert again.layout == wanted


def test_fingerprint_sees_every_number():
    made = Mechanism(1, "chain", "rigid", n=2)
    system = compile_system(made.model).system
    first = fingerprint(system)
    stiffness = system.kinds["springs"].rows["k"]
    stiffness[0] = np.nextafter(stiffness[0], np.inf)
    assert fingerprint(system) != first
    others = {name: tables for name, tables in system.kinds.items() if name != "springs"}
    assert fingerprint(system._replace(kinds=others)) != first


def test_modal_block_has_the_layout_that_the_kernels_expect():
    rng = np.random.default_rng(0)
    m = 3
    body = cloud(rng, m).flexbody("b")
    flat = modal_block(body)
    at, parts = 0, {}
    for name, rows in FLEX_LAYOUT:
        n = (int(rows[:-1] or 1) * m if isinstance(rows, str) else rows) * m
        parts[name] = flat[at : at + n].reshape(-1, m)
        at += n
    assert at == flat.size
    M = parts["M"].reshape(3, 3, m, m)
    for a in range(3):
        for b in range(3):
            np.testing.assert_array_equal(parts["P"][3 * a + b], body.P[a, b])
            np.testing.assert_array_equal(M[a, b], body.Mab[b, a])
    np.testing.assert_array_equal(parts["p"], body.p)
    np.testing.assert_array_equal(parts["G"][:m], body.Mab[1, 2] - body.Mab[2, 1])
    for name in ("M_eta", "K", "D"):
        np.testing.assert_array_equal(parts[name], getattr(body, name))


@pytest.mark.parametrize("kind", ROWS)
def test_joints_have_their_rows_and_leave_the_right_motions(kind):
    """Free motions of each joint in its placed pose: the null space of its Jacobian."""
    model = Model("joint")
    model.add_body("b", mass=1.0, inertia=[1, 1, 1], position=[0.3, -0.2, 0.5])
    model.add_marker("ground.here", position=[0.3, -0.2, 0.5])
    model.add_joint("j", kind, between=["ground.here", "b"])
    bench = Bench(model).at()
    assert bench.layout.nc == ROWS[kind]
    np.testing.assert_array_equal(bench.C, 0.0)
    free = {
        "revolute": [5], "prismatic": [2], "cylindrical": [2, 5], "spherical": [3, 4, 5],
        "fixed": [],
    }[kind]  # fmt: skip
    np.testing.assert_array_equal(bench.Cq[:, free], 0.0)
    assert np.linalg.matrix_rank(bench.Cq) == ROWS[kind]


def test_drivers_add_one_row_with_the_function():
    model = Model("driven")
    model.add_body("b", mass=1.0, inertia=[1, 1, 1])
    model.add_joint("j", "cylindrical", between=["ground", "b"], axis="z")
    model.add_driver("turn", joint="j", angle="0.5*t")
    model.add_driver("slide", joint="j", stroke="2*t")
    bench = Bench(model).at(t=1.0)
    np.testing.assert_allclose(bench.C, [0, 0, 0, 0, -0.5, -2.0])
    np.testing.assert_allclose(bench.rate, [0, 0, 0, 0, -0.5, -2.0])
    np.testing.assert_array_equal(bench.sys.rows["kind"][4:], [ANGLE, DOT2])
    assert bench.layout.rows[0] == "joints.j: axes x and z"
    assert bench.layout.rows[4:] == ("drivers.turn: driven", "drivers.slide: driven")


def test_features_that_are_not_used_have_no_table():
    made = Mechanism(1, "chain", "mixed", n=2, acting=False)
    system = compile_system(made.model).system
    mechanism = {"rigid_bodies", "flexible_bodies", "point_markers", "rigid_markers"}
    mechanism |= {"flexible_markers", "joints", "constraint_rows", "point_joints"}
    assert set(system.kinds) <= mechanism
    assert len(system.parts.coordinates) == len(system.parts.curve_markers) == 0
    assert len(system.sensors.channels) == len(system.functions.ops) == 0
    used = compile_system(Mechanism(1, "chain", "mixed", n=2).model).system
    kinds = used.kinds
    assert all(len(part) > 0 for part in (used.functions.ops, used.sensors.channels))
    assert len(kinds["springs"].rows) > 0 and len(kinds["loads"].rows) > 0
    assert "feedback" not in kinds


def test_equal_markers_modes_and_functions_are_stored_once():
    rng = np.random.default_rng(0)
    model = Model("shared")
    body = cloud(rng, 3).flexbody("b", [interface(rng, "a", 3)])
    model.add_body("b", body)
    for k in range(3):
        model.add_marker(f"b.m{k}", interface="a", position=[0.1 * k, 0, 0])
        model.add_force(f"f{k}", "force", at=f"b.m{k}", value=["2*t", "2*t", 0])
        model.add_force(f"g{k}", "torque", at=f"b.m{k}", value=[0, "2*t", 0])
    system = compile_system(model).system
    assert len(system.parts.markers) == 3
    assert len(set(system.parts.markers["modes"])) == 1
    assert len(system.functions.start) - 1 == 2
    np.testing.assert_allclose(
        system.parts.markers["rho"] + system.parts.markers["arm"],
        [[0.1 * k, 0, 0] for k in range(3)],
        atol=1e-15,
    )


def test_a_joint_within_one_body_is_refused():
    model = Model("loop")
    model.add_body("b", mass=1.0, inertia=[1, 1, 1], markers={"m": {"position": [1, 0, 0]}})
    model.add_joint("j", "spherical", between=["b", "b.m"])
    with pytest.raises(SceneError, match=r"joints\.j"):
        compile_system(model)
    with pytest.raises(SceneError, match="no bod"):
        compile_system(Model("empty"))


def test_coincidence_alone_couples_no_bodies():
    rows = compile_system(Mechanism(1, "tree", "rigid", n=6).model).system
    for group in rows.groups:
        kinds = rows.rows["kind"][group["row"] : group["row"] + group["n"]]
        two = group["body_I"] >= 0 and group["body_J"] >= 0
        if two and (kinds != POINT).any():
            assert group["couple"] >= 0


def test_a_mesh_that_is_not_reduced_is_refused():
    """It was simulated as a rigid body of some mass, in silence."""
    model = Model("bar")
    mesh = {"type": "beam", "length": 1.0, "divisions": 4}
    square = {"type": "rectangle", "y": 0.01, "z": 0.01}
    model.add_body("bar", mesh=mesh, material="steel", sections={"all": square},
                   interfaces={"root": "start", "tip": "end"})  # fmt: skip
    with pytest.raises(SceneError, match=r"bodies.bar: .*flexible_bodies.*simulate"):
        compile_system(model)
    with pytest.raises(SceneError, match=r"bodies.bar: .*reduced body"):
        compile_system(model, {"another": cloud(np.random.default_rng(0), 3).flexbody("b")})
