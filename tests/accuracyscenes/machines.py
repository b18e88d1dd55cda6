"""Mechanisms: cranks, linkages, shafts, gears, cams, a governor, a controller."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexmb.model import Model, load_scene

from .scene import Scene
from .textbook import Linkage, integrated, one_freedom

G = 9.81
_CASES = Path(__file__).parents[2] / "cases"
R, L = 0.15, 0.45  # crank and rod, m


def slider_crank(size=1.0, motor=None):
    """Crank, rod and slider in space, whose joints hold one plane: free under its weight."""
    made = Model("slider-crank", gravity=[0, -G * size, 0])
    r, rod = R * size, L * size
    made.add_body("crank", mass=2, center=[r / 2, 0, 0], inertia=[0.01 * size**2] * 3)
    made.add_body("rod", mass=1, center=[rod / 2, 0, 0], inertia=[0.02 * size**2] * 3,
                  position=[r, 0, 0])  # fmt: skip
    made.add_body("slider", mass=0.5, inertia=[0.01 * size**2] * 3, position=[r + rod, 0, 0])
    made.add_marker("crank.pin", position=[r, 0, 0])
    made.add_marker("rod.end", position=[rod, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "spherical", between=["crank.pin", "rod"])
    made.add_joint("wrist", "cylindrical", between=["rod.end", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    if motor is not None:
        made.add_driver("motor", joint="bearing", angle=motor)
    made.add_sensor("slider", "position", of="slider")
    made.add_sensor("pin", "position", of="crank.pin")
    return made


def turning_crank(size=1.0):
    made = slider_crank(size)
    made.add_force("torque", "torque", at="crank", value=[0, 0, 5 * size**2])
    return made


def slider_crank_truth(t):
    crank = Linkage(
        [2, 1, 0.5], [0.01, 0.02], [[R / 2, 0], [R, L / 2], [0, 0]], [[0], [0], [1]],
        [(0, [R, L], [-1])], -1j * G, lambda t, y, rate: np.array([5.0, 0, 0]),
    )  # fmt: skip
    angle, _, x = crank.run([0, 0, R + L], [0], [0], t)
    return {"slider.x": x, "pin.x": R * np.cos(angle), "pin.y": R * np.sin(angle)}


SPEED = 20.0


def driven_crank_truth(t):
    a = SPEED * t
    return {
        "slider.x": R * np.cos(a) + np.sqrt(L**2 - (R * np.sin(a)) ** 2), "pin.x": R * np.cos(a),
        "pin.y": R * np.sin(a),
    }  # fmt: skip


_BARS = np.array([0, 0.1 + 0.2j, 0.6 + 0.5j, 0.7])


def four_bar(size=1.0):
    """Crank, coupler and rocker let go, in a plane."""
    made = Model("four-bar", plane="xy", gravity=[0, -G * size, 0])
    ends = _BARS * size
    for k, name in enumerate(("crank", "coupler", "rocker")):
        bar = ends[k + 1] - ends[k]
        made.add_body(name, mass=k + 1, center=[abs(bar) / 2, 0, 0],
                      inertia=[0.01 * size**2] * 3, position=[ends[k].real, ends[k].imag, 0],
                      orientation={"axis": "z", "angle": np.angle(bar)})  # fmt: skip
        made.add_marker(f"{name}.end", position=[abs(bar), 0, 0])
    made.add_marker("ground.D", position=[ends[3].real, 0, 0])
    for name, between in {
        "A": ["ground", "crank"], "B": ["crank.end", "coupler"], "C": ["coupler.end", "rocker"],
        "D": ["rocker.end", "ground.D"],
    }.items():  # fmt: skip
        made.add_joint(name, "revolute", between=between, axis="z")
    made.add_sensor("B", "position", of="crank.end")
    made.add_sensor("C", "position", of="coupler.end")
    return made


def four_bar_truth(t):
    bars = np.diff(_BARS)
    a, b, c = np.abs(bars)
    arms = [[a / 2, 0, 0], [a, b / 2, 0], [a, b, c / 2]]
    made = Linkage([1, 2, 3], [0.01] * 3, arms, None, [(-_BARS[3], [a, b, c], [])], -1j * G)
    angle = made.run(np.angle(bars), [0.0], [0], t)
    B = a * np.exp(1j * angle[0])
    C = B + b * np.exp(1j * angle[1])
    return {"B.x": B.real, "B.y": B.imag, "C.x": C.real, "C.y": C.imag}


_CRANK, _ROD = 0.1, 0.4  # of the spatial slider-crank, m
_SIDE = np.array([0, 0.12, 0.1])  # middle of the crank's circle in the y-z plane


def _spatial(a):
    """Pin and its slope, slider and its slope, axes of the rod (3, 3) and their slopes."""
    pin = _SIDE + _CRANK * np.array([0 * a, np.cos(a), np.sin(a)])
    rate = _CRANK * np.array([0 * a, -np.sin(a), np.cos(a)])
    x = np.sqrt(_ROD**2 - pin[1] ** 2 - pin[2] ** 2)
    x_rate = -(pin[1] * rate[1] + pin[2] * rate[2]) / x
    along = (np.array([x, 0 * a, 0 * a]) - pin) / _ROD
    along_rate = (np.array([x_rate, 0 * a, 0 * a]) - rate) / _ROD
    # the cross of the universal joint: one axis y of the slider, the other across rod and y
    cross = np.cross(along, [0, 1, 0])
    cross_rate = np.cross(along_rate, [0, 1, 0])
    size = np.sqrt((cross * cross).sum())
    third = cross / size
    third_rate = (cross_rate - third * (third * cross_rate).sum()) / size
    second, second_rate = (
        np.cross(third, along),
        (np.cross(third_rate, along) + np.cross(third, along_rate)),
    )
    axes, rates = np.array([along, second, third]), np.array([along_rate, second_rate, third_rate])
    return pin, rate, x, x_rate, axes, rates


_ROD_INERTIA = np.array([1e-3, 8e-3, 7.5e-3])


def spatial_crank(size=1.0):
    """A crank about x, a rod on a ball and a universal joint, a slider along x, from a spin."""
    pin, _, x, _, axes, _ = _spatial(0.0)
    made = Model("spatial slider-crank", gravity=[0, 0, -G * size])
    made.add_body("crank", mass=0.5, inertia=[2e-3 * size**2] * 3, position=(size * _SIDE).tolist(),
                  angular_velocity=[6, 0, 0])  # fmt: skip
    made.add_marker("crank.pin", position=[0, _CRANK * size, 0])
    middle = (pin + [x, 0, 0]) / 2 * size
    made.add_body("rod", mass=0.6, inertia=(_ROD_INERTIA * size**2).tolist(),
                  position=middle.tolist(), orientation=axes.T.tolist())  # fmt: skip
    made.add_marker("rod.ball", position=[-_ROD / 2 * size, 0, 0])
    made.add_marker("rod.fork", position=[_ROD / 2 * size, 0, 0])
    made.add_body("slider", mass=0.8, inertia=[1e-3 * size**2] * 3, position=[x * size, 0, 0])
    made.add_marker("ground.bearing", position=(size * _SIDE).tolist())
    made.add_joint("bearing", "revolute", between=["ground.bearing", "crank"], axis="x")
    made.add_joint("ball", "spherical", between=["crank.pin", "rod.ball"])
    made.add_joint("cross", "universal", between=["slider", "rod.fork"], axis="y",
                   second_axis=axes[2].tolist())  # fmt: skip
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_sensor("slider", "position", of="slider", relative_to="ground")
    made.add_sensor("pin", "position", of="crank.pin")
    return made


def spatial_crank_truth(t):
    def inertia(a):
        _, rate, _, x_rate, axes, rates = _spatial(a)
        spin = 0.5 * np.cross(axes, rates).sum(axis=0)
        middle = (rate + np.array([x_rate, 0 * a, 0 * a])) / 2
        return (
            2e-3 + 0.6 * (middle**2).sum() + (_ROD_INERTIA * (axes @ spin) ** 2).sum()
            + 0.8 * x_rate**2
        )  # fmt: skip

    def weight(_, a, rate):
        return -0.6 * G * _spatial(a)[1][2] / 2

    a, _ = one_freedom(inertia, weight, 0.0, 6.0, t)
    y, z = _SIDE[1] + _CRANK * np.cos(a), _SIDE[2] + _CRANK * np.sin(a)
    return {"slider.x": np.sqrt(_ROD**2 - y**2 - z**2), "pin.y": y, "pin.z": z}


BEND = 0.6  # rad, between the shafts


def hooke(size=1.0):
    """Two shafts bent against each other and a universal joint: the first one driven evenly."""
    made = Model("hooke")
    second = [np.cos(BEND), np.sin(BEND), 0]
    made.add_body("first", mass=1, inertia=[0.1 * size**2] * 3)
    made.add_body("second", mass=1, inertia=[0.1 * size**2] * 3)
    made.add_joint("bearing", "revolute", between=["ground", "first"], axis="x")
    made.add_joint("end", "cylindrical", between=["ground", "second"], axis=second)
    made.add_joint("cross", "universal", between=["first", "second"], axis="z",
                   second_axis=np.cross([0, 0, 1.0], second).tolist())  # fmt: skip
    made.add_driver("motor", joint="bearing", angle="12*t")
    made.add_marker("second.rim", position=[0, 0, 0.3 * size])
    made.add_sensor("rim", "position", of="second.rim")
    return made


def hooke_truth(t):
    """tan φ₂ = tan φ₁ cos β, from where the driving shaft's pin is at right angles to both."""
    a = 12 * t
    out = np.arctan2(np.sin(a) * np.cos(BEND), np.cos(a))
    across = np.array([-np.sin(BEND), np.cos(BEND), 0])  # and z, both across the second shaft
    rim = 0.3 * (np.outer(np.cos(out), [0, 0, 1]) - np.outer(np.sin(out), across))
    return dict(zip(("rim.x", "rim.y", "rim.z"), rim.T, strict=True))


