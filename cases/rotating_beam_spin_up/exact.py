"""Spin-up of a cantilever by Ritz' method, with and without geometric stiffening.

Kane, Ryan and Banerjee (1987), Journal of Guidance, Control, and Dynamics 10, 139: an elastic line
clamped to an axis that turns by a prescribed angle. Its bending is v = sum phi_i(x) q_i with
phi_i = (x/L)^(i+1); its ends come closer by the integral of v'^2/2. To the first order in q

    M q'' + (K + W^2 (G - M)) q = -W' X,     G_ij = integral of rhoA (L^2 - x^2)/2 phi_i' phi_j'

where G comes from the shortening alone: the zeroth-order model lacks it. Stretch is neglected
(5.1e-4 m in the end). Prints `sensor time value` for the checks of the scenes.
"""

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.integrate import solve_ivp

L, EI, RHO_A, T = 10.0, 1.4e4, 1.2, 15.0  # m, N m^2, kg/m, s
COUNT = 8  # shape functions


def matrices():
    """M, K, G and X of the powers 2 to COUNT + 1, orthonormalised for the digits' sake."""
    nodes, weights = leggauss(2 * COUNT + 4)
    x, w = (nodes + 1) / 2, weights / 2  # over the length
    n = np.arange(2, COUNT + 2)[:, None]
    phi, slope, bend = x**n, n * x ** (n - 1), n * (n - 1) * x ** (n - 2)
    M = RHO_A * L * (phi * w) @ phi.T
    basis = np.linalg.inv(np.linalg.cholesky(M))
    phi, slope, bend = basis @ phi, basis @ slope, basis @ bend
    K = EI / L**3 * (bend * w) @ bend.T
    G = RHO_A * L * (slope * w * (1 - x**2) / 2) @ slope.T
    X = RHO_A * L**2 * phi @ (w * x)
    return K, G, X, basis.sum(axis=1), (slope * w) @ slope.T / (2 * L)


def deflections(speed, times, stiffening):
    """Deflection of the tip and its shortening at these times [m]."""
    K, G, X, tip, shortening = matrices()
    spring = stiffening * G - np.eye(COUNT)

    def rate(t, y):
        turning = t < T
        W = speed / T * (t - T / (2 * np.pi) * np.sin(2 * np.pi * t / T)) if turning else speed
        W_dot = speed / T * (1 - np.cos(2 * np.pi * t / T)) if turning else 0.0
        q, v = y[:COUNT], y[COUNT:]
        return np.concatenate([v, -W_dot * X - K @ q - W**2 * (spring @ q)])

    run = solve_ivp(rate, (0, times[-1]), np.zeros(2 * COUNT), method="DOP853", t_eval=times,
                    rtol=1e-9, atol=1e-12)  # fmt: skip
    q = run.y[:COUNT].T
    return q @ tip, -np.einsum("ti,ij,tj->t", q, shortening, q)


if __name__ == "__main__":
    times = [5.0, 6.75, 7.5, 10.0, 12.5]
    for time, v, u in zip(times, *deflections(6.0, times, True), strict=True):
        print(f"tip.y {time} {v:.8f}")
        print(f"tip.x {time} {L + u:.8f}")
    for name, stiffening in (("stiffened", True), ("zeroth", False)):
        times = [5.0, 7.5, 10.0]
        for time, v in zip(times, deflections(3.0, times, stiffening)[0], strict=True):
            print(f"{name}.y {time} {v:.8f}")
