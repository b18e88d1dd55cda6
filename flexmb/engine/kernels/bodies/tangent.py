"""Tangents of wrenches at markers, pulled back to the coordinates of the bodies.

For generalised forces Jᵀ w the derivative has two parts: Jᵀ H J, H the change of the wrenches with
the motion of the markers, and the change of J at constant w (the lever arms turn and deform).
"""

from __future__ import annotations

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.triple import (
    add_part,
    inner,
    outer,
    part,
    plus,
    times,
    triple,
    turned,
    turned_back,
)
from flexmb.engine.kernels.bodies.inertia_tangent import add_column, add_skew
from flexmb.engine.kernels.bodies.kinematics import mode_vector
from flexmb.engine.method import FINE
from flexmb.engine.records import Matrix, Vector
from flexmb.engine.state import Now
from flexmb.engine.tables import Parts


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
        for c in range(m):
            point, turning = _modal_column(mk, mn, parts.pool, m, c)
            add_column(Jm, 0, 6 + c, 1.0, turned(A, point))
            add_column(Jm, 3, 6 + c, 1.0, turned(A, turning))
    return FINE


@kernel
def _modal_column(mk, mn, pool, m, c):
    """Translation Φ_t + (TᵀΦ_r) × ŝ and rotation TᵀΦ_r of a marker per η_c, body axes."""
    at = mk["modes"] + c
    turning = turned_back(mn["T"], mode_vector(pool, at + 3 * m, m))
    return plus(mode_vector(pool, at, m), 1.0, outer(turning, triple(mn["arm"]))), turning


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
    return FINE


@unit
def add_lever_tangent(
    parts: Parts, now: Now, k: int, w: Vector, i: int, f: float, B: Matrix
) -> int:
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
        _add_modal_lever(mk, mn, parts.pool, parts.bodies[mk["body"]]["m"], force, moment, B)
    return FINE


@kernel
def _add_modal_lever(mk, mn, pool, m, force, moment, B):
    """Rows and columns of the modes: Φ_t, the tangent T(θ) and the arm all move with η."""
    o, arm = mk["modes"] + 3 * m, triple(mn["arm"])
    whole = plus(moment, 1.0, outer(arm, force))
    for c in range(m):
        point, turning = _modal_column(mk, mn, pool, m, c)
        # moment row: δs × f'; modal rows, δθ': f' and τ' turn with the body
        change = outer(point, force)
        add_column(B, 3, 6 + c, 1.0, change)
        add_part(B[6 + c], 3, 1.0, plus(change, 1.0, outer(turning, moment)))
        # modal rows, δη: the arm turns, and T(θ) changes
        change = turned(mn["T"], outer(outer(turning, arm), force))
        slope = _tangent_slope(mn, mode_vector(pool, o + c, m), whole)
        x, y, z = plus(change, 1.0, slope)
        for r in range(m):
            B[6 + r, 6 + c] += pool[o + r] * x + pool[o + m + r] * y + pool[o + 2 * m + r] * z


@kernel
def _tangent_slope(mn, r, m):
    """Derivative of T(θ) m along δθ = r."""
    th, c = triple(mn["th"]), mn["c"]
    s, u, w = 2.0 * inner(th, r), outer(th, m), outer(r, m)
    x = plus(times(-c[0], w), -s * c[2], u)
    x = plus(x, c[1], plus(outer(r, u), 1.0, outer(th, w)))
    return plus(x, s * c[3], outer(th, u))
