"""The quarter car by its four equations of motion, SciPy's DOP853; it reads road.csv."""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import fsolve

M, MA, J, G = 320.0, 38.0, 1.6, 9.80665
K, C, FREE = 42e3, 2600.0, 0.53
KT, CT, FREE_TYRE = 190e3, 120.0, 0.319
KB, CB, KR, CR = np.array([6e5, 9e5]), np.array([800.0, 1200.0]), 300.0, 4.0
CENTER, SPRING, WHEEL = np.array([0.32, 0]), np.array([0.28, 0.03]), np.array([0.4, 0])
BUSHING, TOP = np.array([-0.4, -0.55]), np.array([-0.12, -0.1])  # on the chassis
ROAD = CubicSpline(
    *np.loadtxt(Path(__file__).with_name("road.csv"), delimiter=",", skiprows=1).T,
    bc_type="natural",
)


def line_force(a, b, va, vb, stiffness, damping, free):
    """Force on b of a spring and damper from a."""
    d = b - a
    length = np.hypot(*d)
    e = d / length
    return -(stiffness * (length - free) + damping * (e @ (vb - va))) * e


def right_side(t, s, moving=1.0):
    """State: height of the chassis, origin (x, y) and angle of the arm, then their rates."""
    s = np.asarray(s)
    y, origin, angle, vy, v, w = s[0], s[1:3], s[3], s[4], s[5:7], s[7]
    c, sn = np.cos(angle), np.sin(angle)
    A = np.array([[c, -sn], [sn, c]])

    def place(p):
        r = A @ p
        return origin + r, v + w * np.array([-r[1], r[0]]), r

    up = np.array([0, vy])
    chassis = np.array([0, y])
    (spring, v_spring, r_spring), (wheel, v_wheel, r_wheel) = place(SPRING), place(WHEEL)
    bushing = -KB * (origin - chassis - BUSHING) - CB * (v - up)
    on_arm = -line_force(spring, chassis + TOP, v_spring, up, K, C, FREE)
    tyre = line_force(
        np.array([0, ROAD(t)]),
        wheel,
        np.array([0, moving * ROAD(t, 1)]),
        v_wheel,
        KT,
        CT,
        FREE_TYRE,
    )
    # about the arm's origin, for the unknowns origin" and angle"
    r = A @ CENTER
    force = bushing + on_arm + tyre + [0, -MA * G] + MA * w * w * r
    moment = r_spring[0] * on_arm[1] - r_spring[1] * on_arm[0]
    moment += r_wheel[0] * tyre[1] - r_wheel[1] * tyre[0]
    moment += -r[0] * MA * G - KR * angle - CR * w
    mass = np.array([
        [MA, 0, -MA * r[1]], [0, MA, MA * r[0]], [-MA * r[1], MA * r[0], J + MA * (r @ r)],
    ])  # fmt: skip
    a = np.linalg.solve(mass, [*force, moment])
    lift = (-bushing[1] - on_arm[1]) / M - G
    return np.array([vy, *v, w, lift, *a])


def values():
    """Rows (sensor, time, value) for the checks."""
    times = [0.0, 0.55, 0.62, 0.7, 0.8, 1.1, 2.0]
    rest = fsolve(
        lambda x: right_side(0.0, [*x, 0, 0, 0, 0], 0.0)[4:], [0.85, -0.4, 0.3, 0], xtol=1e-13
    )
    start = [*rest, 0, 0, 0, 0]
    run = solve_ivp(
        right_side, (0, 2.0), start, "DOP853", times, rtol=1e-9, atol=1e-11, max_step=0.01
    )
    for t, s in zip(times, run.y.T, strict=True):
        yield "chassis.y", t, s[0]
        yield "wheel.y", t, s[2] + WHEEL[0] * np.sin(s[3])
        if t > 0:
            yield "lift.y", t, right_side(t, s)[4]


if __name__ == "__main__":
    for sensor, time, value in values():
        print(f"{sensor} {time:.12g} {value:.12g}")
