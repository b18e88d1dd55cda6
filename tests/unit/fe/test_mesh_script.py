"""The script beside the connecting rod's mesh makes that mesh anew (needs gmsh)."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest


@pytest.mark.slow
def test_the_script_makes_the_mesh(project, tmp_path):
    pytest.importorskip("gmsh")
    from flexmb.fe import read_mesh

    source = project / "meshes" / "connecting_rod.py"
    spec = importlib.util.spec_from_file_location("connecting_rod", source)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.main(tmp_path / "rod.msh")
    made, kept = read_mesh(tmp_path / "rod.msh"), read_mesh(source.with_suffix(".msh"))
    assert set(made.node_sets) == set(kept.node_sets)
    for name in ("bore_big", "bore_small"):
        centre = made.points[made.node_sets[name]].mean(axis=0)
        np.testing.assert_allclose(
            centre, kept.points[kept.node_sets[name]].mean(axis=0), atol=1e-6
        )
    assert np.ptp(made.points, axis=0) == pytest.approx(np.ptp(kept.points, axis=0), abs=1e-6)
