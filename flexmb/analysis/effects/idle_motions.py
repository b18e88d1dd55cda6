"""Idle motions beside an estimate, such as the spin of a rod between two ball joints.

Nothing but its inertia resists such a motion. If the rod begins to bend, it turns its softer side
to its load, by whole turns even of a small load, where small motions tell nothing. So its estimate
holds it, in several positions that it may have turned to.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from flexmb.analysis.assembly.jacobian import ConstraintRows, column_scales, null_space
from flexmb.analysis.effects.perturbation import product, rotate, rotate_back, screw
from flexmb.analysis.effects.stored_motion import Motion
from flexmb.analysis.mobility.free_motions import free_motions
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import BodyColumns
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model

_SMALL_TURN = 0.3  # rotation up to which its effects are linear [rad]
_NO_TURN = 1e-6  # rotation of a slide, times the size of the model over its length
_POSITIONS = 4  # in half a turn, after which the compliance of a bar is the same


def idle_bodies(
    compiled: Compiled, model: Model, motion: Motion, dq: Array
) -> list[tuple[str, ...]]:
    """Sets of bodies that move beside all others, and turn too far by small motions dq (n, nv)."""
    layout = compiled.layout.bodies
    turns = [np.abs(dq[:, body.iv + 3 : body.iv + 6]).max() for body in layout]
    far = {body.name for body, turn in zip(layout, turns, strict=True) if turn > _SMALL_TURN}
    if not far:
        return []
    rows = ConstraintRows(compiled)
    poses = [rows.evaluate(motion.q[k], motion.t[k]) for k in (0, len(motion.t) // 2)]
    motions = free_motions(model, poses[0], poses[1:])
    return [one.bodies for one in motions if one.idle and not far.isdisjoint(one.bodies)]


def turned_motions(
    compiled: Compiled, motion: Motion, idle: Sequence[Sequence[str]]
) -> Iterator[Motion]:
    """The motion as it is, and with each idle body that is rigid in it in further positions."""
    yield motion
    names = {bodies[0] for bodies in idle if len(bodies) == 1}
    for body in compiled.layout.bodies:
        eta = motion.q[:, body.iq + 7 : body.iq + 7 + body.m]
        axis = _axis(compiled, motion, body) if body.name in names and not eta.any() else None
        if axis is not None:
            for k in range(1, _POSITIONS):
                turned = _turned(motion, body, *(np.pi * k / _POSITIONS * axis).reshape(2, 3))
                yield turned.with_channels(compiled)


def _axis(compiled: Compiled, motion: Motion, body: BodyColumns) -> Array | None:
    """The screw (6,) in axes of a body about which it is idle; None if there is not just one."""
    own = slice(body.iv, body.iv + 6)
    scales = column_scales(compiled)[own]
    Cq = ConstraintRows(compiled).evaluate(motion.q[0], motion.t[0]).Cq[:, own]
    free = null_space(compiled.system.row_weights[:, None] * Cq * scales).T * scales
    if len(free) != 1:
        return None
    line, turn = free[0].reshape(2, 3)
    size = np.linalg.norm(turn)
    if size < _NO_TURN * np.linalg.norm(line) / compiled.length:
        return None
    line = rotate_back(motion.q[:1, body.iq + 3 : body.iq + 7], line[None])[0]
    return np.asarray(np.concatenate([line, turn]) / size)


def _turned(motion: Motion, body: BodyColumns, line: Array, angle: Array) -> Motion:
    """The motion with a body displaced by the constant screw exp(line, angle) in its axes."""
    q, v, vd = motion.q.copy(), motion.v.copy(), motion.vd.copy()
    at, e = slice(body.iq, body.iq + 3), slice(body.iq + 3, body.iq + 7)
    first, second = slice(body.iv, body.iv + 3), slice(body.iv + 3, body.iv + 6)
    shift, half = screw(line[None], angle[None])
    w, dw, before = motion.v[:, second], motion.vd[:, second], motion.q[:, e]
    arm = np.broadcast_to(shift, w.shape)
    q[:, at] += rotate(before, arm)
    q[:, e] = product(before, half)
    v[:, first] += rotate(before, np.cross(w, arm))
    vd[:, first] += rotate(before, np.cross(dw, arm) + np.cross(w, np.cross(w, arm)))
    v[:, second], vd[:, second] = rotate_back(half, w), rotate_back(half, dw)
    return replace(motion, q=q, v=v, vd=vd)
