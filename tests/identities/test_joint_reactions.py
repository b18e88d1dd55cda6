"""Reactions of every joint type, in its axes, on both bodies: action, reaction, work and motion.

Two bodies with loads are joined and move at a random state on the constraints. Known without the
multipliers: what the joint does to the two bodies is opposite about any point; it does no work on
the motions that the joint allows; it is what moves each body beside its loads (Newton and Euler,
d'Alembert for the modes); and components that the joint type cannot carry are zero.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, rotation
from generators import cloud, interface, random_rotation
from jointfields import special_fields
from rowmeasures import placed_markers

from flexmb.analysis.assembly.gaps import signs_of_axes
from flexmb.analysis.assembly.jacobian import ConstraintRows
from flexmb.analysis.assembly.positions import close_rows
from flexmb.model import Model
from flexmb.model.joints.joint import JOINT_TYPES

# Of forces and moments below 1000 N: refined solves leave 1e-12 of them.
EXACT = 1e-8
GRAVITY = np.array([1.0, -2.0, -9.0])
AXIS, ACROSS = np.array([2.0, -1.0, 2.0]) / 3, np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0)
SLIDING = ("prismatic", "in-line", "in-plane", "prismatic-spherical", "cam-flat")
BODIES = {"rigid-rigid": (0, 0), "rigid-flexible": (0, 3), "flexible-flexible": (3, 4)}
PLANE = [0, 1, 5]

# Components that a joint cannot carry, on marker J in its axes, then on marker I in its axes
# (flexmb help joints). F, M: force, moment. What is not named here carries all.
NONE = {
    "revolute": ("Mz", "Mz"),
    "prismatic": ("Fz", "Fz"),
    "cylindrical": ("Fz Mz", "Fz Mz"),
    "spherical": ("Mx My Mz", "Mx My Mz"),
    "universal": ("Mz", "Mz"),
    "planar": ("Fx Fy Mz", "Fx Fy Mz"),
    "in-line": ("Mx My Mz", "Fz Mz"),
    "in-plane": ("Mx My Mz", "Fx Fy Mz"),
    "parallel": ("Fx Fy Fz Mz", "Fx Fy Fz Mz"),
    "perpendicular": ("Fx Fy Fz Mz", "Fx Fy Fz Mz"),
    "orientation": ("Fx Fy Fz", "Fx Fy Fz"),
    "distance": ("Mx My Mz", "Mx My Mz"),
    "revolute-spherical": ("Mx My Mz", "Mz"),
    "prismatic-spherical": ("Mx My Mz", "Fz"),
    "cylindrical-spherical": ("Mx My Mz", "Fz Mz"),
    "revolute-revolute": ("Mz", "Mz"),
    "revolute-cylindrical": ("Fz Mz", "Fz Mz"),  # of parallel axes
    "revolute-universal": ("Mz", "Mz"),
    "spherical-universal": ("Mx My Mz", "Mx My Mz"),
    "pin-in-slot": ("Mx My Mz", "Fx Fz My Mz"),
    "point-on-curve": ("Mx My Mz", "Mx My Mz"),
    "cam-knife": ("Mx My Mz", "Fx Fz My Mz"),
    "cam-roller": ("Mx My Mz", "Fx Fz My Mz"),
    "cam-flat": ("Fx Fy Mz", "Fx Mx My Mz"),
    "cam-cam": ("My", "Fz"),  # of skew planes; in parallel ones a force along both normals
}
IN_PLANE = {  # beside those out of the plane; the normal is z, and x the axis of what slides
    "revolute": ("Mz", "Mz"),
    "prismatic": ("Fx", "Fx"),
    "cylindrical": ("Mz", "Mz"),  # with its axis along the normal
    "spherical": ("Mz", "Mz"),
    "in-line": ("Mz", "Fx"),
    "in-plane": ("Mz", "Fy"),
    "orientation": ("Fx Fy", "Fx Fy"),
    "distance": ("Mz", "Mz"),
    "prismatic-spherical": ("Mz", "Fx"),
    "revolute-revolute": ("Mz", "Mz"),
    "pin-in-slot": ("Mz", "Fx Mz"),
    "point-on-curve": ("Mz", "Fx Mz"),
    "cam-knife": ("Mz", "Fx Mz"),
    "cam-roller": ("Mz", "Fx Mz"),
    "cam-flat": ("Fx Fy Mz", "Fx Mz"),
    "cam-cam": ("Fx Mz", "Fx Mz"),
}


class Pair:
    """Two bodies, one joint, loads on both."""

    def __init__(self, kind, bodies, planar=False):
        self.rng = np.random.default_rng(sum(map(ord, kind + bodies)))
        self.planar = planar
        gravity = GRAVITY * [1, 1, 0] if planar else GRAVITY
        self.model = Model(kind, gravity=list(gravity), plane="xy" if planar else None)
        self.loads = {"a": [], "b": []}
        for name, m in zip("ab", BODIES[bodies], strict=True):
            self._body(name, m)
        axis = [0.0, 0.0, 1.0] if planar and kind not in SLIDING else list(AXIS)
        axis = [0.8, 0.6, 0.0] if planar and kind in SLIDING else axis
        second = list(ACROSS)
        if planar or kind in ("revolute-revolute", "revolute-cylindrical"):
            second = axis
        axes = dict(zip(("axis", "second_axis"), (axis, second), strict=True))
        words = list(axes)[: JOINT_TYPES[kind].axes]
        between = ["a.end", "b.end"]
        fields = {word: axes[word] for word in words} | special_fields(self.model, kind, planar)
        self.model.add_joint("joint", kind, between=between, **fields)

    def _body(self, name, m):
        rng, made = self.rng, cloud(self.rng, m)
        turn = np.eye(3) if self.planar else random_rotation(rng)
        flat = np.array([1.0, 1.0, 0.0 if self.planar else 1.0])
        place = {"position": list(rng.standard_normal(3) * flat), "orientation": turn.tolist()}
        at = {word: list(rng.standard_normal(3) * flat) for word in ("end", "load")}
        if m:
            body = made.flexbody(name, [interface(rng, "node", m)])
            self.model.add_body(name, body, **place)
            carried = {"interface": "node"}
        else:
            flatter = {"center": [0.1, 0.2, 0.0], "inertia": [1.0, 2.0, 3.0]} if self.planar else {}
            self.model.add_body(name, **{**made.rigid_fields(), **flatter}, **place)
            carried = {}
        for word, place in at.items():
            self.model.add_marker(f"{name}.{word}", position=place, **carried)
        for kind, keep in (("force", flat), ("torque", 1.0 - flat if self.planar else flat)):
            value = 20.0 * rng.standard_normal(3) * keep
            self.loads[name].append(value)
            self.model.add_force(f"{kind}_{name}", kind, at=f"{name}.load", value=list(value))

    def moving(self):
        """A bench at a random state on the constraints, with accelerations and multipliers."""
        bench = Bench(self.model)
        for _ in range(20):
            bench.randomise(self.rng.integers(1000), eta=0.1)
            bench.state.t[0] = 0.0
            if self.planar:
                for row in bench.sys.parts.bodies:
                    i, angle = int(row["iq"]), self.rng.uniform(-1, 1)
                    bench.q[i + 2 : i + 7] = 0, np.cos(angle), 0, 0, np.sin(angle)
                bench.v[bench.sys.kkt.column < 0] = 0.0
            pose = close_rows(ConstraintRows(bench.compiled), bench.q.copy())
            if pose is not None and self._right_way(bench, pose):
                break
        bench.q[:] = pose.q
        bench.project()
        bench.accelerations()
        return bench.at()

    def _right_way(self, bench, markers):
        """Whether axes that belong together point the same way."""
        kind, row = self.model.joints["joint"].type, bench.sys.rows[0]
        A, B = markers.R[row["I"]], markers.R[row["J"]]
        return all(A[:, k] @ B[:, k] > 0.5 for k in signs_of_axes(kind) if not self.planar)


def cases():
    for kind, row in JOINT_TYPES.items():
        for bodies in BODIES:
            yield pytest.param((kind, bodies, False), id=f"{kind}, {bodies}")
        if row.planar_equations is not None:
            yield pytest.param((kind, "rigid-rigid", True), id=f"{kind}, planar")


@pytest.fixture(params=cases())
def pair(request):
    made = Pair(*request.param)
    made.bench = made.moving()
    made.markers = placed_markers(made.bench.compiled, made.bench.q)
    return made


def wrenches(pair):
    """On J and on I: marker, force and moment at the marker in global axes."""
    bench = pair.bench
    group, told = bench.sys.groups[0], bench.reactions[0]
    row = bench.sys.rows[group["row"]]
    i, j = (int(row[side]) for side in ("JI" if group["reversed"] else "IJ"))
    for marker, part in ((j, told[:2]), (i, told[2:])):
        force, moment = (pair.markers.R[marker] @ c for c in part)
        yield marker, force, moment


def test_reactions(pair):
    """One state for all: opposite, without work, and what the motion needs."""
    bench = pair.bench
    found = list(wrenches(pair))
    size = max(1.0, np.abs([c for _, *both in found for c in both]).max())
    _opposite(pair, found, EXACT * size)
    _without_work(pair, found, EXACT * size)
    _carried(pair, bench.reactions[0].reshape(2, 6))
    generalised = np.zeros(bench.layout.nv)
    for marker, force, moment in found:
        where = bench.columns(bench.body_of(marker))
        generalised[where] += pair.markers.J[marker].T @ np.hstack([force, moment])
    needed = bench.at(lam=np.zeros(bench.layout.nc)).residual
    kept = bench.sys.kkt.column >= 0
    np.testing.assert_allclose(generalised[kept], needed[kept], rtol=0, atol=EXACT * size)
    for (marker, force, moment), name in zip(found, "ba", strict=True):
        if bench.sys.parts.bodies[bench.body_of(marker)]["m"] == 0:
            _newton_euler(pair, name, marker, force, moment)


def _opposite(pair, found, atol):
    (j, force_j, moment_j), (i, force_i, moment_i) = found
    np.testing.assert_allclose(force_j, -force_i, rtol=0, atol=atol)
    arm = pair.markers.x[j] - pair.markers.x[i]
    there = moment_i + moment_j + np.cross(arm, force_j)
    np.testing.assert_allclose(there, 0.0, rtol=0, atol=atol)


def _without_work(pair, found, atol):
    """On random motions of the null space of the joint's rows, modes and bodies together."""
    bench = pair.bench
    kept = np.flatnonzero(bench.sys.kkt.column >= 0)
    Cq = bench.Cq[:, kept]
    motions = np.linalg.svd(Cq)[2][np.linalg.matrix_rank(Cq, tol=1e-9) :]
    for _ in range(3):
        v = np.zeros(bench.layout.nv)
        v[kept] = motions.T @ pair.rng.standard_normal(len(motions))
        power = 0.0
        for marker, force, moment in found:
            twist = pair.markers.J[marker] @ v[bench.columns(bench.body_of(marker))]
            power += np.hstack([force, moment]) @ twist
        assert abs(power) <= 10 * atol


