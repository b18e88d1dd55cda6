"""Machines of one freedom that turn: cams and followers, a rack, a screw, bent shafts, windows."""

from __future__ import annotations

import numpy as np

from flexmb.model import Model

from .scene import Scene
from .textbook import integrated, one_freedom

G = 9.81


def _on_a_pin(model, name, inertia, size, at="ground", **fields):
    """A body of 1 kg on a pin, and the angle it turns by."""
    model.add_body(name, mass=1, inertia=[inertia * size**2] * 3, **fields)
    model.add_joint(f"{name}_pin", "revolute", between=[at, name], axis="z")
    model.add_sensor(f"{name}_turn", "angle", joint=f"{name}_pin")
    model.add_sensor(f"{name}_speed", "angle", joint=f"{name}_pin", derivative=1)


def _follower(model, mass, place, size):
    model.add_body("follower", mass=mass, inertia=[1e-3 * size**2] * 3,
                   position=[0, place * size, 0])  # fmt: skip
    model.add_joint("guide", "prismatic", between=["ground", "follower"], axis="y")
    model.add_sensor("lift", "position", of="follower")


def heart(size=1.0):
    """A heart that turns freely under an edge, which a spring holds."""
    model = Model("heart", plane="xy", gravity=[0, -G * size, 0])
    model.add_curve("heart", polar=f"{size!r}*(0.05 + 0.012*cos(t) + 0.004*cos(3*t))", closed=True)
    _on_a_pin(model, "cam", 2e-3, size, angular_velocity=[0, 0, 15.0])
    _follower(model, 0.6, 0.05, size)
    model.add_joint("touch", "cam-knife", between=["cam", "follower"], curve="heart")
    model.add_force("spring", "translational-spring-damper", joint="guide", stiffness=800,
                    free=0.05 * size)  # fmt: skip
    return model


def heart_truth(t):
    """The edge is above the pivot, at the polar angle π/2 − a of the cam."""

    def lift(a):
        return 0.05 + 0.012 * np.sin(a) - 0.004 * np.sin(3 * a)

    def slope(a):
        return 0.012 * (np.cos(a) - np.cos(3 * a))

    def force(t, a, w):
        return slope(a) * (-0.6 * G - 800 * (lift(a) - 0.05))

    a, _ = one_freedom(lambda a: 2e-3 + 0.6 * slope(a) ** 2, force, 0.0, 15.0, t)
    return {"cam_turn": a, "lift.y": lift(a)}


_DISK, _ROLLER, _OFF = 0.05, 0.02, 0.015


def roller(size=1.0):
    """A disk beside its pivot lifts a roller: a motor drives it from rest."""
    model = Model("roller", plane="xy", gravity=[0, -G * size, 0])
    model.add_curve("disk", circle=_DISK * size, center=[_OFF * size, 0])
    _on_a_pin(model, "cam", 1e-3, size)
    _follower(model, 0.5, np.sqrt((_DISK + _ROLLER) ** 2 - _OFF**2), size)
    model.add_joint("touch", "cam-roller", between=["cam", "follower"], curve="disk",
                    radius=_ROLLER * size)  # fmt: skip
    model.add_force("motor", "torque", at="cam",
                    value=[0, 0, f"{size**2!r}*(0.2 - cam_speed/300)"])  # fmt: skip
    return model


def roller_truth(t):
    """A slider-crank whose rod is as long as both radii."""

    def root(a):
        return np.sqrt((_DISK + _ROLLER) ** 2 - (_OFF * np.cos(a)) ** 2)

    def slope(a):
        return _OFF * np.cos(a) * (1 + _OFF * np.sin(a) / root(a))

    def force(t, a, w):
        return 0.2 - w / 300 - 0.5 * G * slope(a)

    a, _ = one_freedom(lambda a: 1e-3 + 0.5 * slope(a) ** 2, force, 0.0, 0.0, t)
    return {"cam_turn": a, "lift.y": _OFF * np.sin(a) + root(a)}


def rack(size=1.0):
    """A pinion with its mass beside the pin rolls on a rack, which a spring holds."""
    model = Model("rack", plane="xy", gravity=[0, -G * size, 0])
    model.add_marker("ground.below", position=[0, -0.05 * size, 0])
    model.add_body("pinion", mass=2, center=[0, -0.03 * size, 0], inertia=[3e-3 * size**2] * 3,
                   angular_velocity=[0, 0, 20.0])  # fmt: skip
    model.add_body("rack", mass=1, inertia=[1e-3 * size**2] * 3, position=[0, -0.05 * size, 0])
    model.add_joint("pin", "revolute", between=["ground", "pinion"], axis="z")
    model.add_joint("slide", "prismatic", between=["ground.below", "rack"], axis="x")
    model.add_coupler("mesh", "rack-and-pinion", joints=["pin", "slide"], radius=0.05 * size)
    model.add_force("spring", "translational-spring-damper", joint="slide", stiffness=60, free=0)
    model.add_sensor("rack", "position", of="rack")
    model.add_sensor("turn", "angle", joint="pin")
    return model


def rack_truth(t):
    inertia = 3e-3 + 2 * 0.03**2 + 0.05**2

    def slope(_, y):
        return [y[1], -(2 * G * 0.03 * np.sin(y[0]) + 60 * 0.05**2 * y[0]) / inertia]

    turn = integrated(slope, [0.0, 20.0], t)[0]
    return {"turn": turn, "rack.x": 0.05 * turn}


