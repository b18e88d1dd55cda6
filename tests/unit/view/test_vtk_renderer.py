"""The verdict on the renderer: found in a subprocess, kept, and never fatal."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from flexmb.view import vtk_renderer


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEXMB_CACHE_DIR", str(tmp_path))


def _answers(monkeypatch: pytest.MonkeyPatch, answers: dict[str, tuple[int, str, str]]) -> list:
    """Let trial pictures end as told, by window class; the list of those that were tried."""
    tried: list[str] = []

    def run(command, env, **_):
        tried.append(env.get("VTK_DEFAULT_OPENGL_WINDOW", ""))
        code, out, err = answers[tried[-1]]
        return subprocess.CompletedProcess(command, code, out, err)

    monkeypatch.setattr(vtk_renderer.subprocess, "run", run)
    monkeypatch.setattr(vtk_renderer.platform, "system", lambda: "Linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW", raising=False)
    return tried


def test_egl_is_taken_first_where_there_is_no_display_and_remembered(monkeypatch) -> None:
    tried = _answers(
        monkeypatch, {"vtkEGLRenderWindow": (0, "noise\nwindow:vtkEGLRenderWindow\n", "")}
    )
    assert vtk_renderer.probe().works
    assert vtk_renderer.probe().how == "VTK off-screen through EGL"
    assert tried == ["vtkEGLRenderWindow"]
    vtk_renderer.probe(fresh=True)
    assert len(tried) == 2


def test_a_crash_of_the_trial_names_what_to_install(monkeypatch) -> None:
    crash = (-11, "", "")
    tried = _answers(monkeypatch, {"vtkEGLRenderWindow": crash, "vtkOSOpenGLRenderWindow": crash})
    verdict = vtk_renderer.probe()
    assert not verdict.works
    assert "crashes at the first picture" in verdict.how
    for package in ("libegl1", "libegl-mesa0", "libgl1-mesa-dri", "libx11-6", "libosmesa6"):
        assert package in verdict.advice
    assert len(tried) == 2


def test_osmesa_is_the_second_choice(monkeypatch) -> None:
    osmesa = "vtkOSOpenGLRenderWindow"
    _answers(
        monkeypatch, {"vtkEGLRenderWindow": (-11, "", ""), osmesa: (0, f"window:{osmesa}\n", "")}
    )
    verdict = vtk_renderer.probe()
    assert (verdict.works, verdict.window) == (True, osmesa)


def test_a_display_is_tried_first(monkeypatch) -> None:
    tried = _answers(monkeypatch, {"": (0, "window:vtkXOpenGLRenderWindow\n", "")})
    monkeypatch.setenv("DISPLAY", ":0")
    assert vtk_renderer.probe().how == "VTK through the X display"
    assert tried == [""]


def test_new_libraries_ask_for_a_new_trial(monkeypatch) -> None:
    _answers(monkeypatch, {"vtkEGLRenderWindow": (0, "window:vtkEGLRenderWindow\n", "")})
    before = vtk_renderer._fingerprint()
    monkeypatch.setenv("LD_LIBRARY_PATH", "/somewhere/else")
    assert vtk_renderer._fingerprint() != before


def test_a_damaged_or_unwritable_cache_does_no_harm(monkeypatch, tmp_path: Path) -> None:
    tried = _answers(monkeypatch, {"vtkEGLRenderWindow": (0, "window:vtkEGLRenderWindow\n", "")})
    vtk_renderer.probe()
    for file in tmp_path.glob("renderer-*.json"):
        file.write_text("{")
    assert vtk_renderer.probe().works
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("FLEXMB_CACHE_DIR", str(tmp_path / "file" / "below"))
    assert vtk_renderer.probe().works
    assert len(tried) == 3


@pytest.mark.parametrize("system", ["Windows", "Darwin"])
def test_off_linux_vtk_chooses_its_own_window(monkeypatch, system: str) -> None:
    tried = _answers(monkeypatch, {"": (0, "window:vtkWin32OpenGLRenderWindow\n", "")})
    monkeypatch.setattr(vtk_renderer.platform, "system", lambda: system)
    verdict = vtk_renderer.probe()
    assert (verdict.works, tried) == (True, [""])
    vtk_renderer.use(verdict)
    assert "VTK_DEFAULT_OPENGL_WINDOW" not in os.environ


def test_a_crash_on_windows_is_known_by_its_exit_code(monkeypatch) -> None:
    _answers(monkeypatch, {"": (0xC0000005, "", "")})
    monkeypatch.setattr(vtk_renderer.platform, "system", lambda: "Windows")
    verdict = vtk_renderer.probe()
    assert "crashes at the first picture" in verdict.how
    assert "graphics driver" in verdict.advice
