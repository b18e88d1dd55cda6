"""The scripts beside the meshes of the cases make those meshes anew (most of them need gmsh)."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from flexmb.fe import read_mesh


def made_and_kept(name, project, tmp_path, monkeypatch):
    """The mesh that the script makes, and the one beside it."""
    source = project / "meshes" / f"{name}.py"
    monkeypatch.syspath_prepend(str(source.parent))  # scripts import what they share
    spec = importlib.util.spec_from_file_location(name, source)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.main(tmp_path / f"{name}.msh")
    return read_mesh(tmp_path / f"{name}.msh"), read_mesh(source.with_suffix(".msh"))


@pytest.mark.parametrize("name", ["hinged_plate", "tapered_box"])
def test_a_script_makes_the_same_mesh(name, project, tmp_path, monkeypatch):
    made, kept = made_and_kept(name, project, tmp_path, monkeypatch)
    np.testing.assert_allclose(made.points, kept.points, atol=1e-8)
    assert {kind: cells.tolist() for kind, cells in made.blocks.items()} == {
        kind: cells.tolist() for kind, cells in kept.blocks.items()
    }
    assert set(made.node_sets) == set(kept.node_sets)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, groups",
    {
        "connecting_rod": ("bore_big", "bore_small"),
        "bracket": ("bolt1", "bolt2", "bore"),
        "tuning_fork": ("stem_end",),
        "wheel": ("bore",),
    }.items(),
)
def test_a_script_of_gmsh_makes_the_shape(name, groups, project, tmp_path, monkeypatch):
    """Another gmsh divides the shape otherwise: compared are its extents, and those of its groups
    to a hundredth of a millimetre."""
    pytest.importorskip("gmsh")
    made, kept = made_and_kept(name, project, tmp_path, monkeypatch)
    assert set(made.node_sets) == set(kept.node_sets) >= set(groups)
    np.testing.assert_allclose(np.ptp(made.points, axis=0), np.ptp(kept.points, axis=0), atol=1e-6)
    for group in groups:
        extents = [mesh.points[mesh.node_sets[group]] for mesh in (made, kept)]
        for end in (np.min, np.max):
            np.testing.assert_allclose(*(end(x, axis=0) for x in extents), atol=1e-2)
