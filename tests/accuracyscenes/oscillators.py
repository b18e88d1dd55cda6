"""Masses on springs and dampers: linear, stiff, hardening, driven."""

from __future__ import annotations

import numpy as np

from flexmb.model import Model

from .scene import Scene
from .textbook import integrated


def on_rails(masses, places, size=1.0, title="masses"):
    """Masses on guides along x, each with a sensor."""
    made = Model(title)
    for k, (mass, place) in enumerate(zip(masses, places, strict=True)):
        made.add_body(f"m{k}", mass=mass, inertia=[size**2] * 3, position=[place * size, 0, 0])
        made.add_joint(f"guide{k}", "prismatic", between=["ground", f"m{k}"], axis="x")
        made.add_sensor(f"p{k}", "position", of=f"m{k}")
    return made


def linear(M, springs, stiffness, C, x, t):
    """x (n, len(t)) of M ẍ + C ẋ + Bᵀ k B x = 0 from rest at x, by the modes of the damped system.

    B are `springs` (p, n), the elongations by the places. In √k B x and Lᵀ ẋ, M = L Lᵀ, stiff
    springs spoil no digits of soft ones.
    """
    L = np.linalg.inv(np.linalg.cholesky(np.array(M, float)))
    rows = np.sqrt(np.array(stiffness, float))[:, None] * np.array(springs, float)
    p, n = rows.shape
    A = np.block([[np.zeros((p, p)), rows @ L.T], [-L @ rows.T, -L @ np.array(C, float) @ L.T]])
    values, vectors = np.linalg.eig(A)
    share = np.linalg.solve(vectors, np.concatenate([rows @ np.array(x, float), np.zeros(n)]))
    s = ((vectors * share) @ np.exp(np.outer(values, t))).real[:p]
    return np.linalg.lstsq(rows, s, rcond=None)[0]


def oscillator(size=1.0):
    made = on_rails([1], [1.0], size)
    made.add_force("spring", "spring-damper", between=["ground", "m0"], stiffness=100, damping=0.2,
                   free_length=0.9 * size)  # fmt: skip
    return made


def oscillator_truth(t):
    w = np.sqrt(100 - 0.01)
    return {"p0.x": 0.9 + 0.1 * np.exp(-0.1 * t) * (np.cos(w * t) + 0.1 / w * np.sin(w * t))}


def undamped(size=1.0):
    made = on_rails([1], [1.0], size)
    made.add_force("spring", "spring-damper", between=["ground", "m0"], stiffness=100,
                   free_length=0.9 * size)  # fmt: skip
    return made


def undamped_truth(t):
    return {"p0.x": 0.9 + 0.1 * np.cos(10 * t)}


def micron(size=1.0):
    """A swing of 1 µm about a place 1 m away."""
    made = on_rails([1], [1.0], size)
    made.add_force("spring", "spring-damper", between=["ground", "m0"], stiffness=400,
                   free_length=(1 - 1e-6) * size)  # fmt: skip
    return made


def micron_truth(t):
    rest = 1 - 1e-6
    return {"p0.x": rest + (1.0 - rest) * np.cos(20 * t)}


def shaken(size=1.0):
    """A mass at rest, pulled harmonically near its resonance."""
    made = on_rails([2], [1.0], size)
    made.add_force("spring", "spring-damper", between=["ground", "m0"], stiffness=200, damping=2)
    made.add_force("pull", "force", at="m0", value=[f"{5 * size!r}*sin(9*t)", 0, 0])
    return made


def shaken_truth(t):
    """m ẍ + c ẋ + k x = F sin Ωt from rest."""
    m, c, k, F, W = 2.0, 2.0, 200.0, 5.0, 9.0
    forced = F / (k - m * W * W + 1j * c * W)  # of exp(iΩt)
    root = (-c + np.sqrt(complex(c * c - 4 * m * k))) / (2 * m)
    x0, v0 = -forced.imag, -(1j * W * forced).imag
    share = x0 / 2 + (v0 - root.real * x0) / (2j * root.imag)
    free = 2 * (share * np.exp(root * t)).real
    return {"p0.x": 1.0 + (forced * np.exp(1j * W * t)).imag + free}


N_CHAIN = 10


def spring_chain(size=1.0):
    """Ten masses in a row between walls, the first one let go 1 cm from rest."""
    places = [1.0 + k for k in range(N_CHAIN)]
    places[0] += 0.01
    made = on_rails([1] * N_CHAIN, places, size)
    for k in range(N_CHAIN):
        ends = [f"m{k - 1}" if k else "ground", f"m{k}"]
        made.add_force(f"k{k}", "spring-damper", between=ends, stiffness=900,
                       free_length=size)  # fmt: skip
    made.add_marker("ground.wall", position=[(N_CHAIN + 1) * size, 0, 0])
    made.add_force("last", "spring-damper", between=[f"m{N_CHAIN - 1}", "ground.wall"],
                   stiffness=900, free_length=size)  # fmt: skip
    return made


