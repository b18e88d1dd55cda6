"""Static equilibrium: positions and reactions at which all forces are in balance.

The equations F(q, λ) = 0 and C(q, t) = 0 with v = v̇ = 0 are solved by Newton's method with
pseudo-transient continuation (Kelley & Keyes, SIAM J. Numer. Anal. 35 (1998) 508): each step solves

    [[K + M/β, Cqᵀ], [Cq, −ε]] (δ; λ) = (−F₀; −C),

a time step β of a motion in which velocity, not acceleration, is proportional to force. Such a
motion descends to a stable equilibrium. The first β gives a step of a third of the size of the
model. β increases while forces do work along the step, ½(F + F')·δ ≤ 0, and decreases if not; the
last steps are those of Newton's method. States of controllers are constant: they follow from ż = 0.

A machine in steady rotation is in equilibrium in rotating axes: v and v̇ are those of a rotation ω
about a fixed axis, v = ω × r, v̇ = ω × v, and D ∂v/∂q + M ∂v̇/∂q is added to K.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from flexmb.analysis.assembly.jacobian import column_scales, one_blas_thread
from flexmb.analysis.linear.observer import body_axes
from flexmb.analysis.linear.state_equations import StateEquations, Tangents
from flexmb.engine.allocation import new_work
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import solve_stage
from flexmb.engine.initial_conditions import BEGIN, REMEMBER
from flexmb.engine.state import State
from flexmb.errors import AssemblyError
from flexmb.flexbody.arrays import Array, skew
from flexmb.model.model import Model

_MAX_STEPS = 300
_MAX_STEP = 0.3  # largest component of a step, over the size of the model or in radians
_CONVERGED = 1e-9  # correction over the size of the model below which Newton's method may stop
_ROUND_OFF_SIZE = 1e-13  # correction or gap over the size of the model that is round-off
_NEWTON_STEP = 1e-2  # size of a step below which the next ones are those of Newton's method
_WORK_ROUND_OFF = 1e-6  # size of a step below which its work is round-off
_GROWTH, _CUT = 4.0, 0.1  # factors of β after a good and after a rejected step
# Largest β over its first value (Newton's method; finite, so that free motions stay bounded);
# least.
_NEWTON, _LEAST = 1e7, 1e-12
_MAX_BETA = 1e15  # largest β [s²]: a slower motion counts as rest
_MAX_CORRECTIONS = 4  # corrections of joint gaps after a step
_REGULARISATION, _REFINEMENTS = 1e-10, 2  # of scaled rows; refinements that remove its effect
_MAX_TRAVEL = 20.0  # displacement over the size of the model at which there is no equilibrium


def spin_of(model: Model) -> Array:
    """(3,) angular velocity of the whole machine in its equilibrium [rad/s]; zero: at rest."""
    return np.array((0.0, 0.0, 0.0) if model.statics is None else model.statics.spin)


@one_blas_thread()
def solve_equilibrium(
    compiled: Compiled,
    model: Model,
    state: State,
    *,
    descend: bool = True,
    spin: Array | None = None,
) -> int:
    """Bring an assembled state into equilibrium, in place; returns the number of steps.

    Without `descend` only Newton's method is used, which finds unstable equilibria as well. With
    `spin` (3,) [rad/s] the machine rotates about an axis through the origin of the ground.

    Raises
    ------
    AssemblyError
        No equilibrium.
    """
    return _Descent(compiled, model, state, spin).run(descend)


class _Descent:
    """The iteration of one state to its equilibrium."""

    def __init__(
        self, compiled: Compiled, model: Model, state: State, spin: Array | None = None
    ) -> None:
        self.compiled, self.model, self.state = compiled, model, state
        self.spin = spin if spin is not None and np.any(spin) else None
        self.scales = column_scales(compiled)
        starts = np.array([start.iv for start in compiled.starts], int)
        self.rates = np.zeros(len(self.scales), bool)
        self.rates[starts] = True
        self.moving = (self.scales > 0.0) & ~self.rates
        self.unknown = np.flatnonzero(self.moving | self.rates)
        self.size = np.where(self.scales > 0.0, self.scales, 1.0)
        acceleration = np.abs(state.vd[self.moving] / self.size[self.moving]).max(initial=0.0)
        if self.spin is not None:
            acceleration = max(acceleration, float(self.spin @ self.spin))
        state.v[self.moving] = 0.0
        state.vd[:] = 0.0
        self._turn()
        self.equations = StateEquations(compiled, state)
        at_rest = acceleration <= self._round_off()
        self.first = _MAX_STEP / (1.0 if at_rest else float(acceleration))
        self.newton = _NEWTON * self.first  # β of Newton's method
        self.travel = np.zeros_like(self.scales)

    def _round_off(self) -> float:
        """Acceleration (as `first` takes it) by stiffness where the pose is off by round-off."""
        T = self.equations.tangents()
        stiffness, mass = (np.abs(np.diag(X))[self.moving] for X in (T.K, T.M))
        return _ROUND_OFF_SIZE * float((stiffness[mass > 0.0] / mass[mass > 0.0]).max(initial=0.0))

    def run(self, descend: bool) -> int:
        """Steps until the equilibrium is reached."""
        beta = self.first if descend else self.newton
        cautious, last, newton = self.first, np.inf, True
        weights = self.compiled.system.row_weights
        for n in range(_MAX_STEPS):
            self._forget()
            T, F0 = self._equations()
            step, lam = self._step(T, F0, np.array(self.equations.work.con.C), beta)
            longest = self._length(step)
            if not np.isfinite(longest):  # inertia is lost in the round-off of stiffness
                self.newton = beta = _CUT * beta
                continue
            share = min(1.0, _MAX_STEP / longest) if longest > 0.0 else 1.0
            before = F0 + T.L @ lam
            q, v = self.state.q.copy(), self.state.v.copy()
            self._move(share * step)
            self.state.lam[:] = lam
            by_newton = longest <= _CONVERGED and beta >= self.newton
            if by_newton and (longest <= _ROUND_OFF_SIZE or longest > 0.3 * last):
                self._finish()  # within round-off
                return n + 1
            after = self._close(weights)
            work = 0.5 * share * float((before + after)[self.moving] @ step[self.moving])
            if descend and work > 0.0 and longest > _WORK_ROUND_OFF:
                self.state.q[:], self.state.v[:] = q, v
                newton = False
                beta = min(_CUT * beta, cautious)
                cautious = beta
                if beta < _LEAST * self.first:
                    break
                continue
            self.travel += share * step
            newton = newton or longest > _NEWTON_STEP
            if share == 1.0:
                if longest <= _NEWTON_STEP and (newton or longest <= _WORK_ROUND_OFF):
                    beta = self.newton
                else:
                    beta = cautious = min(_GROWTH * beta, self.newton)
            last = longest
            if self._length(self.travel) > _MAX_TRAVEL:
                raise AssemblyError(self._what_grows(before))
        raise AssemblyError(self._what_grows(self._equations()[1] + T.L @ self.state.lam))

    def _length(self, step: Array) -> float:
        """Largest component of a displacement (nv,), over the size of the model or in radians."""
        return float(np.abs(step[self.moving] / self.size[self.moving]).max(initial=0.0))

    def _close(self, weights: Array) -> Array:
        """Close the joints with the factor of the step; returns F at the new positions."""
        force = self.equations.residual()
        for _ in range(_MAX_CORRECTIONS):
            gap = weights * self.equations.work.con.C
            if np.abs(gap).max(initial=0.0) <= _ROUND_OFF_SIZE:
                break
            right = np.concatenate([np.zeros(len(self.unknown)), -gap])
            x = scipy.linalg.lu_solve(self.factor, right, check_finite=False)
            step = np.zeros(len(self.size))
            step[self.unknown] = self.size[self.unknown] * x[: len(self.unknown)]
            if not self._length(step) <= _MAX_STEP:
                break
            self._move(step)
            force = self.equations.residual()
        return force

    def _forget(self) -> None:
        """Unload friction bristles at the present positions."""
        if self.compiled.system.history:
            work = new_work(self.compiled.system)
            solve_stage(self.compiled.system, self.state, work, REMEMBER)

    def _equations(self) -> tuple[Tangents, Array]:
        """Derivatives, and F without multipliers."""
        T = self.equations.tangents()
        F = np.array(self.equations.work.trial.res)
        if self.spin is not None:
            T = T._replace(K=T.K + self._centrifugal(T))
        return T, F - T.L @ self.state.lam

    def _step(self, T: Tangents, F0: Array, gap: Array, beta: float) -> tuple[Array, Array]:
        """δ (nv,) and the multipliers of one step."""
        at, size, weights = self.unknown, self.size, self.compiled.system.row_weights
        beta = min(beta, _MAX_BETA)
        K = T.K[np.ix_(at, at)] + T.M[np.ix_(at, at)] / beta
        rates = self.rates[at]
        if rates.any():  # for a scalar state the unknown is its rate
            K[:, rates] = T.D[np.ix_(at, at[rates])] + T.M[np.ix_(at, at[rates])] / beta
        K = size[at, None] * K * size[at]
        A = weights[:, None] * T.Cq[:, at] * size[at]
        L = size[at, None] * T.L[at] * weights
        unit = max(float(np.abs(values).max(initial=0.0)) for values in (np.diag(K), size * F0))
        unit = unit or 1.0
        n, m = len(at), len(A)
        whole = np.zeros((n + m, n + m))
        whole[:n, :n], whole[:n, n:], whole[n:, :n] = K / unit, L, A
        whole[n:, n:] = -_REGULARISATION * np.eye(m)
        right = np.concatenate([-size[at] * F0[at] / unit, -weights * gap])
        try:
            self.factor = factor = scipy.linalg.lu_factor(whole, check_finite=False)
            whole[n:, n:] = 0.0
            x = scipy.linalg.lu_solve(factor, right, check_finite=False)
            for _ in range(_REFINEMENTS):
                x += scipy.linalg.lu_solve(factor, right - whole @ x, check_finite=False)
        except (np.linalg.LinAlgError, scipy.linalg.LinAlgWarning):
            x = np.full(n + m, np.nan)
        step = np.zeros(len(size))
        step[at] = size[at] * x[:n]
        return step, weights * x[n:] * unit

    def _move(self, step: Array) -> None:
        self.state.q[:] = self.equations.moved(self.state.q, np.where(self.moving, step, 0.0))
        self.state.v[self.rates] += step[self.rates]
        self._turn()

    def _turn(self) -> None:
        """Set velocities and accelerations to those of the steady rotation."""
        if self.spin is None:
            return
        for body, A in zip(
            self.compiled.layout.bodies, body_axes(self.compiled, self.state.q), strict=True
        ):
            place, turn = slice(body.iv, body.iv + 3), slice(body.iv + 3, body.iv + 6)
            r = self.state.q[body.iq : body.iq + 3] + self.compiled.layout.origin
            self.state.v[place] = np.cross(self.spin, r)
            self.state.v[turn] = A.T @ self.spin
            self.state.vd[place] = np.cross(self.spin, self.state.v[place])

    def _centrifugal(self, T: Tangents) -> Array:
        """D ∂v/∂q + M ∂v̇/∂q (nv, nv) of the rotation."""
        assert self.spin is not None
        K, W = np.zeros_like(T.K), skew(self.spin)
        for body in self.compiled.layout.bodies:
            place, turn = slice(body.iv, body.iv + 3), slice(body.iv + 3, body.iv + 6)
            K[:, place] = T.D[:, place] @ W + T.M[:, place] @ W @ W
            K[:, turn] = T.D[:, turn] @ skew(self.state.v[turn])
        return K

    def _finish(self) -> None:
        """Set the history, joint angles and powers of a state at rest."""
        state, work = self.state, new_work(self.compiled.system)
        lam = state.lam.copy()
        solve_stage(self.compiled.system, state, work, REMEMBER)
        solve_stage(self.compiled.system, state, work, BEGIN)
        state.lam[:], state.lam_before[:] = lam, lam
        state.aa[:] = state.vd_before[:] = state.vd[:] = 0.0
        self._turn()
        state.aa[:] = state.vd_before[:] = state.vd

    def _what_grows(self, force: Array) -> str:
        """The sentence on the body that keeps moving."""
        say, layout = self.model.units.say, self.compiled.layout
        far = np.abs(self.travel / self.size) * self.moving
        body = max(layout.bodies, key=lambda b: far[b.iv : b.iv + 6 + b.m].max())
        own = far[body.iv : body.iv + 6 + body.m]
        k = int(own.argmax())
        name = f"bodies.{body.name}"
        direction = self.travel / max(float(np.abs(self.travel).max()), 1e-300)
        along = self.travel[body.iv + k]
        pushing = -float(force[self.moving] @ direction[self.moving]) / max(
            abs(direction[body.iv + k]), 1e-300
        )
        if k < 3:  # noqa: PLR2004
            way = f"{'+' if along > 0 else '-'}{'xyz'[k]}"
            what = f"moves on along {way} under a force of {say(abs(pushing), 'N', 3)}"
        elif k < 6:  # noqa: PLR2004
            what = f"turns on about its {'xyz'[k - 3]} axis, moment {say(abs(pushing), 'N m', 3)}"
        else:
            what = f"deforms on in its modal coordinate {k - 6}"
        distance = float(own.max())
        return (
            f"no equilibrium was reached: {name} {what}, by {distance:.3g} times the model's size "
            "(or radians) so far; hold it by a joint, a spring or a driver, or begin nearer to the "
            "equilibrium"
        )
