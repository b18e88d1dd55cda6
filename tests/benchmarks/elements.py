"""One cantilever by every kind of element; run by hand: `python -m tests.benchmarks.elements`.

A steel strip 1 m x 100 mm x 20 mm, clamped at x = 0. One row for each mesh: degrees of freedom,
error of the first and third bending and of the first torsional frequency, error of the bending
stress at a fifth of the length under a force at the tip, CPU seconds of the whole reduction with
the root and the tip as interfaces and twelve modes. Frequencies are compared with the method of
Ritz for the solid strip (Legendre polynomials, from above), stress with M c / I.
"""

from __future__ import annotations

import time
import warnings

import numpy as np

from flexmb.errors import FlexmbWarning
from flexmb.fe import assemble, reduce, resolve
from flexmb.fe.meshes.mesh_shapes import mesh_from
from flexmb.fe.sections.section_tables import rectangle
from flexmb.fe.sections.shell_section import shell
from flexmb.flexbody.natural_modes import natural_modes
from tests.solidkit import clamped_block

_L, _B, _H = 1.0, 0.1, 0.02
_STATION = 0.2  # of the length: two widths from the root, where the clamp is no longer felt
_STEEL = resolve("steel")
_POLYNOMIALS = (20, 7, 5)  # along x, y, z
_MODES = 10
_SHELLS = ((20, 2), (40, 4), (80, 8))


def beams(n):
    """A line of n elements."""
    return {"type": "beam", "length": _L, "divisions": n}, rectangle(_B, _H)


def shells(kind, n, m):
    """n by m quads, or twice as many triangles."""
    size = {"length": _L, "width": _B, "divisions": [n, m]}
    return {"type": "plate", **size, "elements": kind}, shell(_H)


def solids(kind, *n):
    """Cells n along x, y, z."""
    return {"type": "box", "size": [_L, _B, _H], "divisions": list(n), "elements": kind}, None


MESHES = (
    *(("beam", f"{n}", beams(n)) for n in (5, 10, 20, 40)),
    *(
        ("quad", f"{n} x {m}", shells("quad", n, m))
        for n, m in ((10, 1), (20, 2), (40, 4), (80, 8))
    ),
    *(("triangle", f"{n} x {m}", shells("triangle", n, m)) for n, m in _SHELLS),
    *(
        (kind, " x ".join(map(str, n)), solids(kind, *n))
        for kind, several in {
            "hexahedron20": ((10, 1, 1), (20, 2, 1), (40, 4, 1)),
            "hexahedron27": ((20, 2, 1),),
            "hexahedron": ((20, 2, 1), (40, 4, 2)),
            "wedge15": ((20, 2, 1),),
            "tetra10": ((20, 2, 1), (40, 4, 1)),
            "tetra": ((20, 2, 1), (40, 4, 2)),
        }.items()
        for n in several
    ),
)


def main():
    """Print the table."""
    exact = named(clamped_block((_L, _B, _H), _POLYNOMIALS, _STEEL, _MODES) / (2 * np.pi))
    coarser = named(clamped_block((_L, _B, _H), (16, 6, 4), _STEEL, _MODES) / (2 * np.pi))
    told = ", ".join(f"{name} {f:.2f} Hz" for name, f in exact.items())
    change = max(abs(coarser[name] / exact[name] - 1) for name in exact)
    print(f"Ritz: {told}; with fewer polynomials {100 * change:.2f} % more at most")
    print(f"{'element':>13}{'mesh':>12}{'DOF':>7}{'bending 1':>11}{'bending 3':>11}"
          f"{'torsion':>9}{'stress':>9}{'CPU s':>7}")  # fmt: skip
    body_of(*MESHES[0][2])  # imports what the first row would pay for
    for kind, mesh, model in MESHES:
        begin = time.process_time()
        body = body_of(*model)
        seconds = time.process_time() - begin
        found = shaped(body)
        errors = [100 * (found[name] / exact[name] - 1) for name in exact]
        stress = 100 * (root_stress(body) / (6 * (1 - _STATION) * _L / (_B * _H**2)) - 1)
        print(f"{kind:>13}{mesh:>12}{unknowns(*model):7}{errors[0]:+10.2f}%{errors[1]:+10.2f}%"
              f"{errors[2]:+8.2f}%{stress:+8.2f}%{seconds:7.2f}", flush=True)  # fmt: skip


def named(frequencies):
    """Of the strip: bending 1, sideways, bending 2, bending 3, torsion in ascending order."""
    return dict(zip(("bending 1", "bending 3", "torsion"), frequencies[[0, 3, 4]], strict=True))


def body_of(mesh, section):
    """The strip reduced; the mean of the nodes of the tip is its marker, so that it stays soft."""
    line = section is not None and section.dimension == 1
    groups = ("start", "end") if line else ("x0", "x1")
    tip = groups[1] if line else {"group": groups[1], "type": "rbe3", "weights": "area"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlexmbWarning)  # four-node tetrahedra are warned of
        return reduce(
            mesh,
            material=_STEEL,
            sections=None if section is None else {"all": section},
            interfaces={"root": groups[0], "tip": tip},
            modes=12,
        )


def unknowns(mesh, section):
    """Degrees of freedom of the mesh."""
    sections = None if section is None else {"all": section}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlexmbWarning)
        return assemble(mesh_from(mesh), _STEEL, sections).numbering.n


def shaped(body):
    """Frequencies of the clamped body by what its tip does: up and down, or turning about x."""
    modes, tip = natural_modes(body, ["root"]), body.interface("tip")
    frame, eta = modes.frame, modes.eta
    moved = frame[:3] + np.cross(frame[3:].T, tip.position).T + tip.Phi_t @ eta
    turned = frame[3:] + tip.Phi_r @ eta
    amounts = np.abs(np.stack([moved[2], moved[1], turned[0] * _B / 2, moved[0]]))
    what = amounts.argmax(axis=0)
    bending, torsion = (modes.frequencies[what == k] for k in (0, 2))
    return {"bending 1": bending[0], "bending 3": bending[2], "torsion": torsion[0]}


def root_stress(body):
    """Largest bending stress [Pa] at the station under 1 N up at the tip, the root held."""
    root, tip = body.interface("root"), body.interface("tip")
    force = np.array([0.0, 0.0, 1.0])
    moment = np.cross(tip.position - root.position, force)
    work = (tip.Phi_t - root.Phi_t).T @ force - root.Phi_r.T @ moment
    eta = np.linalg.solve(body.K, work)
    points = body.surface.points
    there = body.surface.node_ids[np.abs(points[:, 0] - _STATION * _L) < 1e-9]
    rows = np.flatnonzero(np.isin(body.stress.ids, there))
    return np.abs(body.stress.at(eta, rows)[:, 0]).max()


if __name__ == "__main__":
    main()
