"""An older picture, plot or table stays until the new one is whole."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from PIL import Image

from flexmb.errors import FlexmbError
from flexmb.folders import write_text_file
from flexmb.view import mpl_renderer
from flexmb.view.plot import save_figure
from flexmb.view.vtk_scene import VtkScene


def fill_disk(monkeypatch, owner, name):
    """The disk has room for the first bytes alone."""

    def write(self, file, *_, **__):
        Path(file).write_bytes(b"\x89PNG\r\n")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(owner, name, write)


def test_a_plot(tmp_path, monkeypatch):
    file = save_figure(Figure(), tmp_path / "a.png")
    before = file.read_bytes()
    fill_disk(monkeypatch, Figure, "savefig")
    with pytest.raises(FlexmbError, match=r"a\.png: cannot be written \(No space left"):
        save_figure(Figure(), file)
    assert file.read_bytes() == before and [*tmp_path.iterdir()] == [file]


def test_a_picture_by_matplotlib(tmp_path, monkeypatch):
    file = tmp_path / "a.png"
    file.write_bytes(b"older")
    fill_disk(monkeypatch, Figure, "savefig")
    monkeypatch.setattr(mpl_renderer, "_figure", lambda *_: Figure())
    with pytest.raises(OSError, match="No space left"):
        mpl_renderer.draw([], file, (10, 10), "")
    assert file.read_bytes() == b"older" and [*tmp_path.iterdir()] == [file]


def test_a_picture_by_vtk(tmp_path, monkeypatch):
    file = tmp_path / "a.png"
    file.write_bytes(b"older")
    fill_disk(monkeypatch, Image.Image, "save")
    scene = object.__new__(VtkScene)
    monkeypatch.setattr(VtkScene, "image", lambda _: Image.new("RGB", (2, 2)).__array_interface__)
    monkeypatch.setattr(Image, "fromarray", lambda _: Image.new("RGB", (2, 2)))
    with pytest.raises(OSError, match="No space left"):
        scene.save(file)
    assert file.read_bytes() == b"older" and [*tmp_path.iterdir()] == [file]


def test_a_text(tmp_path):
    (tmp_path / "study.md").mkdir()
    with pytest.raises(FlexmbError, match=r"study\.md: cannot be written"):
        write_text_file(tmp_path / "study.md", "text")
    assert [path.name for path in tmp_path.iterdir()] == ["study.md"]
