"""Wrenches at markers: their generalised forces on bodies, and the tangents of these.

A wrench w = (force, moment) in global axes has the generalised force Jᵀ w. Its derivative has two
parts: Jᵀ H J, with H the derivative of the wrench by the motion of the markers; and the derivative
of J at constant w, since the moment arms rotate and deform.
"""

from __future__ import annotations

from flexmb.engine.algebra.forms import add_symmetric_rows
from flexmb.engine.algebra.ldl import add_body_block, add_coupling
from flexmb.engine.algebra.vector import (
    add_column,
    add_part,
    add_skew,
    clear,
    cross,
    inner,
    mode_vector,
    part,
    plus,
    times,
    triple,
    turned,
    turned_back,
)
from flexmb.engine.jit import Matrix, Vector, kernel, unit
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import Now, Run
from flexmb.engine.tables import Parts, whole_vectors


@unit
def add_generalized_force(
    parts: Parts, now: Now, k: int, w: Vector, i: int, f: float, out: Vector, o: int
) -> int:
    """out[o:o+6+m] += f Jᵀ w[i:i+6] for marker k; w = (force, moment) in global axes."""
    apply_wrench(parts, now, k, w, i, f, out, o)
    return SUCCESS


@kernel
def apply_wrench(parts, now, k, w, i, f, out, o):
    mk, mn = parts.markers[k], now.marker[k]
    A, s = now.body[mk["body"]]["A"], mn["s"]
    force = times(f, part(w, i))
    add_part(out, o, 1.0, force)
    force, moment = turned_back(A, force), turned_back(A, times(f, part(w, i + 3)))
    add_part(out, o + 3, 1.0, plus(moment, 1.0, cross(triple(s), force)))
    if mk["modes"] >= 0:
        fx, fy, fz = force
        tx, ty, tz = moment
        add_modal_forces(parts, now, k, fx, fy, fz, tx, ty, tz, out, o + 6)


@unit
def add_modal_forces(
    parts: Parts,
    now: Now,
    k: int,
    fx: float,
    fy: float,
    fz: float,
    tx: float,
    ty: float,
    tz: float,
    out: Vector,
    o: int,
) -> int:
    """out[o:o+m] += modal forces of a force and a moment on marker k, in body axes."""
    mk, mn = parts.markers[k], now.marker[k]
    m = parts.bodies[mk["body"]]["m"]
    at, pool = mk["modes"], parts.pool
    if mk["bend"] >= 0:
        at, pool = 0, now.Phi[k]
    turn = turned(mn["T"], plus((tx, ty, tz), 1.0, cross(triple(mn["arm"]), (fx, fy, fz))))
    for j in range(m):
        s = pool[at + 3 * m + j] * turn[0] + pool[at + 4 * m + j] * turn[1]
        out[o + j] += s + pool[at + 5 * m + j] * turn[2]
    for j in range(m):
        out[o + j] += pool[at + j] * fx + pool[at + m + j] * fy + pool[at + 2 * m + j] * fz
    return SUCCESS


@unit
def marker_jacobian(parts: Parts, now: Now, k: int, Jm: Matrix) -> int:
    """Jm (6, 6+m): velocity and angular velocity of marker k, global axes, per v of its body."""
    mk, mn = parts.markers[k], now.marker[k]
    A, s = now.body[mk["body"]]["A"], mn["s"]
    m = parts.bodies[mk["body"]]["m"]
    for r in range(6):
        for c in range(6 + m):
            Jm[r, c] = 0.0
    for r in range(3):
        Jm[r, r] = 1.0
        for c in range(3):
            Jm[3 + r, 3 + c] = A[r, c]
        Jm[r, 3] = A[r, 2] * s[1] - A[r, 1] * s[2]
        Jm[r, 4] = A[r, 0] * s[2] - A[r, 2] * s[0]
        Jm[r, 5] = A[r, 1] * s[0] - A[r, 0] * s[1]
    if mk["modes"] >= 0:
        phi = now.Phi[k] if mk["bend"] >= 0 else parts.pool
        for c in range(m):
            point, turning = _modal_column(mk, mn, phi, m, c)
            add_column(Jm, 0, 6 + c, 1.0, turned(A, point))
            add_column(Jm, 3, 6 + c, 1.0, turned(A, turning))
    return SUCCESS


@kernel
def marker_acceleration(run, at, k, o):
    """Acceleration (o = 0) or angular acceleration (o = 3) of a marker, global axes."""
    parts, now, J, vd = run.system.parts, run.work.now, run.work.dense.J[0], at.vd
    mn, b = now.marker[k], parts.markers[k]["body"]
    if b < 0:
        return 0.0, 0.0, 0.0
    iv, n = parts.bodies[b]["iv"], 6 + parts.bodies[b]["m"]
    marker_jacobian(parts, now, k, J)
    bias = mn["bx"] if o == 0 else mn["bom"]
    x, y, z = bias[0], bias[1], bias[2]
    for c in range(n):
        x += J[o, c] * vd[iv + c]
        y += J[o + 1, c] * vd[iv + c]
        z += J[o + 2, c] * vd[iv + c]
    return x, y, z


