"""Held-out scenes: belt, wheel, hoist, arm, yoke, rotor. No constant was chosen by them."""

from __future__ import annotations

import numpy as np

from flexmb.model import Model

from .scene import Scene
from .textbook import integrated, one_freedom

G = 9.81
_MOTOR, _PULLEY, _FAN, _RATIO = 0.02, 0.005, 0.3, 0.4  # kg m²; turns of the fan for one
_SHAFT, _LOSS, _AIR = 60.0, 0.02, 0.01  # N m/rad, N m s/rad, N m s²/rad²


def belt(size=1.0):
    """A motor from rest, an elastic shaft, a belt, and a fan against the square of its speed."""
    area = size**2
    model = Model("belt drive", plane="xy")
    model.add_marker("ground.right", position=[size, 0, 0])
    for name, inertia, x in (("motor", _MOTOR, 0), ("pulley", _PULLEY, 0), ("fan", _FAN, size)):
        model.add_body(name, mass=1, inertia=[inertia * area] * 3, position=[x, 0, 0])
    for name, between in (
        ("motor", ["ground", "motor"]), ("shaft", ["motor", "pulley"]),
        ("fan", ["ground.right", "fan"]),
    ):  # fmt: skip
        model.add_joint(name, "revolute", between=between, axis="z")
        model.add_sensor(f"{name}_angle", "angle", joint=name)
        model.add_sensor(f"{name}_rate", "angle", joint=name, derivative=1)
    terms = (("motor", _RATIO), ("shaft", _RATIO), ("fan", -1))
    model.add_coupler("belt", "linear", terms=[
        {"joint": joint, "coordinate": "angle", "factor": factor} for joint, factor in terms
    ])  # fmt: skip
    model.add_force("elastic", "rotational-spring-damper", joint="shaft",
                    stiffness=_SHAFT * area, damping=_LOSS * area)  # fmt: skip
    model.add_force("torque", "torque", at="motor",
                    value=[0, 0, f"{area!r}*(8 - motor_rate/15)"])  # fmt: skip
    model.add_force("air", "torque", at="fan",
                    value=[0, 0, f"-{_AIR * area!r}*fan_rate*abs(fan_rate)"])  # fmt: skip
    model.add_marker("fan.rim", position=[0.3 * size, 0, 0])
    model.add_sensor("rim", "position", of="fan.rim")
    return model


def belt_truth(t):
    def slope(_, y):
        motor, pulley, u, w = y
        twist = _SHAFT * (pulley - motor) + _LOSS * (w - u)
        air = _RATIO * _AIR * (_RATIO * w) * abs(_RATIO * w)
        return [u, w, (8 - u / 15 + twist) / _MOTOR, -(twist + air) / (_PULLEY + _RATIO**2 * _FAN)]

    motor, pulley, _, _ = integrated(slope, [0, 0, 0, 0], t)
    return {
        "motor_angle": motor, "shaft_angle": pulley - motor, "fan_angle": _RATIO * pulley,
        "rim.x": 1 + 0.3 * np.cos(_RATIO * pulley), "rim.y": 0.3 * np.sin(_RATIO * pulley),
    }  # fmt: skip


_RADIUS, _OFF, _LEAN = 0.3, 0.12, 0.4


def wheel(size=1.0):
    """An unbalanced wheel that rolls without slip and nearly stops at each turn."""
    model = Model("wheel", plane="xy", gravity=[0, -G * size, 0])
    model.add_body("carriage", mass=0.5, inertia=[0.01 * size**2] * 3)
    model.add_body("wheel", mass=2, center=[0, -_OFF * size, 0], inertia=[0.05 * size**2] * 3,
                   orientation={"axis": "z", "angle": _LEAN},
                   angular_velocity=[0, 0, -5.7])  # fmt: skip
    model.add_joint("ground_line", "prismatic", between=["ground", "carriage"], axis="x")
    model.add_joint("axle", "revolute", between=["carriage", "wheel"], axis="z")
    model.add_coupler("rolling", "linear", terms=[
        {"joint": "ground_line", "coordinate": "stroke", "factor": 1},
        {"joint": "axle", "coordinate": "angle", "factor": _RADIUS * size},
    ])  # fmt: skip
    model.add_marker("wheel.mark", position=[_RADIUS * size, 0, 0])
    model.add_sensor("axle", "position", of="carriage")
    model.add_sensor("mark", "position", of="wheel.mark")
    return model


def wheel_truth(t):
    def inertia(a):
        return 0.5 * _RADIUS**2 + 2 * (_RADIUS**2 + _OFF**2 - 2 * _RADIUS * _OFF * np.cos(a)) + 0.05

    a, _ = one_freedom(inertia, lambda t, a, w: -2 * G * _OFF * np.sin(a), _LEAN, -5.7, t)
    x = -_RADIUS * (a - _LEAN)
    return {
        "axle.x": x, "mark.x": x + _RADIUS * np.cos(a), "mark.y": _RADIUS * np.sin(a),
    }  # fmt: skip


