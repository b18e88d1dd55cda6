"""Scenes at rest with known equilibria and frequencies: a pendulum, masses between walls."""

from __future__ import annotations

from flexmb.model import Model

G = 9.81
FAR = (1000.0, -700.0, 300.0)


def pendulum(spin=0.0, place=(0, 0, 0), **fields):
    made = Model("pendulum", gravity=[0, -G, 0], **fields)
    made.add_marker("ground.pin", position=list(place))
    made.add_body("bar", mass=2.0, center=[0, -0.5, 0], inertia=[0.2, 0.2, 0.3],
                  position=list(place), angular_velocity=[0, 0, spin])  # fmt: skip
    made.add_joint("pin", "revolute", between=["ground.pin", "bar"], axis="z")
    return made


def chain(n=4, k=300.0, c=0.0, m=2.0, redundant=False):
    """Masses on a line between walls."""
    made = Model("chain")
    made.add_marker("ground.end", position=[n + 1.0, 0, 0])
    for i in range(n):
        made.add_body(f"m{i}", mass=m, inertia=[1, 1, 1], position=[i + 1.0, 0, 0])
        made.add_joint(f"guide{i}", "prismatic", between=["ground", f"m{i}"], axis="x")
        if redundant:
            made.add_joint(f"again{i}", "prismatic", between=["ground", f"m{i}"], axis="x")
    ends = ["ground", *(f"m{i}" for i in range(n)), "ground.end"]
    for i, pair in enumerate(zip(ends, ends[1:], strict=False)):
        made.add_force(f"spring{i}", "spring-damper", between=list(pair), stiffness=k, damping=c,
                       free_length=1.0)  # fmt: skip
    return made
