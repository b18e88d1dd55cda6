"""What a picture shows follows from the scene and the result."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import slidercrank
from resultfiles import writer

from flexmb import Model, kinematics
from flexmb.errors import BodyFileError, ResultFileError, ViewError
from flexmb.flexbody import rigid_body, save
from flexmb.results import Result
from flexmb.view.content import Content, Scale
from flexmb.view.drawing import Drawing, round_exaggeration
from flexmb.view.joint_shapes import slide_range
from flexmb.view.mechanism import Mechanism
from flexmb.view.picture import add_ghosts, view_of


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return slidercrank.make(tmp_path_factory.mktemp("run"))


@pytest.fixture
def mechanism(path: Path) -> Mechanism:
    return Mechanism(Result(path))


def compose(mechanism: Mechanism, **words) -> Content:
    return Drawing(mechanism, view_of(mechanism, words)).content()


@pytest.mark.parametrize(
    ("ratio", "factor"),
    [(3e-5, 1000.0), (5e-5, 1000.0), (5.1e-5, 500.0), (0.02, 2.0), (0.06, 1.0), (1e-15, 1.0)],
)
def test_the_automatic_exaggeration_is_round_and_never_blows_up_rounding(ratio, factor) -> None:
    assert round_exaggeration(ratio) == factor


@pytest.mark.parametrize(
    ("largest", "shown"),
    [(4e-8, (40.0, "nm")), (4e-5, (40.0, "µm")), (4e-3, (4.0, "mm")), (2.0, (2.0, "m"))],
)
def test_the_unit_of_the_scale_suits_the_displacement(largest, shown) -> None:
    scale = Scale.fitting(largest)
    assert (pytest.approx(scale.top), scale.unit) == shown


def test_joints_are_where_both_of_their_bodies_are(mechanism: Mechanism) -> None:
    for spec in mechanism.model.joints.values():
        if spec.type == "revolute":
            first, second = (mechanism.point(reference) for reference in spec.between)
            np.testing.assert_allclose(first, second, atol=1e-4)  # rows are 0.4 ms apart


def test_the_deformation_is_exaggerated_about_the_moving_frame(mechanism: Mechanism) -> None:
    points, undeformed, displacement = mechanism.surface("rod", 100.0)
    moved = np.linalg.norm(points - undeformed, axis=1)
    np.testing.assert_allclose(moved, 100 * displacement, rtol=1e-9, atol=1e-15)
    eta = mechanism.pose("rod").eta
    assert displacement.max() == pytest.approx(abs(eta[0]))


def test_the_content_says_time_title_and_exaggeration(mechanism: Mechanism) -> None:
    content = compose(mechanism)
    assert content.title == "Slider-crank with a flexible connecting rod"
    assert content.caption.startswith("t = 0.0133 s, deformation exaggerated 500 times")
    shown = {solid.name for solid in content.solids}
    assert shown == {"crank", "slider", "ground", *mechanism.model.joints}
    assert [body.name for body in content.deformed] == ["rod"]
    assert content.scale.unit == "µm"
    assert "to scale" in compose(mechanism, exaggeration=1.0).caption
    assert compose(mechanism, color="body").scale is None


def test_a_planar_mechanism_is_seen_along_its_axes_from_above(mechanism: Mechanism) -> None:
    camera = compose(mechanism).camera
    assert camera.direction[2] > 0.9
    assert camera.direction[1] > 0.1
    assert camera.up == (0.0, 1.0, 0.0)
    given = compose(mechanism, direction=(0.0, 0.0, -2.0)).camera
    assert given.direction == (0.0, 0.0, -1.0)


def test_a_direction_without_length_is_refused(mechanism: Mechanism) -> None:
    with pytest.raises(ViewError, match="vector of length zero"):
        compose(mechanism, direction=(0.0, 0.0, 0.0))


def test_the_rail_spans_the_way_of_the_slider(mechanism: Mechanism) -> None:
    low, high = slide_range(mechanism, "guide", mechanism.model.joints["guide"])
    assert high == pytest.approx(slidercrank.R + slidercrank.L, rel=1e-6)
    assert low == pytest.approx(slidercrank.L - slidercrank.R, rel=1e-2)


def test_a_time_outside_the_run_is_refused(path: Path) -> None:
    with pytest.raises(ResultFileError, match="outside the run"):
        Mechanism(Result(path), 1.0).pose("rod")


def test_another_flexible_body_than_that_of_the_run_is_noticed(tmp_path: Path) -> None:
    result = Result(slidercrank.make(tmp_path))
    save(rigid_body(1.0, inertia=1.0, name="rod"), tmp_path / "rod.flexbody.h5")
    with pytest.raises(ResultFileError, match="has 0 modes, the run was made with 1"):
        Mechanism(result)
    (tmp_path / "rod.flexbody.h5").unlink()
    with pytest.raises(BodyFileError):
        Mechanism(result)


def test_a_result_without_rows_cannot_be_drawn(tmp_path: Path) -> None:
    with writer(tmp_path / "r.h5") as out:
        pass
    with pytest.raises(ViewError, match="no rows"):
        Mechanism(Result(out.path))


def test_what_stands_where_it_is_drawn_has_no_ghost(mechanism: Mechanism) -> None:
    drawing = Drawing(mechanism, view_of(mechanism, {}))
    content = drawing.content()
    assert add_ghosts(content, drawing, [mechanism.time]).solids == content.solids
    names = [solid.name for solid in add_ghosts(content, drawing, [0.02]).solids]
    assert names[len(content.solids) :] == ["crank", "slider", "rod"]


@pytest.mark.parametrize("size", [[3, 2, 0.01], [3, 0.2, 0.2]])
def test_a_hatch_is_not_seen_edge_on(size, tmp_path) -> None:
    """It turns about an axis in its plane by 80 degrees; a bar is seen along the axis."""
    model = Model("hatch", folder=tmp_path, gravity=[0, 0, -10])
    model.add_body("cover", shape={"type": "box", "size": size}, density=1000, center=[1.5, 0, 0])
    model.add_joint("hinge", "revolute", between=["ground", "cover"], axis="-y")
    model.add_driver("hinge", joint="hinge", angle="80*deg*t")
    machine = Mechanism(kinematics(model, duration=1.0, outputs=20, output=tmp_path), 0.5)
    towards = np.array(compose(machine).camera.direction)
    angles = np.radians(80) * np.linspace(0, 1, 21)
    seen = np.abs(np.stack([-np.sin(angles), 0 * angles, np.cos(angles)], axis=1) @ towards)
    assert (seen.min() > 0.4) == (size[1] > 1)
    assert (abs(towards[1]) > 0.9) == (size[1] < 1)