def andrews(size=1.0):
    made = load_scene(_CASES / "andrews" / "scene.toml")
    made.dynamics = None
    return made


def andrews_truth(t):
    """The seven absolute angles (Hairer & Wanner, Solving Ordinary Differential Equations II)."""
    beta, gamma, phi, delta = (
        -0.061713890014276448, 0.45527981916307037, 0.22266839016588588, 0.48736497954384256
    )  # fmt: skip
    Omega, epsilon = -0.22266839016588588, 1.2305474445498212
    rr, d, ss, e4, zt, zf, u = 0.007, 0.028, 0.035, 0.02, 0.04, 0.02, 0.04
    A, B, C = -0.06934 - 0.00227j, -0.03635 + 0.03273j, 0.014 + 0.072j
    arms = np.zeros((7, 7), complex)
    arms[0, 0] = 0.00092
    arms[1, :2] = rr, -0.0115
    arms[2, 2] = 0.01043 - 0.01874j
    arms[3, 3:5] = -0.00579j, zt
    arms[4, 4] = 0.02308 + 0.00916j
    arms[5, 5:] = 0.00579, -1j * u
    arms[6, 6] = -0.00449 - 0.01228j
    E = np.array([rr, -d, 0, 0, 0, 0, 0], complex)
    ends = [(B, [0, 0, -1j * ss, 0, 0, 0, 0]), (A, [0, 0, 0, -1j * e4, zt, 0, 0]),
            (A, [0, 0, 0, 0, 0, zf, -1j * u])]  # fmt: skip
    loops = [(at, np.array(arm) - E, []) for at, arm in ends]

    def force(_, y, rate):
        arm = (0.02 - 0.018j) * np.exp(1j * y[2])
        away = B + arm - C
        pull = -4530 * (abs(away) - 0.07785) * away / abs(away)
        return np.array([0.033, 0, (np.conj(arm) * pull).imag, 0, 0, 0, 0])

    made = Linkage(
        [0.04325, 0.00365, 0.02373, 0.00706, 0.0705, 0.00706, 0.05498],
        [2.194e-6, 4.41e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5],
        arms, None, loops, 0.0, force,
    )  # fmt: skip
    first = [beta, beta, gamma, phi + delta, delta, Omega + epsilon, epsilon]
    y = made.run(first, [0.0], [0], t)
    tip = E[0] * np.exp(1j * y[0]) + E[1] * np.exp(1j * y[1])
    return {
        "beta": y[0] - beta, "gamma": y[2] - gamma, "delta": y[4] - delta,
        "epsilon": y[6] - epsilon, "E.x": tip.real, "E.y": tip.imag,
    }  # fmt: skip


