"""Coriolis and centrifugal forces on the modes: their part that is linear in the deformation.

With B = ω̃ω̃ and the mass integrals M_bc of `flexible_body` the generalised forces are

    Σ B_bc M_bc η − 2 Σ ω'_k G_k η̇

The pool stores them as `forms`: symmetric ones S_x = M_yy + M_zz and M_xy + M_yx, skew ones G_x =
M_yz − M_zy, and the same by cyclic permutation. A rotation about one axis of the body, as in planar
motion, needs one pair (S, G). Otherwise the weighted sums of the forms are computed once in a step
and used in all its iterations.
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.algebra.forms import (
    add_mixed_forms,
    add_pair_to_block,
    add_symmetric_and_skew,
    combine_forms,
    leading_form,
    size_of_form,
)
from flexmb.engine.algebra.vector import (
    add_multiple,
    add_part,
    axis_vector,
    copy,
    part,
    put_part,
    times,
    zero,
)
from flexmb.engine.bodies.flexible_body import least_turn
from flexmb.engine.jit import kernel
from flexmb.engine.tables import whole_vectors

# Relative change of the angular velocity between the iterations of a step up to which the sums of
# forms are reused. The predicted velocity is wrong by about ten local errors; so the error of an
# old sum is below the local error and decreases with it.
_REUSE_TOLERANCE = 1e-5


@kernel
def place_of_inertia_change(body):
    """Index in the pool of ∂J/∂η: xx, yy, zz, xy, yz, zx (6, m)."""
    return body["flex"] + 12 * body["m"] + 3 * body["m"] * body["m"]


@kernel
def place_of_pairs(body):
    """Index in the pool of the forms, which follow ∂J/∂η."""
    return body["flex"] + whole_vectors(18 * body["m"] + 3 * body["m"] * body["m"])


@kernel
def _form_weights(a, b):
    """Weights (6) of the symmetric forms of the pool in ½ Σ_bc (ã b̃ + b̃ ã)_bc M_bc."""
    xy, yz, zx = a[0] * b[1] + a[1] * b[0], a[1] * b[2] + a[2] * b[1], a[2] * b[0] + a[0] * b[2]
    return -a[0] * b[0], -a[1] * b[1], -a[2] * b[2], 0.5 * xy, 0.5 * yz, 0.5 * zx


@kernel
def _place_of_forms(body):
    """Index in Z of the sums of forms (`tables.deformation_room`); size of a form, padded modes."""
    size, padded = size_of_form(body["m"])
    return body["z"] + whole_vectors(12 * body["m"]), size, padded


@kernel
def _has_one_axis(om):
    """Whether a body rotates about only one of its axes."""
    least = least_turn(om)
    return (abs(om[0]) > least) + (abs(om[1]) > least) + (abs(om[2]) > least) == 1


@kernel
def _can_reuse_forms(forms, at, iteration, om):
    """Whether the sums of this step's first iteration hold for the angular velocity `om` too.

    If not, `om` is stored as the one that the new sums are for.
    """
    allowed, same = _REUSE_TOLERANCE * (abs(om[0]) + abs(om[1]) + abs(om[2])), iteration > 0.0
    for k in range(3):
        same = same and abs(om[k] - forms[at + k]) <= allowed
    if not same:
        put_part(forms, at, om)
    return same


@kernel
def _put_form_product(T, forms, size, padded, m):
    """Product of the two forms of T with η and η̇, which are in `forms`; two parts to be added."""
    x, y, out = forms[2 * size :], forms[2 * size + padded :], forms[2 * size + 2 * padded :]
    zero(x[m:padded])
    zero(y[m:padded])
    zero(out[:padded])
    add_symmetric_and_skew(T, size, padded, x, y, out)


@kernel
def add_velocity_forces(body, now, q, v, om, pool, out):
    """Modal rows += (Σ B_bc M_bc) η − 2 Σ ω'_k G_k η̇.

    If a body rotates almost only about one of its axes, the forms of that axis are multiplied in
    each iteration. The small contribution of the other forms is computed in the first iteration of
    a step only, and is used in the others without change.
    """
    m, o, eta = body["m"], body["iv"] + 6, body["iq"] + 7
    at_pool = place_of_pairs(body)
    at_forms, size, padded = _place_of_forms(body)
    forms = now.Z[at_forms:]
    x, y, product = forms[2 * size :], forms[2 * size + padded :], 2 * size + 2 * padded
    same = _can_reuse_forms(forms, product + 2 * padded, now.iteration[0], om)
    first = part(forms, product + 2 * padded)
    axis = leading_form(_form_weights(first, first))
    f, w = _form_weights(om, om), times(-2.0, om)
    copy(q[eta : eta + m], x)
    copy(v[o : o + m], y)
    if axis < 0:
        if not same:
            combine_forms(pool, at_pool, size, f, w, forms)
        _put_form_product(forms, forms, size, padded, m)
    else:
        if not same:
            zero(forms[: 2 * padded])
            if not _has_one_axis(om):
                zero(x[m:padded])
                zero(y[m:padded])
                add_mixed_forms(pool, at_pool, size, axis, f, w, padded, x, y, forms)
        of_x, of_y = f[axis], w[axis]
        for k in range(m):
            x[k], y[k] = of_x * x[k], of_y * y[k]
        _put_form_product(pool[at_pool + 2 * axis * size :], forms, size, padded, m)
        add_multiple(1.0, forms, 0, forms, product, 2 * padded)
    add_multiple(1.0, forms, product, out, o, m)
    add_multiple(1.0, forms, product + padded, out, o, m)


@kernel
def add_inertia_rate(body, pool, v, om, out):
    """Moment rows += J̇ ω' and modal rows −= ½ ω'ᵀ (∂J/∂η) ω', from the six rows of ∂J/∂η."""
    m, o, x, y, z = body["m"], np.uintp(body["iv"] + 6), 0.0, 0.0, 0.0
    xx = np.uintp(place_of_inertia_change(body))
    yy, zz, xy = xx + np.uintp(m), xx + np.uintp(2 * m), xx + np.uintp(3 * m)
    yz, zx = xx + np.uintp(4 * m), xx + np.uintp(5 * m)
    for k in range(np.uintp(m)):
        a = pool[xx + k] * om[0] + pool[xy + k] * om[1] + pool[zx + k] * om[2]
        b = pool[xy + k] * om[0] + pool[yy + k] * om[1] + pool[yz + k] * om[2]
        c = pool[zx + k] * om[0] + pool[yz + k] * om[1] + pool[zz + k] * om[2]
        x += a * v[o + k]
        y += b * v[o + k]
        z += c * v[o + k]
        out[o + k] -= 0.5 * (a * om[0] + b * om[1] + c * om[2])
    add_part(out, body["iv"] + 3, 1.0, (x, y, z))