@kernel
def _modal_column(mk, mn, phi, m, c):
    """Translation Φ_t + (TᵀΦ_r) × ŝ and rotation TᵀΦ_r of a marker per η_c, body axes."""
    at = c if mk["bend"] >= 0 else mk["modes"] + c
    turning = turned_back(mn["T"], mode_vector(phi, at + 3 * m, m))
    return plus(mode_vector(phi, at, m), 1.0, cross(turning, triple(mn["arm"]))), turning


@unit
def put_product_block(
    H: Matrix,
    i: int,
    j: int,
    Ji: Matrix,
    ni: int,
    Jj: Matrix,
    nj: int,
    f: float,
    T: Matrix,
    B: Matrix,
) -> int:
    """B[:ni, :nj] = f J_iᵀ H[6i:6i+6, 6j:6j+6] J_j; T (6, nj) is scratch."""
    for r in range(6):
        for c in range(nj):
            s = 0.0
            for k in range(6):
                s += H[6 * i + r, 6 * j + k] * Jj[k, c]
            T[r, c] = s
    for r in range(ni):
        for c in range(nj):
            B[r, c] = 0.0
        for k in range(6):
            x = f * Ji[k, r]
            if x != 0.0:
                for c in range(nj):
                    B[r, c] += x * T[k, c]
    return SUCCESS


@unit
def add_moment_arm(parts: Parts, now: Now, k: int, w: Vector, i: int, f: float, B: Matrix) -> int:
    """Add f ∂(Jᵀ w[i:i+6])/∂(r, θ', η) of marker k, w constant in global axes, to B (6+m, 6+m)."""
    mk, mn = parts.markers[k], now.marker[k]
    A, s = now.body[mk["body"]]["A"], triple(mn["s"])
    force, moment = turned_back(A, times(f, part(w, i))), turned_back(A, times(f, part(w, i + 3)))
    add_skew(B, 3, 3, 1.0, moment)
    # s̃ f̃' = f' sᵀ − (s·f') I
    for c in range(3):
        B[3 + c, 3 + c] -= inner(s, force)
        add_column(B, 3, 3 + c, s[c], force)
    if mk["modes"] >= 0:
        m = parts.bodies[mk["body"]]["m"]
        phi = now.Phi[k] if mk["bend"] >= 0 else parts.pool
        _add_modal_arm(mk, mn, parts.pool, phi, m, force, moment, B)
    return SUCCESS


@kernel
def _add_modal_arm(mk, mn, pool, phi, m, force, moment, B):
    """Rows and columns of the modes: Φ, the tangent T(θ) and the arm depend on η.

    With geometric stiffness, Φ is reduced by ηᵀ K_d: a force stiffens the modes by Σ f'_d K_d, and
    a moment by Σ (T m')_d K_d.
    """
    o, arm = 3 * m + (0 if mk["bend"] >= 0 else mk["modes"]), triple(mn["arm"])
    whole = plus(moment, 1.0, cross(arm, force))
    for c in range(m):
        point, turning = _modal_column(mk, mn, phi, m, c)
        # moment row: δs × f'; modal rows, δθ': f' and τ' rotate relative to the body
        change = cross(point, force)
        add_column(B, 3, 6 + c, 1.0, change)
        add_part(B[6 + c], 3, 1.0, plus(change, 1.0, cross(turning, moment)))
        # modal rows, δη: the arm rotates, and T(θ) changes
        change = turned(mn["T"], cross(cross(turning, arm), force))
        slope = _tangent_slope(mn, mode_vector(phi, o + c, m), whole)
        x, y, z = plus(change, 1.0, slope)
        for r in range(m):
            B[6 + r, 6 + c] += phi[o + r] * x + phi[o + m + r] * y + phi[o + 2 * m + r] * z
    if mk["bend"] >= 0:
        at, n = mk["bend"], whole_vectors(mk["forms"] * m)
        add_symmetric_rows(pool, at, n, m, times(-1.0, force), B, 6)
        turn = times(-1.0, turned(mn["T"], whole))
        if mk["forms"] == 6:
            add_symmetric_rows(pool, at + 3 * m, n, m, turn, B, 6)
        elif mk["forms"] == 4:
            f = (0.0, 0.0, inner(triple(mk["turn"]), turn))
            add_symmetric_rows(pool, at + m, n, m, f, B, 6)


@kernel
def _tangent_slope(mn, r, m):
    """Derivative of T(θ) m along δθ = r."""
    th, c = triple(mn["th"]), mn["c"]
    s, u, w = 2.0 * inner(th, r), cross(th, m), cross(r, m)
    x = plus(times(-c[0], w), -s * c[2], u)
    x = plus(x, c[1], plus(cross(r, u), 1.0, cross(th, w)))
    return plus(x, s * c[3], cross(th, u))


