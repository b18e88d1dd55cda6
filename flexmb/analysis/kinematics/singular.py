"""Poses and mechanisms whose motion joints and drivers do not fix: which rows, which coordinates.

In: a compiled model with Cq at one pose. Out: singular values and vectors of Cq in units of the
model's size and radians, and the names of what they move and what they load. A left null vector is
a set of rows of which each repeats the others, a right one is a motion that no row hinders.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.mobility.rank import LARGEST
from flexmb.analysis.mobility.rows import dense_jacobian
from flexmb.engine.compile import Compiled
from flexmb.engine.state import Work
from flexmb.model.joints.joint import JOINT_TYPES
from flexmb.model.model import Model
from flexmb.model.values.names import GROUND, split_reference

__all__ = ["LARGEST", "Decomposition", "JointRates", "decompose", "drivers_of", "owners", "rows_of"]

_RANK = 1e-8  # relative to the largest singular value; round-off leaves 1e-13
_TAKES_PART = 0.2  # of the largest entry of a null vector
_DRIVES = 0.05  # of the same, for drivers
_SHOWN = 4
_GROUNDED = 2.0  # preference for coordinates of joints with ground, where actuators sit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Decomposition:
    """Cq = U S Vᵀ, rows in weighted units, columns likewise; bodies without their modes."""

    U: Array  # (nc, nc)
    S: Array  # (min(nc, n),)
    V: Array  # (nv, n): motions as velocity coordinates
    n: int  # coordinates that may move

    @property
    def rank(self) -> int:
        """Independent rows."""
        return int(np.sum(self.S > _RANK * self.S.max(initial=0.0)))

    def repeated(self, values: Array) -> Array:
        """The part of weighted row values (nc,) that no motion can take away."""
        null = self.U[:, self.rank :]
        part: Array = null @ (null.T @ values)
        return part


def decompose(compiled: Compiled, work: Work) -> Decomposition:
    """Singular values and vectors of Cq as the last factorisation left it."""
    system = compiled.system
    free = system.kkt.column >= 0
    for body in compiled.layout.bodies:
        free[body.iv + 6 : body.iv + 6 + body.m] = False
    weights = np.where(system.weights > 0.0, system.weights, 1.0)
    scaled = system.row_weights[:, None] * dense_jacobian(compiled, work) / weights
    U, S, Vt = np.linalg.svd(scaled[:, free])
    motions = np.zeros((compiled.layout.nv, Vt.shape[0]))
    motions[free] = Vt.T
    return Decomposition(U, S, motions / weights[:, None], int(free.sum()))


def rows_of(compiled: Compiled, vector: Array) -> list[str]:
    """Names of the rows that take part most in a vector (nc,), largest first."""
    size = np.abs(vector)
    order = [k for k in np.argsort(-size) if size[k] > _TAKES_PART * size.max()]
    return [compiled.layout.rows[k] for k in order[:_SHOWN]]


def owners(names: list[str]) -> list[str]:
    """Joints and drivers of rows, each once."""
    return list(dict.fromkeys(name.split(":")[0] for name in names))


def drivers_of(compiled: Compiled, vector: Array) -> list[str]:
    """Scene paths of the drivers that take part in a vector (nc,)."""
    size = np.abs(vector)
    mine = [
        name.split(":")[0]
        for k, name in enumerate(compiled.layout.rows)
        if name.startswith("drivers.") and size[k] > _DRIVES * size.max()
    ]
    return list(dict.fromkeys(mine))


class JointRates:
    """How fast the joint coordinates move in a motion (nv,) of a model at its present pose.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    work : Work
        Its scratch with markers at the velocities of the motion.
    """

    def __init__(self, compiled: Compiled, model: Model, work: Work) -> None:
        self._compiled, self._model, self._marker = compiled, model, work.now.marker
        self.names: list[str] = []
        self.rates: list[float] = []  # rad, or of the size of the model, times the preference
        groups = dict(zip(compiled.layout.reactions, compiled.system.groups, strict=True))
        driven = {
            (driver.joint, motion.coordinate)
            for driver in model.drivers.values()
            for motion in driver.motions(model.plane)
        }
        for joint, spec in model.joints.items():
            row = compiled.system.rows[int(groups[f"joints.{joint}"]["row"])]
            for coordinate in JOINT_TYPES[spec.type].coordinates:
                if (joint, coordinate) not in driven:
                    rate = self._rate(coordinate, int(row["I"]), int(row["J"]))
                    grounded = any(split_reference(end)[0] == GROUND for end in spec.between)
                    rate *= _GROUNDED if grounded else 1.0
                    self.names.append(f"joints.{joint}.{coordinate}")
                    self.rates.append(rate)

    def _rate(self, coordinate: str, i: int, j: int) -> float:
        """Rate of an angle [rad], or of a stroke over the size of the model."""
        mi, mj = self._marker[i], self._marker[j]
        if coordinate != "stroke":
            axis = mi["R"][:, 2] if coordinate == "angle" else mj["R"][:, 2]
            return float((mj["om"] - mi["om"]) @ axis)
        axis = mi["R"][:, 0 if self._model.plane is not None else 2]
        turning = np.cross(mi["om"], axis) @ (mj["x"] - mi["x"])
        return float(axis @ (mj["vx"] - mi["vx"]) + turning) / self._compiled.length
