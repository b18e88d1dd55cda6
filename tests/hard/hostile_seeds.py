"""Whole files of every kind that the hostile inputs are made from."""

from __future__ import annotations

import shutil
import subprocess
import sys
import warnings
from contextlib import redirect_stderr, suppress
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

PROJECT = Path(__file__).parents[2]
SLOW_SCENES = ("andrews", "excavator", "parallel_manipulator")  # a second and more to read
SCENE = """
[bodies.rod]
mass = 1
center = [0, -0.5, 0]
inertia = [0.1, 0.1, 0.1]
[joints.pin]
type = "revolute"
between = ["ground", "rod"]
axis = "z"
[sensors.swing]
type = "angle"
joint = "pin"
[dynamics]
duration = 0.1
step = 0.001
outputs = 3
"""


MANY = {
    "study": ("--vary", "dynamics.step=1e-3,5e-4", "--repeats", 1),
    "sweep": ("--vary", "bodies.rod.mass=0.9..1.1:3"),
    "budget": (),
}
"""Commands of many runs of the short scene, and their words."""


def prepare(folder: Path) -> None:
    """Copy scenes and meshes, and make whole bodies, results and meshes of every format."""
    for name in ("cases", "meshes"):
        leave = shutil.ignore_patterns("*.png", "*.py", "out", *SLOW_SCENES)
        shutil.copytree(PROJECT / name, folder / name, ignore=leave, dirs_exist_ok=True)
    seeds = folder / "seeds"
    seeds.mkdir(exist_ok=True)
    (seeds / "short.toml").write_text(
        'gravity = "earth -x"\n' + SCENE + '[sensors.end]\ntype = "position"\nof = "rod"\n'
    )
    cases = folder / "cases"
    commands: list[list[Any]] = [
        ["run", seeds / "short.toml", "--output", seeds / "short", "--no-picture"],
        ["run", cases / "hub_beam" / "scene.toml", "--output", seeds / "flexible", "--no-picture"],
        *(
            [name, seeds / "short.toml", *words, "--workers", 1, "--output", seeds / name]
            for name, words in MANY.items()
        ),
    ]
    for words in commands:
        subprocess.run(
            [sys.executable, "-m", "flexmb", *map(str, words)], capture_output=True, check=True
        )
    write_meshes(seeds)


def write_meshes(seeds: Path) -> None:
    """A small mesh with groups in every format that can be written here."""
    import meshio

    x, y, z = np.meshgrid([0, 0.5, 1.0], [0, 0.1], [0, 0.1], indexing="ij")
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    number = np.arange(12).reshape(3, 2, 2)
    hexes = [
        [number[i, 0, 0], number[i + 1, 0, 0], number[i + 1, 1, 0], number[i, 1, 0],
         number[i, 0, 1], number[i + 1, 0, 1], number[i + 1, 1, 1], number[i, 1, 1]]
        for i in range(2)
    ]  # fmt: skip
    split = ((0, 1, 3, 4), (1, 2, 3, 6), (1, 3, 4, 6), (3, 4, 6, 7), (1, 4, 5, 6))
    tetras = [[cell[k] for k in corners] for cell in hexes for corners in split]
    ends = [[0, 1, 2], [8, 9, 10]]
    meshes = {
        "hexes": meshio.Mesh(points, [("hexahedron", hexes)]),
        "tetras": meshio.Mesh(points, [("tetra", tetras)]),
        "faces": meshio.Mesh(points, [("triangle", ends)]),
        "beams": meshio.Mesh(points, [("line", [[0, 4], [4, 8]])]),
    }
    grouped = meshio.Mesh(
        points, [("tetra", tetras), ("triangle", ends)],
        point_sets={"root": np.array([0, 1, 2, 3])},
        cell_data={"gmsh:physical": [np.full(10, 3), np.array([1, 2])],
                   "gmsh:geometrical": [np.full(10, 3), np.array([1, 2])]},
        field_data={"all": np.array([3, 3]), "A": np.array([1, 2]), "B": np.array([2, 2])},
    )  # fmt: skip
    options: dict[str, list[dict[str, Any]]] = {
        "gmsh": [{}, {"binary": False}], "gmsh22": [{}, {"binary": False}],
        "vtk": [{}, {"binary": False}, {"binary": False, "fmt_version": "4.2"}],
        "vtu": [{}, {"binary": False}, {"compression": None}],
        "xdmf": [{}, {"data_format": "XML"}, {"data_format": "Binary"}],
        "stl": [{"binary": True}, {"binary": False}], "ply": [{"binary": False}, {}],
    }  # fmt: skip
    for ending, formats in meshio.extension_to_filetypes.items():
        for form in ["gmsh", "gmsh22", "ansys"] if ending == ".msh" else formats[:1]:
            for k, option in enumerate(options.get(form, [{}])):
                for name, mesh in (meshes | {"grouped": grouped}).items():
                    path = seeds / f"{form.removeprefix('.')}{k}-{name}{ending}"
                    with (
                        suppress(Exception),
                        warnings.catch_warnings(),
                        redirect_stderr(StringIO()),
                    ):
                        warnings.simplefilter("ignore")
                        meshio.write(path, mesh, file_format=form, **option)
                    if path.is_file() and not path.stat().st_size:
                        path.unlink()
