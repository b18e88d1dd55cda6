"""What the scripts that need gmsh share: meshing a solid, and a file that is small everywhere.

In: a path, and a function that draws the geometry and names its groups. Out: the file, gmsh 4.1,
with coordinates of twelve significant digits.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import gmsh


def make(path: Path, draw: Callable[[], None], **options: float) -> None:
    """Write the mesh of second-order tetrahedra of what ``draw`` draws.

    ``options`` are those of gmsh under ``Mesh.``, such as ``MeshSizeMax`` in millimetres.
    """
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add(path.stem)
    draw()
    for name, value in {**options, "ElementOrder": 2}.items():
        gmsh.option.setNumber(f"Mesh.{name}", value)
    gmsh.model.mesh.generate(3)
    write(path)


def write(path: Path) -> None:
    """Write gmsh's present model, and end gmsh."""
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.write(str(path))
    gmsh.finalize()
    text = compact(path.read_text(encoding="utf-8"))
    path.write_text(text, encoding="utf-8", newline="\n")


def compact(text: str) -> str:
    """The file with coordinates of twelve significant digits."""

    def shorten(match: re.Match[str]) -> str:
        value = float(match.group())
        return f"{0.0 if math.fabs(value) < 1e-9 else value:.12g}"

    start, end = text.index("$Nodes"), text.index("$EndNodes")
    number = re.compile(r"-?\d+\.\d+(?:e[-+]?\d+)?|-?\d+e[-+]?\d+")
    return text[:start] + number.sub(shorten, text[start:end]) + text[end:]
