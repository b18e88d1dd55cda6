"""Planar linkages for kinematic analyses and assembly."""

from __future__ import annotations

import numpy as np

from flexmb.model import Model


def turned(angle):
    """Axes turned about z."""
    c, s = np.cos(angle), np.sin(angle)
    return [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]


def bar(made, name, length, start=(0.0, 0.0), angle=0.0):
    """A bar of 1 kg/m from `start` at an angle, with the marker `end`."""
    made.add_body(
        name, mass=length, center=[length / 2, 0, 0],
        inertia=[1e-3 * length, length**3 / 12, length**3 / 12],
        position=[*start, 0.0], orientation=turned(angle),
    )  # fmt: skip
    made.add_marker(f"{name}.end", position=[length, 0, 0])


def four_bar(lengths, angles, plane="xy", units="SI"):
    """Crank, coupler, rocker on a frame along x, placed at the angles of the three bars [rad]."""
    a, b, c, d = lengths
    made = Model("four-bar", plane=plane, units=units)
    made.add_marker("ground.right", position=[d, 0, 0])
    one, two, three = angles
    bar(made, "crank", a, (0.0, 0.0), one)
    bar(made, "coupler", b, (a * np.cos(one), a * np.sin(one)), two)
    bar(made, "rocker", c, (d, 0.0), three)
    made.add_joint("left", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("right", "revolute", between=["ground.right", "rocker"], axis="z")
    made.add_joint("crank_pin", "revolute", between=["crank.end", "coupler"], axis="z")
    made.add_joint("rocker_pin", "revolute", between=["coupler.end", "rocker.end"], axis="z")
    return made


def four_bar_angles(lengths, crank, branch=1):
    """Angles of coupler and rocker for crank angles, by Freudenstein's equation.

    K1 cos φ − K2 cos θ + K3 = cos(θ − φ), K1 = d/a, K2 = d/c, K3 = (a² − b² + c² + d²)/(2ac), by
    the half-angle tangent (Norton, Design of Machinery, section 4.5).
    """
    a, b, c, d = lengths
    K1, K2, K3 = d / a, d / c, (a * a - b * b + c * c + d * d) / (2 * a * c)
    A = np.cos(crank) - K1 - K2 * np.cos(crank) + K3
    B, C = -2.0 * np.sin(crank), K1 - (K2 + 1) * np.cos(crank) + K3
    rocker = 2.0 * np.arctan2(-B - branch * np.sqrt(B * B - 4 * A * C), 2 * A)
    coupler = np.arctan2(
        c * np.sin(rocker) - a * np.sin(crank), d + c * np.cos(rocker) - a * np.cos(crank)
    )
    return coupler, rocker


def slider_crank(r, l, crank=0.5, plane="xy"):  # noqa: E741
    """Crank, rod and slider along x, placed at a crank angle; nothing is driven yet."""
    made = Model("slider-crank", plane=plane)
    beta = -np.arcsin(r * np.sin(crank) / l)
    bar(made, "crank", r, (0.0, 0.0), crank)
    bar(made, "rod", l, (r * np.cos(crank), r * np.sin(crank)), beta)
    x = r * np.cos(crank) + l * np.cos(beta)
    made.add_body("slider", mass=1.0, inertia=[1e-3] * 3, position=[x, 0, 0])
    made.add_joint("main", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "revolute", between=["crank.end", "rod"], axis="z")
    made.add_joint("wrist", "revolute", between=["rod.end", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    return made


class Kept:
    """A sink that remembers; it may interrupt at a chosen append."""

    def __init__(self, interrupt_at=None):
        self.blocks, self.interrupt_at = [], interrupt_at

    def append(self, block):
        self.blocks.append(block)
        if len(self.blocks) == self.interrupt_at:
            raise KeyboardInterrupt

    def __getitem__(self, name):
        return np.concatenate([getattr(block, name) for block in self.blocks])


def swept(made, **fields):
    """Outcome, rows and channels of a kinematic analysis."""
    from flexmb.analysis.kinematics import kinematics
    from flexmb.engine.compile import compile_system

    if fields:
        made.set_kinematics(**fields)
    compiled, sink = compile_system(made), Kept()
    outcome = kinematics(compiled, made, sink)
    columns = {}
    if sink.blocks:
        columns = dict(zip(compiled.layout.channels, sink["sensors"].T, strict=True))
    return outcome, sink, columns
