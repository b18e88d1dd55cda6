"""Orbits: forces by expressions over distances."""

from __future__ import annotations

import numpy as np
from scipy.optimize import newton

from flexmb.model import Model

from .scene import Scene
from .textbook import integrated


def kepler(e):
    """Scene of an orbit about the origin with a = 1 m and G M = 1 m³/s², and its solution."""

    def make(size=1.0):
        made = Model("kepler", plane="xy")
        made.add_body("m", mass=1, inertia=[1, 1, 1], position=[(1 - e) * size, 0, 0],
                      velocity=[0, np.sqrt((1 + e) / (1 - e)) * size, 0])  # fmt: skip
        made.add_sensor("m", "position", of="m", relative_to="ground")
        made.add_sensor("r", "distance", between=["ground", "m"])
        GM = f"{size**3!r}"
        made.add_force("pull", "force", at="m", value=[f"-{GM}*m.x/r**3", f"-{GM}*m.y/r**3", 0])
        return made

    def truth(t):
        """Kepler's equation for the eccentric anomaly."""
        mean = np.mod(t + np.pi, 2 * np.pi) - np.pi
        E = np.array([newton(lambda E, m=m: E - e * np.sin(E) - m, m + 0.85 * e * np.sign(m),
                             lambda E: 1 - e * np.cos(E), tol=1e-14, maxiter=100)
                      for m in mean])  # fmt: skip
        x, y = np.cos(E) - e, np.sqrt(1 - e * e) * np.sin(E)
        return {"m.x": x, "m.y": y, "r": 1 - e * np.cos(E)}

    return make, truth


# Three equal masses on one path in the shape of an eight (Chenciner & Montgomery, 2000).
_PLACES = np.array([[0.97000436, -0.24308753], [-0.97000436, 0.24308753], [0.0, 0.0]])
_SPEED = np.array([-0.93240737, -0.86473146])
_SPEEDS = np.array([-_SPEED / 2, -_SPEED / 2, _SPEED])


def eight(size=1.0):
    made = Model("eight", plane="xy")
    for k in range(3):
        made.add_body(f"m{k}", mass=1, inertia=[1, 1, 1],
                      position=[*(size * _PLACES[k]).tolist(), 0],
                      velocity=[*(size * _SPEEDS[k]).tolist(), 0])  # fmt: skip
        made.add_sensor(f"p{k}", "position", of=f"m{k}")
    for k, j in ((0, 1), (1, 2), (2, 0)):
        made.add_sensor(f"d{k}{j}", "distance", between=[f"m{k}", f"m{j}"])
        made.add_force(f"f{k}{j}", "line-force", between=[f"m{k}", f"m{j}"],
                       value=f"-{size**3!r}/d{k}{j}**2")  # fmt: skip
    return made


def eight_truth(t):
    def slope(_, y):
        z, rate = y[:3], y[3:]
        apart = z[:, None] - z[None, :]
        far = np.abs(apart) + np.eye(3)
        return np.concatenate([rate, -(apart / far**3).sum(axis=1)])

    first = np.concatenate([_PLACES @ [1, 1j], _SPEEDS @ [1, 1j]])
    z = integrated(slope, first, t)[:3]
    found = {f"p{k}.x": z[k].real for k in range(3)} | {f"p{k}.y": z[k].imag for k in range(3)}
    return found | {f"d{k}{j}": np.abs(z[k] - z[j]) for k, j in ((0, 1), (1, 2), (2, 0))}


_HALF = 0.05  # of the length of the orbit's radius


def dumbbell(size=1.0):
    """Two masses on a bar in an orbit: the gradient of the pull turns it."""
    made = Model("dumbbell", plane="xy")
    made.add_body("bar", mass=1, inertia=[_HALF**2 * size**2] * 3, position=[size, 0, 0],
                  velocity=[0, 1.05 * size, 0], angular_velocity=[0, 0, 0.4],
                  orientation={"axis": "z", "angle": 0.6})  # fmt: skip
    for name, side in (("one", 1), ("two", -1)):
        made.add_marker(f"bar.{name}", position=[side * _HALF * size, 0, 0])
        made.add_sensor(f"{name}", "position", of=f"bar.{name}", relative_to="ground")
        made.add_sensor(f"r_{name}", "distance", between=["ground", f"bar.{name}"])
        pull = f"-{0.5 * size**3!r}"
        made.add_force(f"pull_{name}", "force", at=f"bar.{name}",
                       value=[f"{pull}*{name}.{x}/r_{name}**3" for x in "xy"] + [0])  # fmt: skip
    made.add_sensor("turned", "angle", between=["ground", "bar"], axis="z")
    return made


def dumbbell_truth(t):
    def slope(_, y):
        z, angle = y[0] + 1j * y[1], y[2]
        arm = _HALF * np.exp(1j * angle)
        pulls = [-0.5 * p / abs(p) ** 3 for p in (z + arm, z - arm)]
        a, turn = sum(pulls), (np.conj(arm) * (pulls[0] - pulls[1])).imag
        return [*y[3:], a.real, a.imag, turn / _HALF**2]

    y = integrated(slope, [1.0, 0.0, 0.6, 0.0, 1.05, 0.4], t)
    z, arm = y[0] + 1j * y[1], _HALF * np.exp(1j * y[2])
    return {
        "one.x": (z + arm).real, "one.y": (z + arm).imag, "two.x": (z - arm).real,
        "two.y": (z - arm).imag, "turned": y[2] - 0.6,
    }  # fmt: skip


_round, _oval, _comet = kepler(0.1), kepler(0.6), kepler(0.9)

ORBITS = {
    "orbit, e = 0.1": Scene(_round[0], 20.0, _round[1]),
    "orbit, e = 0.6": Scene(_oval[0], 20.0, _oval[1]),
    "orbit, e = 0.9": Scene(_comet[0], 20.0, _comet[1]),
    "three bodies on an eight": Scene(eight, 6.0, eight_truth),
    "satellite turned by gravity": Scene(dumbbell, 12.0, dumbbell_truth),
}
