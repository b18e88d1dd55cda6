"""Equations of motion written once more, without flexmb: what the scenes are judged by.

Linkages in a plane by the angles of their links and the lengths of their slides, trees of bodies on
ball joints by their angular velocities, and one-freedom machines by energy; integrated by SciPy's
DOP853 with tolerances of 1e-13.
"""

from __future__ import annotations

from contextlib import contextmanager
from functools import cache, wraps

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg.lapack import dgesv

_KNOBS = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-16}
_EVALUATIONS = [0]


def integrated(rate, first, t, **knobs):
    """y (n, len(t)) of y' = rate(t, y), from t[0] on, as accurate as SciPy can."""
    found = solve_ivp(rate, (t[0], t[-1]), first, t_eval=t, **{**_KNOBS, **knobs})
    assert found.success, found.message
    _EVALUATIONS[0] += found.nfev
    return found.y


def found_once(truth):
    """`truth(t)`, a table or channels by name, found once for the same times.

    Many runs are judged by it, of other methods and accuracies.
    """
    known = {}

    def fixed(values):
        values = np.array(values)
        values.flags.writeable = False
        return values

    @wraps(truth)
    def values(t):
        key = np.asarray(t, float).tobytes()
        if key not in known:
            found = truth(t)
            by_name = isinstance(found, dict)
            known[key] = {c: fixed(v) for c, v in found.items()} if by_name else fixed(found)
        return known[key].copy() if isinstance(known[key], dict) else known[key]

    return values


@contextmanager
def counted(tolerance):
    """Solve with this relative tolerance for a while; the list holds the evaluations since."""
    before = _KNOBS.copy()
    _KNOBS.update(rtol=tolerance, atol=1e-3 * tolerance)
    _EVALUATIONS[0] = 0
    try:
        yield _EVALUATIONS
    finally:
        _KNOBS.update(before)


class Linkage:
    """Bodies in a plane, complex places of their centres z = z₀ + A exp(iφ) + B x.

    Coordinates are the angles φ of n bodies from the x axis and the lengths x of p slides. Loops
    close where c + C exp(iφ) + D x = 0.

    Parameters
    ----------
    mass, inertia : (k,) and (n,)
        Of the centres [kg], and about them for each angle [kg m²].
    arms, slides : (k, n) complex, (k, p) complex
        A and B.
    loops : list of (c, C (n,), D (p,))
        Complex.
    force : callable
        `force(t, y, rate)`: generalised forces (n + p,) beside the weight.
    """

    def __init__(self, mass, inertia, arms, slides=None, loops=(), gravity=0.0, force=None):
        self.mass, self.A = np.array(mass, float), np.array(arms, complex)
        k, n = self.A.shape
        self.B = np.zeros((k, 0)) if slides is None else np.array(slides, complex)
        self.J = np.concatenate([np.array(inertia, float), np.zeros(self.B.shape[1])])
        self.loops, self.gravity, self.n = loops, gravity, n
        self.force = force or (lambda t, y, rate: np.zeros(len(self.J)))
        self.c = np.array([loop[0] for loop in loops], complex)
        self.C = np.array([loop[1] for loop in loops], complex).reshape(len(loops), n)
        D = [loop[2] for loop in loops] if self.B.shape[1] else np.zeros((len(loops), 0))
        self.D = np.array(D, complex).reshape(len(loops), self.B.shape[1])

    def closed(self, y, fixed):
        """Coordinates on the loops, those of the indices `fixed` as they are."""
        if not len(self.c):
            return y
        y, free = y.copy(), _others(len(y), tuple(fixed))
        for _ in range(20):
            turn = np.exp(1j * y[: self.n])
            gap = _parts(self.c + self.C @ turn + self.D @ y[self.n :])
            step = _solution(_parts(self._slopes(turn))[:, free], gap)
            y[free] -= step
            if np.abs(step).max() < 1e-9:  # quadratic: the next one is round-off
                break
        return y

    def _slopes(self, turn):
        return np.concatenate([1j * self.C * turn, self.D], axis=1)

    def rates(self, y, rate, fixed):
        """Rates of all coordinates from those of the indices `fixed`."""
        rate, free = rate.copy(), _others(len(y), tuple(fixed))
        slopes = _parts(self._slopes(np.exp(1j * y[: self.n])))
        rate[free] = -_solution(slopes[:, free], slopes[:, fixed] @ rate[fixed])
        return rate

    def accelerations(self, t, y, rate):
        turn, square = np.exp(1j * y[: self.n]), rate[: self.n] ** 2
        slope = np.concatenate([1j * self.A * turn, self.B], axis=1)  # of the centres
        weighed = slope.conj().T * self.mass
        M = (weighed @ slope).real + np.diag(self.J)
        Q = (weighed @ (self.gravity + self.A @ (turn * square))).real + self.force(t, y, rate)
        if not len(self.c):
            return _solution(M, Q)
        held = _parts(self._slopes(turn))
        n, m = len(M), len(held)
        matrix = np.zeros((n + m, n + m))
        matrix[:n, :n], matrix[n:, :n], matrix[:n, n:] = M, held, held.T
        right = np.concatenate([Q, _parts(self.C @ (turn * square))])
        return _solution(matrix, right)[:n]

    def run(self, first, rate, fixed, t):
        """Coordinates (n + p, len(t)) from a pose and the rates of the free ones, `fixed`."""
        fixed = np.array(fixed)
        last = self.closed(np.array(first, float), fixed)
        whole = np.zeros(len(last))

        def spread(half):
            nonlocal last
            y = last.copy()
            y[fixed] = half[: len(fixed)]
            whole[fixed] = half[len(fixed) :]
            last = self.closed(y, fixed)
            return last, self.rates(last, whole, fixed) if len(self.c) else whole

        def slope(t, half):
            y, dy = spread(half)
            return np.concatenate([dy[fixed], self.accelerations(t, y, dy)[fixed]])

        begin = last.copy()
        found = integrated(slope, np.concatenate([begin[fixed], np.array(rate, float)]), t)
        last, rows = begin, []
        for half in found.T:
            rows.append(spread(half)[0].copy())
        return np.array(rows).T


