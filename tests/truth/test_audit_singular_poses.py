"""Small motions about a run through a pose that rigid bodies could not pass."""

from __future__ import annotations

import numpy as np
import pytest

import flexmb
from flexmb.analysis.effects.contribution import estimate
from flexmb.engine.compile import compile_system
from flexmb.model import Model
from flexmb.workflow.neighbours import ModelVariants

PIN, HEAVIER = 2.0, 1.0 + 1e-4  # kg of a pin; its mass in the other model
REACH = 0.5  # m, of a rod
AXES = ("pin.x", "pin.y")


def five_bar(size, pin=PIN):
    """Two flexible cranks, driven apart to 1/1000 beyond the reach of the two rigid rods.

    `size` is that of all lengths and times: the deformations over the lengths are the same.
    """
    made = Model("five-bar", plane="xy")
    base, crank, reach = 0.6 * size, 0.3 * size, REACH * size
    made.add_marker("ground.b", position=[base, 0, 0])
    upright = {"axis": "z", "angle": "90 deg"}
    for name, x in (("left", 0.0), ("right", base)):
        made.add_body(
            name, mesh={"type": "beam", "length": crank, "divisions": 6}, material="steel",
            sections={"all": {"type": "rectangle", "y": 0.006 * size, "z": 0.01 * size}}, modes=2,
            interfaces={"root": "start", "tip": "end"}, position=[x, 0, 0], orientation=upright,
        )  # fmt: skip
    half = float(np.sqrt(reach**2 - (0.5 * base) ** 2))
    top = [0.5 * base, crank + half, 0]
    made.add_body("pin", mass=pin * size**3, inertia=[1e-4 * size**5] * 3, position=top)
    for name, other in (("left", "ground"), ("right", "ground.b")):
        made.add_joint(f"bearing_{name}", "revolute", between=[other, f"{name}.root"], axis="z")
        made.add_joint(f"rod_{name}", "distance", between=[f"{name}.tip", "pin"], length=reach)
    lean = float(np.arcsin((1.001 * reach - 0.5 * base) / crank))
    for name, sign in (("left", 1.0), ("right", -1.0)):
        angle = f"{sign * lean} * sin(2*pi*t/{size})**2"
        made.add_driver(f"motor_{name}", joint=f"bearing_{name}", angle=angle)
    made.add_sensor("pin", "position", of="pin")
    made.set_validity(deflection="any", load_factor="any")
    made.set_dynamics(duration=0.5 * size, outputs=2000, accuracy=1e-7, verify=False)
    return made


@pytest.mark.seconds
@pytest.mark.parametrize("size", [1.0, 1e-6])
def test_a_pin_passes_where_rigid_rods_would_be_stretched(size):
    """A heavier pin moves by as much as a run with it does, where flexible cranks let it pass."""
    run = flexmb.simulate(five_bar(size))
    change = np.array([flexmb.simulate(five_bar(size, PIN * HEAVIER))[k] - run[k] for k in AXES])
    variants = ModelVariants.of(run, 2000)
    other = compile_system(five_bar(size, PIN * HEAVIER), variants.bodies)
    response, _ = estimate(variants.compiled, other, variants.model, variants.motion, {})
    at = [variants.compiled.layout.channels.index(name) for name in AXES]
    span = np.abs(change).max()
    np.testing.assert_allclose(response.channels[:, at].T, change, atol=0.05 * span)
