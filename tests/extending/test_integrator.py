"""An integrator by one file of the engine and one line of words: Bogacki and Shampine's."""

from __future__ import annotations

from pathlib import Path

import pytest

from extending import Extension

PENDULUM = """
import numpy as np
import flexmb

def pendulum(**knobs):
    model = flexmb.Model("pendulum", gravity=[0, -9.81, 0])
    model.add_body("rod", mass=2.0, inertia=[0.1, 0.1, 0.1], position=[0.5, 0, 0])
    model.add_marker("rod.pin", position=[-0.5, 0, 0])
    model.add_joint("hinge", "revolute", between=["ground", "rod.pin"], axis="z")
    model.add_sensor("p", "position", of="rod")
    return flexmb.simulate(model, duration=2.0, outputs=40, **knobs)

truth = pendulum(accuracy=1e-12, method="explicit-rk", verify=False)["p.x"]
for step in (0.01, 0.005):
    print(np.abs(pendulum(method="bogacki-shampine", step=step)["p.x"] - truth).max())
result = pendulum(method="bogacki-shampine", accuracy=1e-4)
print(np.abs(result["p.x"] - truth).max() / np.ptp(truth))
print(result.statistics["measured_error_of_positions"])
"""


@pytest.mark.seconds
def test_a_new_integrator_has_its_order_and_reaches_an_accuracy(tmp_path: Path) -> None:
    long, short, error, measured = map(
        float, Extension("integrator", tmp_path).run(PENDULUM).split()
    )
    assert 2.0**2.7 < long / short < 2.0**3.3
    assert error < 2e-4
    assert error / 3 < measured < 3 * error


@pytest.mark.seconds
def test_the_new_integrator_is_listed_and_allowed(tmp_path: Path) -> None:
    extension = Extension("integrator", tmp_path)
    code = "import sys; from flexmb.cli import main; sys.argv[1:] = ['list', 'methods']; main()"
    assert "bogacki-shampine" in extension.run(code)
    mistake = (
        "import flexmb; m = flexmb.Model('m')\n"
        "try: m.set_dynamics(duration=1, method='bogacki-shampin')\n"
        "except flexmb.FlexmbError as error: print(error)"
    )
    assert "nearest: bogacki-shampine" in extension.run(mistake)
