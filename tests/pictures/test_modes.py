"""Pictures of mode shapes and of stress: both ways of drawing, what they show, mistakes."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from femeshes import line
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app
from flexmb.errors import BodyFileError, ReductionError, ViewError
from flexmb.fe import Mesh, rectangle, reduce
from flexmb.fe.sections.thin_walls import i_section
from flexmb.flexbody import rigid_body, save
from flexmb.flexbody.natural_modes import natural_modes
from flexmb.view import modes


@pytest.fixture(scope="module")
def beam():
    """A bar of 1 m, 60 by 80 mm, that can be held at its root."""
    section = {"all": rectangle(0.06, 0.08)}
    return reduce(
        line(8),
        material="steel",
        sections=section,
        interfaces={"root": "root"},
        modes=6,
        name="bar",
    )


def _colored(path: Path) -> np.ndarray:
    """Which pixels have a strong colour: the scale's, not the ghost's grey."""
    picture = matplotlib.image.imread(path)[:, :, :3]
    return np.ptp(picture, axis=2) > 0.15


def test_a_grid_has_a_mode_in_every_panel(beam, tmp_path: Path, drawn_by: str) -> None:
    path = flexmb.render_modes(
        beam, [1, 2, 3, 4], held=["root"], size=(640, 400), output=tmp_path / "a.png"
    )
    shown = _colored(path)
    assert shown.shape == (400, 640)
    for row in (slice(40, 190), slice(240, 390)):
        for column in (slice(60, 320), slice(380, 640)):
            assert shown[row, column].mean() > 0.01


def test_the_held_end_stays_and_the_bar_is_as_thick_as_its_section(beam) -> None:
    found = natural_modes(beam, ["root"])
    shapes = found.shapes(beam.surface.points, beam.surface.modes)
    at_root = beam.surface.points[:, 0] < 1e-9
    largest = np.abs(shapes).max(axis=(0, 1))
    assert (np.abs(shapes[at_root]).max(axis=(0, 1)) < 1e-9 * largest).all()
    np.testing.assert_allclose(np.ptp(beam.surface.points, axis=0), [1.0, 0.06, 0.08], rtol=1e-12)


def test_corners_of_a_section_turn_with_the_node(beam) -> None:
    """A corner moves by u + theta x s."""
    surface, nodes = beam.surface, beam.nodes
    corner = int(np.flatnonzero((surface.points > [0.9, 0.02, 0.03]).all(axis=1))[0])
    row = nodes.row(int(surface.node_ids[corner]))
    arm = surface.points[corner] - nodes.position[row]
    turned = np.cross(nodes.Phi_r[row].T, arm).T
    np.testing.assert_allclose(surface.modes[corner], nodes.Phi_t[row] + turned, atol=1e-12)


def test_the_extruded_surface_encloses_the_volume_of_the_beam() -> None:
    """Divergence theorem over all triangles; two legs at a right angle, an I and a rectangle."""
    path = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 1.0]])
    sets = {"beam": {"line": np.array([0, 1])}, "leg": {"line": np.array([2])}}
    mesh = Mesh(path, {"line": np.array([[0, 1], [1, 2], [2, 3]])}, {}, sets)
    section = i_section(height=0.2, width=0.1, web=0.01, flange=0.02)
    sections = {"beam": section, "leg": rectangle(0.05, 0.04)}
    body = reduce(mesh, material="steel", sections=sections, modes=1)
    a, b, c = (body.surface.points[body.surface.faces[:, k]] for k in range(3))
    volume = np.einsum("ta,ta->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(2 * section.A + 0.05 * 0.04, rel=1e-12)


def test_the_title_says_number_and_frequency(beam) -> None:
    panels = []

    def keep(given, path, size, columns):
        panels.extend(given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(modes, "draw_panels", keep)
        flexmb.render_modes(beam, 2, output="unused.png")
    assert panels[0].title == f"mode 2: {beam.frequencies[1]:.4g} Hz"
    assert panels[0].caption == "bar, free"
    moved = np.linalg.norm(panels[0].deformed[0].points - panels[0].deformed[0].undeformed, axis=1)
    size = np.linalg.norm([1.0, 0.06, 0.08])
    assert moved.max() == pytest.approx(0.1 * size)


@pytest.mark.parametrize(
    ("options", "error", "sentence"),
    [
        ({"modes": 0}, ViewError, "has the modes 1 to 6, given 0"),
        ({"modes": [1, 7, 9]}, ViewError, "given 7, 9"),
        ({"modes": []}, ViewError, "given none"),
        ({"held": ["rooot"]}, ReductionError, 'no interface "rooot".*nearest: root'),
        ({"exaggeration": "much"}, ViewError, "neither a number nor"),
        ({"direction": (0, 0, 0)}, ViewError, "has no length"),
        ({"size": (100, 60)}, ViewError, "too small"),
        ({"output": "a.jpg"}, ViewError, "must end in .png"),
    ],
)
def test_mistakes_are_told(beam, tmp_path: Path, options, error, sentence) -> None:
    options = {"output": "a.png", **options}
    with pytest.raises(error, match=sentence):
        flexmb.render_modes(beam, **{**options, "output": tmp_path / options["output"]})
    assert list(tmp_path.iterdir()) == []


def test_a_rigid_body_and_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ViewError, match="no modes to draw"):
        flexmb.render_modes(rigid_body(1.0, inertia=1.0), output=tmp_path / "a.png")
    with pytest.raises(BodyFileError, match="no such file"):
        flexmb.render_modes(tmp_path / "none.h5", output=tmp_path / "a.png")


def call(*words: object):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_the_command_draws_modes_of_a_body_file(beam, tmp_path: Path, without_vtk) -> None:
    file = save(beam, tmp_path / "bar.flexbody.h5")
    done = call("render", file, "--modes", "1..2", "--held", "root", "--size", "400x300")
    assert done.exit_code == 0, done.stderr
    assert f"written: {tmp_path / 'bar.modes.png'}" in done.stdout
    assert "a simple picture was drawn instead" in done.stdout
    assert _colored(tmp_path / "bar.modes.png").any()
    assert "belongs to the picture of a run" in call("render", file, "--time", "0.1").stderr
    assert "7, 1..6 or 1,3,5" in call("render", file, "--mode", "x").stderr
