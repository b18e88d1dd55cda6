"""Pictures by von Mises stress: the scale, its unit, the layer, bodies without stress."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import slidercrank

from flexmb.errors import ViewError
from flexmb.flexbody import StressModes, load, save
from flexmb.results import Result
from flexmb.view.drawing import Drawing
from flexmb.view.mechanism import Mechanism
from flexmb.view.picture import render, view_of


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The rod has 1 GPa in xx at the bottom and 2 GPa at the top per eta, in its first half."""
    run = Result(slidercrank.make(tmp_path_factory.mktemp("run")))
    body = load(run.flexbodies["rod"])
    nodes = np.unique(body.surface.node_ids)
    nodes = nodes[: len(nodes) // 2]
    modes = np.zeros((2 * len(nodes), 6, 1))
    modes[::2, 0], modes[1::2, 0] = 1e9, 2e9
    layer, part = np.tile([0, 1], len(nodes)), np.zeros(2 * len(nodes), dtype=int)
    stress = StressModes(np.repeat(nodes, 2), part, layer, ("all",), ("bottom", "top"), modes)
    save(dataclasses.replace(body, stress=stress), run.flexbodies["rod"])
    return Result(run.path)


def test_the_largest_of_the_layers_is_shown_with_a_suitable_unit(result: Result) -> None:
    mechanism = Mechanism(result)
    eta = abs(mechanism.pose("rod").eta[0])
    for layer, factor in ((None, 2e9), ("top", 2e9), ("bottom", 1e9)):
        view = view_of(mechanism, {"color": "von_mises", "layer": layer})
        content = Drawing(mechanism, view).content()
        (rod,) = content.deformed
        known = np.isfinite(rod.values)
        assert 0.3 < known.mean() < 0.7  # the first half tells its stress
        np.testing.assert_allclose(rod.values[known], factor * eta, rtol=1e-6)
        assert content.scale.largest == pytest.approx(factor * eta, rel=1e-6)
    assert content.scale.label == f"von Mises stress [{content.scale.unit}]"
    assert content.scale.unit in ("kPa", "MPa")
    assert f"largest von Mises stress {content.scale.top:.3g}" in content.caption


def test_both_ways_draw_it(result: Result, tmp_path: Path, drawn_by: str) -> None:
    path = render(result, color="von_mises", output=tmp_path / "a.png", size=(400, 225))
    picture = matplotlib.image.imread(path)[:, :300, :3]  # without the colour bar
    yellow = (picture[:, :, 0] > 0.6) & (picture[:, :, 1] > 0.6) & (picture[:, :, 2] < 0.4)
    assert yellow.mean() > 1e-4


def test_mistakes_are_told(result: Result, tmp_path: Path) -> None:
    out = tmp_path / "a.png"
    with pytest.raises(
        ViewError, match='no flexible body has stress in a layer "topp"; nearest: top'
    ):
        render(result, color="von_mises", layer="topp", output=out)
    with pytest.raises(ViewError, match='the layer "top" is of stress'):
        render(result, layer="top", output=out)
    with pytest.raises(ViewError, match='color: unknown choice "mises"; nearest: von_mises'):
        render(result, color="mises", output=out)
    bare = Result(slidercrank.make(tmp_path / "bare"))
    with pytest.raises(ViewError, match="no flexible body of the run has stress"):
        render(bare, color="von_mises", output=out)