def screw(size=1.0):
    """A heavy nut runs down a steep screw and up again, held by a spring."""
    model = Model("screw", gravity=[0, 0, -G * size])
    model.add_body("nut", mass=2, inertia=[part * size**2 for part in (0.01, 0.01, 4e-3)])
    model.add_marker("nut.rim", position=[0.1 * size, 0, 0])
    model.add_joint("screw", "screw", between=["ground", "nut"], axis="z", pitch=0.05 * size)
    model.add_force("spring", "translational-spring-damper", joint="screw", stiffness=40, free=0)
    model.add_sensor("rim", "position", of="nut.rim")
    model.add_sensor("turn", "angle", joint="screw")
    return model


def screw_truth(t):
    lead = 0.05 / (2 * np.pi)
    rate = np.sqrt(40 * lead**2 / (4e-3 + 2 * lead**2))
    turn = -2 * G / (40 * lead) * (1 - np.cos(rate * t))
    return {
        "turn": turn, "rim.x": 0.1 * np.cos(turn), "rim.y": 0.1 * np.sin(turn),
        "rim.z": lead * turn,
    }  # fmt: skip


def _bent_shafts(bend, speed, driven, duration):
    """Two shafts at an angle, a universal joint between them, both free."""
    across = np.array([-np.sin(bend), np.cos(bend), 0])

    def make(size=1.0):
        model = Model("bent shafts")
        model.add_body("first", mass=1, inertia=[0.01 * size**2] * 3,
                       angular_velocity=[speed, 0, 0])  # fmt: skip
        model.add_body("second", mass=1, inertia=[driven * size**2] * 3,
                       orientation={"axis": "z", "angle": bend})  # fmt: skip
        model.add_joint("bearing", "revolute", between=["ground", "first"], axis="x")
        model.add_joint("end", "cylindrical", between=["ground", "second"],
                        axis=[np.cos(bend), np.sin(bend), 0])  # fmt: skip
        model.add_joint("cross", "universal", between=["first", "second"], axis="z",
                        second_axis=across.tolist())  # fmt: skip
        model.add_marker("second.rim", position=[0, 0, 0.1 * size])
        model.add_sensor("turn", "angle", joint="bearing")
        model.add_sensor("second_turn", "angle", joint="end")
        model.add_sensor("rim", "position", of="second.rim")
        return model

    def truth(t):
        """The turns: tan b = cos β tan a."""
        c = np.cos(bend)

        def ratio(a):
            return c / (np.cos(a) ** 2 + (c * np.sin(a)) ** 2)

        def inertia(a):
            return 0.01 + driven * ratio(a) ** 2

        a, _ = one_freedom(inertia, lambda t, a, w: 0.0, 0.0, speed, t)
        b = np.arctan2(c * np.sin(a), np.cos(a))
        b += 2 * np.pi * np.round((a - b) / (2 * np.pi))
        side = -0.1 * np.sin(b)
        return {
            "turn": a, "second_turn": b, "rim.x": across[0] * side, "rim.y": across[1] * side,
            "rim.z": 0.1 * np.cos(b),
        }  # fmt: skip

    return Scene(make, duration, truth)


def _windows(n):
    """Parallelograms side by side in space: n + 1 cranks, n couplers, all pins revolute."""

    def make(size=1.0):
        model, lean = Model("windows", gravity=[0, -G * size, 0]), 0.4
        for k in range(n + 1):
            model.add_marker(f"ground.at{k}", position=[k * size, 0, 0])
            model.add_body(f"crank{k}", mass=1, center=[0, -0.5 * size, 0],
                           inertia=[0.1 * size**2] * 3, position=[k * size, 0, 0],
                           orientation={"axis": "z", "angle": lean},
                           angular_velocity=[0, 0, 1.0])  # fmt: skip
            model.add_marker(f"crank{k}.end", position=[0, -size, 0])
            model.add_joint(f"pin{k}", "revolute", between=[f"ground.at{k}", f"crank{k}"], axis="z")
        for k in range(n):
            place = [(k + np.sin(lean)) * size, -np.cos(lean) * size, 0]
            model.add_body(f"bar{k}", mass=0.5, center=[0.5 * size, 0, 0],
                           inertia=[0.1 * size**2] * 3, position=place)  # fmt: skip
            model.add_marker(f"bar{k}.end", position=[size, 0, 0])
            for end, crank in (("", k), (".end", k + 1)):
                model.add_joint(f"hinge{k}{end[1:]}", "revolute", axis="z",
                                between=[f"bar{k}{end}", f"crank{crank}.end"])  # fmt: skip
        model.add_sensor("first", "position", of="crank0.end")
        model.add_sensor("last", "position", of=f"crank{n}.end")
        return model

    def truth(t):
        inertia, weight = (n + 1) * 0.35 + n * 0.5, (n + 0.5) * G
        a = integrated(lambda t, y: [y[1], -weight * np.sin(y[0]) / inertia], [0.4, 1.0], t)[0]
        ends = {"first": 0, "last": n}
        found = {f"{name}.x": k + np.sin(a) for name, k in ends.items()}
        return found | {f"{name}.y": -np.cos(a) for name in ends}

    return Scene(make, 3.0, truth)


TRANSMISSIONS = {
    "heart": Scene(heart, 3.0, heart_truth),
    "roller": Scene(roller, 2.0, roller_truth),
    "rack": Scene(rack, 3.0, rack_truth),
    "screw": Scene(screw, 3.0, screw_truth),
    "shafts bent by 60°": _bent_shafts(np.pi / 3, 20.0, 0.02, 2.0),
    "shafts bent by 89°": _bent_shafts(np.radians(89), 5.0, 1e-6, 2.0),
    "windows": _windows(5),
}