def cart_pole(size=1.0):
    """A rod held upright on a cart by its angle, its place and their speeds."""
    made = Model("cart-pole", gravity=[0, -G * size, 0], plane="xy")
    made.add_body("cart", mass=1, inertia=[0.1 * size**2] * 3)
    made.add_body("rod", mass=0.2, center=[0, 0.5 * size, 0], inertia=[0.02 * size**2] * 3,
                  orientation={"axis": "z", "angle": 0.15})  # fmt: skip
    made.add_marker("rod.tip", position=[0, size, 0])
    made.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
    made.add_joint("pin", "revolute", between=["cart", "rod"], axis="z")
    made.add_sensor("place", "stroke", joint="rail")
    made.add_sensor("speed", "stroke", joint="rail", derivative=1)
    made.add_sensor("lean", "angle", between=["cart", "rod"], axis="z")
    made.add_sensor("fall", "angle", joint="pin", derivative=1)
    made.add_sensor("tip", "position", of="rod.tip")
    held = f"{size!r}*(-40*(lean + 0.15) - 10*fall) + 2*place + 3*speed"
    made.add_force("motor", "force", at="cart", value=[held, 0, 0])
    return made


def cart_pole_truth(t):
    def motor(_, y, rate):
        lean, place = y[0] - np.pi / 2, y[1]
        return np.array([0, -40 * lean - 10 * rate[0] + 2 * place + 3 * rate[1]])

    made = Linkage([1, 0.2], [0.02], [[0], [0.5]], [[1], [1]], gravity=-1j * G, force=motor)
    angle, x = made.run([np.pi / 2 + 0.15, 0], [0, 0], [0, 1], t)
    return {"place": x, "tip.x": x + np.cos(angle), "tip.y": np.sin(angle)}


