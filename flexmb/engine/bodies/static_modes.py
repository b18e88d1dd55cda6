"""Quasi-static modes: they follow the present loads, K_ss η_s = Q_s − Cq_sᵀ λ, without inertia.

Their bodies have no modal mass of them (`flexbody.effects.without_modal_inertia`): beside dynamic
modes they are a residual flexibility on which the rest moves (MacNeal, Computers & Structures 1,
1971, 581). Implicit methods solve for η_s with all else, by a matrix with b K_ss there.

Kinetostatic bodies, those of deformation "quasi-static", and all by an explicit method hold η_s
within a step, as if its modal mass were τ² K_ss; then η_s follows the loads, λ being that of the
motion in which η_s stays, and joints are closed with the deformed body: the slow solution, without
vibrations of what hangs on this compliance, and without rates of η_s. Single solves hold all η_s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.jit import Integers, Vector, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.state import Point, Run

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexmb.flexbody import FlexBody

_SLOW = 1e8  # τ² over 1/ω² of the softest of them


class StaticModes(NamedTuple):
    """Quasi-static modes, body after body."""

    rows: Integers  # (b,) bodies that have some
    first: Integers  # (b + 1,) where those of a body begin
    modes: Integers  # numbers of the modes in their bodies
    kinetostatic: Integers  # (b,) 1: held by implicit methods too
    heavy: Vector  # (b,) τ² [s²]
    compliance: Vector  # K_ss⁻¹ of the bodies, row by row


@unit
def add_static_mass(run: Run, of: StaticModes, at: Point, cv: float, cp: float) -> int:
    """Add τ² K_ss to the matrix of bodies that hold η_s, and of single solves."""
    parts, kkt, fac = run.system.parts, run.system.kkt, run.work.factor
    for n in range(of.rows.shape[0]):
        if of.kinetostatic[n] == 0 and (cv != 0.0 or cp != 0.0):
            continue
        body = parts.bodies[of.rows[n]]
        panel, m, o = kkt.panels[body["panel"]], body["m"], body["iv"] + 6
        K = body["flex"] + 12 * m + m * m
        for i in range(of.first[n], of.first[n + 1]):
            r = kkt.column[o + of.modes[i]]
            for j in range(of.first[n], of.first[n + 1]):
                c = kkt.column[o + of.modes[j]]
                x = of.heavy[n] * parts.pool[K + of.modes[i] * m + of.modes[j]]
                if r >= c:
                    fac.low[panel["at"] + r * panel["nc"] + c] += x
                if r <= c:
                    fac.up[panel["at"] + c * panel["nc"] + r] += x
    return FINE


@unit
def follow_loads(run: Run, of: StaticModes, at: Point) -> float:
    """Move the modes into equilibrium with Trial.res; the largest weighted change."""
    bodies, weights, res = run.system.parts.bodies, run.system.weights, run.work.trial.res
    change, place = 0.0, 0
    for n in range(of.rows.shape[0]):
        body, begin, end = bodies[of.rows[n]], of.first[n], of.first[n + 1]
        if of.kinetostatic[n] == 0 and run.method.stages == 0:
            place += (end - begin) ** 2
            continue
        iq, iv = body["iq"] + 7, body["iv"] + 6
        for i in range(begin, end):
            step = 0.0
            for j in range(begin, end):
                step -= of.compliance[place] * res[iv + of.modes[j]]
                place += 1
            at.q[iq + of.modes[i]] += step
            at.v[iv + of.modes[i]] = 0.0
            at.vd[iv + of.modes[i]] = 0.0
            if not abs(step) * weights[iv + of.modes[i]] <= change:
                change = abs(step) * weights[iv + of.modes[i]]
    return change


STATIC_MODES = Kind(
    "static_modes", StaticModes, {"matrix": add_static_mass, "static": follow_loads}
)


def static_modes(bodies: Sequence[tuple[int, FlexBody, NDArray[np.int64], bool]]) -> StaticModes:
    """Tables of the quasi-static modes of bodies by row, kinetostatic or not."""
    heavy, compliance = [], []
    for _, body, modes, _ in bodies:
        square = np.diag(body.K)[modes] / np.diag(body.M_eta)[modes]
        heavy.append(_SLOW / square.min())
        compliance.append(np.linalg.inv(body.K[np.ix_(modes, modes)]).ravel())
    rows, _, modes, kinetostatic = zip(*bodies, strict=True)
    return StaticModes(
        np.array(rows, np.int64),
        np.cumsum([0, *map(len, modes)]),
        np.concatenate(modes),
        np.array(kinetostatic, np.int64),
        np.array(heavy),
        np.concatenate(compliance),
    )