def _solution(A, b):
    """x of A x = b, at a third of what `np.linalg.solve` takes where A is small."""
    _, _, x, info = dgesv(A, b)
    assert info == 0
    return x


@cache
def _others(count, some):
    """Indices below `count` that are not among some."""
    return np.setdiff1d(np.arange(count), some)


def _parts(rows):
    """Real and imaginary parts of complex rows, one below the other."""
    return np.concatenate([rows.real, rows.imag])


def rotation(p):
    """Direction cosines (..., 3, 3) of Euler parameters (..., 4), scalar first, of any length."""
    e0, e1, e2, e3 = np.moveaxis(p / np.linalg.norm(p, axis=-1, keepdims=True), -1, 0)
    return 2 * np.moveaxis(
        np.array([
            [e0 * e0 + e1 * e1 - 0.5, e1 * e2 - e0 * e3, e1 * e3 + e0 * e2],
            [e1 * e2 + e0 * e3, e0 * e0 + e2 * e2 - 0.5, e2 * e3 - e0 * e1],
            [e1 * e3 - e0 * e2, e2 * e3 + e0 * e1, e0 * e0 + e3 * e3 - 0.5],
        ]), (0, 1), (-2, -1),
    )  # fmt: skip


def _tilde(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def ball_chain(mass, center, inertia, end, gravity, p, omega, t):
    """Rotations (n, len(t), 3, 3) of bodies in a row on ball joints, the first one on ground.

    Unknown are the angular velocities in global axes. `center` and `end` (n, 3) are those of the
    body seen from its joint, in its axes; `inertia` (n, 3) principal, about the centre.
    """
    n = len(mass)

    def slope(_, y):
        p, w = y[: 4 * n].reshape(n, 4), y[4 * n :].reshape(n, 3)
        R = rotation(p)
        arms = [[R[j] @ (end[j] if j < k else center[j]) for j in range(k + 1)] for k in range(n)]
        M, Q = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
        for k in range(n):
            J = np.zeros((3, 3 * n))
            bias = np.zeros(3)
            for j, a in enumerate(arms[k]):
                J[:, 3 * j : 3 * j + 3] = -_tilde(a)
                bias += np.cross(w[j], np.cross(w[j], a))
            M += mass[k] * J.T @ J
            Q += mass[k] * J.T @ (np.asarray(gravity) - bias)
            about = R[k] @ np.diag(inertia[k]) @ R[k].T
            part = slice(3 * k, 3 * k + 3)
            M[part, part] += about
            Q[part] -= np.cross(w[k], about @ w[k])
        dp = [
            0.5 * np.concatenate([[-q[1:] @ u], q[0] * u + np.cross(u, q[1:])])
            for q, u in zip(p, w, strict=True)
        ]
        return np.concatenate([*dp, np.linalg.solve(M, Q)])

    first = np.concatenate([np.ravel(p), np.ravel(omega)]).astype(float)
    found = integrated(slope, first, t)[: 4 * n]
    return rotation(np.moveaxis(found.reshape(n, 4, -1), 1, 2))


def one_freedom(inertia, force, first, rate, t):
    """(x, rate) of ½ m(x) ẋ² with the generalised force Q(t, x, ẋ): m ẍ = Q − ½ m' ẋ².

    `inertia` takes complex numbers: its slope is a complex step, exact to round-off.
    """

    def slope(t, y):
        m = inertia(complex(y[0], 1e-30))
        return [y[1], (force(t, *y) - 0.5 * m.imag / 1e-30 * y[1] ** 2) / m.real]

    return integrated(slope, [first, rate], t)
