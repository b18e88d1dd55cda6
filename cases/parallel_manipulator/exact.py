"""The platform's motion, and the forces in legs without mass by Newton's and Euler's equations.

For assemblies.toml the poses that have the leg lengths of t = 1 s, by Newton's method on the closed
form of inverse kinematics from four starts (the scene rounds to nine digits); for singular.toml the
forces of a level platform that turns, by the balance whose determinant is zero at a yaw of 90
degrees.
"""

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


def turned(yaw, tilt, roll):
    """Direction cosines Rz Rx Ry."""
    (c, C, k), (s, S, n) = np.cos([yaw, tilt, roll]), np.sin([yaw, tilt, roll])
    about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return about_z @ [[1, 0, 0], [0, C, -S], [0, S, C]] @ [[k, 0, n], [0, 1, 0], [-n, 0, k]]


def leg_lines(p, A):
    """Lengths of the legs (inverse kinematics) and the six Plücker coordinates of their lines."""
    heads = HEADS @ A.T
    legs = p + heads - FEET
    lengths = np.linalg.norm(legs, axis=1)
    units = legs / lengths[:, None]
    return lengths, np.hstack([units, np.cross(heads, units)])


STARTS = (  # place and angles of Rz Rx Ry of four of the assemblies above the base
    (0.12, 0, 1.3, 0.25, 0.2, 0),
    (0.0, 0.46, 0.99, -0.42, 1.13, 1.27),
    (-0.36, -0.38, 0.88, 1.7, -0.94, 1.77),
    (0.53, -0.42, 0.79, 0.68, 0.14, -1.62),
)


def assembly(start, wanted):
    """Place and angles that have the wanted leg lengths, near a start."""
    x = np.array(start, float)
    for _ in range(30):
        gap = leg_lines(x[:3], turned(*x[3:]))[0] - wanted
        slopes = np.empty((6, 6))
        for k in range(6):
            d = 1e-30j * np.eye(6)[k]
            heads = HEADS @ turned(*(x[3:] + d[3:])).T
            legs = x[:3] + d[:3] + heads - FEET
            slopes[:, k] = np.sqrt((legs**2).sum(axis=1)).imag / 1e-30
        x = x - np.linalg.solve(slopes, gap)
    return x


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
    wanted = leg_lines(*pose(1.0))[0]
    for n, start in enumerate(STARTS):
        x = assembly(start, wanted)
        assert np.abs(leg_lines(x[:3], turned(*x[3:]))[0] - wanted).max() < 1e-14
        for sensor, value in zip(("x", "y", "z"), x[:3] + [3 * n, 0, 0], strict=True):
            yield "assemblies.toml", f"place{n}.{sensor}", 0, value
        for sensor, value in zip(("alpha", "beta", "gamma"), x[3:], strict=True):
            yield "assemblies.toml", f"turn{n}.{sensor}", 0, value
    for t in (0.4, 0.8, 1.04):
        lines = leg_lines(np.array([0, 0, 1.2]), turned(np.pi / 2 * t, 0, 0))[1]
        push = np.linalg.solve(lines.T, [0, 0, MASS * G, 0, 0, 0])
        yield "singular.toml", "attitude.alpha", t, np.pi / 2 * t
        yield "singular.toml", "push0", t, push[0]


if __name__ == "__main__":
    for scene, sensor, time, value in values():
        print(f"{scene} {sensor} {time:.12g} {value:.15g}")
