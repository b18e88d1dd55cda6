"""The quick-return mechanism in three models: crank, block on a slotted lever, link, ram.

The crank turns about (0, A), the lever about the origin; the ram slides along x at height H. Own
numbers. Model A has all five bodies (15 coordinates, 14 equations), B a pin in the slot in place of
the block (12, 11), C a link without mass besides (9, 8); Hong & Liu 2011, section 1.6.
"""

from __future__ import annotations

import numpy as np

from flexmb.model import Model

A, R, L, B, H = 0.3, 0.1, 0.6, 0.2, 0.55  # crank pivot, crank, lever, link, ram [m]
SPEED = 2.0 * np.pi  # rad/s


def quick_return(model="A", plane="xy", turns=1.0, outputs=200):
    """Model A, B or C of the mechanism, driven at constant speed from a horizontal crank."""
    made = Model(f"quick-return {model}", plane=plane, gravity=[0, -9.81, 0])
    made.add_marker("ground.pivot", position=[0, A, 0])
    made.add_marker("ground.guide", position=[0, H, 0])
    phi = np.arctan2(A, R)
    tip = L * np.array([np.cos(phi), np.sin(phi)])
    beta = np.arcsin((H - tip[1]) / B)
    lying = np.array([[np.cos(phi), -np.sin(phi), 0], [np.sin(phi), np.cos(phi), 0], [0, 0, 1]])
    _bar(made, "crank", R, [0, A, 0], np.eye(3))
    _bar(made, "lever", L, [0, 0, 0], lying)
    ram = [tip[0] + B * np.cos(beta), H, 0]
    made.add_body("ram", mass=2.0, inertia=[1e-3] * 3, position=ram)
    made.add_joint("bearing", "revolute", between=["ground.pivot", "crank"], axis="z")
    made.add_joint("lever_bearing", "revolute", between=["ground", "lever"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground.guide", "ram"], axis="x")
    slot = [np.cos(phi), np.sin(phi), 0]
    if model == "A":
        made.add_body(
            "block", mass=0.3, inertia=[1e-4] * 3, position=[R, A, 0], orientation=lying.tolist()
        )
        made.add_joint("crank_pin", "revolute", between=["crank.end", "block"], axis="z")
        made.add_joint("slot", "prismatic", between=["lever", "block"], axis=slot)
    else:
        made.add_joint("slot", "in-line", between=["lever", "crank.end"], axis=slot)
    if model == "C":
        made.add_joint("link", "distance", between=["lever.end", "ram"])
    else:
        turn = np.array(
            [[np.cos(beta), -np.sin(beta), 0], [np.sin(beta), np.cos(beta), 0], [0, 0, 1]]
        )
        _bar(made, "link", B, [*tip, 0], turn)
        made.add_joint("lever_pin", "revolute", between=["lever.end", "link"], axis="z")
        made.add_joint("ram_pin", "revolute", between=["link.end", "ram"], axis="z")
    made.add_driver("motor", joint="bearing", angle=f"{SPEED!r}*t")
    for kind in ("position", "velocity", "acceleration"):
        made.add_sensor(f"ram_{kind}", kind, of="ram")
    made.set_kinematics(duration=turns * 2.0 * np.pi / SPEED, outputs=outputs)
    return made


def _bar(made, name, length, position, orientation):
    made.add_body(
        name, mass=length * 5.0, center=[length / 2, 0, 0],
        inertia=[1e-4, length**3 * 5 / 12, length**3 * 5 / 12],
        position=list(position), orientation=np.asarray(orientation).tolist(),
    )  # fmt: skip
    made.add_marker(f"{name}.end", position=[length, 0, 0])


def ram_motion(t):
    """Position, velocity and acceleration of the ram at times t, from the loop equations."""
    a = SPEED * t
    x, y = R * np.cos(a), A + R * np.sin(a)
    xd, yd = -R * SPEED * np.sin(a), R * SPEED * np.cos(a)
    s2, dot, area = x * x + y * y, x * xd + y * yd, x * yd - y * xd
    phi = np.arctan2(y, x)
    w = area / s2
    # d(area)/dt = x ÿ − y ẍ = −SPEED² (x (y − A) − y x) = SPEED² A x
    wd = SPEED**2 * A * x / s2 - 2.0 * area * dot / s2**2
    c, s = np.cos(phi), np.sin(phi)
    k = H - L * s  # of the link, k² + (ram − L c)² = B²
    kd, kdd = -L * c * w, L * s * w * w - L * c * wd
    p = np.sqrt(B * B - k * k)
    pd = -k * kd / p
    pdd = -(kd * kd + k * kdd + pd * pd) / p
    return L * c + p, -L * s * w + pd, -L * c * w * w - L * s * wd + pdd
