"""A scene's beam with masses, springs and a section in its own units, reduced and reused."""

from __future__ import annotations

import math

import meshio
import numpy as np
import pytest

from flexmb.model import Model
from flexmb.workflow.flexible_bodies import flexible_bodies


def _write_line(path, n: int = 4) -> None:
    """A line of 1000 mm with point groups root and tip."""
    points = np.zeros((n + 1, 3))
    points[:, 0] = np.linspace(0, 1000, n + 1)
    cells = [
        ("vertex", np.array([[0]])),
        ("vertex", np.array([[n]])),
        ("line", np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)),
    ]
    tags = [np.full(len(data), k + 1) for k, (_, data) in enumerate(cells)]
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    mesh = meshio.Mesh(points, cells, cell_data=data)
    groups = {"root": (1, 0), "tip": (2, 0), "rod": (3, 1)}
    mesh.field_data = {name: np.array(value) for name, value in groups.items()}
    meshio.write(path, mesh, file_format="gmsh22")


def _model(folder, mass):
    model = Model("m", units="mm-t-s", folder=folder)
    model.add_body(
        "rod",
        mesh="rod.msh",
        material="steel",
        interfaces={"a": "root", "b": "tip"},
        modes=2,
        sections={"rod": {"type": "tapered", "start": {"type": "circle", "radius": 20},
                          "end": {"type": "circle", "radius": 10}}},
        masses={"knob": {"at": "tip", "mass": mass, "inertia": [1, 1, 1]}},
        springs={"bow": {"between": ["root", "tip"], "stiffness": 1.0}},
    )  # fmt: skip
    return model


def test_a_scene_with_masses_and_springs(tmp_path) -> None:
    _write_line(tmp_path / "rod.msh")
    bodies, _, notes = flexible_bodies(_model(tmp_path, "3 kg"), tmp_path)
    frustum = math.pi / 3 * (0.02**2 + 0.02 * 0.01 + 0.01**2) * 7850
    assert bodies["rod"].mass == pytest.approx(frustum + 3.0)
    _, _, notes = flexible_bodies(_model(tmp_path, "3 kg"), tmp_path)
    assert any("reused" in note for note in notes)
    bodies, _, notes = flexible_bodies(_model(tmp_path, "4 kg"), tmp_path)
    assert bodies["rod"].mass == pytest.approx(frustum + 4.0)
    assert not any("reused" in note for note in notes)
