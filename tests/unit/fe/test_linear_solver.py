"""The linear solver: solutions, and singular matrices."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import block
from scipy.sparse import csr_array

from flexmb.errors import ReductionError
from flexmb.fe import assemble, resolve
from flexmb.fe.solver.linear_solver import factor


def test_solves_for_one_and_many_right_sides():
    fe = assemble(block((2, 1, 1)), resolve("steel"))
    held = fe.numbering.table[fe.mesh.group_nodes("x0"), :3].ravel()
    free = np.setdiff1d(np.arange(fe.numbering.n), held)
    K = fe.K[free][:, free]
    b = np.random.default_rng(0).normal(size=(len(free), 3))
    x = factor(K).solve(b)
    np.testing.assert_allclose(K @ x, b, atol=1e-9)
    np.testing.assert_allclose(factor(K).solve(b[:, 0]), x[:, 0], rtol=1e-9)


def test_singular_matrices_are_refused():
    fe = assemble(block((2, 1, 1)), resolve("steel"))
    with pytest.raises(ReductionError, match="singular"):
        factor(fe.K)
    with pytest.raises(ReductionError, match="without stiffness"):
        factor(csr_array(np.diag([1.0, 0.0])))
