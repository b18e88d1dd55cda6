"""A motion that a loop looks at while it is computed is that of the run."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from restscenes import pendulum

import flexmb
from flexmb.errors import SceneError


def scene():
    made = pendulum(2.0)
    made.add_sensor("bar", "position", of="bar.center")
    return made


@pytest.mark.parametrize("fields", [{"step": 1e-3}, {"accuracy": 1e-7}])
def test_rows_are_those_of_the_run(fields):
    fields = {"duration": 0.5, "outputs": 10, **fields}
    rows = list(flexmb.iterate_motion(scene(), **fields))
    run = flexmb.simulate(scene(), **fields)
    np.testing.assert_allclose([row.time for row in rows], run.time, atol=1e-15)
    for name in ("bar.x", "bar.y"):
        found = [row.sensors[name] for row in rows]
        np.testing.assert_allclose(found, run[name], atol=1e-7)


def test_a_loop_may_end_it():
    first = list(islice(flexmb.iterate_motion(scene(), duration=1e4, step=1e-3, outputs=10**6), 3))
    assert [row.time for row in first] == pytest.approx([0.0, 0.01, 0.02])


def test_mistakes_come_with_the_first_row():
    with pytest.raises(SceneError, match="duration"):
        next(flexmb.iterate_motion(scene(), duration=-1.0))
