"""The slider on the rod: least potential energy, and the load of its bearing."""

import numpy as np
from scipy.optimize import minimize

L, M, MS, K_WALL, K_ROD, G = 1.0, 4.0, 3.0, 900.0, 400.0, 9.80665
WALL, FREE_WALL, FREE_ROD = np.array([0.0, 1.0]), 0.6, 0.5
PLACED = np.radians(20.0)


def energy(x):
    """Of the angle from the horizontal and the place along the rod."""
    end = L * np.array([np.cos(x[0]), np.sin(x[0])])
    wall, rod = np.hypot(*(end - WALL)) - FREE_WALL, x[1] - FREE_ROD
    weight = G * np.sin(x[0]) * (M * L / 2 + MS * x[1])
    return K_WALL * wall**2 / 2 + K_ROD * rod**2 / 2 + weight


def gradient(x):
    end = L * np.array([np.cos(x[0]), np.sin(x[0])])
    d = end - WALL
    pull = K_WALL * (np.hypot(*d) - FREE_WALL) * d / np.hypot(*d)
    turn = pull @ (L * np.array([-np.sin(x[0]), np.cos(x[0])]))
    return np.array([
        turn + G * np.cos(x[0]) * (M * L / 2 + MS * x[1]),
        K_ROD * (x[1] - FREE_ROD) + MS * G * np.sin(x[0]),
    ])  # fmt: skip


def values():
    """Rows (scene, sensor, time, value) for the checks."""
    x = minimize(energy, [PLACED, 0.5], jac=gradient, method="BFGS", options={"gtol": 1e-9}).x
    for _ in range(4):  # Newton's steps to round-off
        H = np.array([gradient(x + 1e-6 * e) - gradient(x - 1e-6 * e) for e in np.eye(2)]) / 2e-6
        x = x - np.linalg.solve(H, gradient(x))
    assert np.linalg.eigvalsh((H + H.T) / 2).min() > 0  # stable
    d = L * np.array([np.cos(x[0]), np.sin(x[0])]) - WALL
    pull = -K_WALL * (np.hypot(*d) - FREE_WALL) * d / np.hypot(*d)  # on the rod
    carried = -pull - [0, -(M + MS) * G]
    for scene, t in (("scene.toml", 0.0), ("settling.toml", 12.0)):
        yield scene, "rod", t, x[0]
        yield scene, "slider", t, x[1]
        yield scene, "bearing.x", t, carried[0]
        yield scene, "bearing.y", t, carried[1]


if __name__ == "__main__":
    for scene, sensor, time, value in values():
        print(f"{scene} {sensor} {time:.12g} {value:.12g}")
