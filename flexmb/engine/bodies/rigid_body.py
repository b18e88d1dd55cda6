"""Rigid bodies, and the frame of flexible ones: inertia forces, their tangents, energies.

With c = ∫ρ x, J = tr(S) I − S, S_ab = ∫ρ x_a x_b and a' = Aᵀ(r̈ − g):

    force    m (r̈ − g) + A (ω̇'×c + ω'×(ω'×c) + 2 ω'×(p η̇) + p η̈)
    moment   c × a' + J ω̇' + ω'×J ω'

The terms with p are those of flexible bodies (`flexible_body` has their modal rows). Gravity is an
acceleration of the frame, so it is no separate force. Rows and columns of the tangents are in the
order of v of the body, (r, ω', η).

In a planar model a rigid body has three coordinates: displacements along two global axes a, b and
the rotation about the normal, which is ± its own axis k; i, j are its other axes, (i, j, k) cyclic.
With w = ω'_k and e = ω̇'_k its inertia force is the one above with all other components zero.
Coordinates out of the plane are constant, and their residual is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.algebra.ldl import add_body_block
from flexmb.engine.algebra.vector import (
    add_column,
    add_part,
    add_skew,
    column,
    cross,
    inner,
    modal_vector,
    part,
    plus,
    put_part,
    rotation_matrix,
    times,
    triple,
    turned,
    turned_back,
)
from flexmb.engine.jit import Integers, kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import GRAVITY_ENERGY, KINETIC_ENERGY, Point, Run

if TYPE_CHECKING:
    from flexmb.model.body import RigidBodySpec


class Bodies(NamedTuple):
    """Bodies of one kind; other records of bodies begin with the same field."""

    rows: Integers  # their rows in the table of bodies


@unit
def turn_bodies(run: Run, of: Bodies, at: Point) -> int:
    """Direction cosines of the bodies."""
    bodies, body_now, rows, q = run.system.parts.bodies, run.work.now.body, of.rows, at.q
    for n in range(rows.shape[0]):
        rotation_matrix(q, bodies[rows[n]]["iq"] + 3, body_now[rows[n]]["A"])
    return SUCCESS


@unit
def prepare_rigid(run: Run, of: Bodies, at: Point) -> int:
    """J = tr(S) I − S and c of undeformed bodies; those of rigid bodies never change."""
    bodies, body_now, rows = run.system.parts.bodies, run.work.now.body, of.rows
    for n in range(rows.shape[0]):
        S, J, c = bodies[rows[n]]["S0"], body_now[rows[n]]["J"], body_now[rows[n]]["c"]
        trace = S[0, 0] + S[1, 1] + S[2, 2]
        for a in range(3):
            c[a] = bodies[rows[n]]["S1"][a]
            for b in range(3):
                J[a, b] = (trace if a == b else 0.0) - S[a, b]
    return SUCCESS


@unit
def put_frame_forces(run: Run, i: int, at: Point, m: int) -> int:
    """Force and moment rows of the frame of body i in Trial.res, without M_ωη and V.

    `m`: number of modes that act on them through p.
    """
    parts, v, vd, out = run.system.parts, at.v, at.vd, run.work.trial.res
    body, bn = parts.bodies[i], run.work.now.body[i]
    iv, flex, A, J = body["iv"], body["flex"], bn["A"], bn["J"]
    c, om, e = triple(bn["c"]), part(v, iv + 3), part(vd, iv + 3)
    a = plus(part(vd, iv), -1.0, triple(parts.gravity))
    # ω̇×c + ω×(ω×c + 2 p η̇) + p η̈
    x = plus(cross(om, c), 2.0, modal_vector(parts.pool, flex, m, v, iv + 6))
    x = plus(cross(om, x), 1.0, cross(e, c))
    x = turned(A, plus(x, 1.0, modal_vector(parts.pool, flex, m, vd, iv + 6)))
    put_part(out, iv, plus(x, body["mass"], a))
    moment = plus(turned(J, e), 1.0, cross(om, turned(J, om)))
    put_part(out, iv + 3, plus(moment, 1.0, cross(c, turned_back(A, a))))
    return SUCCESS


@unit
def rigid_inertia_forces(run: Run, of: Bodies, at: Point) -> int:
    """Trial.res = M v̇ + velocity terms + gravity of rigid bodies."""
    for n in range(of.rows.shape[0]):
        put_frame_forces(run, of.rows[n], at, 0)
    return SUCCESS


@kernel
def _add_rotated_skew(B, f, A, a):
    """Add f A ã to the 3 × 3 block of B at (0, 3): the rows are those of A times a~."""
    for k in range(3):
        add_part(B[k], 3, f, cross(part(A[k], 0), a))


@unit
def put_frame_matrix(run: Run, i: int, at: Point, cv: float, cp: float, m: int) -> int:
    """dense.B[:6, :6] = M + cv ∂F/∂v + cp ∂F/∂q of the frame of body i, F its inertia forces.

    `m`: number of modes that act on them through p.
    """
    parts, B, v, vd = run.system.parts, run.work.dense.B, at.v, at.vd
    body, bn, pool = parts.bodies[i], run.work.now.body[i], parts.pool
    A, J, c, iv = bn["A"], bn["J"], triple(bn["c"]), body["iv"]
    for r in range(3):
        for k in range(3):
            B[r, k] = body["mass"] if r == k else 0.0
            B[r, 3 + k] = 0.0
            B[3 + r, 3 + k] = J[r, k]
    _add_rotated_skew(B, -1.0, A, c)
    for r in range(3):
        for k in range(3):
            B[3 + r, k] = B[k, 3 + r]
    om, e = part(v, iv + 3), part(vd, iv + 3)
    turning = plus(cross(om, c), 2.0, modal_vector(pool, body["flex"], m, v, iv + 6))
    if cv != 0.0:
        # ∂ A(ω×(ω×c) + 2ω×(p η̇))/∂ω = −A (ω×c + 2 p η̇)~ − A ω̃ c̃,  ω̃ c̃ = c ωᵀ − (ω·c) I
        _add_rotated_skew(B, -cv, A, turning)
        add_skew(B, 3, 3, -cv, turned(J, om))
        for k in range(3):
            x = plus(times(inner(om, c), column(A, k)), -v[iv + 3 + k], turned(A, c))
            add_column(B, 0, 3 + k, cv, x)
            add_column(B, 3, 3 + k, cv, cross(om, column(J, k)))
    if cp != 0.0:
        x = plus(plus(cross(om, turning), 1.0, cross(e, c)), 1.0,
                 modal_vector(pool, body["flex"], m, vd, iv + 6))  # fmt: skip
        _add_rotated_skew(B, -cp, A, x)
        # δ(c × a') = c̃ ã' δθ' = (a' cᵀ − (a'·c) I) δθ', a' = Aᵀ(r̈ − g)
        a = turned_back(A, plus(part(vd, iv), -1.0, triple(parts.gravity)))
        for k in range(3):
            B[3 + k, 3 + k] -= cp * inner(a, c)
            add_column(B, 3, 3 + k, cp * bn["c"][k], a)
    return SUCCESS


@unit
def rigid_matrix(run: Run, of: Bodies, at: Point, cv: float, cp: float) -> int:
    """Add M + cv ∂F/∂v + cp ∂F/∂q of rigid bodies, F their inertia forces."""
    bodies, body_now, rows = run.system.parts.bodies, run.work.now.body, of.rows
    panels, low, up = run.system.kkt.panels, run.work.factor.low, run.work.factor.up
    for n in range(rows.shape[0]):
        if cv == 0.0 and cp == 0.0:
            body = bodies[rows[n]]
            _add_rigid_mass(body, body_now[rows[n]], panels[body["panel"]]["at"], low, up)
        else:
            put_frame_matrix(run, rows[n], at, cv, cp, 0)
            add_body_block(run, rows[n], run.work.dense.B)
    return SUCCESS


@kernel
def _add_rigid_mass(body, bn, at, low, up):
    """M of a rigid body in space, whose coordinates are the columns of its panel."""
    A, J, c, mass = bn["A"], bn["J"], triple(bn["c"]), body["mass"]
    for r in range(3):
        turns = at + 18 + 6 * r
        _add_to_both(low, up, at + 7 * r, mass)
        x, y, z = cross(c, part(A[r], 0))  # row r of −A c̃
        _add_to_both(low, up, at + 18 + r, x)
        _add_to_both(low, up, at + 24 + r, y)
        _add_to_both(low, up, at + 30 + r, z)
        for k in range(r + 1):
            _add_to_both(low, up, turns + 3 + k, J[r, k])


@kernel
def _add_to_both(low, up, o, x):
    low[o] += x
    up[o] += x


@unit
def rigid_mass_product(run: Run, of: Bodies, at: Point) -> int:
    """Factor.sol = M Trial.res of rigid bodies."""
    bodies, body_now, rows = run.system.parts.bodies, run.work.now.body, of.rows
    x, out, place = run.work.trial.res, run.work.factor.sol, run.system.kkt.place
    for n in range(rows.shape[0]):
        _multiply_rigid(bodies[rows[n]], body_now[rows[n]], x, bodies[rows[n]]["iv"], out, place)
    return SUCCESS


@kernel
def _multiply_rigid(body, bn, x, o, out, place):
    """m a + A(α × c) and c × Aᵀa + J α of a rigid body with x = (a, α)."""
    A, c, a, alpha = bn["A"], triple(bn["c"]), part(x, o), part(x, o + 3)
    force = plus(turned(A, cross(alpha, c)), body["mass"], a)
    moment = plus(turned(bn["J"], alpha), 1.0, cross(c, turned_back(A, a)))
    out[place[o]], out[place[o + 1]], out[place[o + 2]] = force
    out[place[o + 3]], out[place[o + 4]], out[place[o + 5]] = moment


@kernel
def rigid_kinetic(parts, now, v, i):
    """½ vᵀ M v of one body without its modes, J: ½ m ṙ² + ṙ·A(ω'×c) + ½ ω'·J ω'."""
    o, bn, mass = parts.bodies[i]["iv"], now.body[i], parts.bodies[i]["mass"]
    speed, om = part(v, o), part(v, o + 3)
    e = inner(speed, plus(turned(bn["A"], cross(om, triple(bn["c"]))), 0.5 * mass, speed))
    return e + 0.5 * inner(om, turned(bn["J"], om))


@kernel
def body_weight(parts, now, q, i):
    """−g·(m r + A c) of one body, J."""
    body, bn = parts.bodies[i], now.body[i]
    r = plus(part(q, body["iq"]), 1.0, triple(parts.origin))
    moment = plus(turned(bn["A"], triple(bn["c"])), body["mass"], r)
    return -inner(triple(parts.gravity), moment)


@unit
def frame_energy(run: Run, i: int, what: int, at: Point) -> float:
    """Kinetic energy (0) without that of modes, or gravity energy (2) of one body [J]."""
    if what == 0:
        return rigid_kinetic(run.system.parts, run.work.now, at.v, i)
    return body_weight(run.system.parts, run.work.now, at.q, i)


@unit
def rigid_energies(run: Run, of: Bodies, at: Point) -> int:
    """Kinetic and gravity energy of rigid bodies."""
    out, rows = run.work.energies, of.rows
    for n in range(rows.shape[0]):
        out[KINETIC_ENERGY] += frame_energy(run, rows[n], 0, at)
        out[GRAVITY_ENERGY] += frame_energy(run, rows[n], 2, at)
    return SUCCESS


RIGID_BODIES = Kind(
    "rigid_bodies",
    Bodies,
    {
        "constants": prepare_rigid,
        "position": turn_bodies,
        "force": rigid_inertia_forces,
        "matrix": rigid_matrix,
        "mass": rigid_mass_product,
        "energy": rigid_energies,
    },
)


class PlanarBodies(NamedTuple):
    """Rigid bodies of a planar model."""

    rows: Integers  # their rows in the table of bodies
    about: Integers  # (n,) their axis k along the normal
    plane: Integers  # (3,) the global axes a, b, and the normal


@unit
def planar_inertia_forces(run: Run, of: PlanarBodies, at: Point) -> int:
    """Trial.res = M v̇ + velocity terms + gravity in the plane."""
    parts, body_now, out, rows = run.system.parts, run.work.now.body, run.work.trial.res, of.rows
    bodies, g, v, vd, about = parts.bodies, parts.gravity, at.v, at.vd, of.about
    a, b, c = of.plane[0], of.plane[1], of.plane[2]
    for n in range(rows.shape[0]):
        body, bn, k = bodies[rows[n]], body_now[rows[n]], about[n]
        A, s, iv, mass = bn["A"], bn["c"], body["iv"], body["mass"]
        i = k + 1 if k < 2 else 0
        j = i + 1 if i < 2 else 0
        w, e = v[iv + 3 + k], vd[iv + 3 + k]
        x, y = vd[iv + a] - g[a], vd[iv + b] - g[b]
        fi, fj = -e * s[j] - w * w * s[i], e * s[i] - w * w * s[j]
        out[iv + a] = mass * x + A[a, i] * fi + A[a, j] * fj
        out[iv + b] = mass * y + A[b, i] * fi + A[b, j] * fj
        out[iv + c] = 0.0
        pi, pj = A[a, i] * x + A[b, i] * y, A[a, j] * x + A[b, j] * y
        out[iv + 3 + i] = 0.0
        out[iv + 3 + j] = 0.0
        out[iv + 3 + k] = bn["J"][k, k] * e + s[i] * pj - s[j] * pi
    return SUCCESS


@unit
def planar_matrix(run: Run, of: PlanarBodies, at: Point, cv: float, cp: float) -> int:
    """Add M + cv ∂F/∂v + cp ∂F/∂q in the plane; columns: along a, along b, rotation."""
    parts, body_now, factor, rows = run.system.parts, run.work.now.body, run.work.factor, of.rows
    bodies, g, v, vd, panels = parts.bodies, parts.gravity, at.v, at.vd, run.system.kkt.panels
    a, b, about, low, up = of.plane[0], of.plane[1], of.about, factor.low, factor.up
    for n in range(rows.shape[0]):
        body, bn, k = bodies[rows[n]], body_now[rows[n]], about[n]
        A, s, iv, o = bn["A"], bn["c"], body["iv"], panels[body["panel"]]["at"]
        i = k + 1 if k < 2 else 0
        j = i + 1 if i < 2 else 0
        w, e, turn = v[iv + 3 + k], vd[iv + 3 + k], bn["J"][k, k]
        # the force in body axes is (−e s_j − w² s_i, e s_i − w² s_j): its change by e, w, angle
        fi, fj = -s[j], s[i]
        low[o + 6] += A[a, i] * fi + A[a, j] * fj
        low[o + 7] += A[b, i] * fi + A[b, j] * fj
        fi, fj = fi - 2.0 * cv * w * s[i], fj - 2.0 * cv * w * s[j]
        if cp != 0.0:
            fi -= cp * (e * s[i] - w * w * s[j])
            fj -= cp * (e * s[j] + w * w * s[i])
            x, y = vd[iv + a] - g[a], vd[iv + b] - g[b]
            turn -= cp * s[i] * (A[a, i] * x + A[b, i] * y)
            turn -= cp * s[j] * (A[a, j] * x + A[b, j] * y)
        up[o + 6] += A[a, i] * fi + A[a, j] * fj
        up[o + 7] += A[b, i] * fi + A[b, j] * fj
        _add_to_both(low, up, o, body["mass"])
        _add_to_both(low, up, o + 4, body["mass"])
        _add_to_both(low, up, o + 8, turn)
    return SUCCESS


PLANAR_BODIES = Kind(
    "planar_bodies",
    PlanarBodies,
    {
        "constants": prepare_rigid,
        "position": turn_bodies,
        "force": planar_inertia_forces,
        "matrix": planar_matrix,
        "mass": rigid_mass_product,
        "energy": rigid_energies,
    },
)

Array = NDArray[np.float64]


def mass_properties(specs: Sequence[RigidBodySpec]) -> tuple[Array, Array, Array]:
    """Mass (n,), centre (n, 3) and inertia about it (n, 3, 3) of rigid bodies."""
    of = [spec.mass_properties for spec in specs]
    center = np.array([each.center for each in of]).reshape(-1, 3)
    inertia = np.array([each.inertia for each in of]).reshape(-1, 3, 3)
    return np.array([each.mass for each in of]), center, inertia


def second_moments(specs: Sequence[RigidBodySpec], about: Array) -> tuple[Array, Array, Array]:
    """Mass (n,), first (n, 3) and second moment ∫ρ s sᵀ (n, 3, 3) of rigid bodies about points
    (n, 3).

    A mass distribution with inertia J about its centre has the second moment ½ tr(J) I − J.
    """
    mass, c, J = mass_properties(specs)
    c = c - about
    second = 0.5 * np.trace(J, axis1=1, axis2=2)[:, None, None] * np.eye(3) - J
    first = mass[:, None] * c
    return mass, first, second + mass[:, None, None] * (c[:, :, None] * c[:, None, :])
