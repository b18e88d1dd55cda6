"""Where laws act: on the distance of two markers, on a component of their separation, on a scalar
coordinate. With the gradient g (12) of the measure, the wrench pair is −R g, as for a constraint
row whose multiplier is R."""

from __future__ import annotations

from flexmb.engine.element_tables import COORDINATE_OF, DISTANCE_OF
from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.blocks import clear
from flexmb.engine.kernels.forces import law
from flexmb.engine.kernels.joints import primitive, row_tangent
from flexmb.engine.kernels.joints.dots import separation
from flexmb.engine.tables import DISTANCE, DOT2

Z = 2


@kernel
def actuator(row, fun):
    """Present value of its function of time."""
    return fun[row["fun"], 0] if row["fun"] >= 0 else 0.0


@kernel
def defined(row, mi, mj):
    """Whether the measure has a direction: the distance of one point has none."""
    if row["measure"] != DISTANCE_OF:
        return True
    hx, hy, hz = separation(mi, mj)
    return hx * hx + hy * hy + hz * hz > 0.0


@kernel
def between(row, mi, mj, g):
    """s and ṡ between two markers, and the gradient g (12)."""
    kind = DISTANCE if row["measure"] == DISTANCE_OF else DOT2
    primitive.gradient(None, kind, Z, Z, mi, mj, g)
    return primitive.value(None, kind, Z, Z, mi, mj, 0.0), primitive.rate(g, mi, mj)


@kernel
def between_markers(row):
    """Whether a law acts between two markers, not on a coordinate."""
    return row["measure"] != COORDINATE_OF


@kernel
def present(row, coordinates, now, v):
    """s and ṡ of a law, after a position and a velocity stage."""
    if between_markers(row):
        mi, mj, g = now.marker[row["I"]], now.marker[row["J"]], now.element.E[0]
        return between(row, mi, mj, g)
    if coordinates is not None:
        k = row["coordinate"]
        return now.element.s[k], v[coordinates[k]["iv"]]
    return 0.0, 0.0


@kernel
def add_tangent(row, elements, now, fun, cv, cp, g, H):
    """Add −(cp ∂w/∂position + cv ∂w/∂velocity) of a law between markers to H (12, 12).

    Leaves its damping between the velocities of the markers in W of the scratch, and R g in g;
    returns whether there is damping.
    """
    s, mi, mj = now.element, now.marker[row["I"]], now.marker[row["J"]]
    kind = DISTANCE if row["measure"] == DISTANCE_OF else DOT2
    x, v = between(row, mi, mj, g)
    f, k, c = law.resistance(row, elements, s.stack, x, v, actuator(row, fun))
    clear(s.W, 12, 12)
    row_tangent.add_row_tangent(None, kind, Z, Z, mi, mj, 1.0, s.E[0], s.W)
    for b in range(12):
        turn = 0.0  # of ṡ at constant velocities of the markers
        for a in range(3):
            turn += mi["vx"][a] * s.W[a, b] + mi["om"][a] * s.W[3 + a, b]
            turn += mj["vx"][a] * s.W[6 + a, b] + mj["om"][a] * s.W[9 + a, b]
        along = (cp * k + cv * c) * g[b] + (cp * c * turn if c != 0.0 else 0.0)
        for a in range(12):
            H[a, b] += g[a] * along + cp * f * s.W[a, b]
    for a in range(12):
        for b in range(12):
            s.W[a, b] = c * g[a] * g[b]
    for a in range(12):
        g[a] *= f
    return c != 0.0
