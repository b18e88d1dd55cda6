"""Held-out scenes: linkages in space and of six bars, a gyroscope in rings."""

from __future__ import annotations

import numpy as np

from flexmb.model import Model

from .scene import Scene
from .textbook import Linkage, integrated, one_freedom

G = 9.81
_CRANK, _ARM, _FIRST = 0.1, 0.25, 1.2
_PIVOT = np.array([0.1, -0.3, 0.0])
_BALLS = [np.array([_CRANK, 0, 0]),
          _PIVOT + _ARM * np.array([0, np.cos(_FIRST), np.sin(_FIRST)])]  # fmt: skip
_BAR = float(np.linalg.norm(_BALLS[1] - _BALLS[0]))


def spatial(size=1.0):
    """A crank about z, a rocker about x, a coupler on two balls, with a torque from rest (RSSR)."""
    area = size**2
    along = (_BALLS[1] - _BALLS[0]) / _BAR
    across = np.cross([0, 0, 1.0], along)
    across /= np.linalg.norm(across)
    axes = np.array([along, across, np.cross(along, across)]).T
    model = Model("spatial four-bar", gravity=[0, 0, -G * size])
    model.add_body("crank", mass=1, inertia=[0.02 * area] * 3)
    model.add_marker("crank.ball", position=[_CRANK * size, 0, 0])
    model.add_body("bar", mass=0.6, inertia=[1e-4 * area, 6e-3 * area, 6e-3 * area],
                   position=(size * (_BALLS[0] + _BALLS[1]) / 2).tolist(),
                   orientation=axes.tolist())  # fmt: skip
    for name, side in (("begin", -0.5), ("end", 0.5)):
        model.add_marker(f"bar.{name}", position=[side * _BAR * size, 0, 0])
    model.add_body("rocker", mass=1, inertia=[0.03 * area] * 3, position=(size * _PIVOT).tolist())
    model.add_marker("ground.pivot", position=(size * _PIVOT).tolist())
    model.add_marker("rocker.ball", position=(size * (_BALLS[1] - _PIVOT)).tolist())
    model.add_joint("crank", "revolute", between=["ground", "crank"], axis="z")
    model.add_joint("rocker", "revolute", between=["ground.pivot", "rocker"], axis="x")
    model.add_joint("first", "spherical", between=["crank.ball", "bar.begin"])
    model.add_joint("second", "spherical", between=["bar.end", "rocker.ball"])
    model.add_force("torque", "torque", at="crank", value=[0, 0, 0.8 * area])
    model.add_sensor("crank", "position", of="crank.ball")
    model.add_sensor("rocker", "position", of="rocker.ball")
    return model


def _rocker(a):
    """Angle of the rocker and its slope by that of the crank."""
    P, Q = _PIVOT[1] - _CRANK * np.sin(a), _PIVOT[2]
    gap = _PIVOT[0] - _CRANK * np.cos(a)
    S = (_BAR**2 - gap**2 - P**2 - Q**2 - _ARM**2) / (2 * _ARM)  # P cos β + Q sin β
    b = 2 * np.arctan((Q - np.sqrt(P**2 + Q**2 - S**2)) / (P + S))
    P_rate = -_CRANK * np.cos(a)
    S_rate = -(gap * _CRANK * np.sin(a) + P * P_rate) / _ARM
    return b, (S_rate - P_rate * np.cos(b)) / (Q * np.cos(b) - P * np.sin(b))


def spatial_truth(t):
    """The bar, whose inertia is round, does not spin about itself."""

    def rates(a):
        b, slope = _rocker(a)
        first = _CRANK * np.array([-np.sin(a), np.cos(a), 0 * a])
        return first, slope * _ARM * np.array([0 * a, -np.sin(b), np.cos(b)]), slope

    def inertia(a):
        first, second, slope = rates(a)
        middle, turn = (first + second) / 2, (second - first) / _BAR
        return 0.02 + 0.6 * (middle**2).sum() + 6e-3 * (turn**2).sum() + 0.03 * slope**2

    def force(_, a, w):
        first, second, _ = rates(a)
        return 0.8 - 0.6 * G * (first[2] + second[2]) / 2

    a, _ = one_freedom(inertia, force, 0.0, 0.0, t)
    b, _ = _rocker(a)
    return {
        "crank.x": _CRANK * np.cos(a), "crank.y": _CRANK * np.sin(a),
        "rocker.y": _PIVOT[1] + _ARM * np.cos(b), "rocker.z": _ARM * np.sin(b),
    }  # fmt: skip


_PINS = {
    "A": 0.1j, "B": 0.35 + 0.3j, "P": 0.15 + 0.45j, "Q": 0.45 + 0.65j, "B0": 0.4, "C0": 0.75 + 0.2j,
}  # fmt: skip
_BARS = {  # from, to, mass
    "crank": ("A0", "A", 0.5), "coupler": ("A", "B", 1.0), "rocker": ("B0", "B", 0.8),
    "link": ("P", "Q", 0.6), "lever": ("C0", "Q", 1.5),
}  # fmt: skip
_PINS["A0"] = 0j
_INERTIA = 0.01


