"""Shapes of curves: what the words mean, in any units, from files and back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipe

from flexmb.engine.joints.curve import pieces_of, place_curve
from flexmb.errors import FlexmbWarning
from flexmb.model import Model, lookup
from flexmb.model.joints.curve import curve_shape


def shape(units="SI", **fields):
    model = Model("curve", units=units, parameters={"c": 2.0})
    model.add_curve("c", **fields)
    return curve_shape(model, "c")


def frames(found, u):
    """Value and derivatives by differences, to compare with those the shape tells."""
    h = 1e-4
    ahead, behind, here = (found.at(np.array([u + s]))[0] for s in (h, -h, 0.0))
    return here, (ahead[0] - behind[0]) / (2 * h), (ahead[0] - 2 * here[0] + behind[0]) / h**2


SHAPES = {
    "polar": {"polar": "1 + 0.3*sin(2*t)"},
    "xyz": {"x": "cos(t)", "y": "2*sin(t)", "z": "t**2"},
    "circle": {"circle": 2, "center": [1, -1]},
    "points": {"points": [[0, 0], [1, 2], [3, 1], [2, -1]], "closed": True},
    "table": {"polar_points": [[0, 1], [2, 1.5], [4, 1.2], [7, 1.1]]},
}


@pytest.mark.parametrize("name", SHAPES)
def test_derivatives_belong_to_the_values(name):
    found = shape(**SHAPES[name])
    for u in found.breaks[0] + np.ptp(found.breaks) * np.array([0.13, 0.57, 0.81]):
        here, first, second = frames(found, u)
        np.testing.assert_allclose(here[1], first, atol=1e-6)
        np.testing.assert_allclose(here[2], second, atol=1e-5)


def test_splines_pass_their_points_and_join_in_curvature():
    points = np.array(SHAPES["points"]["points"])
    found = shape(**SHAPES["points"])
    np.testing.assert_allclose(found.at(found.breaks[:-1])[:, 0, :2], points, atol=1e-14)
    first, last = found.at(found.breaks[[0, -1]])
    np.testing.assert_allclose(first, last, atol=1e-12)


def test_a_table_of_points_on_a_line_is_the_line():
    """A natural spline has no curvature there."""
    found = shape(points=[[0, 0], [1, 1], [4, 4], [5, 5]])
    at = found.at(np.linspace(0, found.breaks[-1], 7))
    np.testing.assert_allclose(at[:, 0, 0], at[:, 0, 1], atol=1e-14)
    np.testing.assert_allclose(at[:, 2], 0.0, atol=1e-13)


def test_units_of_a_scene_are_those_of_its_curves():
    inside = [
        shape("mm-t-s", **fields).points
        for fields in ({"circle": 50}, {"circle": "c*25"}, {"polar": "50"}, {"polar": "5 cm"})
    ]
    for found in inside:
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), 0.05, rtol=1e-14)
    line = shape("mm-t-s", polar="c*t + 1", range=["pi/2", "90*deg + 1"])
    assert np.linalg.norm(line.points[0]) == pytest.approx((np.pi + 1) * 1e-3)


def test_the_parameter_of_an_expression_is_a_number_whatever_the_unit_of_time():
    milli, plain = shape("mm-kg-ms", polar="1 + t"), shape("mm-kg-s", polar="1 + t")
    np.testing.assert_array_equal(milli.points, plain.points)


def test_pieces_have_their_length_for_parameter():
    """An ellipse, whose perimeter is 4 a E(1 − b²/a²)."""
    found = pieces_of(shape(x="2*cos(t)", y="sin(t)", closed=True))

    assert found.ends[-1] == pytest.approx(8 * ellipe(0.75), rel=1e-13)
    at = found.at(np.linspace(0, found.ends[-1], 999))
    np.testing.assert_allclose(np.linalg.norm(at[:, 1], axis=1), 1.0, atol=1e-10)
    np.testing.assert_allclose((at[:, 0, 0] / 2) ** 2 + at[:, 0, 1] ** 2, 1.0, atol=1e-12)
    assert found.error < 1e-12


@pytest.mark.parametrize("rise", ["step", "step5", "havsin"])
@pytest.mark.parametrize("begin", [0.0, -np.pi])
def test_pieces_meet_at_the_ends_of_rises(rise, begin):
    """Where the second or third derivative jumps; pieces across were 3e-11 to 9e-9 of the size off.

    The radius is that of the words, by polynomials and a cosine.
    """
    found = shape(
        polar=f"1 + {rise}(t, -1, 0, 0.5, 0.2) - {rise}(t, 1, 0, 2.5, 0.2)",
        range=[begin, begin + 2 * np.pi], closed=begin != 0.0,
    )  # fmt: skip
    pieces = pieces_of(found)
    x = pieces.at(np.linspace(0.0, pieces.ends[-1], 20000)[1:-1])[:, 0]
    angle = np.arctan2(x[:, 1], x[:, 0])
    angle = np.where(angle < begin, angle + 2 * np.pi, angle)
    share = np.clip([(angle + 1) / 1.5, (angle - 1) / 1.5], 0.0, 1.0)
    up, down = {
        "step": share**2 * (3 - 2 * share),
        "step5": share**3 * (10 - 15 * share + 6 * share**2),
        "havsin": 0.5 - 0.5 * np.cos(np.pi * share),
    }[rise]
    wanted = 1 + 0.2 * (up - down)
    np.testing.assert_allclose(np.hypot(x[:, 0], x[:, 1]), wanted, rtol=0, atol=1e-13)
    assert len(pieces.coefficients) < 300


def test_a_corner_is_told():
    model = Model("corner")
    model.add_curve("roof", x="t", y="abs(t - 0.123)", range=[-1, 1])
    with pytest.warns(FlexmbWarning, match=r"curves.roof is followed within .* corner"):
        place_curve(model, "roof", lookup.place_marker(model, "ground.origin"))


@pytest.mark.parametrize(
    "rows", ["x, y\n1, 0\n0, 1\n-1, 0 # left\n\n0, -1\n", "1;0\n0;1\n-1;0\n0;-1"]
)
def test_points_of_a_file_stay_with_the_scene(rows, tmp_path):
    (tmp_path / "cam.csv").write_text(rows)
    model = Model("file", units="mm-t-s", folder=tmp_path)
    model.add_curve("cam", file="cam.csv", closed=True)
    table = model.to_scene_dict()["curves"]["cam"]
    assert table == {"points": [[1, 0], [0, 1], [-1, 0], [0, -1]], "closed": True}
    told = curve_shape(model, "cam").points
    np.testing.assert_allclose(np.linalg.norm(told[0]), 1e-3)


@pytest.mark.parametrize("name", SHAPES)
def test_a_scene_gives_its_curves_back(name):
    model = Model("curve", units="mm-t-s")
    model.add_curve("c", **SHAPES[name])
    model.add_body("b", mass=1, inertia=[1, 1, 1])
    again = Model.from_scene_dict(model.to_scene_dict())
    np.testing.assert_array_equal(curve_shape(again, "c").points, curve_shape(model, "c").points)


def test_pieces_have_the_curvature_of_a_helix():
    """r/(r² + c²) anywhere on it, and the tangent is a unit vector: of six turns."""
    found = pieces_of(shape(x="0.5*cos(t)", y="0.5*sin(t)", z="-0.2*t", range=[0, 40]))
    _, tangent, bend = found.at(np.linspace(0.0, 0.999 * found.ends[-1], 5000)).swapaxes(0, 1)
    np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(bend, axis=1), 0.5 / 0.29, rtol=1e-10)
    assert len(found.coefficients) <= 256


def test_a_curve_may_bend_where_it_is_closed():
    """The curvature of its begin counted at its end: it was off by 2e-8 in 1024 pieces."""
    pieces = pieces_of(shape(polar="0.05 + 0.01*(step(t,0,0,2,1) - step(t,4,0,6,1))", closed=True))
    x, y, _ = pieces.at(np.linspace(0.0, pieces.ends[-1], 5000))[:, 0].T
    angle = np.arctan2(y, x) % (2 * np.pi)
    up, down = np.clip(angle / 2, 0, 1), np.clip((angle - 4) / 2, 0, 1)
    radius = 0.05 + 0.01 * (up**2 * (3 - 2 * up) - down**2 * (3 - 2 * down))
    assert np.abs(np.hypot(x, y) - radius).max() < 1e-14
    assert len(pieces.coefficients) <= 256
    place, change = pieces.breaks[-1]
    assert place == pieces.ends[-1] and change > 1e-3
