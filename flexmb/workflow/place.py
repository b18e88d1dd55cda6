"""Where a scene's output goes when nothing else is said."""

from __future__ import annotations

from pathlib import Path

__all__ = ["output_folder"]


def output_folder(scene: str | Path) -> Path:
    """``out/<name>``, the name being that of the scene's folder for a file ``scene.toml``."""
    path = Path(scene)
    return Path("out") / (path.resolve().parent.name if path.stem == "scene" else path.stem)