def six_bar(size=1.0):
    """Stephenson's linkage of six bars, from rest by a torque on the crank."""
    model = Model("Stephenson's linkage", plane="xy", gravity=[0, -G * size, 0])

    def vector(z):
        return [z.real * size, z.imag * size, 0]

    for name, (begin, end, mass) in _BARS.items():
        bar = _PINS[end] - _PINS[begin]
        model.add_body(name, mass=mass, center=vector(bar / 2), inertia=[_INERTIA * size**2] * 3,
                       position=vector(_PINS[begin]))  # fmt: skip
        model.add_marker(f"{name}.end", position=vector(bar))
    for pin in ("B0", "C0"):
        model.add_marker(f"ground.{pin}", position=vector(_PINS[pin]))
    model.add_marker("coupler.P", position=vector(_PINS["P"] - _PINS["A"]))
    for name, between in {
        "A0": ["ground", "crank"], "A": ["crank.end", "coupler"], "B0": ["ground.B0", "rocker"],
        "B": ["coupler.end", "rocker.end"], "C0": ["ground.C0", "lever"],
        "P": ["coupler.P", "link"], "Q": ["link.end", "lever.end"],
    }.items():  # fmt: skip
        model.add_joint(name, "revolute", between=between, axis="z")
    model.add_force("torque", "torque", at="crank", value=[0, 0, 3 * size**2])
    for name, of in (("A", "crank.end"), ("P", "coupler.P"), ("Q", "lever.end")):
        model.add_sensor(name, "position", of=of)
    return model


def six_bar_truth(t):
    bar = {name: _PINS[end] - _PINS[begin] for name, (begin, end, _) in _BARS.items()}
    a, b, c, d, e = (bar[name] for name in _BARS)
    to_P = _PINS["P"] - _PINS["A"]
    arms = [[a / 2, 0, 0, 0, 0], [a, b / 2, 0, 0, 0], [0, 0, c / 2, 0, 0], [a, to_P, 0, d / 2, 0],
            [0, 0, 0, 0, e / 2]]  # fmt: skip
    loops = [(-_PINS["B0"], [a, b, -c, 0, 0], []), (-_PINS["C0"], [a, to_P, 0, d, -e], [])]
    masses = [mass for _, _, mass in _BARS.values()]
    linkage = Linkage(masses, [_INERTIA] * 5, arms, None, loops, -1j * G,
                      lambda t, y, rate: np.array([3.0, 0, 0, 0, 0]))  # fmt: skip
    turn = np.exp(1j * linkage.run(np.zeros(5), [0.0], [0], t))
    A = a * turn[0]
    channels = {}
    for name, z in (("A", A), ("P", A + to_P * turn[1]), ("Q", _PINS["C0"] + e * turn[4])):
        channels |= {f"{name}.x": z.real, f"{name}.y": z.imag}
    return channels


_OUTER, _INNER, _WHEEL = 0.02, (0.008, 0.01, 0.012), (0.01, 0.01, 0.018)
_MASS, _HEIGHT, _LEAN, _SPIN = 1.5, 0.04, 1.0, 120.0


def gimbals(size=1.0):
    """A heavy gyroscope in two rings: the outer one turns about z, the inner one about x."""
    area = size**2
    tilt = {"axis": "x", "angle": _LEAN}
    axis = np.array([0, -np.sin(_LEAN), np.cos(_LEAN)])
    model = Model("gimbals", gravity=[0, 0, -G * size])
    model.add_body("outer", mass=0.5, inertia=[_OUTER * area] * 3)
    model.add_body("inner", mass=0.4, inertia=[J * area for J in _INNER], orientation=tilt)
    model.add_body("wheel", mass=_MASS, center=[0, 0, _HEIGHT * size],
                   inertia=[J * area for J in _WHEEL], orientation=tilt,
                   angular_velocity=(_SPIN * axis).tolist())  # fmt: skip
    model.add_joint("vertical", "revolute", between=["ground", "outer"], axis="z")
    model.add_joint("nodes", "revolute", between=["outer", "inner"], axis="x")
    model.add_joint("spin", "revolute", between=["inner", "wheel"], axis=axis.tolist())
    model.add_marker("inner.pole", position=[0, 0, 0.2 * size])
    model.add_marker("wheel.rim", position=[0.1 * size, 0, 0])
    model.add_sensor("pole", "position", of="inner.pole")
    model.add_sensor("rim", "position", of="wheel.rim")
    return model


def gimbals_truth(t):
    """Magnus, Kreisel, §8: ψ and φ are cyclic, so that θ alone is left of Lagrange's equations."""
    A, C = _WHEEL[0] + _MASS * _HEIGHT**2, _WHEEL[2]
    across, up = _INNER[1] + A, _INNER[2]
    H = C * _SPIN
    first = H * np.cos(_LEAN)

    def slope(_, y):
        s, c = np.sin(y[2]), np.cos(y[2])
        turn = (first - H * c) / (_OUTER + across * s * s + up * c * c)
        lean = (across - up) * s * c * turn**2 - H * turn * s + _MASS * G * _HEIGHT * s
        return [turn, _SPIN - turn * c, y[3], lean / (_INNER[0] + A)]

    a, spin, lean, _ = integrated(slope, [0, 0, _LEAN, 0], t)
    nodes = np.array([np.cos(a), np.sin(a), 0 * a])
    aside = np.array([-np.sin(a) * np.cos(lean), np.cos(a) * np.cos(lean), np.sin(lean)])
    pole = 0.2 * np.array([np.sin(a) * np.sin(lean), -np.cos(a) * np.sin(lean), np.cos(lean)])
    rim = 0.1 * (nodes * np.cos(spin) + aside * np.sin(spin))
    return {f"{name}.{x}": r[k] for name, r in (("pole", pole), ("rim", rim))
            for k, x in enumerate("xyz")}  # fmt: skip


LINKAGES = {
    "spatial four-bar": Scene(spatial, 2.0, spatial_truth),
    "Stephenson's linkage": Scene(six_bar, 1.0, six_bar_truth),
    "gimbals": Scene(gimbals, 2.0, gimbals_truth),
}