def spring_chain_truth(t):
    n = N_CHAIN
    springs = np.eye(n + 1, n) - np.eye(n + 1, n, k=-1)
    none = np.zeros((n, n))
    x = linear(np.eye(n), springs, [900] * (n + 1), none, [0.01] + [0] * (n - 1), t)
    return {f"p{k}.x": 1.0 + k + x[k] for k in range(n)}


def stiff_spring(size=1.0):
    """Two masses held together by 1e8 N/m, slowly swinging on 100 N/m."""
    made = on_rails([1, 1], [1.0, 2.0], size)
    made.add_force("soft", "spring-damper", between=["ground", "m0"], stiffness=100,
                   free_length=0.9 * size)  # fmt: skip
    made.add_force("stiff", "spring-damper", between=["m0", "m1"], stiffness=1e8, damping=100,
                   free_length=size)  # fmt: skip
    return made


def stiff_spring_truth(t):
    C = [[100, -100], [-100, 100]]
    x = linear(np.eye(2), [[1, 0], [-1, 1]], [100, 1e8], C, [0.1, 0.1], t)
    return {"p0.x": 0.9 + x[0], "p1.x": 1.9 + x[1]}


def stiff_damper(size=1.0):
    """A dashpot of 1e6 N s/m, on whose far end a spring pulls, beside a swing."""
    made = on_rails([1, 1], [1.0, 2.0], size)
    made.add_force("spring", "spring-damper", between=["ground", "m0"], stiffness=100, damping=1,
                   free_length=0.9 * size)  # fmt: skip
    made.add_force("dashpot", "spring-damper", between=["m0", "m1"], damping=1e6,
                   free_length=size)  # fmt: skip
    made.add_marker("ground.wall", position=[3 * size, 0, 0])
    made.add_force("far", "spring-damper", between=["m1", "ground.wall"], stiffness=50,
                   free_length=size)  # fmt: skip
    return made


def stiff_damper_truth(t):
    C = [[1e6 + 1, -1e6], [-1e6, 1e6]]
    x = linear(np.eye(2), np.eye(2), [100, 50], C, [0.1, 0.0], t)
    return {"p0.x": 0.9 + x[0], "p1.x": 2.0 + x[1]}


def duffing(size=1.0):
    """A spring that hardens, driven."""
    made = on_rails([1], [1.0], size)
    made.add_force("spring", "translational-spring-damper", joint="guide0",
                   spring_force=f"4*x + {40 / size**2!r}*x**3", damping=0.1, free=size)  # fmt: skip
    made.add_force("pull", "force", at="m0", value=[f"{3 * size!r}*cos(2.5*t)", 0, 0])
    return made


def duffing_truth(t):
    x, _ = integrated(
        lambda t, y: [y[1], 3 * np.cos(2.5 * t) - 0.1 * y[1] - 4 * y[0] - 40 * y[0] ** 3], [0, 0], t
    )
    return {"p0.x": 1.0 + x}


def rotor(size=1.0):
    """A rotor of 1 m turned from rest, and beside it a mass that swings by 0.2 mm."""
    made = Model("rotor")
    made.add_body("rotor", mass=5, inertia=[size**2, size**2, 2 * size**2])
    made.add_marker("rotor.rim", position=[size, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "rotor"], axis="z")
    made.add_force("torque", "torque", at="rotor", value=[0, 0, 4 * size**2])
    made.add_body("small", mass=1, inertia=[size**2] * 3, position=[1e-4 * size, 0, size])
    made.add_marker("ground.high", position=[0, 0, size])
    made.add_joint("guide", "prismatic", between=["ground.high", "small"], axis="x")
    made.add_force("spring", "translational-spring-damper", joint="guide", stiffness=400)
    made.add_sensor("rim", "position", of="rotor.rim")
    made.add_sensor("small", "position", of="small")
    return made


def rotor_truth(t):
    return {
        "rim.x": np.cos(t**2), "rim.y": np.sin(t**2), "small.x": 1e-4 * np.cos(20 * t),
    }  # fmt: skip


OSCILLATORS = {
    "oscillator": Scene(oscillator, 5.0, oscillator_truth),
    "mass on a spring": Scene(undamped, 5.0, undamped_truth),
    "swing of 1 µm at 1 m": Scene(micron, 3.0, micron_truth),
    "mass shaken from rest": Scene(shaken, 10.0, shaken_truth),
    "chain of springs": Scene(spring_chain, 3.0, spring_chain_truth),
    "stiff spring beside a slow swing": Scene(stiff_spring, 2.0, stiff_spring_truth, stiff=True),
    "stiff damper": Scene(stiff_damper, 3.0, stiff_damper_truth, stiff=True),
    "Duffing's spring": Scene(duffing, 10.0, duffing_truth),
    "rotor": Scene(rotor, 3.0, rotor_truth),
}
