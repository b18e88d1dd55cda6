"""Both ways of drawing, for all tests of pictures."""

from __future__ import annotations

import pytest

from flexmb.view import vtk_renderer

NO_VTK = vtk_renderer.Verdict(
    False, "", "VTK cannot render here: a library is missing", "install it"
)


@pytest.fixture
def without_vtk(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine on which VTK does not render."""
    monkeypatch.setattr(vtk_renderer, "probe", lambda fresh=False: NO_VTK)


@pytest.fixture(params=["vtk", "matplotlib"])
def drawn_by(request: pytest.FixtureRequest) -> str:
    """Both ways of drawing; VTK is left out where it does not work."""
    if request.param == "matplotlib":
        request.getfixturevalue("without_vtk")
    elif not vtk_renderer.probe().works:
        pytest.skip("VTK does not render on this machine")
    return request.param