@unit
def add_marker_tangent(run: Run, k: int, side: int, f: float) -> int:
    """Add f Jᵀ H J of marker k, one end of a pair, to its body; returns 6 + m.

    H (12, 12) is in dense.H; J is stored in dense.J[side].
    """
    parts, d = run.system.parts, run.work.dense
    b = parts.markers[k]["body"]
    if b < 0:
        return 0
    n = 6 + parts.bodies[b]["m"]
    J = d.J[side]
    marker_jacobian(parts, run.work.now, k, J)
    put_product_block(d.H, side, side, J, n, J, n, f, d.T, d.B)
    add_body_block(run, b, d.B)
    return n


@unit
def add_pair_tangent(run: Run, i: int, j: int, link: int, f: float) -> int:
    """Add f Jᵀ H J for the bodies of markers i and j, H (12, 12) in dense.H."""
    parts, d = run.system.parts, run.work.dense
    n0, n1 = add_marker_tangent(run, i, 0, f), add_marker_tangent(run, j, 1, f)
    if link < 0:
        return SUCCESS
    a, b = parts.markers[i]["body"], parts.markers[j]["body"]
    put_product_block(d.H, 0, 1, d.J[0], n0, d.J[1], n1, f, d.T, d.B)
    add_coupling(run, a, b, link, 0, d.B)
    put_product_block(d.H, 1, 0, d.J[1], n1, d.J[0], n0, f, d.T, d.B)
    add_coupling(run, b, a, link, 1, d.B)
    return SUCCESS


@unit
def add_moment_arms(run: Run, i: int, j: int, f: float) -> int:
    """Change of the moment arms of the wrench pair dense.g[1] on markers i and j (−1: none)."""
    parts, d = run.system.parts, run.work.dense
    for side in range(2):
        k = i if side == 0 else j
        b = parts.markers[k]["body"] if k >= 0 else -1
        if b >= 0:
            n = 6 + parts.bodies[b]["m"]
            clear(d.B, n, n)
            add_moment_arm(parts, run.work.now, k, d.g[1], 6 * side, f, d.B)
            add_body_block(run, b, d.B)
    return SUCCESS


@unit
def add_rate_tangent(run: Run, n: int, f: float) -> int:
    """Add f Σ X_r U_rᵀ, r < n, to dense.H (12, 12).

    It is the tangent of wrench pairs Σ X_r (U_r·V) that depend on rates U_r·V. V (12) are the
    velocities of both markers; X_r and U_r are rows of dense.X and dense.U.
    """
    X, U, H = run.work.dense.X, run.work.dense.U, run.work.dense.H
    for r in range(12):
        for k in range(n):
            x = f * X[k, r]
            if x != 0.0:
                for c in range(12):
                    H[r, c] += x * U[k, c]
    return SUCCESS


@unit
def add_rate_arms(run: Run, v: Vector, i: int, j: int, link: int, n: int, f: float) -> int:
    """Add f Jᵀ Σ X_r ∂(U_r·V)/∂q, r < n; J of markers i and j is in dense.J.

    At constant velocities v of the bodies, V changes with the moment arms. Rows of dense.T: Jᵀ X_r
    of the two bodies; from row 12 on ∂(U_r·V)/∂q, which is vᵀ times the tangent of the moment arms
    of U_r.
    """
    parts, d = run.system.parts, run.work.dense
    T, B, X = d.T, d.B, d.X
    for side in range(2):
        k = i if side == 0 else j
        b = parts.markers[k]["body"]
        if b < 0:
            continue
        J, o, size = d.J[side], parts.bodies[b]["iv"], 6 + parts.bodies[b]["m"]
        for r in range(n):
            clear(B, size, size)
            add_moment_arm(parts, run.work.now, k, d.U[r], 6 * side, f, B)
            for c in range(size):
                push, rate = 0.0, 0.0
                for a in range(6):
                    push += X[r, 6 * side + a] * J[a, c]
                for a in range(size):
                    rate += v[o + a] * B[a, c]
                T[6 * side + r, c], T[12 + 6 * side + r, c] = push, rate
    for pair in range(4):
        here, there = pair // 2, pair % 2
        a, b = parts.markers[j if here else i]["body"], parts.markers[j if there else i]["body"]
        if a < 0 or b < 0 or (here != there and link < 0):
            continue
        for r in range(6 + parts.bodies[a]["m"]):
            for c in range(6 + parts.bodies[b]["m"]):
                B[r, c] = 0.0
                for k in range(n):
                    B[r, c] += T[6 * here + k, r] * T[12 + 6 * there + k, c]
        if here == there:
            add_body_block(run, a, B)
        else:
            add_coupling(run, a, b, link, here, B)
    return SUCCESS