def _newton_euler(pair, name, marker, force, moment):
    """m a_c and the rate of the angular momentum about the centre, by hand."""
    bench, spec = pair.bench, pair.model.bodies[name]
    at = bench.columns(bench.body_of(marker))
    body = bench.sys.parts.bodies[bench.body_of(marker)]
    A = rotation(bench.q[body["iq"] + 3 : body["iq"] + 7])
    w, vd = bench.v[at][3:6], bench.vd[at]
    c, J = np.array(spec.center), np.array(spec.inertia)
    spin = np.cross(w, np.cross(w, c)) + np.cross(vd[3:6], c)
    center = bench.q[body["iq"] : body["iq"] + 3] + A @ c
    load = next(k for k, x in enumerate(pair.markers.x) if _is_load(pair, k, name))
    pull, torque = pair.loads[name]
    weight = spec.mass * bench.sys.parts.gravity
    rate = A @ (J @ vd[3:6] + np.cross(w, J @ w))
    net = spec.mass * (vd[:3] + A @ spin)
    about = moment + np.cross(pair.markers.x[marker] - center, force) + torque
    about += np.cross(pair.markers.x[load] - center, pull)
    kept = PLANE if pair.planar else range(6)
    left = np.hstack([force + pull + weight - net, about - rate])
    np.testing.assert_allclose(left[kept], 0.0, rtol=0, atol=EXACT * max(1.0, np.abs(net).max()))


def _is_load(pair, k, name):
    """Whether marker k of the tables is the one with the load of a body."""
    table = pair.bench.sys.parts.markers[k]
    given = pair.model.bodies[name].markers["load"].position
    place = table["rho"] + table["arm"]
    return "ab"[table["body"]] == name and np.allclose(place, given, rtol=0, atol=1e-12)


def _carried(pair, told):
    """Just the components that the joint cannot carry are zero, in a plane those out of it too."""
    kind = pair.model.joints["joint"].type
    names = [f"{what}{axis}" for what in "FM" for axis in "xyz"]
    size = max(1.0, np.abs(told).max())
    for side, parts in enumerate(told):
        none = (IN_PLANE if pair.planar else NONE).get(kind, ("", ""))[side].split()
        if pair.planar and (kind, side) != ("cam-flat", 0):  # whose z is across the flat
            none += ["Fz", "Mx", "My"]
        zero = [name for name, part in zip(names, parts, strict=True) if abs(part) < EXACT * size]
        assert set(none) == set(zero), (kind, side, zero)
