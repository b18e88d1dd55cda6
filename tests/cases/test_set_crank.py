"""The slider-crank of the IVP test set from its printed first state to its published last one."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest
from truthkit import Memory, reference

import flexmb
from flexmb.analysis.assembly.initial_state import StartValues
from flexmb.analysis.dynamics.dynamics import prepare_dynamics, run_dynamics
from flexmb.engine.compile import compile_system
from flexmb.flexbody import load

CASE = Path(__file__).parents[2] / "cases" / "test_set_crank"
TABLE = reference("simeon_crank")


@pytest.mark.seconds
def test_published_end_values():
    """The stored reference has the printed matrices; published are 9 digits of the first state."""
    model = flexmb.load_scene(CASE / "scene.toml", {"dynamics.outputs": "5"})
    model.checks.clear()
    compiled = compile_system(model, {"rod": load(CASE / "rod.flexbody.h5")})
    crank, rod, slider = compiled.layout.bodies
    y = np.array(TABLE["initial_y14_consistent"])
    q, v = compiled.initial_q.copy(), np.zeros(sum(6 + body.m for body in compiled.layout.bodies))
    q[rod.iq + 7 : rod.iq + 11], q[slider.iq] = y[3:7], y[2]
    v[crank.iv + 5], v[rod.iv + 1], v[rod.iv + 5] = y[7], 0.15 * y[7], y[8]
    v[rod.iv + 6 : rod.iv + 10], v[slider.iv] = y[10:14], y[9]
    memory = Memory()
    outcome = run_dynamics(prepare_dynamics(compiled, model, begin=StartValues(q, v)), memory)
    assert outcome.status == "finished"
    tables = memory.tables()
    q = next(table for table in tables if table.ndim == 2 and table.shape[1] == len(q))[-1]
    angle = 2 * np.arctan2(q[rod.iq + 6], q[rod.iq + 3])
    angle = (angle + np.pi) % (2 * np.pi) - np.pi
    found = np.array([angle, q[slider.iq], *q[rod.iq + 7 : rod.iq + 11]])
    own = np.array(TABLE["published_mass_block"]["y24"])[1:7]
    np.testing.assert_allclose(found[:4], own[:4], rtol=1e-7)
    np.testing.assert_allclose(found[4:], own[4:], rtol=0, atol=2e-11)
    published = np.array(TABLE["published"]["y24"])[1:7]
    np.testing.assert_allclose(found[:4], published[:4], rtol=5e-7)
    np.testing.assert_allclose(found[4:], published[4:], rtol=0, atol=5e-11)


def test_the_file_holds_the_arrays_of_the_script():
    made, stored = runpy.run_path(str(CASE / "rod.py"))["rod"](), load(CASE / "rod.flexbody.h5")
    for name in ("mass", "S1", "S0", "p", "P", "Mab", "K"):
        assert getattr(stored, name) == pytest.approx(getattr(made, name)), name
