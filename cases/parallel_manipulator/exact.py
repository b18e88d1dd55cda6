"""The platform's motion, and the forces in legs without mass by Newton's and Euler's equations."""

import numpy as np

W, MASS, G = 2 * np.pi / 4, 40.0, 9.80665
INERTIA = np.diag([4.0, 4.0, 8.0])
CORNERS = 2 * np.pi * (np.arange(6) // 2) / 3
SIGNS = (-1.0) ** np.arange(6)


def ring(radius, angles):
    return radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)


FEET, HEADS = ring(1.1, CORNERS + 0.25 * SIGNS), ring(0.6, CORNERS + 0.8 * SIGNS)


def angles(t):
    """Yaw about z, then tilt about the turned x."""
    return 0.25 * np.sin(W * t), 0.2 * (1 - np.cos(W * t))


def pose(t):
    """Place and direction cosines."""
    yaw, tilt = angles(t)
    c, s, C, S = np.cos(yaw), np.sin(yaw), np.cos(tilt), np.sin(tilt)
    A = np.array([[c, -s * C, s * S], [s, c * C, -c * S], [0, S, C]])
    return np.array([0.12 * np.sin(W * t), 0, 1.2 + 0.1 * (1 - np.cos(W * t))]), A


def leg_forces(t):
    """Push of each leg: balance of forces and of moments about the centre of mass."""
    h = 2e-3
    p, A = zip(*(pose(t + k * h) for k in range(-2, 3)), strict=True)
    first, second = (
        np.array([1, -8, 0, 8, -1]) / (12 * h),
        np.array([-1, 16, -30, 16, -1]) / (12 * h * h),
    )
    acceleration = np.tensordot(second, p, 1)
    rate, bend = np.tensordot(first, A, 1), np.tensordot(second, A, 1)

    def axial(S):
        return np.array([S[2, 1] - S[1, 2], S[0, 2] - S[2, 0], S[1, 0] - S[0, 1]]) / 2

    spin = axial(rate @ A[2].T)
    turn = axial(bend @ A[2].T + rate @ rate.T)
    J = A[2] @ INERTIA @ A[2].T
    heads = HEADS @ A[2].T
    legs = p[2] + heads - FEET
    legs /= np.linalg.norm(legs, axis=1)[:, None]
    balance = np.vstack([legs.T, np.cross(heads, legs).T])
    load = [*(MASS * (acceleration + [0, 0, G])), *(J @ turn + np.cross(spin, J @ spin))]
    return np.linalg.solve(balance, load)


def values():
    """Rows (scene, sensor, time, value) for the checks."""
    for t in (0.5, 1.0, 2.2, 3.0):
        p, _ = pose(t)
        for scene in ("scene.toml", "platform.toml"):
            yield scene, "platform.x", t, p[0]
            yield scene, "platform.z", t, p[2]
            yield scene, "attitude.alpha", t, angles(t)[0]
            yield scene, "attitude.beta", t, angles(t)[1]
        push = leg_forces(t)
        yield "platform.toml", "push0", t, push[0]
        yield "platform.toml", "push3", t, push[3]


if __name__ == "__main__":
    for scene, sensor, time, value in values():
        print(f"{scene} {sensor} {time:.12g} {value:.15g}")
