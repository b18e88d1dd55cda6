"""Make elliptic_plate.msh and elliptic_membrane.msh, quarters of the plates of NAFEMS LE10 and LE1.

Run ``python meshes/elliptic_plate.py``. Both lie between the ellipses (x/2)^2 + y^2 = 1 and
(x/3.25)^2 + (y/2.75)^2 = 1, in metres, with x and y positive; the plate is 0.6 m thick, the
membrane 0.1 m. They are of 20-node hexahedra. Groups of faces
are ``outer``, ``upper``, ``lower``, ``on_x``, ``on_y``; ``belt`` is the middle line of the outer
face of the plate.
"""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
from hinged_plate import write

EDGES = (
    *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
    *((0, 4), (1, 5), (2, 6), (3, 7)),
)  # of a hexahedron, in the order of its mid-side nodes
CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)


def plan(out: np.ndarray, around: np.ndarray) -> np.ndarray:
    """x, y from the shares of the way outwards and around, from the x axis."""
    r, angle = out, np.pi / 2 * around
    return np.stack([(2 + 1.25 * r) * np.cos(angle), (1 + 1.75 * r) * np.sin(angle)], axis=-1)


def plate(file: str, divisions: tuple[int, int, int], thickness: float) -> None:
    """Hexahedra out, around and up: on a grid of half their size, without the middles of faces."""
    size = 2 * np.array(divisions)
    grid = np.indices(size + 1).reshape(3, -1).T
    grid = grid[(grid % 2).sum(axis=1) < 2]
    node = {tuple(g): k for k, g in enumerate(grid)}
    offsets = [2 * c for c in CORNERS] + [CORNERS[a] + CORNERS[b] for a, b in EDGES]
    cells = 2 * np.stack(np.indices(divisions), axis=-1).reshape(-1, 3)
    solids = np.array([[node[tuple(c + o)] for o in offsets] for c in cells])
    share = grid / size
    points = np.column_stack([plan(share[:, 0], share[:, 1]), thickness * share[:, 2]])
    groups = {"solid": ("hexahedron20", solids)}
    faces = {"outer": (0, 2), "on_x": (1, 0), "on_y": (1, 2), "lower": (2, 0), "upper": (2, 2)}
    ends = {"outer": size[0], "on_x": 0, "on_y": size[1], "lower": 0, "upper": size[2]}
    for name, (axis, side) in faces.items():
        local = [k for k, o in enumerate(offsets) if o[axis] == side]
        corners = [k for k in local if k < 8]
        ring = [corners[0]]
        pairs = [{a, b} for a, b in combinations(corners, 2) if (a, b) in EDGES or (b, a) in EDGES]
        while len(ring) < 4:
            ring.append(next(k for k in corners if k not in ring and {ring[-1], k} in pairs))
        middles = [
            8 + next(e for e, pair in enumerate(EDGES) if set(pair) == {ring[k], ring[k - 3]})
            for k in range(4)
        ]
        on = (grid[solids[:, local], axis] == ends[name]).all(axis=1)
        groups[name] = ("quad8", solids[on][:, ring + middles])
    if divisions[2] % 2 == 0:
        belt = np.array([node[size[0], k, divisions[2]] for k in range(size[1] + 1)])
        groups["belt"] = ("line3", np.stack([belt[:-2:2], belt[2::2], belt[1::2]], axis=1))
    write(Path(__file__).with_name(file), points, groups)


if __name__ == "__main__":
    plate("elliptic_plate.msh", (7, 10, 4), thickness=0.6)
    plate("elliptic_membrane.msh", (10, 16, 1), thickness=0.1)
