"""A composite joint is a link without mass: the limit of a link that has some.

Two bodies, one of them flexible, under weight, loads and velocities that the joint allows. With an
explicit link of mass m between them, accelerations and what the joints do to the bodies differ from
those of the composite joint in proportion to m.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench
from generators import cloud, interface, random_rotation
from truthkit import order

from flexmb.model import Model

A = np.array([1.0, 2.0, 2.0]) / 3
ACROSS = np.array([2.0, 1.0, -2.0]) / 3
SKEW = np.array([0.6, 0.0, 0.8])
I, J = np.array([0.3, -0.2, 0.5]), np.array([1.1, 0.4, -0.3])  # noqa: E741
MASSES = np.array([1e-3, 1e-4, 1e-5])  # of bodies of some 2 kg
SLOPE = 0.02  # the next term is of the order m

ball = ("spherical", {})
pin, slide, tube = ((kind, {"axis": list(A)}) for kind in ("revolute", "prismatic", "cylindrical"))
hook = ("universal", {"axis": list(A), "second_axis": list(ACROSS)})
both = {"axis": list(A), "second_axis": list(A)}
crossed = {"axis": list(A), "second_axis": list(ACROSS)}

# name: (fields of the composite joint, place of marker J, joint at I, joint at J)
CASES = {
    "distance": ({}, J, ball, ball),
    "revolute-spherical": ({"axis": list(A)}, J, pin, ball),
    "prismatic-spherical": ({"axis": list(A)}, J, slide, ball),
    "cylindrical-spherical": ({"axis": list(A)}, J, tube, ball),
    "revolute-revolute": (both, J, pin, pin),
    "revolute-revolute, meeting": (
        {"axis": list(A), "second_axis": list(SKEW)}, I, pin, ("revolute", {"axis": list(SKEW)}),
    ),
    "revolute-cylindrical": (both, J, pin, tube),
    "revolute-cylindrical, across": (
        crossed, J, pin, ("cylindrical", {"axis": list(ACROSS)}),
    ),
    "revolute-universal": (crossed, J, pin, hook),
    "spherical-universal": ({}, J, ball, hook),
}  # fmt: skip
Z = {"axis": [0, 0, 1]}
ALONG = {"axis": [0.6, 0.8, 0]}
IN_PLANE = {
    "distance": ({}, ("revolute", Z), ("revolute", Z)),
    "revolute-revolute": (Z | {"second_axis": [0, 0, 1]}, ("revolute", Z), ("revolute", Z)),
    "prismatic-spherical": (ALONG, ("prismatic", ALONG), ("revolute", Z)),
}


def ends(place_J, planar):
    """Two bodies with a marker each, under weight and loads."""
    rng = np.random.default_rng(4)
    model = Model("link", gravity=[1, -9, 0 if planar else 3], plane="xy" if planar else None)
    flat = np.array([1, 1, 0 if planar else 1])
    turn = np.eye(3) if planar else random_rotation(rng)
    r = flat * [0.7, 0.1, -0.4]
    one, two = cloud(rng), cloud(rng, 0 if planar else 3)
    fields = {"mass": 1.2, "center": [0.1, 0.2, 0.0], "inertia": [1.0, 1.5, 2.0]}
    model.add_body("a", **(fields if planar else one.rigid_fields()))
    model.add_marker("a.end", position=list(flat * I))
    at = {"position": list(r), "orientation": turn.tolist()}
    place = {"position": list(turn.T @ (flat * place_J - r))}
    if planar:
        model.add_body("b", **fields, **at)
    else:
        model.add_body("b", two.flexbody("b", [interface(rng, "node", 3)]), **at)
        place["interface"] = "node"
    model.add_marker("b.end", **place)
    for name in "ab":
        for kind in ("force", "torque"):
            value = rng.standard_normal(3) * 5 * (flat if kind == "force" else 1)
            if planar and kind == "torque":
                value[:2] = 0
            model.add_force(f"{kind}_{name}", kind, at=f"{name}.end", value=list(value))
    return model, flat


def composite(kind, fields, place_J, planar=False):
    model, _ = ends(place_J, planar)
    model.add_joint("joint", kind, between=["a.end", "b.end"], **fields)
    bench = Bench(model)
    rng = np.random.default_rng(9)
    bench.v[:] = rng.standard_normal(bench.layout.nv) * (bench.sys.kkt.column >= 0)
    bench.project()
    bench.accelerations(rounds=3)
    return bench


def explicit(mass, first, second, place_J, v, planar=False):
    """The same bodies with a link of that mass; they move as told, and the link with them."""
    model, flat = ends(place_J, planar)
    middle = flat * (I + place_J) / 2 + flat * [0.1, -0.1, 0.2]
    model.add_body(
        "link", mass=mass, inertia=list(mass * np.array([0.1, 0.15, 0.2])), position=list(middle)
    )
    for name, place in (("I", I), ("J", place_J)):
        model.add_marker(f"link.{name}", position=list(flat * place - middle))
    model.add_joint("first", first[0], between=["a.end", "link.I"], **first[1])
    model.add_joint("second", second[0], between=["link.J", "b.end"], **second[1])
    bench = Bench(model)
    n = len(v)
    bench.v[:n], bench.v[n:] = v, 0.0
    bench.at()
    Cq = bench.Cq[:, n:] * (bench.sys.kkt.column[n:] >= 0)
    bench.v[n:] = np.linalg.lstsq(Cq, -bench.rate, rcond=None)[0]
    bench.at()
    np.testing.assert_allclose(bench.rate, 0, atol=1e-12)
    bench.accelerations(rounds=3)
    return bench


def on_the_bodies(bench, n):
    """Accelerations of the two bodies, and the generalised forces of the joints on them."""
    bench.at()
    return np.concatenate([bench.vd[:n], (bench.Cq.T @ bench.lam)[:n]])


def check(kind, fields, first, second, place_J, planar=False):
    wanted = composite(kind, fields, place_J, planar)
    n, v = wanted.layout.nv, wanted.v.copy()
    truth = on_the_bodies(wanted, n)
    found = np.array(
        [on_the_bodies(explicit(m, first, second, place_J, v, planar), n) for m in MASSES]
    )
    errors = np.abs(found - truth).max(axis=1)
    assert errors[0] > 1e-5  # the link's mass does count
    assert abs(order(MASSES, errors) - 1.0) < SLOPE, errors


@pytest.mark.parametrize("case", CASES)
def test_a_composite_joint_is_the_limit_of_an_explicit_link(case):
    fields, place_J, first, second = CASES[case]
    check(case.split(",")[0], fields, first, second, place_J)


@pytest.mark.parametrize("case", IN_PLANE)
def test_so_it_is_in_a_plane(case):
    fields, first, second = IN_PLANE[case]
    check(case, fields, first, second, J, planar=True)


def test_every_composite_joint_is_here():
    from flexmb.model.joints.joint import JOINT_TYPES

    links = {name for name, row in JOINT_TYPES.items() if row.summary.startswith("link")}
    assert {case.split(",")[0] for case in CASES} == links
    planar = {name for name in links if JOINT_TYPES[name].planar_equations is not None}
    assert set(IN_PLANE) == planar
