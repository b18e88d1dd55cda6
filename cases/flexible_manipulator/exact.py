"""The flexible manipulator in minimal coordinates: the source of the scene's checks.

Each link is an inextensible bar, clamped to its turning hub: its deflection is a sum of three
polynomials x^2 .. x^4, its points come nearer by half the integral of the slope squared. Lagrange's
equations from the positions x(q, t) of mass points: (J' m J) q" = -J' m b - K q, b what remains of
x" without q".
"""

import numpy as np
from scipy.integrate import solve_ivp

LENGTH, PAYLOAD, J_PAYLOAD, ELBOW, TIME = 0.8, 1.5, 2e-3, 1.0, 1.0
J_ELBOW = ELBOW * 0.035**2 / 2
YOUNG, DENSITY = 70e9, 2700.0
SECTIONS = ((0.020, 0.040), (0.016, 0.030))  # thickness in the plane, width
N = 3  # shapes of each link
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
S = (NODES + 1) / 2
POWERS = np.arange(2, N + 2)


def shapes(s, derivative=0):
    """Polynomials of s = x/LENGTH, or a derivative by x, (points, N)."""
    s = np.atleast_1d(s)[:, None]
    factor = np.ones(N)
    for k in range(derivative):
        factor = factor * (POWERS - k)
    return factor * s ** (POWERS - derivative) / LENGTH**derivative


# half of the integral of products of slopes up to each point
P = POWERS[:, None] + POWERS - 1
SHORTER = np.array([
    POWERS[:, None] * POWERS * s**P / P / (2 * LENGTH) for s in [*S, 1.0]
])  # fmt: skip
STIFFNESS = np.zeros((2 * N, 2 * N))
for k, (h, b) in enumerate(SECTIONS):
    bent = shapes(S, 2)
    STIFFNESS[k * N : (k + 1) * N, k * N : (k + 1) * N] = (
        YOUNG * b * h**3 / 12 * bent.T @ (bent * (WEIGHTS * LENGTH / 2)[:, None])
    )
LINKS = [DENSITY * h * b * LENGTH * WEIGHTS / 2 for h, b in SECTIONS]
MASS = np.concatenate([
    np.repeat(LINKS[0], 2), np.repeat(LINKS[1], 2), [ELBOW, ELBOW, PAYLOAD, PAYLOAD],
    [J_ELBOW, J_ELBOW, J_PAYLOAD, J_PAYLOAD],
])  # fmt: skip


def cycloid(t, end):
    s = np.clip(t / TIME, 0, 1)
    return end * (s - np.sin(2 * np.pi * s) / (2 * np.pi))


def link(origin, angle, q):
    """Points along a link, its end, and the direction of its end, at k states."""
    shorter = np.einsum("xij,ki,kj->kx", SHORTER, q, q)
    x, w = np.append(S, 1.0) * LENGTH - shorter, q @ shapes(np.append(S, 1.0)).T
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    points = origin[:, None] + np.stack([c * x - s * w, s * x + c * w], axis=-1)
    slope = q @ shapes(1.0, 1)[0]
    return points[:, :-1], points[:, -1], angle + slope + slope**3 / 6  # of arc length: arcsin


def positions(q, t):
    """Mass points, elbow, payload, and unit vectors that turn with elbow and payload."""
    shoulder = cycloid(t, np.radians(60))
    first, elbow, turned = link(np.zeros((len(q), 2)), shoulder, q[:, :N])
    second, payload, end = link(elbow, turned + cycloid(t, np.radians(90)), q[:, N:])
    units = [np.cos(turned), np.sin(turned), np.cos(end), np.sin(end)]
    flat = [points.reshape(len(q), -1) for points in (first, second)]
    return np.hstack([*flat, elbow, payload, np.stack(units, axis=1)])


def right_side(t, y):
    """q' and q": the Jacobian by complex steps, the rest of x" by differences of order four."""
    n = 2 * N
    q, v, h = y[:n], y[n:], 2e-4
    J = positions(q + 1e-30j * np.eye(n), np.full(n, t)).imag.T / 1e-30
    s = h * np.arange(-2, 3)
    bias = np.array([-1, 16, -30, 16, -1]) @ positions(q + np.outer(s, v), t + s) / (12 * h * h)
    a = np.linalg.solve(J.T @ (MASS[:, None] * J), -J.T @ (MASS * bias) - STIFFNESS @ q)
    return np.append(v, a)


def values():
    """Rows (sensor, time, value) for the checks."""
    times = [0.25, 0.5, 0.75, 1.0, 1.3, 1.6, 2.0]
    run = solve_ivp(
        right_side,
        (0, 2.0),
        np.zeros(4 * N),
        "DOP853",
        times,
        rtol=1e-6,
        atol=np.repeat([1e-8, 1e-5], 2 * N),
    )
    for t, q in zip(times, run.y[: 2 * N].T, strict=True):
        x, y = positions(q[None], np.array([t]))[0, -6:-4]
        yield "payload.x", t, x
        yield "payload.y", t, y


if __name__ == "__main__":
    for sensor, time, value in values():
        print(f"{sensor} {time:.12g} {value:.12g}")
