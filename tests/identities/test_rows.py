"""The rows in numpy against those of the kernels: two independent ways to C and Cq."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench
from generators import TOPOLOGIES, Mechanism
from jointfields import special_fields
from mechanisms import excavator, quick_return

from flexmb.analysis.mobility.rows import MEASURES, moved, rows_at
from flexmb.engine.compile.joints.joint_rows import DRIVER_ROWS, JOINT_ROWS
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


@pytest.mark.parametrize("name", MODELS)
def test_values_and_jacobian_are_those_of_the_kernels(name):
    """Round-off of sums of products of size one is left, and of angles and lengths about three."""
    model = MODELS[name]()
    bench = Bench(model)
    bench.randomise(1)
    bench.at()
    rows = rows_at(bench.compiled, bench.q.copy(), float(bench.state.t[0]))
    np.testing.assert_allclose(rows.C, bench.C, rtol=0, atol=1e-13)
    np.testing.assert_allclose(rows.Cq, bench.Cq, rtol=0, atol=1e-13)
    np.testing.assert_allclose(rows.markers.x, bench.marker("x"), rtol=0, atol=1e-13)


def test_positions_move_as_in_the_kernels():
    bench = Bench(Mechanism(4, "chain", "mixed").model)
    d = bench.randomise(2).standard_normal(bench.layout.nv)
    np.testing.assert_allclose(
        moved(bench.compiled, bench.q, d), bench.moved(bench.q, d), atol=1e-14
    )


def test_every_kind_of_row_has_its_measure():
    """A kind that a joint or driver uses and that is missing here would stop `flexmb check`."""
    kinds = {row[0] for rows in JOINT_ROWS.values() for row in rows}
    assert kinds | {row[0] for row in DRIVER_ROWS.values()} <= set(MEASURES)
