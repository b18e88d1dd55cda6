"""Rigid bodies of a planar model: three coordinates wide.

A body moves along two global axes a, b and turns about the normal, which is ± its own axis k; i, j
are its other axes, (i, j, k) cyclic. With w = ω'_k and e = ω̇'_k the inertia force is that of
`inertia` with all other components zero. Coordinates out of the plane stay as they are, and their
residual is zero.
"""

from __future__ import annotations

from typing import NamedTuple

from flexmb.engine.jit import unit
from flexmb.engine.kernels.bodies import energy, inertia, inertia_tangent
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.records import Integers
from flexmb.engine.state import Point, Run


class PlanarBodies(NamedTuple):
    """Rigid bodies of a planar model."""

    rows: Integers  # their rows in the table of bodies
    about: Integers  # (n,) their axis k along the normal
    plane: Integers  # (3,) the global axes a, b, and the normal


@unit
def turn_bodies(run: Run, of: PlanarBodies, at: Point) -> int:
    """Direction cosines of the bodies."""
    bodies, body_now, rows, q = run.system.parts.bodies, run.work.now.body, of.rows, at.q
    for n in range(rows.shape[0]):
        inertia.rotation_matrix(q, bodies[rows[n]]["iq"] + 3, body_now[rows[n]]["A"])
    return FINE


@unit
def prepare_bodies(run: Run, of: PlanarBodies, at: Point) -> int:
    """J and c of the bodies, which never change."""
    inertia.prepare_bodies(run.system.parts.bodies, run.work.now.body, of.rows)
    return FINE


@unit
def inertia_forces(run: Run, of: PlanarBodies, at: Point) -> int:
    """Trial.res = M v̇ + velocity terms + gravity in the plane."""
    parts, body_now, out, rows = run.system.parts, run.work.now.body, run.work.trial.res, of.rows
    bodies, g, v, vd, about = parts.bodies, parts.gravity, at.v, at.vd, of.about
    a, b, c = of.plane[0], of.plane[1], of.plane[2]
    for n in range(rows.shape[0]):
        body, bn, k = bodies[rows[n]], body_now[rows[n]], about[n]
        A, s, iv, mass = bn["A"], bn["c"], body["iv"], body["mass"]
        i = k + 1 if k < 2 else 0
        j = i + 1 if i < 2 else 0
        w, e = v[iv + 3 + k], vd[iv + 3 + k]
        x, y = vd[iv + a] - g[a], vd[iv + b] - g[b]
        fi, fj = -e * s[j] - w * w * s[i], e * s[i] - w * w * s[j]
        out[iv + a] = mass * x + A[a, i] * fi + A[a, j] * fj
        out[iv + b] = mass * y + A[b, i] * fi + A[b, j] * fj
        out[iv + c] = 0.0
        pi, pj = A[a, i] * x + A[b, i] * y, A[a, j] * x + A[b, j] * y
        out[iv + 3 + i] = 0.0
        out[iv + 3 + j] = 0.0
        out[iv + 3 + k] = bn["J"][k, k] * e + s[i] * pj - s[j] * pi
    return FINE


PLANAR_BODIES = Kind(
    "planar_bodies",
    PlanarBodies,
    {
        "constants": prepare_bodies,
        "position": turn_bodies,
        "force": inertia_forces,
        "matrix": inertia_tangent.rigid_matrix,
        "mass": inertia_tangent.rigid_mass_product,
        "energy": energy.rigid_energies,
    },
)
