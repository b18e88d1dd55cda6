"""The motion does not depend on what the body frame is fixed at: orders of the difference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexiblescenes import rod

import flexmb
from flexmb.model import Model


def spun_up(body, **words):
    """Tip of a beam that its hub turns ever faster, smoothly up to 32 rad/s."""
    made = Model("blade")
    made.add_body("beam", body, **words)
    made.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
    made.add_driver("motor", joint="hub", angle="1000*t**4")
    made.add_sensor("tip", "position", of="beam.tip")
    made.set_validity(speed="any")
    found = flexmb.simulate(
        made, duration=0.2, accuracy=1e-6, outputs=30, method="radau", verify=False
    )
    return np.array([found[f"tip.{axis}"] for axis in "xyz"])


@pytest.mark.parametrize("coupling", ["partial", pytest.param("full", marks=pytest.mark.slow)])
def test_with_stiffening_both_frames_agree_to_a_higher_order(coupling):
    """Without it they differ with the square of the deflection, which falls with the stiffness."""
    body = rod(0.01, 1.0, 10, 4, geometric_stiffening="full")
    sizes, errors = [], {"none": [], "full": []}
    for stiffer in (4.0, 8.0):
        made = replace(body, K=stiffer * body.K)
        words = {"inertia_coupling": coupling}
        sizes.append(np.abs(spun_up(made, **words) - spun_up(made, deformation="rigid")).max())
        for stiffening, found in errors.items():
            words["geometric_stiffening"] = stiffening
            mean, held = (spun_up(made, frame=frame, **words)
                          for frame in ("mean axis", "interface root"))  # fmt: skip
            found.append(np.abs(mean - held).max())
    assert sizes[0] / sizes[1] == pytest.approx(2.0, rel=0.2)
    assert errors["none"][0] / errors["none"][1] == pytest.approx(4.0, rel=0.1)
    assert errors["full"][0] / errors["full"][1] == pytest.approx(8.0, rel=0.2)
    assert errors["full"][0] < 0.03 * errors["none"][0]
