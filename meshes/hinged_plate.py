"""Make hinged_plate.msh: a square plate whose edges end in living hinges, in metres.

Run ``python meshes/hinged_plate.py``. The plate lies in the xy plane, a corner at the origin. From
each node of its edges a beam of 1 mm runs outwards: where that bends easily, the edge is simply
supported by whatever holds its outer end. Physical groups: surface ``plate``, lines ``hinges`` and
``corners`` (the beams at the corners), points ``frame`` (the outer ends of all beams).
"""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np

SIDE = 10.0  # m
DIVISIONS = 24
HINGE = 1e-3  # m, length of the beams


def main(path: Path) -> None:
    """Place the nodes, and write the file."""
    n = DIVISIONS
    i, j = (part.ravel() for part in np.indices((n + 1, n + 1)))
    plate = np.stack([i, j, 0 * i], axis=1) * SIDE / n
    outwards = np.stack([(i == n) * 1.0 - (i == 0), (j == n) * 1.0 - (j == 0), 0.0 * i], axis=1)
    edge = np.flatnonzero(outwards.any(axis=1))
    frame = len(plate) + np.arange(len(edge))
    points = np.concatenate([plate, plate[edge] + HINGE * outwards[edge]])
    node = np.arange(len(plate)).reshape(n + 1, n + 1)
    quads = np.stack([node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], axis=-1)
    beams = np.stack([edge, frame], axis=1)
    corner = outwards[edge].all(axis=1, where=[True, True, False])
    groups = {
        "plate": ("quad", quads.reshape(-1, 4)),
        "hinges": ("line", beams[~corner]),
        "corners": ("line", beams[corner]),
        "frame": ("vertex", frame[:, None]),
    }
    write(path, points, groups)


def write(path: Path, points: np.ndarray, groups: dict[str, tuple[str, np.ndarray]]) -> None:
    """Write elements by the name of their group."""
    dimension = {"vertex": 0, "line": 1, "line3": 1, "quad": 2, "quad8": 2, "hexahedron20": 3}
    tags = [np.full(len(cells), k + 1) for k, (_, cells) in enumerate(groups.values())]
    mesh = meshio.Mesh(
        points.round(9),
        list(groups.values()),
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={
            name: np.array([k + 1, dimension[kind]])
            for k, (name, (kind, _)) in enumerate(groups.items())
        },
    )
    meshio.gmsh.write(path, mesh, fmt_version="2.2", binary=False, float_fmt=".10g")


if __name__ == "__main__":
    main(Path(__file__).with_suffix(".msh"))
