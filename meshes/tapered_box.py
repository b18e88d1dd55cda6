"""Make tapered_box.msh: a tapered box of thin walls with ribs, of shells and beams, in metres.

Run ``python meshes/tapered_box.py``. The box runs along x from its root at x = 0; its walls are
quads, its ribs the closed frames of beams around it. Physical groups: surface ``walls``, lines
``ribs``, lines ``root`` and ``tip`` at the ends.
"""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np

LENGTH = 4.0  # m
ROOT, TIP = (0.6, 0.3), (0.3, 0.15)  # m along y and z, of the walls' middle
BAYS, PER_BAY = 8, 4  # ribs at every fourth ring of nodes
ACROSS = (8, 4)  # elements along y and z


def main(path: Path) -> None:
    """Place the nodes ring by ring, and write the file."""
    rings, around = BAYS * PER_BAY + 1, 2 * sum(ACROSS)
    unit = ring()
    s = np.linspace(0.0, 1.0, rings)[:, None]
    size = (1 - s) * np.array(ROOT) + s * np.array(TIP)
    points = np.zeros((rings, around, 3))
    points[:, :, 0] = LENGTH * s
    points[:, :, 1:] = unit[None] * size[:, None]
    node = np.arange(rings * around).reshape(rings, around)
    beyond = np.roll(node, -1, axis=1)
    walls = np.stack([node[:-1], node[1:], beyond[1:], beyond[:-1]], axis=-1).reshape(-1, 4)
    edges = np.stack([node, beyond], axis=-1)
    ribs = edges[PER_BAY:-1:PER_BAY].reshape(-1, 2)
    cells = [("quad", walls), ("line", ribs), ("line", edges[0]), ("line", edges[-1])]
    tags = [np.full(len(rows), k + 1) for k, (_, rows) in enumerate(cells)]
    mesh = meshio.Mesh(
        points.reshape(-1, 3).round(9),
        cells,
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={
            name: np.array([tag + 1, 2 if tag == 0 else 1])
            for tag, name in enumerate(("walls", "ribs", "root", "tip"))
        },
    )
    meshio.write(path, mesh, file_format="gmsh22", binary=False)


def ring() -> np.ndarray:
    """(around, 2) nodes of a section of unit size, anticlockwise about x from -y, -z."""
    y, z = (np.linspace(-0.5, 0.5, count + 1) for count in ACROSS)
    low = np.stack([y[:-1], np.full(ACROSS[0], -0.5)], axis=1)
    right = np.stack([np.full(ACROSS[1], 0.5), z[:-1]], axis=1)
    return np.concatenate([low, right, -low, -right])


if __name__ == "__main__":
    main(Path(__file__).with_suffix(".msh"))