def hoist(size=1.0):
    """A trolley driven over 6 m, a load on a rope that is reeled, pushed aside."""
    model = Model("hoist", gravity=[0, 0, -G * size])
    model.add_body("trolley", mass=100, inertia=[size**2] * 3)
    model.add_body("load", mass=20, inertia=[size**2] * 3, position=[0, 0, -2 * size],
                   velocity=[0, 0.4 * size, 0])  # fmt: skip
    model.add_joint("rail", "prismatic", between=["ground", "trolley"], axis="x")
    model.add_driver("motor", joint="rail", stroke=f"{3 * size!r}*(1 - cos(0.4*t))")
    model.add_driver("reel", between=["trolley", "load"],
                     distance=f"{size!r}*(1.5 + 0.5*cos(0.9*t))")  # fmt: skip
    model.add_sensor("load", "position", of="load")
    model.add_sensor("swing", "position", of="load", relative_to="trolley")
    return model


def hoist_truth(t):
    """The direction n of the rope: l n'' = (g − a) across n − 2 l' n' − l |n'|² n."""

    def slope(t, y):
        n, rate = y[:3], y[3:]
        length, reel = 1.5 + 0.5 * np.cos(0.9 * t), -0.45 * np.sin(0.9 * t)
        pull = np.array([-3 * 0.16 * np.cos(0.4 * t), 0, -G])
        across = (pull - n * (n @ pull) - 2 * reel * rate) / length
        return [*rate, *(across - n * (rate @ rate))]

    n = integrated(slope, [0, 0, -1, 0, 0.2, 0], t)[:3]
    x, y, z = (1.5 + 0.5 * np.cos(0.9 * t)) * n
    place = 3 * (1 - np.cos(0.4 * t))
    return {"load.x": x + place, "load.y": y, "load.z": z, "swing.x": x, "swing.y": y, "swing.z": z}


_GAINS = ((60.0, 12.0), (25.0, 4.0))
_AIMS = (1.2, -0.9)


def arm(size=1.0):
    """Two links on a table that wait for half of the run, then follow a controller."""
    area = size**2
    model = Model("arm", plane="xy", gravity="none")
    for k, (mass, length) in enumerate(((3, 0.6), (2, 0.5))):
        model.add_body(f"link{k}", mass=mass, center=[length / 2 * size, 0, 0],
                       inertia=[0.05 * area] * 3, position=[0.6 * k * size, 0, 0])  # fmt: skip
        model.add_marker(f"link{k}.end", position=[length * size, 0, 0])
        before = "link0.end" if k else "ground"
        model.add_joint(f"motor{k}", "revolute", between=[before, f"link{k}"], axis="z")
        model.add_sensor(f"angle{k}", "angle", joint=f"motor{k}")
        model.add_sensor(f"rate{k}", "angle", joint=f"motor{k}", derivative=1)
        (kp, kd), aim = _GAINS[k], _AIMS[k]
        model.add_force(
            f"torque{k}", "rotational-spring-damper", joint=f"motor{k}",
            value=f"{kp * area!r}*({aim}*step5(t, 3, 0, 4, 1) - angle{k}) - {kd * area!r}*rate{k}",
        )  # fmt: skip
    model.add_sensor("hand", "position", of="link1.end")
    return model


def arm_truth(t):
    """Spong, Hutchinson & Vidyasagar, Robot Modeling and Control, §7.3, with absolute numbers."""

    def slope(t, y):
        a, b, u, w = y
        s = min(max(t - 3, 0.0), 1.0)
        aim = s**3 * (10 - 15 * s + 6 * s * s)
        torque = [
            kp * (goal * aim - q) - kd * v
            for (kp, kd), goal, q, v in zip(_GAINS, _AIMS, (a, b), (u, w), strict=True)
        ]
        cross = 2 * 0.6 * 0.25
        own = 2 * 0.25**2 + 0.05
        mixed = own + cross * np.cos(b)
        first = 3 * 0.3**2 + 0.05 + 2 * 0.6**2 + own + 2 * cross * np.cos(b)
        h = cross * np.sin(b)
        right = [torque[0] + h * w * (2 * u + w), torque[1] - h * u * u]
        return [u, w, *np.linalg.solve([[first, mixed], [mixed, own]], right)]

    y = np.zeros((4, len(t)))
    late = t > 3
    y[:, late] = integrated(slope, [0, 0, 0, 0], np.append(3.0, t[late]))[:, 1:]
    a, b = y[:2]
    hand = 0.6 * np.exp(1j * a) + 0.5 * np.exp(1j * (a + b))
    return {"angle0": a, "angle1": b, "hand.x": hand.real, "hand.y": hand.imag}


