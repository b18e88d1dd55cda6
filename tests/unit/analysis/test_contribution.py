"""Contributions of effects to sensors: what is at rest by symmetry is moved by nobody."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.analysis.effects.contribution import contributions
from flexmb.model import Model


@pytest.mark.parametrize(("sum_of_all", "share"), [(0.0, 0.0), (0.1, 0.0), (2.0, 1.0)])
def test_a_sensor_at_rest_counts_what_all_bodies_together_change(sum_of_all, share) -> None:
    model = Model("craft")
    model.add_body("bus", mass=1.0, inertia=[1.0] * 3)
    model.add_body("arm", mass=1.0, inertia=[1.0] * 3)
    for name in ("bus", "arm"):
        model.add_sensor(name, "position", of=name)
    names = tuple(f"{name}.{axis}" for name in ("bus", "arm") for axis in "xyz")
    t = np.linspace(0.0, 1.0, 9)
    moves = np.zeros((9, 6))
    moves[:, 3] = t  # the arm; the bus rests
    change = np.zeros((9, 6))
    change[:, 0], change[:, 3] = 1e-3 * t, 0.01 * t
    histories = moves, moves + change
    bus, arm = contributions(model, histories, change, names, sum_of_all * change)
    alone = contributions(model, histories, change, names)
    assert (bus.at_rest, arm.at_rest) == (True, False)
    assert alone[0].share == pytest.approx(1.0)
    assert bus.share == pytest.approx(share)
    assert arm.share == alone[1].share == pytest.approx(0.01 / 1.01)
