"""Scenes whose accuracy is judged, each with its closed form or textbook equation."""

from __future__ import annotations

import numpy as np
from femeshes import line
from scipy.integrate import solve_ivp
from scipy.optimize import newton
from scipy.special import ellipj, ellipk

from flexmb.fe import rectangle, reduce
from flexmb.model import Model

STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7800.0}


def rod(height):
    return reduce(
        line(8, end=(0.45, 0, 0)), material=STEEL, interfaces={"root": "root", "tip": "tip"},
        modes=4, sections={"all": rectangle(height, height)},
    )  # fmt: skip


def links(n):
    """n links of 1 m hinged in a row, let go from the horizontal."""
    made = Model("links", gravity=[0, -9.81, 0])
    for k in range(n):
        made.add_body(f"b{k}", mass=1, center=[0.5, 0, 0], inertia=[0.01, 0.1, 0.1],
                      position=[k, 0, 0])  # fmt: skip
        made.add_marker(f"b{k}.end", position=[1, 0, 0])
        ends = [f"b{k - 1}.end" if k else "ground", f"b{k}"]
        made.add_joint(f"j{k}", "revolute", between=ends, axis="z")
        made.add_sensor(f"end{k}", "position", of=f"b{k}.end")
    return made


def oscillator():
    made = Model("oscillator")
    made.add_body("m", mass=1, inertia=[1, 1, 1], position=[1, 0, 0])
    made.add_joint("guide", "prismatic", between=["ground", "m"], axis="x")
    made.add_force("spring", "spring-damper", between=["ground", "m"], stiffness=100, damping=0.2,
                   free_length=0.9)  # fmt: skip
    made.add_sensor("m", "position", of="m")
    return made


def top():
    made = Model("top", gravity=[0, 0, -9.81])
    made.add_body(
        "top", mass=15, center=[0, 0, 1], inertia=[0.23, 0.23, 0.45],
        angular_velocity=[0, -8, 20], orientation={"axis": "x", "angle": "60 deg"},
    )  # fmt: skip
    made.add_marker("top.tip", position=[0, 0, 1])
    made.add_joint("point", "spherical", between=["ground", "top"])
    made.add_sensor("tip", "position", of="top.tip")
    return made


def tumbling():
    made = Model("tumbling")
    made.add_body("b", mass=1, inertia=[1, 2, 2.8], angular_velocity=[0.1, 3, 0.1])
    made.add_marker("b.p", position=[0.5, 0.5, 0.5])
    made.add_sensor("p", "position", of="b.p")
    return made


def thrown():
    """A spatial chain of three bodies, the last one spun."""
    made = Model("thrown", gravity=[0, -9.81, 0])
    for k in range(3):
        spin = {"angular_velocity": [1.0, 2.0, 3.0]} if k == 2 else {}
        made.add_body(f"b{k}", mass=1.0 + k, center=[0.5, 0.1, 0], inertia=[0.02, 0.1, 0.09],
                      position=[k, 0, 0.1 * k], **spin)  # fmt: skip
        made.add_marker(f"b{k}.end", position=[1, 0, 0.1])
        ends = [f"b{k - 1}.end" if k else "ground", f"b{k}"]
        made.add_joint(f"j{k}", "spherical", between=ends)
        made.add_sensor(f"end{k}", "position", of=f"b{k}.end")
    return made


def flexible_pendulum():
    made = Model("flexible pendulum", gravity=[0, -9.81, 3.0])
    made.add_body("rod", rod(0.002))
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip")
    return made


