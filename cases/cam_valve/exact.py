"""Flat follower on a cam, in closed form: lift, contour, contact force, and when it is lost.

A flat that lies on a contour r(t) is lifted by the support function of it: with the law of lift h
over the angle t from the nose the contour is the envelope (r + h) n + h' n'. The cam pushes the
tappet with m (a + g) + k (lift + preload). ``python exact.py contour.csv`` writes 90 points.
"""

import sys
from pathlib import Path

import numpy as np

R, LIFT, LENGTH, END, A, B, G = 0.015, 0.008, 0.05, 0.006, 0.03, 0.04, 9.80665
MASS, STIFFNESS, PRELOAD = 0.15, 20e3, 0.010  # of contact_loss.toml
SPEEDS = {"scene.toml": 40 * np.pi, "spline_cam.toml": 40 * np.pi, "contact_loss.toml": 160 * np.pi}


def law(t):
    """Lift over the angle from the nose, and its first two derivatives."""
    c, s = np.cos(t / 2), np.sin(t / 2)
    return LIFT * c**8, -4 * LIFT * c**7 * s, LIFT * (14 * c**6 * s**2 - 2 * c**8)


def contour(t):
    """Points of the cam, its nose along x."""
    h, slope, _ = law(t)
    normal, along = np.array([np.cos(t), np.sin(t)]), np.array([-np.sin(t), np.cos(t)])
    return ((R + h) * normal + slope * along).T


def from_nose(scene, time):
    """Angle of the follower from the nose: the nose looks down at t = 0."""
    return SPEEDS[scene] * time - np.pi


def contact_force(time):
    """Push of the cam on the tappet of contact_loss.toml."""
    h, _, bend = law(from_nose("contact_loss.toml", time))
    return MASS * (bend * SPEEDS["contact_loss.toml"] ** 2 + G) + STIFFNESS * (h + PRELOAD)


def time_of_loss():
    """When the force is first zero, by bisection."""
    turn = 2 * np.pi / SPEEDS["contact_loss.toml"]
    low, high = 0.25 * turn, 0.5 * turn
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if contact_force(middle) > 0 else (low, middle)
    return low


def values():
    """Rows (scene, sensor, time, value) for the checks."""
    for scene in ("scene.toml", "spline_cam.toml", "contact_loss.toml"):
        turn = 2 * np.pi / SPEEDS[scene]
        for share in (0.35, 0.45, 0.5, 0.6):
            time = share * turn
            h, slope, bend = law(from_nose(scene, time))
            yield scene, "tappet.y", time, R + h
            if scene == "scene.toml":
                rise = h - END  # of the middle of the round end over the pivot
                psi = -np.arcsin(END / np.hypot(A, rise)) - np.arctan2(rise, A)
                yield scene, "rocker", time, psi
                yield scene, "valve.y", time, R + LENGTH + END + B * np.sin(psi) - END
            else:
                yield scene, "tappet_velocity.y", time, slope * SPEEDS[scene]
                yield scene, "tappet_acceleration.y", time, bend * SPEEDS[scene] ** 2
            if scene == "contact_loss.toml":
                yield scene, "push.y", time, contact_force(time)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        lines = [f"{x:.12g},{y:.12g}" for x, y in contour(2 * np.pi * np.arange(90) / 90)]
        Path(sys.argv[1]).write_text("x [m],y [m]\n" + "\n".join(lines) + "\n", encoding="utf-8")
    else:
        for scene, sensor, time, value in values():
            print(f"{scene} {sensor} {time:.12g} {value:.15g}")
