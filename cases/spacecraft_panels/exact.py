"""A spacecraft with two beams that a wheel turns about y: linear, bending by Ritz' method.

Turned by theta, a point of either panel at the distance a + x from the axis moves by (a + x) theta
+ w; both panels bend alike, in opposite directions. Without any moment from outside the angular
momentum stays zero, J_wheel the wheel's, phi its angle on the bus:

    J theta + 2 X'q + J_wheel phi = 0,        q'' + K q + X theta'' = 0

Prints `sensor time value`.
"""

import numpy as np
from scipy.integrate import solve_ivp

L, B, H, A = 2.4, 0.8, 0.005, 0.5  # panels: length, width, thickness; where they begin, m
YOUNG, RHO = 70e9, 2700.0
RHO_A, EI = RHO * B * H, YOUNG * B * H**3 / 12
J_WHEEL = 40 * 0.3**2 / 2
J = (
    300 / 12 * (1.0**2 + 1.2**2) + J_WHEEL + 2 * RHO_A * (((A + L) ** 3 - A**3) / 3 + L * H**2 / 12)
)  # kg m^2, all of the craft
TURNS, T = 22 * np.pi, 6.0  # rad of the wheel, s
COUNT = 8

nodes, weights = np.polynomial.legendre.leggauss(2 * COUNT + 4)
x, w = L * (nodes + 1) / 2, L * weights / 2
n = np.arange(2, COUNT + 2)[:, None]
phi, bend = (x / L) ** n, n * (n - 1) / L**2 * (x / L) ** (n - 2)
basis = np.linalg.inv(np.linalg.cholesky(RHO_A * (phi * w) @ phi.T))  # so that M = 1
phi, bend, tip = basis @ phi, basis @ bend, basis.sum(axis=1)
K = EI * (bend * w) @ bend.T
X = RHO_A * phi @ (w * (A + x))
MASS = np.eye(COUNT) - 2 * np.outer(X, X) / J


def wheel(t):
    """Angle of the wheel on the bus and its second derivative: the quintic from rest to rest."""
    s = min(t / T, 1.0)
    angle, second = 10 * s**3 - 15 * s**4 + 6 * s**5, 60 * s - 180 * s**2 + 120 * s**3
    return TURNS * angle, TURNS * second / T**2


def rate(t, y):
    """Rates of q and q'; theta'' = -(2 X'q'' + J_wheel phi'')/J."""
    q = y[:COUNT]
    force = -K @ q + X * J_WHEEL / J * wheel(t)[1]
    return np.concatenate([y[COUNT:], np.linalg.solve(MASS, force)])


if __name__ == "__main__":
    times = [1.5, 3.0, 6.0, 8.0, 10.0]
    run = solve_ivp(rate, (0, 10), np.zeros(2 * COUNT), method="DOP853", t_eval=times, rtol=1e-9,
                    atol=1e-12, max_step=0.05)  # fmt: skip
    for time, y in zip(times, run.y.T, strict=True):
        q = y[:COUNT]
        print(f"attitude {time:g} {-(J_WHEEL * wheel(time)[0] + 2 * X @ q) / J:.9f}")
        print(f"east.z {time:g} {-tip @ q:.8f}")
