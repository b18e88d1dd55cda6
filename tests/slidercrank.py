"""A slider-crank with a bending rod, moved by closed-form kinematics: a result without a run.

Crank r, rod l, in the x-y plane; the rod is a prismatic bar whose surface bends in the first mode
of a free beam's half sine, with an amplitude that follows the crank.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexmb.flexbody import FlexBody, Interface, ModeInfo, Surface, save
from flexmb.model import Model
from flexmb.results.output_block import OutputBlock
from flexmb.results.writer import ResultWriter

R, L, SPEED = 0.15, 0.56, 2 * np.pi * 25  # m, m, rad/s
_AMPLITUDE = 40e-6  # m, of the half sine
_BAR = (0.03, 0.012)  # m, height and width of the bar


def bent_bar(n: int = 40, m: int = 1) -> FlexBody:
    """A bar of 4 n + 4 nodes from (0, 0, 0) to (L, 0, 0); modes: half sines in y, one metre high.

    Only the first moves mass.
    """
    x = np.linspace(0.0, L, n + 1)
    ring = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * _BAR
    points = np.array([[xi, y, z] for xi in x for y, z in ring])
    quads = [
        [4 * i + k, 4 * i + (k + 1) % 4, 4 * i + 4 + (k + 1) % 4, 4 * i + 4 + k]
        for i in range(n)
        for k in range(4)
    ] + [[3, 2, 1, 0], [4 * n, 4 * n + 1, 4 * n + 2, 4 * n + 3]]
    faces = np.array([corners for a, b, c, d in quads for corners in ([a, c, b], [a, d, c])])
    modes = np.zeros((len(points), 3, m))
    waves = np.arange(1, m + 1)
    modes[:, 1, :] = np.sin(np.pi * np.outer(points[:, 0] / L, waves))
    ends = (("big_end", 0.0, 1.0), ("small_end", L, -1.0))
    mass = 1.6
    J = np.diag([1e-4, mass * L**2 / 3, mass * L**2 / 3])
    p, P = np.zeros((3, m)), np.zeros((3, 3, m))
    P[0, 1, 0] = mass * L / np.pi
    p[1, 0] = 2 * mass / np.pi
    Mab = np.zeros((3, 3, m, m))
    Mab[1, 1] = 0.5 * mass * np.eye(m)
    return FlexBody(
        name="rod",
        mass=mass,
        S1=np.array([mass * L / 2, 0, 0]),
        S0=0.5 * np.trace(J) * np.eye(3) - J,
        p=p,
        P=P,
        Mab=Mab,
        K=1e8 * np.diag(waves**4.0),
        interfaces=tuple(
            Interface(
                name,
                np.array([x, 0.0, 0.0]),
                np.zeros((3, m)),
                np.outer([0.0, 0.0, np.pi / L], waves * turn**waves),
            )
            for name, x, turn in ends
        ),
        modes=tuple(
            ModeInfo(k, "elastic", 1779.0 * (k + 1) ** 2, True, "chosen") for k in range(m)
        ),
        surface=Surface(points, faces, np.zeros((0, 2), dtype=int), modes, np.arange(len(points))),
    )


def scene() -> dict[str, Any]:
    """The scene of the result."""
    return {
        "title": "Slider-crank with a flexible connecting rod",
        "bodies": {
            "crank": {
                "mass": 1.0,
                "inertia": [1e-4, 2e-3, 2e-3],
                "center": [R / 2, 0, 0],
                "markers": {"tip": {"position": [R, 0, 0]}},
            },
            "rod": {"flexbody": "rod.flexbody.h5", "position": [R, 0, 0]},
            "slider": {
                "shape": {"type": "box", "size": [0.09, 0.06, 0.05]},
                "mass": 0.5,
                "position": [R + L, 0, 0],
            },
        },
        "joints": {
            "main_bearing": {"type": "revolute", "between": ["ground", "crank"], "axis": "z"},
            "crank_pin": {"type": "revolute", "between": ["crank.tip", "rod.big_end"], "axis": "z"},
            "wrist_pin": {"type": "revolute", "between": ["rod.small_end", "slider"], "axis": "z"},
            "guide": {"type": "prismatic", "between": ["ground", "slider"], "axis": "x"},
        },
        "sensors": {
            "slider": {"type": "position", "of": "slider"},
            "speed": {"type": "velocity", "of": "slider"},
            "crank_angle": {"type": "angle", "joint": "main_bearing"},
        },
        "view": {"time": 0.0133, "history": ["slider.x", "speed.x", "crank_angle"]},
    }


def _about_z(angle: np.ndarray) -> np.ndarray:
    zero = np.zeros_like(angle)
    return np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=1)


def rows(t: np.ndarray, layout: Any) -> OutputBlock:
    """Two revolutions in closed form."""
    turn = SPEED * t
    rod = -np.arcsin(R * np.sin(turn) / L)
    x = R * np.cos(turn) + L * np.cos(rod)
    zero = np.zeros_like(t)
    eta = _AMPLITUDE * np.sin(turn) * (1 + 0.3 * np.sin(7 * turn))
    at = np.stack([zero, zero, zero], axis=1)
    tip = np.stack([R * np.cos(turn), R * np.sin(turn), zero], axis=1)
    end = np.stack([x, zero, zero], axis=1)
    eta = np.outer(eta, np.arange(1, layout.bodies[1].m + 1) ** -4.0)
    q = np.hstack([
        at, _about_z(turn), tip, _about_z(rod), eta, end, _about_z(zero)
    ])  # fmt: skip
    speed = -R * SPEED * np.sin(turn) * (1 + R * np.cos(turn) / (L * np.cos(rod)))
    sensors = np.stack([x, zero, zero, speed, zero, zero, turn], axis=1)
    n = len(t)
    return OutputBlock(
        t=t,
        q=q,
        v=np.zeros((n, layout.nv)),
        vd=np.zeros((n, layout.nv)),
        lam=np.zeros((n, layout.nc)),
        reactions=np.zeros((n, 12 * len(layout.reactions))),
        sensors=sensors,
        energy=np.full((n, len(layout.energies)), 0.5),
        drift=np.zeros((n, 2)),
    )


def make(folder: Path, n: int = 40, m: int = 1) -> Path:
    """Write rod.flexbody.h5 and result.h5 into `folder`; the path of the result.

    The rod has 4 n + 4 nodes and m modes.
    """
    from resultfiles import FakeBody, FakeLayout

    folder.mkdir(parents=True, exist_ok=True)
    save(bent_bar(n, m), folder / "rod.flexbody.h5")
    model = Model.from_scene_dict(scene(), folder)
    layout = FakeLayout(
        bodies=(
            FakeBody("crank", 0, 0, 0),
            FakeBody("rod", 7, 6, m),
            FakeBody("slider", 14 + m, 12 + m, 0),
        ),
        nq=21 + m,
        nv=18 + m,
        nc=0,
        rows=(),
        channels=model.channels(),
    )
    with ResultWriter(
        folder / "result.h5",
        layout,
        201,
        scene=model.to_scene_dict(),
        flexbodies={"rod": "rod.flexbody.h5"},
    ) as out:
        out.append(rows(np.linspace(0.0, 2 * 2 * np.pi / SPEED, 201), layout))
        out.finish({"steps": 8000}, "finished")
    return out.path
