"""A free hub with a flexible blade under a torque: Lagrange's equations, bending by Ritz' method.

Turned by theta, a point of the blade is at R + x - s along it and v beside it, s the integral of
v'^2/2 from 0 to x. With v = sum phi_i(x) q_i and the kinetic energy to the second order in q
(first-order approximate coupling; Cai, Hong and Yang (2005), Mechanics Research Communications 32,
173), D the matrix of the shortening, X the integral of rhoA (R + x) phi:

    (J + q'(M - D) q) theta'' + X' q'' + 2 theta' q'(M - D) q' = torque
    X theta'' + M q'' + (K - theta'^2 (M - D)) q = 0

Without D (`zeroth order`) the blade would fold up above its first frequency. Prints `sensor time
value`.
"""

import numpy as np
from scipy.integrate import solve_ivp

L, R = 8.0, 0.5  # m
RHO_A = 2766.67 * 7.2968e-5  # kg/m
EI = 6.8952e10 * 8.2189e-9  # N m^2
J_HUB = 20.0  # kg m^2
TORQUE, T = 33.0, 15.0  # N m, s
COUNT = 8

nodes, weights = np.polynomial.legendre.leggauss(2 * COUNT + 4)
x, w = L * (nodes + 1) / 2, L * weights / 2
n = np.arange(2, COUNT + 2)[:, None]
phi, slope, bend = (x / L) ** n, n / L * (x / L) ** (n - 1), n * (n - 1) / L**2 * (x / L) ** (n - 2)
basis = np.linalg.inv(np.linalg.cholesky(RHO_A * (phi * w) @ phi.T))  # so that M = 1
phi, slope, bend, tip = basis @ phi, basis @ slope, basis @ bend, basis.sum(axis=1)
K = EI * (bend * w) @ bend.T
# the tension of unit speed at x: integral of rhoA (R + z) from x to L
D = (slope * w * RHO_A * (R * (L - x) + (L**2 - x**2) / 2)) @ slope.T
X = RHO_A * phi @ (w * (R + x))
J = J_HUB + RHO_A * ((R + L) ** 3 - R**3) / 3
SOFTENING = np.eye(COUNT) - D


def rate(t, y):
    """Rates of theta, q, theta', q'."""
    q, speed, v = y[1 : COUNT + 1], y[COUNT + 1], y[COUNT + 2 :]
    torque = TORQUE * np.sin(np.pi * t / T) ** 2 if t < T else 0.0
    mass = np.block([[np.array([[J + q @ SOFTENING @ q]]), X[None]], [X[:, None], np.eye(COUNT)]])
    force = np.append(torque - 2 * speed * (q @ SOFTENING @ v), -K @ q + speed**2 * (SOFTENING @ q))
    return np.concatenate([y[COUNT + 1 :], np.linalg.solve(mass, force)])


if __name__ == "__main__":
    times = [5.0, 10.0, 15.0, 20.0]
    run = solve_ivp(rate, (0, 20), np.zeros(2 * COUNT + 2), method="DOP853", t_eval=times,
                    rtol=1e-9, atol=1e-12)  # fmt: skip
    for time, state in zip(times, run.y.T, strict=True):
        print(f"angle {time:g} {state[0]:.8f}")
        print(f"speed {time:g} {state[COUNT + 1]:.8f}")
        print(f"tip.y {time:g} {tip @ state[1 : COUNT + 1]:.8f}")
