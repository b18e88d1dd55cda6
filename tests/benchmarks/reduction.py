"""What the reduction of large models costs; run by hand: `python -m tests.benchmarks.reduction`.

One row for each model, each in a process of its own: degrees of freedom, CPU seconds by phase, the
largest memory of the process, entries of the factor, and how well the columns of the basis fulfil
their equations. Names of models after the command run these alone.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy.sparse.linalg import norm

from flexmb.fe import Mesh, assemble, craig_bampton, make_interfaces, orthonormalise, resolve
from flexmb.fe.meshes.mesh_file import read_mesh
from flexmb.fe.reduce import make_body

_PHASES = ("mesh", "assemble", "order", "factor", "modes", "rest")
_RING = ((0, 1), (1, 2), (2, 3), (3, 0))
_EDGES = (*_RING, *((a + 4, b + 4) for a, b in _RING), *((a, a + 4) for a in range(4)))
_CORNERS = np.array(
    [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [0, 0, 2], [2, 0, 2], [2, 2, 2], [0, 2, 2]]
)


def hex20_block(n):
    """Block 4 x 1 x 1 m of 4n x n x n hexahedra with mid-side nodes, its end faces as groups."""
    local = np.vstack([_CORNERS, [(_CORNERS[a] + _CORNERS[b]) // 2 for a, b in _EDGES]])
    cells = 2 * np.indices((4 * n, n, n)).reshape(3, -1).T
    grid = cells[:, None] + local
    key = (grid[..., 0] * (2 * n + 1) + grid[..., 1]) * (2 * n + 1) + grid[..., 2]
    _, first, connected = np.unique(key, return_index=True, return_inverse=True)
    points = grid.reshape(-1, 3)[first] / (2 * n)
    ends = {name: np.flatnonzero(points[:, 0] == x) for name, x in (("x0", 0.0), ("x1", 4.0))}
    return Mesh(points, {"hexahedron20": connected.reshape(key.shape)}, ends)


def tet10_plate(size):
    """Plate 400 x 200 x 30 mm with twelve holes, meshed by Gmsh with this size of elements [m]."""
    import gmsh  # an optional package

    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    plate = gmsh.model.occ.addBox(0, 0, 0, 0.4, 0.2, 0.03)
    places = [(x, y) for x in (0.08, 0.16, 0.24, 0.32) for y in (0.05, 0.1, 0.15)]
    add = gmsh.model.occ.addCylinder
    holes = [(3, add(x, y, -0.01, 0, 0, 0.05, 0.015)) for x, y in places]
    body, _ = gmsh.model.occ.cut([(3, plate)], holes)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in body], name="body")
    for name, x in (("x0", 0.0), ("x1", 0.4)):
        found = gmsh.model.getEntitiesInBoundingBox(x - 1e-6, -1, -1, x + 1e-6, 1, 1, 2)
        gmsh.model.addPhysicalGroup(2, [tag for _, tag in found], name=name)
    for option in ("MeshSizeMin", "MeshSizeMax"):
        gmsh.option.setNumber(f"Mesh.{option}", size)
    gmsh.option.setNumber("Mesh.ElementOrder", 2)
    gmsh.option.setNumber("Mesh.HighOrderOptimize", 1)
    gmsh.model.mesh.generate(3)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plate.msh"
        gmsh.write(str(path))
        gmsh.finalize()
        return read_mesh(path)


MODELS = {
    "hex20-30k": lambda: hex20_block(8),
    "hex20-119k": lambda: hex20_block(13),
    "hex20-307k": lambda: hex20_block(18),
    "tet10-110k": lambda: tet10_plate(0.0085),
    "tet10-247k": lambda: tet10_plate(0.006),
}


class Stopwatch:
    """CPU seconds by phase, told by the progress of the library."""

    def __init__(self):
        self.seconds, self.details = defaultdict(float), {}
        self._phase, self._since = "mesh", time.process_time()

    def __call__(self, phase, fraction, detail=""):
        now = time.process_time()
        self.seconds[self._phase if self._phase in _PHASES else "rest"] += now - self._since
        self._phase, self._since = phase, now
        if detail:
            self.details[phase] = detail


def measure(name):
    """One row of the table."""
    watch = Stopwatch()
    mesh = MODELS[name]()
    watch("assemble", 0.0)
    fe = assemble(mesh, resolve("steel"), None, watch)
    interfaces = make_interfaces(fe, {"left": "x0", "right": "x1"})
    reduced = craig_bampton(fe, interfaces, 20, watch)
    watch("rest", 0.0)
    make_body(name, fe, reduced, orthonormalise(fe, reduced), progress=watch)
    watch("rest", 1.0)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    total = sum(watch.seconds.values()) - watch.seconds["mesh"]
    times = "".join(f"{watch.seconds[phase]:9.1f}" for phase in _PHASES)
    entries = watch.details["factor"].split(", ")[-1].removesuffix(" entries")
    static, vibration = residuals(fe, reduced)
    held = f"{static:9.0e}{vibration:9.0e}"
    return f"{name:>11}{fe.numbering.n:8}{times}{total:9.1f}{peak:7.2f}{entries:>9}{held}"


def residuals(fe, reduced):
    """Largest residual of the constraint modes, relative to the forces of the neighbours, and of
    the fixed-interface modes, relative to their forces of inertia; inside the interfaces."""
    held = np.concatenate([part.dofs for part in reduced.interfaces])
    inner = np.setdiff1d(np.arange(fe.numbering.n), held)
    c = 6 * len(reduced.interfaces)
    force = fe.K @ reduced.basis
    scale = norm(fe.K[inner][:, held]) * np.linalg.norm(reduced.basis[held, :c], axis=0)
    static = np.linalg.norm(force[inner, :c], axis=0) / scale
    inertia = (fe.M @ reduced.basis[:, c:])[inner] * np.diag(reduced.K)[c:]
    wrong = np.linalg.norm(force[inner, c:] - inertia, axis=0)
    return static.max(), (wrong / np.linalg.norm(inertia, axis=0)).max()


def main(names):
    if len(names) == 1:
        print(measure(names[0]), flush=True)
        return
    print(f"{'model':>11}{'DOF':>8}{''.join(f'{phase:>9}' for phase in _PHASES)}{'CPU s':>9}"
          f"{'GB':>7}{'entries':>9}{'static':>9}{'modes':>9}", flush=True)  # fmt: skip
    for name in names or MODELS:
        subprocess.run([sys.executable, "-m", __spec__.name, name], check=True)


if __name__ == "__main__":
    main(sys.argv[1:])