@kernel
def add_velocity_block(body, pool, q, v, cv, cp, Z, B):
    """Modal rows of B += cp Σ B_bc M_bc − 2 cv Σ ω_b G_b, and cv times the derivative by ω'."""
    m, o, eta = body["m"], body["iv"] + 6, body["iq"] + 7
    at, om = place_of_pairs(body), part(v, body["iv"] + 3)
    f = _form_weights(om, om)
    at_forms, size, padded = _place_of_forms(body)
    forms = Z[at_forms:]
    forms[2 * size + 4 * padded] = math.inf  # the stored sums are overwritten: no reuse
    shares = (cp * f[0], cp * f[1], cp * f[2], cp * f[3], cp * f[4], cp * f[5])
    combine_forms(pool, at, size, shares, times(-2.0 * cv, om), forms)
    add_pair_to_block(forms, size, m, padded, B, 6)
    for d in range(3):
        axis = axis_vector(d)
        combine_forms(pool, at, size, _form_weights(om, axis), times(-1.0, axis), forms)
        copy(q[eta : eta + m], forms[2 * size :])
        copy(v[o : o + m], forms[2 * size + padded :])
        _put_form_product(forms, forms, size, padded, m)
        for k in range(m):
            i = 2 * size + 2 * padded + k
            B[6 + k, 3 + d] += 2.0 * cv * (forms[i] + forms[i + padded])
