"""The rows of the units against those in numpy, `rowmeasures`: two independent ways to C and Cq."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench
from generators import TOPOLOGIES, Mechanism
from jointfields import special_fields
from mechanisms import excavator, quick_return
from rowmeasures import MEASURES, moved, rows_at

from flexmb.analysis.assembly.jacobian import ConstraintRows, DenseJacobian, row_gradient
from flexmb.engine.compiled_units import interpretation, interpreted, prepare_units
from flexmb.engine.initial_conditions import evaluate_rows
from flexmb.engine.joints import DISTANCE, RADIAL, ROW_KINDS
from flexmb.engine.joints.joint import DRIVER_ROWS, JOINT_ROWS
from flexmb.model import Model
from flexmb.model.joints.joint import JOINT_TYPES


def all_joints():
    """Each joint type between two bodies of its own, anywhere."""
    model, rng = Model("all joints"), np.random.default_rng(5)
    for k, row in enumerate(JOINT_TYPES.values()):
        for name in (f"a{k}", f"b{k}"):
            model.add_body(name, mass=1.0, inertia=[1, 1, 1], position=list(rng.uniform(-1, 1, 3)))
        axes = [[1.0, 2, 2], [2.0, 1, -2]]
        if row.name.startswith("revolute-") and row.axes == 2:
            axes[1] = axes[0]
        words = dict(zip(("axis", "second_axis"), axes[: row.axes], strict=False))
        words |= special_fields(model, row.name)
        model.add_joint(row.name, row.name, between=[f"a{k}", f"b{k}"], **words)
    return model


MODELS = {
    **{top: lambda top=top: Mechanism(3, top, "mixed").model for top in TOPOLOGIES},
    "all joints": all_joints,
    "excavator": lambda: excavator("UCU"),
    "planar": lambda: quick_return("C", driven=True),
}


# Round-off of sums of products of size one, and of angles and lengths about three.
ROUND_OFF = 1e-13


@pytest.fixture(params=MODELS)
def bench(request):
    """Every stage at a random state."""
    made = Bench(MODELS[request.param]())
    made.randomise(1)
    return made.at()


def test_values_and_jacobian_are_those_of_the_kernels(bench):
    rows = rows_at(bench.compiled, bench.q.copy(), float(bench.state.t[0]))
    np.testing.assert_allclose(rows.C, bench.C, rtol=0, atol=ROUND_OFF)
    np.testing.assert_allclose(rows.Cq, bench.Cq, rtol=0, atol=ROUND_OFF)
    np.testing.assert_allclose(rows.markers.x, bench.marker("x"), rtol=0, atol=ROUND_OFF)
    dense = DenseJacobian(bench.compiled).of(bench.work)
    np.testing.assert_allclose(rows.Cq, dense, rtol=0, atol=ROUND_OFF)


def test_rows_of_the_mobility_analysis_are_those_in_numpy(bench):
    """In plain Python, and in machine code unless the tests run without."""
    t, constraints = float(bench.state.t[0]), ConstraintRows(bench.compiled)
    wanted = rows_at(bench.compiled, bench.q, t)
    with interpretation():
        plain = constraints.evaluate(bench.q, t)
    prepare_units([evaluate_rows])  # all others were called at the random state
    for rows in (plain, constraints.evaluate(bench.q, t)):
        np.testing.assert_allclose(rows.C, wanted.C, rtol=0, atol=ROUND_OFF)
        np.testing.assert_allclose(rows.Cq, wanted.Cq, rtol=0, atol=ROUND_OFF)
        np.testing.assert_allclose(rows.g, wanted.g, rtol=0, atol=ROUND_OFF)
        np.testing.assert_allclose(rows.x, wanted.markers.x, rtol=0, atol=ROUND_OFF)
        np.testing.assert_allclose(rows.R, wanted.markers.R, rtol=0, atol=ROUND_OFF)


def test_positions_move_as_in_the_kernels():
    bench = Bench(Mechanism(4, "chain", "mixed").model)
    d = bench.randomise(2).standard_normal(bench.layout.nv)
    wanted = bench.moved(bench.q, d)
    np.testing.assert_allclose(moved(bench.compiled, bench.q, d), wanted, atol=1e-14)
    rows = ConstraintRows(bench.compiled)
    np.testing.assert_allclose(rows.move(bench.q, d), wanted, atol=1e-14)
    with interpretation():
        np.testing.assert_allclose(rows.move(bench.q, d), wanted, atol=1e-14)


def test_a_row_without_a_gradient_is_not_finite():
    """A distance of zero has no direction, whether in Python or in machine code."""
    x, R = np.zeros(3), np.eye(3)
    assert not np.any(np.isfinite(row_gradient((DISTANCE, 0, 0), x, R, x, R)[:3]))
    assert not np.any(np.isfinite(row_gradient((RADIAL, 0, 0), x, R, x, R)[:3]))


def test_every_kind_of_row_has_its_measure():
    """A kind without one would go unchecked."""
    assert set(MEASURES) == set(range(len(ROW_KINDS)))
    kinds = {row[0] for rows in JOINT_ROWS.values() for row in rows}
    assert kinds | {row[0] for row in DRIVER_ROWS.values()} <= set(MEASURES)


def test_rows_are_evaluated_by_machine_code_where_it_is_there(monkeypatch):
    bench = Bench(Mechanism(3, "loop", "mixed").model).at()
    prepare_units([evaluate_rows])
    if not interpreted():
        monkeypatch.setattr(evaluate_rows, "function", pytest.fail)
    rows = ConstraintRows(bench.compiled).evaluate(bench.q)
    np.testing.assert_allclose(rows.C, bench.C, rtol=0, atol=ROUND_OFF)