def governor(size=1.0):
    """A shaft that spins freely with two arms hinged on it, let go half open."""
    made = Model("governor", gravity=[0, 0, -G * size])
    made.add_body("shaft", mass=2, inertia=[0.05 * size**2, 0.05 * size**2, 0.02 * size**2],
                  angular_velocity=[0, 0, 9])  # fmt: skip
    made.add_joint("bearing", "revolute", between=["ground", "shaft"], axis="z")
    for name, side in (("right", 1), ("left", -1)):
        made.add_body(name, mass=0.5, center=[0, 0, -0.3 * size],
                      inertia=[0.002 * size**2, 0.002 * size**2, 0.001 * size**2],
                      orientation={"axis": "y", "angle": -side * 0.5})  # fmt: skip
        made.add_marker(f"{name}.ball", position=[0, 0, -0.3 * size])
        made.add_joint(name, "revolute", between=["shaft", name], axis="y")
        made.add_sensor(name, "position", of=f"{name}.ball")
    return made


def governor_truth(t):
    """Lagrange in the turn ψ, whose momentum is kept, and the opening θ of the arms."""
    m, arm, J, Jz, shaft = 0.5, 0.3, 0.002, 0.001, 0.02

    def about(a):
        return shaft + 2 * ((m * arm**2 + J) * np.sin(a) ** 2 + Jz * np.cos(a) ** 2)

    momentum = 9 * about(0.5)

    def slope(_, y):
        turn = momentum / about(y[1])
        rise = 2 * (m * arm**2 + J - Jz) * np.sin(y[1]) * np.cos(y[1]) * turn**2
        return [turn, y[2], (rise - 2 * m * G * arm * np.sin(y[1])) / (2 * (m * arm**2 + J))]

    turn, open_, _ = integrated(slope, [0, 0.5, 0], t)
    out, down = arm * np.sin(open_), -arm * np.cos(open_)
    found = {}
    for name, side in (("right", 1), ("left", -1)):
        found |= {f"{name}.x": side * out * np.cos(turn), f"{name}.y": side * out * np.sin(turn),
                  f"{name}.z": down}  # fmt: skip
    return found


