"""The two linear systems of Radau's method, for the corrections of all stages at once.

With A⁻¹ = V diag(γ, μ, μ̄) V⁻¹ simplified Newton solves one real and one complex system,

    S(c) = [[M + c ∂F/∂v + c² ∂F/∂q, Cqᵀ], [Cq, −ε]],   c = h/γ and c = h/μ

(Hairer & Wanner, Solving Ordinary Differential Equations II, 1996, §IV.8).
"""

from __future__ import annotations

from flexmb.engine.algebra import ldl
from flexmb.engine.algebra.vector import copy, larger, scaled_max, weighted_max
from flexmb.engine.bodies.motion import max_over_round_off
from flexmb.engine.equations_of_motion import run_stage
from flexmb.engine.integrators.radau_coefficients import STAGES, Radau
from flexmb.engine.iteration_matrix import factorise_pair, put_matrix, put_rows, store_diagonal
from flexmb.engine.jit import Vector, kernel, unit
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import Run

# cv that selects the mass matrix of steps, not that of single solves, and is zero otherwise.
_TINY_DAMPING = 1e-300


@unit
def factorise_stages(run: Run, radau: Radau, h: float) -> int:
    """Assemble and factor S(h/γ) and S(h/μ) at the stage that was evaluated last."""
    fac, col, kkt, at = run.work.factor, run.work.collocation, run.system.kkt, run.trial_point
    pair, real, memory = col.pair, col.real, run.state.memory[0]
    n = radau.mu_real**2 + radau.mu_imag**2
    x, y = radau.mu_real * h / n, -radau.mu_imag * h / n
    fac.symmetric[0] = int(memory["symmetric"])
    pair.symmetric[0] = fac.symmetric[0]
    for i in range(pair.low.shape[0]):
        pair.low[i] = pair.up[i] = 0.0
    put_matrix(run, at, _TINY_DAMPING, 0.0)  # without the artificial mass of single solves
    _add_matrix(pair, fac, -1j)
    put_matrix(run, at, y, 2.0 * x * y)
    _add_matrix(pair, fac, 1j)
    put_matrix(run, at, x, x * x - y * y)
    _add_matrix(pair, fac, 1.0 + 0j)
    c = h / radau.gamma
    put_matrix(run, at, c, c * c)
    _add_matrix(pair, fac, -1.0 + 0j)
    store_diagonal(kkt.panels, fac.low, fac.diagonal)
    put_rows(run, at, c, c * c)
    _add_matrix(pair, fac, 1.0 + 0j)  # constraint rows
    run.state.count[0]["regularised_pivots"] += factorise_pair(run, pair)
    copy(fac.low, real.low)
    copy(fac.up, real.up)
    copy(fac.d, real.d)
    copy(fac.eps, real.eps)
    real.symmetric[0] = fac.symmetric[0]
    run.state.count[0]["factorisations"] += 2
    memory["factor_age"], memory["contraction"], memory["factor_step"] = 0.0, 1.0, h
    return SUCCESS


@kernel
def _add_matrix(pair, fac, f):
    """pair += f times the assembled matrix."""
    for i in range(pair.low.shape[0]):
        pair.low[i] += f * fac.low[i]
        pair.up[i] += f * fac.up[i]


@kernel
def correct_stages(run, radau, h):
    """Newton correction of displacements and multipliers of all stages; returns three sizes of it.

    1: over the error scales (with fixed steps weighted). 2: weighted. 3: over the round-off of
    positions.
    """
    st, col, kkt, weights = run.state, run.work.collocation, run.system.kkt, run.system.weights
    place, nv = kkt.place, st.v.shape[0]
    real, pair, to, back = col.real, col.pair, radau.to, radau.back
    x, z, eps = real.sol, pair.sol, real.eps
    c = h / radau.gamma
    m = h / complex(radau.mu_real, radau.mu_imag)
    for k in range(nv):
        r, p, q = _transformed(to, col.res, k)
        x[place[k]] = -c * c * r
        z[place[k]] = -m * m * complex(p, q)
    for k in range(st.lam.shape[0]):
        # Multipliers are regularised towards those extrapolated from the ends of the last steps,
        # which distribute loads over redundant rows; towards zero, each step would yield to them.
        i = place[nv + k]
        r, p, q = _transformed(to, col.gap, k)
        lr, lp, lq = _transformed(to, col.lam, k)
        nr, np_, nq = _transformed(to, col.next_lam, k)
        x[i] = eps[i] * c * c * (lr - nr) - r
        z[i] = eps[i] * m * m * complex(lp - np_, lq - nq) - complex(p, q)
    ldl.solve(kkt, real, x)
    ldl.solve_complex(kkt, pair)
    for k in range(nv):
        r, y = x[place[k]], z[place[k]]
        for i in range(STAGES):
            d = back[0, i] * r + back[1, i] * y.real + back[2, i] * y.imag
            col.u[i, k] += d
            col.change[i, k] = d
    for k in range(st.lam.shape[0]):
        i = place[nv + k]
        r, y = x[i] / (c * c), z[i] / (m * m)
        for n in range(STAGES):
            col.lam[n, k] += back[0, n] * r + back[1, n] * y.real + back[2, n] * y.imag
    size, moved, units = 0.0, 0.0, 0.0
    for i in range(STAGES):
        moved = larger(moved, weighted_max(col.change[i], weights))
        units = max(units, max_over_round_off(run, col.change[i]))
        if run.settings.step == 0.0:
            size = larger(size, scaled_max(col.change[i], weights, st.q_scale))
            size = larger(size, scaled_max(col.change[i], weights, st.v_scale) / h)
    if run.settings.step > 0.0:
        size = moved
    return size, moved, units


@kernel
def _transformed(to, rows, k):
    """Column k of three stages in the basis of V: of γ; real and imaginary part of that of μ."""
    a, b, c = rows[0, k], rows[1, k], rows[2, k]
    return (
        to[0, 0] * a + to[0, 1] * b + to[0, 2] * c,
        to[1, 0] * a + to[1, 1] * b + to[1, 2] * c,
        to[2, 0] * a + to[2, 1] * b + to[2, 2] * c,
    )


@unit
def filter_motion(run: Run, x: Vector) -> int:
    """x ← S(h/γ)⁻¹ M x."""
    tr, real, kkt = run.work.trial, run.work.collocation.real, run.system.kkt
    nv, place = x.shape[0], kkt.place
    copy(x, tr.res)
    run_stage(run.stages.mass, run, run.trial_point)
    copy(run.work.factor.sol, real.sol)
    for k in range(run.work.con.C.shape[0]):
        real.sol[place[nv + k]] = 0.0
    ldl.solve(kkt, real, real.sol)
    for k in range(nv):
        x[k] = real.sol[place[k]]
    return SUCCESS
