"""Every joint type between rigid and flexible bodies, in space and in the plane, at random states.

Rows, Jacobian, right side and tangents belong together far from where the joint is closed: Cq
against differences of C, γ against differences of the rates, the iteration matrix against
differences of the residual. What body carries a marker must not matter, so each type is tried
between two rigid bodies, a rigid and a flexible one, and two flexible ones.
"""

from __future__ import annotations

import numpy as np
import pytest
from curvekit import on_curve
from enginekit import Bench, slope
from generators import cloud, interface, random_rotation

from flexmb.model import Model
from flexmb.model.joints.joint import JOINT_TYPES

# The difference rules leave 1e-12 of the size of the numbers here, which are below 1000 (curves are
# of short pieces, whose third derivatives jump where they meet).
DIFFERENCES, STEP = 5e-9, 4e-4
AXIS = np.array([2.0, -1.0, 2.0]) / 3
ACROSS = np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0)
SECOND = {"revolute-revolute": AXIS}  # parallel; the others take one across
IN_PLANE = ("prismatic", "in-line", "in-plane", "prismatic-spherical", "cam-flat")
CARRIERS = {"rigid-rigid": (0, 0), "rigid-flexible": (0, 3), "flexible-flexible": (3, 4)}


def carrier(model, name, rng, m, planar):
    """A body with a marker `end`; in a planar model with the normal along one of its axes."""
    made = cloud(rng, m)
    turn = np.eye(3) if planar else random_rotation(rng)
    place = {"position": [*rng.standard_normal(2), 0.0], "orientation": turn.tolist()}
    if m:
        ends = [interface(rng, "node", m)]
        model.add_body(name, made.flexbody(name, ends), **place)
        model.add_marker(f"{name}.end", interface="node", position=[0.1, -0.2, 0.3])
    else:
        fields = made.rigid_fields()
        if planar:
            fields |= {"center": [0.1, 0.2, 0.0], "inertia": [1.0, 2.0, 3.0]}
        model.add_body(name, **fields, **place)
        z = 0.0 if planar else 0.3
        model.add_marker(f"{name}.end", position=[*rng.standard_normal(2), z])


def joined(kind, carriers, planar=False):
    """Two bodies and one joint of that type between them."""
    rng = np.random.default_rng(sum(map(ord, kind + carriers)))
    model = Model(kind, plane="xy" if planar else None)
    for name, m in zip("ab", CARRIERS[carriers], strict=True):
        carrier(model, name, rng, m, planar)
    fields = on_curve(model, kind, planar)
    if JOINT_TYPES[kind].axes > 0:
        fields["axis"] = [0.8, 0.6, 0.0] if planar and kind in IN_PLANE else list(AXIS)
        if planar and kind not in IN_PLANE:
            fields["axis"] = [0.0, 0.0, 1.0]
    if kind == "screw":
        fields["pitch"] = 0.7
    if JOINT_TYPES[kind].axes > 1:
        fields["second_axis"] = fields["axis"] if planar else list(SECOND.get(kind, ACROSS))
    model.add_joint("joint", kind, between=["a.end", "b.end"], **fields)
    return model


def benches():
    for kind, row in JOINT_TYPES.items():
        for carriers in CARRIERS:
            yield pytest.param((kind, carriers, False), id=f"{kind}, {carriers}")
        if row.planar_equations is not None:
            yield pytest.param((kind, "rigid-rigid", True), id=f"{kind}, planar")


@pytest.fixture(params=benches())
def bench(request):
    made = Bench(joined(*request.param))
    made.randomise(7)
    return made


def close(found, wanted):
    scale = max(1.0, np.abs(wanted).max(initial=0.0))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=DIFFERENCES * scale)


def test_jacobian_rates_and_right_side(bench):
    q, v, n = bench.q.copy(), bench.v.copy(), bench.layout.nv
    Cq, gamma = bench.at().Cq, bench.gamma
    for d in np.eye(n):
        close(Cq @ d, slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).C, STEP))
    close(-gamma, slope(lambda s: bench.at(q=bench.moved(q, s * v)).rate, STEP))


def test_tangents(bench):
    n, q, v = bench.layout.nv, bench.q.copy(), bench.v.copy()
    kept = bench.sys.kkt.column >= 0
    position = (bench.matrix(cp=1.0) - bench.matrix())[:n, :n][np.ix_(kept, kept)]
    velocity = (bench.matrix(cv=1.0) - bench.matrix())[:n, :n][np.ix_(kept, kept)]
    there, then = [], []
    for d in np.eye(n)[kept]:
        moved = slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).residual, STEP)
        there.append(moved[kept])
        bench.at(q=q)
        then.append(slope(lambda s, d=d: bench.at(v=v + s * d).residual)[kept])
        bench.at(v=v)
    close(position, np.array(there).T)
    close(velocity, np.array(then).T)
