"""The flexible four-bar in minimal coordinates: the source of the scene's checks.

Crank angle prescribed, coupler inextensible with sine modes between its pins, its chord shorter by
half the integral of the slope squared: second order, so geometric stiffening by all loads is in it.
Lagrange's equations from the positions x(q, t) of mass points (Gauss points along the coupler, the
rocker by its moment of inertia): (J' m J) q" = -J' m b - K q, b what remains of x" without q".
"""

import numpy as np
from scipy.integrate import solve_ivp

CRANK, COUPLER, ROCKER, GROUND = 0.10, 0.40, 0.30, 0.40
HEIGHT, WIDTH, YOUNG, DENSITY = 0.003, 0.02, 70e9, 2700.0
J_ROCKER = 0.15 * ROCKER**2 / 3
SPEED = 45.0
START, TURN = 4 * np.pi / SPEED, 2 * np.pi / SPEED

N = 5  # sine modes
K = np.arange(1, N + 1) * np.pi / COUPLER
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
X = COUPLER * (NODES + 1) / 2  # points along the coupler, from B
MASS = np.repeat(DENSITY * HEIGHT * WIDTH * COUPLER * WEIGHTS / 2, 2)
MASS = np.append(MASS, [J_ROCKER / ROCKER**2] * 2)
STIFFNESS = YOUNG * WIDTH * HEIGHT**3 / 12 * K**4 * COUPLER / 2
SINES = np.sin(np.outer(X, K))
# half of the integrals of cos(k x) cos(l x) from 0 to x: what the bent strip is shorter up to x
SUM, DIFFERENCE = K[:, None] + K, K[:, None] - K
SHORTER = np.array([
    K[:, None] * K / 4 * (np.sin(SUM * x) / SUM + x * np.sinc(DIFFERENCE * x / np.pi))
    for x in [*X, COUPLER]
])  # fmt: skip


def crank_angle(t):
    """Integral of the 3-4-5 polynomial of the speed, then constant speed."""
    s = np.minimum(t / START, 1.0)
    return SPEED * (START * (2.5 * s**4 - 3 * s**5 + s**6) + np.maximum(t - START, 0.0))


def positions(q, t):
    """Coupler points and B in the plane, (k, 2 n + 2), at k states q (k, N) and times t (k,)."""
    shorter = np.einsum("xkl,sk,sl->sx", SHORTER, q, q)
    chord = COUPLER - shorter[:, -1:]
    a = crank_angle(t)[:, None]
    A = np.hstack([GROUND + CRANK * np.cos(a), CRANK * np.sin(a)])
    d2 = np.sum(A * A, axis=1, keepdims=True)  # D is the origin; B from the triangle D, A, B
    along = (ROCKER**2 + d2 - chord**2) / (2 * d2)
    B = along * A + np.sqrt(ROCKER**2 / d2 - along**2) * A[:, ::-1] * [-1, 1]
    ex = (A - B) / chord
    ey = ex[:, ::-1] * [-1, 1]
    bent = (X - shorter[:, :-1])[..., None] * ex[:, None] + (q @ SINES.T)[..., None] * ey[:, None]
    return np.hstack([(B[:, None] + bent).reshape(len(q), -1), B])


def right_side(t, y):
    """q' and q": the Jacobian by complex steps, the rest of x" by differences of order four."""
    q, v, h = y[:N], y[N:], 1e-3 / SPEED
    J = positions(q + 1e-30j * np.eye(N), np.full(N, t)).imag.T / 1e-30
    s = h * np.arange(-2, 3)
    bias = np.array([-1, 16, -30, 16, -1]) @ positions(q + np.outer(s, v), t + s) / (12 * h * h)
    a = np.linalg.solve(J.T @ (MASS[:, None] * J), -J.T @ (MASS * bias) - STIFFNESS * q)
    return np.append(v, a)


def values():
    """Rows (scene, sensor, time, value) for the checks."""
    times = [START, *(START + np.array([0.25, 0.5, 1.0, 1.5, 2.0]) * TURN)]
    run = solve_ivp(
        right_side,
        (0, times[-1]),
        np.zeros(2 * N),
        "DOP853",
        times,
        rtol=1e-6,
        atol=np.repeat([1e-9, 1e-6], N),
    )
    for t, q in zip(times, run.y[:N].T, strict=True):
        yield "scene.toml", "bow", t, float(np.sin(K * COUPLER / 2) @ q)
        yield "scene.toml", "B.y", t, float(positions(q[None], np.array([t]))[0, -1])


if __name__ == "__main__":
    for scene, sensor, time, value in values():
        print(f"{scene} {sensor} {time:.12g} {value:.15g}")