def gears(size=1.0):
    """Two wheels, 3 : 1, the small one on a spring of torsion: it turns many times."""
    made = Model("gears", plane="xy")
    made.add_marker("ground.right", position=[0.4 * size, 0, 0])
    for name, J, at in (("large", 0.09, "ground"), ("small", 0.01, "ground.right")):
        place = [0.4 * size if name == "small" else 0.0, 0, 0]
        made.add_body(name, mass=1, inertia=[J * size**2] * 3, position=place,
                      angular_velocity=[0, 0, 20 if name == "large" else -60])  # fmt: skip
        made.add_joint(name, "revolute", between=[at, name], axis="z")
        made.add_sensor(f"{name}_angle", "angle", joint=name)
    made.add_coupler("mesh", "gear", joints=["large", "small"], teeth=[30, 10])
    made.add_force("twist", "rotational-spring-damper", joint="small", stiffness=0.2 * size**2)
    return made


def gears_truth(t):
    """(J₁/9 + J₂) φ̈ + k φ = 0."""
    w = np.sqrt(0.2 / (0.09 / 9 + 0.01))
    angle = -60 / w * np.sin(w * t)
    return {"small_angle": angle, "large_angle": -angle / 3}


def cam(size=1.0):
    """A round disk turned about a point beside its middle, under a flat follower."""
    made = Model("cam", plane="xy", gravity=[0, -G * size, 0])
    made.add_curve("disk", circle=0.05 * size, center=[0.02 * size, 0])
    made.add_body("cam", mass=1.0, inertia=[1e-3 * size**2] * 3)
    made.add_body("follower", mass=0.5, inertia=[1e-3 * size**2] * 3, position=[0, 0.05 * size, 0])
    made.add_joint("pivot", "revolute", between=["ground", "cam"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "follower"], axis="y")
    made.add_joint("contact", "cam-flat", between=["cam", "follower"], curve="disk", axis="y")
    made.add_driver("motor", joint="pivot", angle="5*t + t**2")
    made.add_sensor("lift", "position", of="follower")
    return made


def cam_truth(t):
    return {"lift.y": 0.05 + 0.02 * np.sin(5 * t + t**2)}


def cycloid(size=1.0):
    """A bead let go on an inverted cycloid (Huygens): the length from the bottom is harmonic."""
    made = Model("bead", gravity=[0, -G * size, 0], plane="xy")
    a = _CYCLOID * size
    made.add_curve("wire", x=f"{a!r}*(t - sin(t))", y=f"-{a!r}*(1 - cos(t))",
                   range=[0.2, "2*pi - 0.2"])  # fmt: skip
    at = a * np.array([_BEGIN - np.sin(_BEGIN), -1 + np.cos(_BEGIN), 0])
    made.add_body("bead", mass=0.2, inertia=[1e-4 * size**2] * 3, position=at.tolist())
    made.add_joint("wire", "point-on-curve", between=["ground", "bead"], curve="wire")
    made.add_sensor("bead", "position", of="bead")
    return made


_CYCLOID, _BEGIN = 0.1, 1.2


def cycloid_truth(t):
    a = _CYCLOID
    share = np.cos(_BEGIN / 2) * np.cos(np.sqrt(G / (4 * a)) * t)
    turn = 2 * np.arccos(share)
    return {"bead.x": a * (turn - np.sin(turn)), "bead.y": -a * (1 - np.cos(turn))}


MACHINES = {
    "slider-crank": Scene(turning_crank, 1.0, slider_crank_truth),
    "driven slider-crank": Scene(
        lambda s=1.0: slider_crank(s, f"{SPEED}*t"), 1.0, driven_crank_truth
    ),
    "four-bar": Scene(four_bar, 2.0, four_bar_truth),
    "spatial slider-crank": Scene(spatial_crank, 2.0, spatial_crank_truth),
    "Hooke's joint": Scene(hooke, 1.0, hooke_truth),
    "Andrews' mechanism": Scene(andrews, 0.03, andrews_truth, sized=False),
    "cart-pole": Scene(cart_pole, 5.0, cart_pole_truth),
    "governor": Scene(governor, 4.0, governor_truth),
    "gears": Scene(gears, 3.0, gears_truth),
    "cam": Scene(cam, 2.0, cam_truth),
    "bead on a cycloid": Scene(cycloid, 3.0, cycloid_truth),
}
