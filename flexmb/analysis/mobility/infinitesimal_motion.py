"""Motions that joints allow at first order only, as in a taut net or links stretched straight.

In: the rows of a closed pose. Out: the motions u that no row prevents at first order, Cq u = 0, but
that are no finite motions, since the rows open with the square of u. This is so if a self-stress σ,
σᵀ Cq = 0, has σᵀ (Cq u)_q u > 0 for all of them. C. R. Calladine & S. Pellegrino, First-order
infinitesimal mechanisms, Int. J. Solids Structures 27 (1991) 505-515.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmb.analysis.assembly.jacobian import (
    ConstraintPose,
    ConstraintRows,
    column_scales,
    joint_rows,
    null_space,
    plain_name,
)
from flexmb.engine.state import State
from flexmb.flexbody.arrays import Array

_MAX_MOTIONS = 100  # with more free motions the question is not examined
_STEP = 1e-4  # step of differences, over the model size
# Rows whose second-order opening along a motion of size one is less than this, over the model size,
# stay closed.
_SECOND_ORDER = 1e-5
_DEFINITE = 1e-6  # least eigenvalue of a form that counts as definite, over the largest
_MAX_ITERATIONS = 1000  # of the search for a definite form
_MAX_NAMES = 6  # names in a sentence
_AT_REST = 1e-9  # velocity or acceleration along a motion that is none; round-off is 1e-15


@dataclass(frozen=True)
class InfinitesimalMotion:
    """Infinitesimal motions (columns, k) of size one, moving bodies, and joints in self-stress."""

    motions: Array
    bodies: tuple[str, ...]
    joints: tuple[str, ...]

    def is_begun(self, pose: ConstraintPose, state: State) -> bool:
        """Whether velocities or accelerations of a state in the pose have a part along the motions.

        Accelerations are compared with the largest one of any body, or with the largest that the
        reactions alone would cause.
        """
        columns, scales = pose.jacobian.columns, column_scales(pose.compiled)
        push = pose.Cq.T @ state.lam
        size = np.abs(state.vd[columns] / scales[columns]).max(initial=0.0)
        size = max(size, np.abs(state.v[columns] / scales[columns]).max(initial=0.0) ** 2)
        for body in pose.compiled.system.parts.bodies:
            iv = int(body["iv"])
            size = max(size, np.abs(push[iv : iv + 3]).max() / body["mass"] / pose.compiled.length)
        rates = np.array([state.vd, state.v * size**0.5])[:, columns] / scales[columns]
        return bool(np.abs(rates @ self.motions).max(initial=0.0) > _AT_REST * size)

    @property
    def sentence(self) -> str:
        """Sentence for the user: what is wrong, and the cure."""
        k = self.motions.shape[1]
        what = "1 free motion is" if k == 1 else f"{k} free motions are"
        return (
            f"{what} infinitesimal: {_names(self.bodies)} may begin to move, but the joints "
            f"{_names(self.joints)} stop them at once, as taut links do; no finite reaction bears "
            "a load across: give the links some sag, or take springs in place of some of them"
        )


def _names(names: tuple[str, ...]) -> str:
    more = len(names) - _MAX_NAMES
    return ", ".join(names[:_MAX_NAMES]) + (f" and {more} more" if more > 0 else "")


def infinitesimal_motion(
    constraints: ConstraintRows, pose: ConstraintPose
) -> InfinitesimalMotion | None:
    """The motions that the joints allow at first order only; None if there are none."""
    jacobian, scales = pose.jacobian, column_scales(constraints.compiled)
    rows = joint_rows(constraints.compiled)
    stresses = jacobian.joint_circuits[:, rows]
    free = null_space(jacobian.A[rows])
    if not len(stresses) or not 0 < free.shape[1] <= _MAX_MOTIONS:
        return None

    def opening(u: Array) -> Array:
        """(n, columns) σᵀ (Cq u)_q for the n self-stresses σ and a motion u."""
        step = np.zeros(len(scales))
        step[jacobian.columns] = _STEP * u
        ahead, behind = (
            constraints.evaluate(constraints.move(pose.q, scales * d)).jacobian.A[rows]
            for d in (step, -step)
        )
        return np.asarray(stresses @ (ahead - behind) / (2.0 * _STEP))

    any_motion = free @ np.random.default_rng(0).standard_normal(free.shape[1])
    if np.abs(opening(any_motion) @ any_motion).max() < _SECOND_ORDER * (any_motion @ any_motion):
        return None  # the motions are finite: a mechanism, the usual case
    forms = np.stack([opening(u) @ free for u in free.T], axis=1)
    forms = (forms + forms.transpose(0, 2, 1)) / 2.0
    _, size, Vt = np.linalg.svd(forms.reshape(-1, free.shape[1]))
    curved = Vt[: int(np.sum(size > _SECOND_ORDER))].T
    stress = _positive_combination(curved.T @ forms @ curved)
    if stress is None:
        return None
    motions = free @ curved
    moving = np.abs(jacobian.velocities(motions)).max(axis=1) > _SECOND_ORDER
    layout = constraints.compiled.layout
    bodies = [body.name for body in layout.bodies if np.any(moving[body.iv : body.iv + 6 + body.m])]
    tense = np.abs(stress @ stresses) > _SECOND_ORDER * np.abs(stress @ stresses).max()
    joints = dict.fromkeys(np.array(jacobian.owners, object)[rows][tense])
    return InfinitesimalMotion(motions, tuple(bodies), tuple(plain_name(path) for path in joints))


def _positive_combination(forms: Array) -> Array | None:
    """Factors (n,) for which the sum of symmetric forms (n, k, k) is positive definite, or None.

    They are found by the perceptron algorithm.
    """
    if not forms.shape[1]:
        return None
    factors = np.trace(forms, axis1=1, axis2=2)
    for _ in range(_MAX_ITERATIONS):
        values, vectors = np.linalg.eigh(np.tensordot(factors, forms, 1))
        if values[0] > _DEFINITE * abs(values).max():
            return np.asarray(factors)
        worst = np.einsum("nij,i,j", forms, vectors[:, 0], vectors[:, 0])
        size = float(np.linalg.norm(worst))
        if size < _DEFINITE * abs(forms).max():
            return None
        factors = factors / max(float(np.linalg.norm(factors)), 1.0) + worst / size
    return None
