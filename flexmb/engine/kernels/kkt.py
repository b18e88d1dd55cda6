"""The iteration matrix S = [[M + cv ∂F/∂v + cp ∂F/∂q, Cqᵀ], [Cq, −ε]] in the panels of the factor.

F are the inertia, applied and constraint forces on the left side, M v̇ + … + Cqᵀ λ − Q. With
cv = cp = 0 it is the matrix of the acceleration level. ε_i is 1e-9 of (Cq diag(S)⁻¹ Cqᵀ)_ii:
relative, so that no unit or step size can turn it into noise, and taken back by refinement.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra import ldl
from flexmb.engine.kernels.algebra.blocks import add_body_block, put_row, row_compliance
from flexmb.engine.kernels.bodies import inertia_tangent, kinematics
from flexmb.engine.kernels.forces import joint_friction
from flexmb.engine.kernels.forces.basic_tangent import load_tangents, spring_tangents
from flexmb.engine.kernels.forces.contact_tangent import contact_tangents
from flexmb.engine.kernels.forces.force_tangent import add_coordinate_tangents, element_tangents
from flexmb.engine.kernels.joints import constraint, coordinate, slider
from flexmb.engine.kernels.joints.group_tangent import group_tangents
from flexmb.engine.kernels.joints.slider_tangent import slider_tangents
from flexmb.engine.kernels.sensors.signal_tangent import signal_tangents

_REGULARISATION = 1e-9


@kernel
def factorise(sys, wk, v, vd, lam, cv, cp):
    """Assemble S at the state of the last position stage and factor it; returns pivots replaced.

    `factor.symmetric` says which way. The matrix itself stays in low0 and up0, for refinement.
    """
    low, up = wk.factor.low, wk.factor.up
    symmetric = wk.factor.symmetric[0] == 1
    for i in range(low.shape[0]):
        low[i] = 0.0
        up[i] = 0.0
    if cp != 0.0 or cv != 0.0:
        kinematics.velocity(sys.parts, wk.now, v)
    _bodies(sys.parts, sys.kkt, wk, v, vd, cv, cp)
    coordinate.add_tangents(sys.parts.coordinates, sys.kkt, cv, cp, low, up)
    add_coordinate_tangents(sys.elements, sys.parts.coordinates, sys.kkt, wk, v, cv, cp)
    constraint.jacobian(sys.lines, sys.parts, wk.now, sys.rows, wk.dense)
    if cp != 0.0 or cv != 0.0:
        group_tangents(sys, wk, lam, cp)
        slider_tangents(sys, sys.parts.sliders, wk, lam, cp)
        spring_tangents(sys, sys.springs, wk, v, cv, cp)
        load_tangents(sys, sys.loads, wk, cp)
        contact_tangents(sys, sys.contacts, wk, v, cv, cp)
        joint_friction.add_tangents(sys, sys.frictions, wk, v, cv, cp)
        element_tangents(sys, sys.elements, wk, v, cv, cp)
    if cv != 0.0:
        signal_tangents(sys.signals, sys, wk, v, cv, cp)
    if symmetric:
        for i in range(low.shape[0]):
            low[i] = 0.5 * (low[i] + up[i])
    _keep_diagonal(sys.kkt.panels, wk.factor)
    _jacobian_blocks(sys, wk.dense.jac, wk.factor)
    coordinate.put_rows(sys, sys.parts.coordinates, wk.factor)
    slider.put_rows(sys, sys.parts.sliders, wk)
    if not symmetric and (cp != 0.0 or cv != 0.0):
        joint_friction.put_couplings(sys, sys.frictions, wk, v, lam)
    for i in range(low.shape[0]):
        wk.factor.low0[i] = low[i]
    if not symmetric:
        for i in range(up.shape[0]):
            wk.factor.up0[i] = up[i]
    wk.factor.replaced[0] = ldl.factor(sys.kkt, wk.factor)
    return wk.factor.replaced[0]


@kernel
def _bodies(parts, kkt, wk, v, vd, cv, cp):
    B, Z = wk.dense.B, wk.now.Z
    for i in range(parts.bodies.shape[0]):
        body, bn = parts.bodies[i], wk.now.body[i]
        inertia_tangent.mass_block(body, bn, parts.pool, Z, B)
        if cv != 0.0:
            inertia_tangent.add_velocity_tangent(body, bn, parts.pool, Z, v, cv, B)
        if cp != 0.0:
            inertia_tangent.add_position_tangent(body, bn, Z, parts, v, vd, cp, B)
        add_body_block(body, kkt, B, wk.factor.low, wk.factor.up)


@kernel
def _keep_diagonal(panels, factor):
    """|diagonal| of the coordinates; infinite where there is none, so that nothing counts there."""
    for i in range(panels.shape[0]):
        panel = panels[i]
        for c in range(panel["nc"]):
            diagonal = abs(factor.low[panel["at"] + c * panel["nc"] + c])
            factor.diagonal[panel["col"] + c] = diagonal if diagonal > 0.0 else math.inf


@kernel
def _jacobian_blocks(sys, jac, factor):
    symmetric = factor.symmetric[0] == 1
    bodies, kkt, links = sys.parts.bodies, sys.kkt, sys.kkt.links
    for k in range(sys.groups.shape[0]):
        group = sys.groups[k]
        panel = kkt.panels[group["panel"]]
        for r in range(group["n"]):
            row = sys.rows[group["row"] + r]
            s = 0.0
            for side in range(2):
                b = group["body_I"] if side == 0 else group["body_J"]
                if b < 0:
                    continue
                link = links[group["link_I"] if side == 0 else group["link_J"]]
                at = row["jac_I"] if side == 0 else row["jac_J"]
                put_row(link, r, bodies[b], kkt.column, jac, at, factor.low)
                if not symmetric:
                    put_row(link, r, bodies[b], kkt.column, jac, at, factor.up)
                s += row_compliance(bodies[b], kkt, jac, at, factor.low)
            factor.eps[panel["col"] + r] = _REGULARISATION * s
            at = panel["at"] + r * panel["nc"] + r
            factor.low[at] = -_REGULARISATION * s
            if not symmetric:
                factor.up[at] = -_REGULARISATION * s


@kernel
def permute(kkt, top, bottom, out):
    """out = (top, bottom) in elimination order."""
    n = top.shape[0]
    for i in range(n):
        out[kkt.place[i]] = top[i]
    for i in range(bottom.shape[0]):
        out[kkt.place[n + i]] = bottom[i]


@kernel
def factorise_metric(sys, wk, metric):
    """Assemble and factor [[W, Cqᵀ], [Cq, −ε]], W a diagonal metric (nv), for kinematics.

    Modal coordinates stay out of Cq: flexible bodies keep their shape. Returns pivots replaced.
    """
    factor, kkt = wk.factor, sys.kkt
    low = factor.low
    for i in range(low.shape[0]):
        low[i] = 0.0
    factor.symmetric[0] = 1
    put_metric(sys.parts, kkt, metric, low)
    constraint.jacobian(sys.lines, sys.parts, wk.now, sys.rows, wk.dense)
    _hold_shapes(sys.parts, sys.rows, wk.dense.jac)
    _jacobian_blocks(sys, wk.dense.jac, factor)
    coordinate.put_rows(sys, sys.parts.coordinates, factor)
    slider.put_rows(sys, sys.parts.sliders, wk)
    for i in range(low.shape[0]):
        factor.low0[i] = low[i]
    factor.replaced[0] = ldl.factor_symmetric(kkt, factor)
    return factor.replaced[0]


@kernel
def put_metric(parts, kkt, metric, low):
    """The metric of bodies and scalar coordinates on the diagonal."""
    for i in range(parts.bodies.shape[0]):
        body = parts.bodies[i]
        panel, o = kkt.panels[body["panel"]], body["iv"]
        for c in range(6 + body["m"]):
            pc = kkt.column[o + c]
            if pc >= 0:
                low[panel["at"] + pc * panel["nc"] + pc] = metric[o + c]
    coordinate.put_metric(parts.coordinates, kkt, metric, low)


@kernel
def _hold_shapes(parts, rows, jac):
    """No modal coordinate in the Jacobian rows."""
    for k in range(rows.shape[0]):
        for side in range(2):
            at = rows[k]["jac_I"] if side == 0 else rows[k]["jac_J"]
            if at >= 0:
                marker = rows[k]["I"] if side == 0 else rows[k]["J"]
                m = parts.bodies[parts.markers[marker]["body"]]["m"]
                for c in range(6, 6 + m):
                    jac[at + c] = 0.0
