"""The misaligned four-bar at rest in each position: least strain energy of three elastic bars.

Each bar is a cantilever from its first pin: displacement and rotation vector of its end against
Timoshenko's compliances. Turning angles of the pins, ends of crank and rocker are free; the coupler
must fit between. Residuals are the square roots of the energies.
"""

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

CRANK, COUPLER, ROCKER, GROUND = 0.10, 0.24, 0.18, 0.22
YOUNG, NU, LEAN, SPEED, START = 207e9, 0.3, np.radians(5), 0.6, 1.0
C_ANGLE = np.hypot(GROUND, CRANK)
RISE = np.arccos((COUPLER**2 + C_ANGLE**2 - ROCKER**2) / (2 * COUPLER * C_ANGLE)) - np.arctan2(
    CRANK, GROUND
)
PIN_C = np.array([COUPLER * np.cos(RISE), CRANK + COUPLER * np.sin(RISE), 0])
TILT = np.arctan2(PIN_C[1], PIN_C[0] - GROUND)


def root_stiffness(length, side):
    """Transposed Cholesky factor of the 6 x 6 end stiffness of a cantilever of square section."""
    G, A, moment = YOUNG / (2 * (1 + NU)), side**2, side**4 / 12
    shear = 10 * (1 + NU) / (12 + 11 * NU)  # Cowper
    compliance = np.zeros((6, 6))
    compliance[0, 0] = length / (YOUNG * A)
    compliance[3, 3] = length / (G * 0.1405770 * side**4)  # Saint-Venant's constant of a square
    for w, r, sign in ((1, 5, 1), (2, 4, -1)):
        compliance[w, w] = length**3 / (3 * YOUNG * moment) + length / (shear * G * A)
        compliance[r, r] = length / (YOUNG * moment)
        compliance[w, r] = compliance[r, w] = sign * length**2 / (2 * YOUNG * moment)
    return np.linalg.cholesky(np.linalg.inv(compliance)).T


ROOTS = [root_stiffness(*bar) for bar in ((CRANK, 0.016), (COUPLER, 0.016), (ROCKER, 0.008))]


def about_z(angle):
    return Rotation.from_rotvec([0, 0, angle])


def bar_end(R, origin, length, d):
    """Rotation and place of a bar's end."""
    return R * Rotation.from_rotvec(d[3:]), origin + R.apply(np.array([length, 0, 0]) + d[:3])


# the pin C in the placed pose: z along its axis; the coupler's and the rocker's sides of it
PIN = Rotation.from_rotvec([0, LEAN, 0])
COUPLER_SIDE, ROCKER_SIDE = about_z(RISE).inv() * PIN, about_z(TILT).inv() * PIN


def residuals(x, phi):
    """18 square roots of energies at a crank angle; x: three pin angles, ends of crank, rocker."""
    crank, rocker = x[3:9] * SCALE, x[9:15] * SCALE
    at_b, b = bar_end(about_z(np.pi / 2 + phi), np.zeros(3), CRANK, crank)
    R2 = at_b * about_z(RISE - np.pi / 2 + x[0])
    at_c, c = bar_end(about_z(TILT + x[2]), np.array([GROUND, 0, 0]), ROCKER, rocker)
    R2_end = at_c * ROCKER_SIDE * about_z(x[1]) * COUPLER_SIDE.inv()
    turn = (R2.inv() * R2_end).as_rotvec()
    coupler = np.append(R2.inv().apply(c - b) - [COUPLER, 0, 0], turn)
    return np.concatenate([K @ d for K, d in zip(ROOTS, (crank, coupler, rocker), strict=True)])


SCALE = np.array([0.01, 0.01, 0.01, 0.1, 0.1, 0.1])


def solve(phis):
    """State and energy along increasing crank angles from the placed pose."""
    x, states = np.zeros(15), []
    for phi in phis:
        fit = least_squares(residuals, x, args=(phi,), method="lm", xtol=1e-14, ftol=1e-14)
        x = fit.x
        states.append((x, fit.cost))
    return states


def values():
    """Rows (sensor, time, value) at crank angles; the torque is the slope of the energy."""
    for phi in np.radians([60, 120, 240, 300]):
        t = phi / SPEED + START / 2  # the integral of the step's 3-4-5 polynomial is a half
        h = 1e-3
        path = np.append(np.linspace(0, phi - h, 1 + round(phi / 0.05)), [phi, phi + h])
        (_, before), (x, energy), (_, after) = solve(path)[-3:]
        _, c = bar_end(about_z(TILT + x[2]), np.array([GROUND, 0, 0]), ROCKER, x[9:15] * SCALE)
        yield "torque.z", t, (after - before) / (2 * h)
        yield "bending", t, energy
        yield "C.z", t, c[2]
        yield "rocker", t, x[2]


if __name__ == "__main__":
    for sensor, time, value in values():
        print(f"{sensor} {time:.12g} {value:.12g}")
