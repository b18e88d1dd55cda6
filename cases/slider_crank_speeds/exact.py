"""The slider-crank with a bending rod in minimal coordinates, at three speeds.

Crank prescribed, rod inextensible with sine modes between its pins, its chord shorter by half the
integral of the slope squared. (J' m J) q" = -J' m b - K q, positions x(q, t) of mass points, J by
complex steps, b what remains of x" without q" by differences of order four.
"""

import numpy as np
from scipy.integrate import solve_ivp

CRANK, ROD, HEIGHT, YOUNG, DENSITY, SLIDER = 0.15, 0.30, 0.008, 210e9, 7850.0, 0.05
SPEEDS = {"slow.toml": 50.0, "medium.toml": 200.0, "scene.toml": 300.0}
N = 4
K = np.arange(1, N + 1) * np.pi / ROD
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
X = ROD * (NODES + 1) / 2
MASS = np.append(np.repeat(DENSITY * HEIGHT**2 * ROD * WEIGHTS / 2, 2), SLIDER)
STIFFNESS = YOUNG * HEIGHT**4 / 12 * K**4 * ROD / 2
SUM, DIFFERENCE = K[:, None] + K, K[:, None] - K


def shorter_by(x):
    """Half of the integrals of cos(k x) cos(l x) from 0 to x."""
    return K[:, None] * K / 4 * (np.sin(SUM * x) / SUM + x * np.sinc(DIFFERENCE * x / np.pi))


SHORTER = np.array([shorter_by(x) for x in [*X, ROD]])


def crank_angle(t, speed):
    """Integral of the 3-4-5 polynomial of the speed within two periods, then constant speed."""
    start = 4 * np.pi / speed
    s = np.minimum(t / start, 1.0)
    return speed * (start * (2.5 * s**4 - 3 * s**5 + s**6) + np.maximum(t - start, 0.0))


def frame(q, t, speed):
    """Pin, unit vectors along and across the rod, slider; what rod points are nearer."""
    shorter = np.einsum("xkl,sk,sl->sx", SHORTER, q, q)
    a = crank_angle(t, speed)[:, None]
    pin = CRANK * np.hstack([np.cos(a), np.sin(a)])
    chord = ROD - shorter[:, -1:]
    x = pin[:, :1] + np.sqrt(chord**2 - pin[:, 1:] ** 2)
    ex = (np.hstack([x, 0 * x]) - pin) / chord
    return pin, ex, ex[:, ::-1] * [-1, 1], x, shorter


def positions(q, t, speed):
    pin, ex, ey, x, shorter = frame(q, t, speed)
    bent = (X - shorter[:, :-1])[..., None] * ex[:, None]
    bent = bent + (q @ np.sin(np.outer(K, X)))[..., None] * ey[:, None]
    return np.hstack([(pin[:, None] + bent).reshape(len(q), -1), x])


def middle(q, t, speed):
    """Place of the middle of the rod."""
    pin, ex, ey, _, _ = frame(q, t, speed)
    near = np.einsum("kl,sk,sl->s", shorter_by(ROD / 2), q, q)[:, None]
    return pin + (ROD / 2 - near) * ex + (q @ np.sin(K * ROD / 2))[:, None] * ey


def right_side(t, y, speed):
    q, v, h = y[:N], y[N:], 1e-3 / speed
    J = positions(q + 1e-30j * np.eye(N), np.full(N, t), speed).imag.T / 1e-30
    s = h * np.arange(-2, 3)
    x = positions(q + np.outer(s, v), t + s, speed)
    bias = np.array([-1, 16, -30, 16, -1]) @ x / (12 * h * h)
    a = np.linalg.solve(J.T @ (MASS[:, None] * J), -J.T @ (MASS * bias) - STIFFNESS * q)
    return np.append(v, a)


def motion(speed, times):
    atol = np.repeat([1e-9, 1e-6], N)
    span = (0, times[-1])
    run = solve_ivp(
        right_side, span, np.zeros(2 * N), "DOP853", times, args=(speed,), rtol=1e-6, atol=atol
    )
    return run.y[:N].T


def rigid_share(speed):
    """Largest distance of a rigid rod's middle from it in the last turn, over its range in x."""
    times = 2 * np.pi / speed * (2 + np.linspace(0, 1, 101))
    bent = middle(motion(speed, times), times, speed)
    straight = middle(np.zeros((len(times), N)), times, speed)
    return float(np.abs(bent - straight).max() / np.ptp(bent[:, 0]))


def values():
    """Rows (scene, sensor, time, value) for the checks."""
    for scene, speed in SPEEDS.items():
        times = 2 * np.pi / speed * np.array([2.0, 2.3, 2.6, 3.0])
        q = motion(speed, times)
        for t, (x, y), s in zip(
            times, middle(q, times, speed), positions(q, times, speed)[:, -1], strict=True
        ):
            yield scene, "middle.x", t, x
            yield scene, "middle.y", t, y
            yield scene, "slider.x", t, s


if __name__ == "__main__":
    for scene, sensor, time, value in values():
        print(f"{scene} {sensor} {time:.12g} {value:.12g}")
