"""The test set's slider-crank in its own coordinates: angles of crank and rod, slider, q1 to q4.

Mass matrix M(x), stiffness and constraints as Simeon printed them (IVP Test Set, "crank"). The
velocity forces follow from M: M x" + M' x' = grad(x'M x'/2) - K x - G' lambda, with derivatives by
complex steps. It begins without deformation velocity, in the equilibrium of stretch with the first
motion. Prints `sensor time value`.
"""

import numpy as np
from scipy.integrate import solve_ivp

L1, L2, SPEED, PI = 0.15, 0.3, 150.0, 3.1415927
M1, M2, M3, J1, J2 = 0.36, 0.151104, 0.075552, 0.002727, 0.0045339259
RHO, B, YOUNG = 7870.0, 0.008, 2e11
AREA = B * B
MQ = np.zeros((4, 4))
MQ[:2, :2], MQ[2:, 2:] = np.eye(2) / 2, [[8, 1], [1, 2]]
MQ *= RHO * AREA * L2
KQ = np.zeros((4, 4))
KQ[:2, :2] = np.diag([PI**4 / 24, PI**4 * 2 / 3]) * (B / L2) ** 2
KQ[2:, 2:] = np.array([[16, -8], [-8, 7]]) / 3
KQ *= YOUNG * AREA / L2
C1 = RHO * AREA * L2 * np.array([0, 0, 2 / 3, 1 / 6])
C2 = RHO * AREA * L2 * np.array([2 / PI, 0, 0, 0])
C12 = RHO * AREA * L2**2 * np.array([0, 0, 1 / 3, 1 / 6])
C21 = RHO * AREA * L2**2 * np.array([1 / PI, -1 / (2 * PI), 0, 0])
SKEW = np.zeros((4, 4))
SKEW[0, 2:], SKEW[1, 3] = [-16 / PI**3, 8 / PI**3 - 1 / PI], 1 / (2 * PI)
SKEW = RHO * AREA * L2 * (SKEW - SKEW.T)
STEP = 1e-30j


def mass(x):
    """(7, 7)."""
    q, d = x[3:], x[0] - x[1]
    M = np.zeros((7, 7), dtype=x.dtype)
    M[0, 0], M[1, 1], M[2, 2] = J1 + M2 * L1**2, J2 + 2 * C12 @ q + q @ MQ @ q, M3
    M[0, 1] = L1 * (L2 * M2 / 2 * np.cos(d) + np.cos(d) * (C1 @ q) + np.sin(d) * (C2 @ q))
    M[0, 3:] = L1 * (-np.sin(d) * C1 + np.cos(d) * C2)
    M[1, 3:] = C21 - SKEW @ q
    M[3:, 3:] = np.triu(MQ)
    return M + np.triu(M, 1).T


def constraints(x, v):
    """Jacobian and right side of G x" = gamma: the guide, the slider, the crank's speed."""
    (f1, f2), q4, (w1, w2) = x[:2], x[6], v[:2]
    r, s1, c1, s2, c2 = L2 + q4, np.sin(f1), np.cos(f1), np.sin(f2), np.cos(f2)
    G = np.zeros((3, 7))
    G[0, [0, 1, 6]] = L1 * c1, r * c2, s2
    G[1, [0, 1, 2, 6]] = L1 * s1, r * s2, 1, -c2
    G[2, 0] = 1
    gamma = [L1 * s1 * w1**2 + r * s2 * w2**2 - 2 * c2 * w2 * v[6],
             -L1 * c1 * w1**2 - r * c2 * w2**2 - 2 * s2 * w2 * v[6], 0]  # fmt: skip
    return G, gamma


def accelerations(x, v):
    """(7,)."""
    M, G, gamma = mass(x), *constraints(x, v)
    gradient = np.array([mass(x + STEP * e).imag @ v for e in np.eye(7)]) / STEP.imag
    rate = mass(x + STEP * v).imag @ v / STEP.imag
    force = gradient @ v / 2 - rate
    force[3:] -= KQ @ x[3:]
    whole = np.block([[M, G.T], [G, np.zeros((3, 3))]])
    return np.linalg.solve(whole, np.append(force, gamma))[:7]


def first(stretch):
    """State with this stretch (q3, q4) and no deformation velocity."""
    x = np.array([0, 0, L1 + L2 + stretch[1], 0, 0, *stretch])
    w = -L1 * SPEED / (L2 + stretch[1])
    return x, np.array([SPEED, w, 0, 0, 0, 0, 0])


if __name__ == "__main__":
    stretch = np.array([1e-5, 1.7e-5])
    for _ in range(3):  # Newton's method for q3" = q4" = 0
        J = [accelerations(*first(stretch + e))[5:] - accelerations(*first(stretch - e))[5:]
             for e in 1e-8 * np.eye(2)]  # fmt: skip
        off = accelerations(*first(stretch))[5:]
        stretch = stretch - np.linalg.solve(np.transpose(J) / 2e-8, off)
    times = [0.01, 0.03, 0.05]
    run = solve_ivp(
        lambda t, y: np.append(y[7:], accelerations(y[:7], y[7:])), (0, times[-1]),
        np.concatenate(first(stretch)), method="DOP853", t_eval=times, rtol=1e-10, atol=1e-14,
    )  # fmt: skip
    for time, y in zip(times, run.y.T, strict=True):
        print(f"rod {time:g} {y[1]:.11f}")
        print(f"slider.x {time:g} {y[2]:.12f}")
        print(f"middle.y {time:g} {y[3]:.13f}")
        print(f"middle.x {time:g} {L2 / 2 + y[5]:.13f}")
