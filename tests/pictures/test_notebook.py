"""What a notebook shows of models, results, pictures and films."""

from __future__ import annotations

import base64
import io
import re

import pytest
import slidercrank
from PIL import Image

from flexmb.model import Model
from flexmb.results import Result


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return Result(slidercrank.make(tmp_path_factory.mktemp("run")))


def test_a_picture_is_shown_and_leaves_no_file(result: Result) -> None:
    files = sorted(result.path.parent.iterdir())
    png = result.snapshot(0.01, size=(200, 120))._repr_png_()
    assert Image.open(io.BytesIO(png)).size == (200, 120)
    assert sorted(result.path.parent.iterdir()) == files


@pytest.mark.seconds
def test_a_film_is_shown(result: Result) -> None:
    html = result.animation(end=0.004, speed=0.02, size=(160, 90), processes=1)._repr_html_()
    kind, text = re.search(r'src="data:(\S+);base64,([^"]+)"', html).groups()
    data = base64.b64decode(text)
    assert data[:6] == b"GIF89a" if kind == "image/gif" else data[4:8] == b"ftyp"


def test_a_model_shows_its_parts_and_escapes_their_names() -> None:
    model = Model("a < b")
    for k in range(20):
        model.add_body(f"b{k}", mass=1, inertia=[1, 1, 1])
    model.add_joint("pin", "revolute", between=["ground", "b0"], axis="z")
    html = model._repr_html_()
    assert "a &lt; b" in html
    assert "20 bodies" in html
    assert "b11 and 8 more" in html
    assert "pin (ground, b0)" in html