def yoke(size=1.0):
    """A crank in the slot of a yoke: a spring and a damper of the third power of the speed."""
    model = Model("Scotch yoke", plane="xy")
    model.add_body("crank", mass=1, inertia=[0.02 * size**2] * 3)
    model.add_marker("crank.pin", position=[0.1 * size, 0, 0])
    model.add_body("yoke", mass=3, inertia=[0.01 * size**2] * 3, position=[0.1 * size, 0, 0])
    model.add_curve("slot", x="0", y=f"{size!r}*t", range=[-0.2, 0.2])
    model.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    model.add_joint("guide", "prismatic", between=["ground", "yoke"], axis="x")
    model.add_joint("pin", "pin-in-slot", between=["yoke", "crank.pin"], curve="slot")
    model.add_force("torque", "torque", at="crank", value=[0, 0, 1.5 * size**2])
    model.add_force("buffer", "translational-spring-damper", joint="guide", stiffness=40,
                    free=0.1 * size, damper_force=f"{8 / size**2!r}*v**3")  # fmt: skip
    model.add_sensor("yoke", "position", of="yoke")
    model.add_sensor("pin", "position", of="crank.pin")
    return model


def yoke_truth(t):
    def force(_, a, w):
        arm = -0.1 * np.sin(a)
        stretch, speed = 0.1 * (np.cos(a) - 1), arm * w
        return 1.5 - arm * (40 * stretch + 8 * speed**3)

    a, _ = one_freedom(lambda a: 0.02 + 3 * (0.1 * np.sin(a)) ** 2, force, 0.0, 0.0, t)
    x, y = 0.1 * np.cos(a), 0.1 * np.sin(a)
    return {"yoke.x": x, "pin.x": x, "pin.y": y}


_HUB, _DISK, _CROSS, _OFFSET = 2.0, 3.0, 1.0, 1e-3  # kg; m
_STIFF, _LOSSES = (9600.0, 12000.0), (12.0, 20.0)


def rotor(size=1.0):
    """An unbalanced disk on a bushing that is run up through two critical speeds."""
    model = Model("rotor on a bushing")
    model.add_body("cross", mass=_CROSS, inertia=[size**2] * 3)
    model.add_body("hub", mass=_HUB, inertia=[size**2] * 3)
    model.add_body("disk", mass=_DISK, center=[_OFFSET * size, 0, 0],
                   inertia=[0.05 * size**2] * 3)  # fmt: skip
    model.add_marker("disk.rim", position=[0.2 * size, 0, 0])
    model.add_joint("across", "prismatic", between=["ground", "cross"], axis="x")
    model.add_joint("along", "prismatic", between=["cross", "hub"], axis="y")
    model.add_joint("bearing", "revolute", between=["hub", "disk"], axis="z")
    model.add_force("bushing", "bushing", between=["ground", "hub"],
                    stiffness=[*_STIFF, 0.0], damping=[*_LOSSES, 0.0])  # fmt: skip
    model.add_driver("motor", joint="bearing", angle="10*t**2")
    model.add_sensor("hub", "position", of="hub")
    model.add_sensor("rim", "position", of="disk.rim")
    return model


def rotor_truth(t):
    """(M + m) x'' + c x' + k x = m e (φ'² cos φ + φ'' sin φ), and the same across."""
    mass = (_CROSS + _HUB + _DISK, _HUB + _DISK)

    def slope(t, y):
        a, w = 10 * t * t, 20 * t
        pull = [w * w * np.cos(a) + 20 * np.sin(a), w * w * np.sin(a) - 20 * np.cos(a)]
        return [*y[2:], *((_DISK * _OFFSET * pull[i] - _LOSSES[i] * y[2 + i] - _STIFF[i] * y[i])
                          / mass[i] for i in range(2))]  # fmt: skip

    x, y = integrated(slope, [0, 0, 0, 0], t)[:2]
    a = 10 * t * t
    return {"hub.x": x, "hub.y": y, "rim.x": x + 0.2 * np.cos(a), "rim.y": y + 0.2 * np.sin(a)}


DRIVES = {
    "belt drive": Scene(belt, 4.0, belt_truth),
    "unbalanced wheel": Scene(wheel, 8.0, wheel_truth),
    "hoist": Scene(hoist, 12.0, hoist_truth),
    "arm that waits": Scene(arm, 6.0, arm_truth),
    "Scotch yoke": Scene(yoke, 2.0, yoke_truth),
    "rotor on a bushing": Scene(rotor, 4.0, rotor_truth),
}