def flexible_crank():
    made = Model("flexible crank")
    made.add_body("crank", mass=1.0, inertia=[0.01] * 3)
    made.add_marker("crank.pin", position=[0.15, 0, 0])
    made.add_body("rod", rod(0.012), position=[0.15, 0, 0])
    made.add_body("slider", mass=0.5, inertia=[0.01] * 3, position=[0.6, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "spherical", between=["crank.pin", "rod.root"])
    made.add_joint("wrist", "cylindrical", between=["rod.tip", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_driver("motor", joint="bearing", angle="150*t")
    made.add_sensor("slider", "position", of="slider")
    return made


ECCENTRICITY = 0.6


def kepler():
    """An orbit about the origin with a = 1 m and G M = 1 m³/s²."""
    made, e = Model("kepler"), ECCENTRICITY
    made.add_body("m", mass=1, inertia=[1, 1, 1], position=[1 - e, 0, 0],
                  velocity=[0, np.sqrt((1 + e) / (1 - e)), 0])  # fmt: skip
    made.add_sensor("m", "position", of="m")
    made.add_sensor("r", "distance", between=["ground", "m"])
    made.add_force("pull", "force", at="m", value=["-m.x/r**3", "-m.y/r**3", 0])
    return made


def forced():
    made = links(1)
    made.add_force("twist", "torque", at="b0", value=[0, 0, "6*sin(3*t)"])
    return made


def nutating():
    """A fast top let go with its axis at rest."""
    made = Model("nutating", gravity=[0, 0, -9.81])
    made.add_body(
        "top", mass=1, center=[0, 0, 0.1], inertia=[5e-3, 5e-3, 2e-3],
        angular_velocity=[0, 0, 80], orientation={"axis": "x", "angle": "60 deg"},
    )  # fmt: skip
    made.add_marker("top.tip", position=[0, 0, 0.1])
    made.add_joint("point", "spherical", between=["ground", "top"])
    made.add_sensor("tip", "position", of="top.tip")
    return made


def rotor():
    """A rotor of 1 m turned from rest, and beside it a mass that swings by 0.2 mm."""
    made = Model("rotor")
    made.add_body("rotor", mass=5, inertia=[1, 1, 2])
    made.add_marker("rotor.rim", position=[1, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "rotor"], axis="z")
    made.add_force("torque", "torque", at="rotor", value=[0, 0, 4])
    made.add_body("small", mass=1, inertia=[1, 1, 1], position=[1e-4, 0, 1])
    made.add_marker("ground.high", position=[0, 0, 1])
    made.add_joint("guide", "prismatic", between=["ground.high", "small"], axis="x")
    made.add_force("spring", "translational-spring-damper", joint="guide", stiffness=400)
    made.add_sensor("rim", "position", of="rotor.rim")
    made.add_sensor("small", "position", of="small")
    return made


AWAY = [1000.0, -500.0, 800.0]


def moved(model):
    """The same scene about another point: bodies, and the ground's end of every joint."""
    scene = model.to_scene_dict()
    for body in scene["bodies"].values():
        body["position"] = list(np.add(body.get("position", [0, 0, 0]), AWAY))
    scene["ground"] = {"markers": {"away": {"position": AWAY}}}
    for joint in scene.get("joints", {}).values():
        joint["between"] = ["ground.away" if e == "ground" else e for e in joint["between"]]
    return Model.from_scene_dict(scene)


_POWERS = {"mass": 3, "inertia": 5, "center": 1, "position": 1, "gravity": 1}


def scaled(model, s):
    """The same motion s times as large: masses go with volumes, forces with s⁴."""

    def grown(table):
        for key, value in table.items():
            if isinstance(value, dict):
                grown(value)
            elif key in _POWERS and not isinstance(value, str):
                table[key] = (s ** _POWERS[key] * np.array(value)).tolist()

    scene = model.to_scene_dict()
    grown(scene)
    return Model.from_scene_dict(scene)


def oscillator_truth(t):
    found = solve_ivp(
        lambda _, y: [y[1], -100 * (y[0] - 0.9) - 0.2 * y[1]], (0, t[-1]), [1.0, 0.0],
        t_eval=t, rtol=1e-12, atol=1e-14, method="DOP853",
    )  # fmt: skip
    return {"m.x": found.y[0]}


def pendulum_truth(t):
    """sin(angle/2) = k sn: one link hung at its end, from the horizontal; J = 0.1 + 0.25."""
    w, k = np.sqrt(9.81 * 0.5 / 0.35), np.sin(np.pi / 4)
    sn = ellipj(ellipk(k * k) + w * t, k * k)[0]
    angle = 2 * np.arcsin(k * sn)  # from the lowest point
    return {"end0.x": np.sin(angle), "end0.y": -np.cos(angle)}


def forced_truth(t):
    found = solve_ivp(
        lambda t, y: [y[1], (6 * np.sin(3 * t) - 9.81 * 0.5 * np.cos(y[0])) / 0.35], (0, t[-1]),
        [0.0, 0.0], t_eval=t, rtol=1e-13, atol=1e-14, method="DOP853",
    )  # fmt: skip
    return {"end0.x": np.cos(found.y[0]), "end0.y": np.sin(found.y[0])}


def kepler_truth(t):
    """Kepler's equation for the eccentric anomaly."""
    e = ECCENTRICITY
    E = newton(lambda E: E - e * np.sin(E) - t, t, lambda E: 1 - e * np.cos(E), tol=1e-14)
    return {
        "m.x": np.cos(E) - e, "m.y": np.sqrt(1 - e * e) * np.sin(E), "r": 1 - e * np.cos(E),
    }  # fmt: skip


def rotor_truth(t):
    return {
        "rim.x": np.cos(t**2), "rim.y": np.sin(t**2), "small.x": 1e-4 * np.cos(20 * t),
    }  # fmt: skip


# Each scene, how long it is run, and the closed form of what moves.
SCENES = {
    "pendulum": (lambda: links(1), 3.0, pendulum_truth),
    "long pendulum": (lambda: links(1), 100.0, pendulum_truth),
    "double pendulum": (lambda: links(2), 2.0, None),
    "oscillator": (oscillator, 5.0, oscillator_truth),
    "top": (top, 1.5, None),
    "nutating top": (nutating, 2.0, None),
    "tumbling body": (tumbling, 5.0, None),
    "spatial chain": (thrown, 1.0, None),
    "orbit": (kepler, 20.0, kepler_truth),
    "driven pendulum": (forced, 10.0, forced_truth),
    "rotor": (rotor, 3.0, rotor_truth),
}
