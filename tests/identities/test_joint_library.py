"""Every joint type holds exactly what it should: poses reached by products of exponentials.

A body hangs on ground by one joint. It is moved as the joint (for composites: the joint, the link
and the other joint) allows, by turns and slides about lines of the placed pose (Brockett's product
of exponentials); the rows must vanish there, and their Jacobian must have the rank that the table
of joints says. Equations: 6 less the freedoms.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench
from scipy.spatial.transform import Rotation

from flexmb.errors import SceneError
from flexmb.model import Model
from flexmb.model.joints.joint import JOINT_TYPES

A = np.array([1.0, 2.0, 2.0]) / 3  # the axis
ACROSS = np.array([2.0, 1.0, -2.0]) / 3
THIRD = np.cross(A, ACROSS)
SKEW = np.array([0.6, 0.0, 0.8])
I, J = np.array([0.3, -0.2, 0.5]), np.array([1.1, 0.4, -0.3])  # noqa: E741


def turn(axis, through):
    return ("turn", np.asarray(axis), np.asarray(through))


def slide(axis):
    return ("slide", np.asarray(axis), None)


def ball(at):
    return [turn(e, at) for e in np.eye(3)]


ALL = [slide(e) for e in np.eye(3)]
ALONG_PLANE = [slide(ACROSS), slide(THIRD)]

# name: (joint fields, marker J, motions of the body in the placed pose)
CASES = {
    "fixed": ({}, I, []),
    "revolute": ({"axis": A}, I, [turn(A, I)]),
    "prismatic": ({"axis": A}, I, [slide(A)]),
    "cylindrical": ({"axis": A}, I, [turn(A, I), slide(A)]),
    "spherical": ({}, I, ball(I)),
    "universal": ({"axis": A, "second_axis": ACROSS}, I, [turn(A, I), turn(ACROSS, I)]),
    "constant-velocity": ({"axis": A}, I, None),
    "planar": ({"axis": A}, I, [*ALONG_PLANE, turn(A, J)]),
    "in-line": ({"axis": A}, I, [slide(A), *ball(I)]),
    "in-plane": ({"axis": A}, I, [*ALONG_PLANE, *ball(I)]),
    "parallel": ({"axis": A}, J, [*ALL, turn(A, J)]),
    "perpendicular": ({"axis": A, "second_axis": ACROSS}, J, [*ALL, turn(A, I), turn(ACROSS, J)]),
    "orientation": ({}, J, ALL),
    "distance": ({}, J, [*ball(I), *ball(J)]),
    "revolute-spherical": ({"axis": A}, J, [turn(A, I), *ball(J)]),
    "prismatic-spherical": ({"axis": A}, J, [slide(A), *ball(J)]),
    "cylindrical-spherical": ({"axis": A}, J, [turn(A, I), slide(A), *ball(J)]),
    "revolute-revolute": ({"axis": A, "second_axis": A}, J, [turn(A, I), turn(A, J)]),
    "revolute-revolute, meeting": (
        {"axis": A, "second_axis": SKEW},
        I,
        [turn(A, I), turn(SKEW, I)],
    ),
    "revolute-cylindrical": ({"axis": A, "second_axis": A}, J, [turn(A, I), turn(A, J), slide(A)]),
    "revolute-cylindrical, across": (
        {"axis": A, "second_axis": ACROSS},
        J,
        [turn(A, I), turn(ACROSS, J), slide(ACROSS)],
    ),
    "revolute-universal": (
        {"axis": A, "second_axis": ACROSS},
        J,
        [turn(A, I), turn(A, J), turn(ACROSS, J)],
    ),
    "spherical-universal": ({}, J, [*ball(I), turn(A, J), turn(ACROSS, J)]),
}


def hinged(case):
    """A placed body on ground by one joint of that type."""
    fields, place, _ = CASES[case]
    fields = {k: list(v) for k, v in fields.items()}
    model = Model("one joint")
    start = Rotation.from_euler("xyz", [0.3, -0.8, 1.9])
    r = np.array([0.7, 0.1, -0.4])
    local = start.inv().apply(place - r)
    model.add_marker("ground.I", position=list(I))
    model.add_body(
        "b",
        mass=1.0,
        inertia=[1.0, 1.0, 1.0],
        position=list(r),
        orientation=start.as_matrix().tolist(),
        markers={"J": {"position": list(local), "orientation": start.inv().as_matrix().tolist()}},
    )
    model.add_joint("joint", case.split(",")[0], between=["ground.I", "b.J"], **fields)
    return model


def moved(bench, motions, rng):
    """The placed pose after a random turn or slide of every motion, the last one first."""
    r, p = bench.compiled.initial_q[:3].copy(), np.roll(bench.compiled.initial_q[3:7], -1)
    R = Rotation.from_quat(p)
    for kind, axis, through in reversed(motions):
        s = rng.uniform(-1.2, 1.2)
        if kind == "slide":
            r = r + s * axis
        else:
            Q = Rotation.from_rotvec(s * axis)
            r, R = through + Q.apply(r - through), Q * R
    return np.concatenate([r, np.roll(R.as_quat(), 1)])


def bent_motions(rng):
    """A constant-velocity joint bends about any line across its shaft."""
    angle = rng.uniform(0, 2 * np.pi)
    return [turn(np.cos(angle) * ACROSS + np.sin(angle) * THIRD, I)]


@pytest.mark.parametrize("case", CASES)
def test_rows_vanish_on_all_motions_that_the_joint_allows(case):
    bench, rng = Bench(hinged(case)), np.random.default_rng(3)
    equations = JOINT_TYPES[case.split(",")[0]].equations
    assert bench.layout.nc == equations
    for _ in range(6):
        motions = CASES[case][2]
        motions = bent_motions(rng) if motions is None else motions
        bench.at(q=moved(bench, motions, rng), v=np.zeros(6))
        np.testing.assert_allclose(bench.C, 0.0, atol=1e-13)
        assert np.linalg.matrix_rank(bench.Cq, tol=1e-6) == equations


@pytest.mark.parametrize("quarters", [1, 2, 3])
@pytest.mark.parametrize("case", ["revolute", "cylindrical", "planar", "parallel"])
def test_joints_hold_as_well_after_quarters_of_a_turn(case, quarters):
    """About an axis that they leave free no row becomes another one."""
    bench = Bench(hinged(case))
    whole = turn(A, I)

    class Quarter:
        uniform = staticmethod(lambda *_: 0.5 * np.pi * quarters)

    bench.at(q=moved(bench, [whole], Quarter), v=np.zeros(6))
    np.testing.assert_allclose(bench.C, 0.0, atol=1e-13)
    equations = JOINT_TYPES[case].equations
    assert np.linalg.svd(bench.Cq, compute_uv=False)[equations - 1] > 0.1


def test_the_table_of_joints_is_whole():
    elsewhere = {"screw"}  # its turn and slide are one motion: test_couplers
    elsewhere |= {name for name, row in JOINT_TYPES.items() if row.curves}
    assert {case.split(",")[0] for case in CASES} | elsewhere == set(JOINT_TYPES)


@pytest.mark.parametrize(
    ("case", "fields", "sentence"),
    [
        ("revolute-revolute", {"axis": A, "second_axis": SKEW}, "must be parallel, or the markers"),
        ("revolute-cylindrical", {"axis": A, "second_axis": SKEW}, "parallel or at right angles"),
    ],
)
def test_axes_that_a_link_cannot_have_are_told(case, fields, sentence, monkeypatch):
    monkeypatch.setitem(CASES, case, (fields, J, []))
    with pytest.raises(SceneError, match=sentence):
        Bench(hinged(case))


@pytest.mark.parametrize("case", ["distance", "revolute-spherical", "cylindrical-spherical"])
def test_a_link_without_length_is_told(case, monkeypatch):
    monkeypatch.setitem(CASES, case, (CASES[case][0], I, []))
    with pytest.raises(SceneError, match="joints.joint: the link has no length"):
        Bench(hinged(case))


X, Y, Z = np.eye(3)
FLAT = Z, np.array([0.8, 0.6, 0.0]), np.array([-0.6, 0.8, 0.0])
PLANAR = {
    "fixed": ({}, "I", []),
    "revolute": ({"axis": Z}, "I", ["about I"]),
    "prismatic": ({"axis": FLAT[1]}, "I", ["along"]),
    "cylindrical": ({"axis": FLAT[1]}, "I", ["along"]),
    "spherical": ({}, "I", ["about I"]),
    "in-line": ({"axis": FLAT[1]}, "I", ["along", "about I"]),
    "in-plane": ({"axis": FLAT[1]}, "I", ["across", "about I"]),
    "orientation": ({}, "J", ["along", "across"]),
    "distance": ({}, "J", ["about I", "about J"]),
    "prismatic-spherical": ({"axis": FLAT[1]}, "J", ["along", "about J"]),
    "revolute-revolute": ({"axis": Z, "second_axis": Z}, "J", ["about I", "about J"]),
}


def flat(point):
    return np.array([point[0], point[1], 0.0])


MOTIONS = {
    "about I": turn(Z, flat(I)),
    "about J": turn(Z, flat(J)),
    "along": slide(FLAT[1]),
    "across": slide(FLAT[2]),
}


@pytest.mark.parametrize("case", PLANAR)
def test_planar_rows_vanish_on_all_motions_that_the_joint_allows(case):
    fields, place, motions = PLANAR[case]
    model = Model("one joint", plane="xy")
    model.add_marker("ground.I", position=list(flat(I)))
    start, r = Rotation.from_euler("z", 0.7), np.array([0.7, 0.1, 0.0])
    local = start.inv().apply(flat(I if place == "I" else J) - r)
    turned = start.inv().as_matrix().tolist()
    model.add_body(
        "b",
        mass=1.0,
        inertia=[1.0, 1.0, 1.0],
        position=list(r),
        orientation=start.as_matrix().tolist(),
        markers={"J": {"position": list(local), "orientation": turned}},
    )
    words = {k: list(v) for k, v in fields.items()}
    model.add_joint("joint", case, between=["ground.I", "b.J"], **words)
    bench, rng = Bench(model), np.random.default_rng(4)
    equations = JOINT_TYPES[case].planar_equations
    assert bench.layout.nc == equations == 3 - len(motions)
    for _ in range(4):
        bench.at(q=moved(bench, [MOTIONS[name] for name in motions], rng), v=np.zeros(6))
        np.testing.assert_allclose(bench.C, 0.0, atol=1e-13)
        assert np.linalg.matrix_rank(bench.Cq[:, [0, 1, 5]], tol=1e-6) == equations


def test_the_table_of_planar_joints_is_whole():
    assert set(PLANAR) == {
        name
        for name, row in JOINT_TYPES.items()
        if row.planar_equations is not None and not row.curves
    }


def test_joints_without_meaning_in_a_plane_are_told():
    model = Model("one joint", plane="xy")
    model.add_body("b", mass=1.0, inertia=[1.0, 1.0, 1.0])
    model.add_joint("hook", "universal", between=["ground", "b"])
    (problem,) = model.problems()
    assert problem.where == "joints.hook.type" and "has no meaning in a plane" in problem.what
    assert "universal" not in problem.allowed and "distance" in problem.allowed
