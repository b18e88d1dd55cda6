"""A scene that stays from frame to frame shows what a scene made anew shows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmb.view import vtk_renderer
from flexmb.view.camera import Camera
from flexmb.view.content import Content, Deformed, Scale, Solid
from flexmb.view.page_motion import rigid_motion
from flexmb.view.shapes import box, sphere

SIZE = (320, 180)
BALL, BAR = sphere(0.05), box((1.0, 0.2, 0.1))


def _at(k: int, at: float) -> np.ndarray:
    place = np.eye(4)
    place[:3, 3] = [0.3 * k + at, 0.1 * k, 0.2 * k]
    return place


def _content(angle: float, bend: float, balls: int = 1, at: float = 0.0) -> Content:
    turned = _at(0, at + 0.3)
    turned[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
    plate = box((0.8, 0.4, 0.1))
    moved = plate.points + np.array([-0.8, 0.0, bend]) * (1.0 + plate.points[:, :1])
    amount = np.linalg.norm(moved - plate.points, axis=1)
    lines = np.zeros((0, 2), dtype=np.int64)
    body = Deformed(
        "plate",
        moved + [at, 0, 0],
        plate.points + [at, 0, 0],
        plate.faces,
        lines,
        amount,
        "#808080",
        amount,
    )
    return Content(
        title="a scene",
        caption=f"angle {angle:.2f}",
        solids=(
            Solid("bar", BAR, "#c04020", matrix=turned),
            *(Solid("ball", BALL, "#e07b24", matrix=_at(k, at)) for k in range(balls)),
        ),
        deformed=(body,),
        scale=Scale(2.0, 1.0, "m"),
        camera=Camera((0.36, 0.48, 0.8), (0.0, 1.0, 0.0)),
    )


def _image(*contents: Content) -> np.ndarray:
    """The last of the contents, after the others in the same scene."""
    with vtk_renderer.open_scene(1, SIZE, 1, vtk_renderer.probe()) as scene:
        for content in contents:
            vtk_renderer.show(scene, [content], SIZE)
            image = scene.image()
    return image.astype(int)


@pytest.mark.skipif(not vtk_renderer.probe().works, reason="VTK does not render on this machine")
def test_a_frame_does_not_depend_on_the_frames_before_it() -> None:
    last = _content(1.2, 0.3)
    alone = _image(last)
    after = _image(_content(0.0, 0.0), _content(0.5, 0.1, balls=3), _content(0.9, -0.2), last)
    assert (np.abs(after - alone).max(axis=2) > 12).mean() < 0.002
    other = _image(_content(0.9, -0.2))
    assert (np.abs(other - alone).max(axis=2) > 12).mean() > 0.02


@pytest.mark.skipif(not vtk_renderer.probe().works, reason="VTK does not render on this machine")
def test_a_scene_far_from_the_origin_looks_the_same() -> None:
    here, there = _image(_content(1.2, 0.3)), _image(_content(1.2, 0.3, at=1e7))
    assert (np.abs(here - there).max(axis=2) > 12).mean() < 0.002


def test_a_rigid_motion_is_recognised_and_a_deformation_is_not() -> None:
    points = sphere(0.3, (1e3, 0.0, 0.0)).points
    R = Rotation.from_rotvec((0.4, -2.0, 1.0)).as_matrix()
    after = points @ R.T + np.array([5.0, -1.0, 2.0])
    motion = rigid_motion(points, after)
    assert motion is not None
    assert np.allclose(motion[:3, :3], R, atol=1e-9)
    assert np.allclose(points @ motion[:3, :3].T + motion[:3, 3], after, atol=1e-9)
    bent = after.copy()
    bent[7] += 1e-3
    assert rigid_motion(points, bent) is None
    assert rigid_motion(points, points * np.array([1.0, 1.0, -1.0])) is None  # mirrored: no motion
