"""The quick-return in closed form, and its torque from the power of all masses at constant speed.

Torque times speed is the rate of kinetic and potential energy: velocities by complex steps, the
rate by differences of order four. ``python exact.py torque.csv`` writes a turn of it.
"""

import sys
from pathlib import Path

import numpy as np

A, R, L, B, SPEED, G, STEEL = 0.30, 0.15, 0.60, 0.25, 4 * np.pi, 9.80665, 7850.0
TURN = 2 * np.pi / SPEED


def box(x, y, z):
    """Mass and moment of inertia about z of a steel box."""
    m = STEEL * x * y * z
    return m, m * (x * x + y * y) / 12


CRANK, BLOCK = box(0.03, R + 0.03, 0.02), box(0.05, 0.06, 0.02)
LEVER, LINK, RAM = box(0.03, L + 0.03, 0.015), box(B + 0.03, 0.02, 0.015), box(0.2, 0.05, 0.05)
MODELS = {
    "scene.toml": (CRANK, BLOCK, LEVER, LINK, RAM),
    "pin_in_slot.toml": (CRANK, (0, 0), LEVER, LINK, RAM),
    "massless_link.toml": (CRANK, (0, 0), LEVER, (0, 0), RAM),
}


def motion(t):
    """Middles (x, y) and angles of crank, block, lever, link, ram; times may be complex."""
    phi = SPEED * t
    s, c = np.sin(phi), np.cos(phi)
    psi = np.arctan(R * s / (A + R * c))  # of the lever, to the left
    S, C = np.sin(psi), np.cos(psi)
    chi = np.arcsin((L - L * C) / B)  # of the link, up
    ram = -L * S + B * np.cos(chi)
    middles = [
        (-R / 2 * s, A + R / 2 * c), (-R * s, A + R * c), (-L / 2 * S, L / 2 * C),
        (-L * S + B / 2 * np.cos(chi), L * C + B / 2 * np.sin(chi)), (ram, L),
    ]  # fmt: skip
    return np.array(middles), np.array([phi, psi, psi, chi, 0 * phi])


def energy(t, bodies):
    middles, angles = motion(t + 1e-30j)
    v, w = middles.imag / 1e-30, angles.imag / 1e-30
    mass, inertia = np.array(bodies).T
    return mass @ (np.sum(v * v, axis=1) / 2 + G * middles[:, 1].real) + inertia @ (w * w) / 2


def torque(t, bodies, h=1e-4):
    e = [energy(t + k * h, bodies) for k in (-2, -1, 1, 2)]
    return float(np.dot([1, -8, 8, -1], e) / (12 * h) / SPEED)


def link_force(t, h=1e-4):
    """On the ram along x, of a link without mass."""
    x = [motion(t + k * h)[0][4, 0] for k in range(-2, 3)]
    return RAM[0] * float(np.dot([-1, 16, -30, 16, -1], x) / (12 * h * h))


def values():
    """Rows (scene, sensor, time, value) for the checks."""
    for part in (0.125, 0.4, 0.55, 0.8):
        t = part * TURN
        x, v = motion(t)[0][4, 0], motion(t + 1e-30j)[0][4, 0].imag / 1e-30
        for scene, bodies in MODELS.items():
            yield scene, "ram.x", t, x
            yield scene, "ram_velocity.x", t, v
            yield scene, "torque.z", t, torque(t, bodies)
        yield "massless_link.toml", "link_force.x", t, link_force(t)
        yield "forward.toml", "crank", t, SPEED * t
        yield "forward.toml", "ram.x", t, x
    yield "forward.toml", "speed", TURN, SPEED


if __name__ == "__main__":
    for scene, sensor, time, value in values():
        print(f"{scene} {sensor} {time:.12g} {value:.15g}")
    if len(sys.argv) > 1:
        table = [(t, torque(t, MODELS["scene.toml"])) for t in np.linspace(0, TURN, 361)]
        table[-1] = (TURN, table[0][1])
        lines = [f"{t:.12g},{value:.10g}" for t, value in table]
        Path(sys.argv[1]).write_text("\n".join(["time,torque", *lines]) + "\n", encoding="utf-8")
