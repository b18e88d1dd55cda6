"""A flexible body as the mechanism holds it: its compliance, and how it moves the sensors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from scipy.linalg import block_diag

from flexmb.analysis.assembly.jacobian import ConstraintRows, Decomposition, column_scales
from flexmb.analysis.dynamics.linear_elasticity import (
    flexible_columns,
    joined_frame,
    largest_lengths,
    relative_motion,
)
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import BodyColumns
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array
from flexmb.flexbody.static_response import LEAST_MOTION
from flexmb.model.excitation import marker_interface
from flexmb.model.model import Model
from flexmb.model.reading import GROUND

_DEPENDENT = 1e-9  # compliance of a set of joint rows, over the largest, that has no meaning


class ModalCompliance:
    """Compliance of modes in the mechanism: eta per modal force, all bodies in equilibrium.

    With G η = 0 what the joints demand of the modes, whatever the bodies do, it is
    K⁻¹ − K⁻¹ Gᵀ (G K⁻¹ Gᵀ)⁺ G K⁻¹.
    """

    def __init__(self, compiled: Compiled) -> None:
        self._rows, self._scales = ConstraintRows(compiled), column_scales(compiled)
        self._weights = compiled.system.row_weights
        every = list(flexible_columns(compiled))
        self._places = np.concatenate(
            [columns.iv + 6 + np.arange(columns.m) for columns, _ in every]
        )
        self._rigid = np.setdiff1d(np.flatnonzero(self._scales > 0.0), self._places)
        self._inverse = block_diag(*(np.linalg.inv(body.K) for _, body in every))
        ends = np.cumsum([0, *(columns.m for columns, _ in every)])
        names = [columns.name for columns, _ in every]
        self._parts = {name: slice(ends[k], ends[k + 1]) for k, name in enumerate(names)}

    def of(self, q: Array, names: Iterable[str]) -> list[Array]:
        """(m, m) of each of these bodies in the pose q."""
        Cq = self._rows.evaluate(q).Cq
        A = self._weights[:, None] * Cq
        rows = Decomposition.of(A[:, self._rigid] * self._scales[self._rigid])
        G = rows.U[:, rows.rank :].T @ A[:, self._places]
        between = G @ self._inverse @ G.T
        size = np.sqrt(between.diagonal().clip(1e-300))
        stiffness = np.linalg.pinv(between / np.outer(size, size), rcond=_DEPENDENT, hermitian=True)
        taken = (G @ self._inverse) / size[:, None]
        C = self._inverse - taken.T @ stiffness @ taken
        return [C[part, part] for part in (self._parts[name] for name in names)]


def position_sensors(
    compiled: Compiled, model: Model, columns: BodyColumns, body: FlexBody
) -> Iterator[tuple[Array, Array]]:
    """Channels of each position sensor on a body, and the motion of its marker (3 k, m).

    That is relative to the joints; of a marker that is no interface it is that of all points. A
    body that is joined to an interface moves with it.
    """
    frame, channels = joined_frame(body, columns.name, model), compiled.layout.channels
    names = [one.name for one in body.interfaces]
    places: dict[str, set[str]] = {}  # of this body's interfaces, by the bodies joined there
    for joint in model.joints.values():
        for here, there in (joint.between, joint.between[::-1]):
            owner, _, place = here.partition(".")
            one = marker_interface(model.bodies[owner], place) if owner == columns.name else None
            if one in names:
                places.setdefault(there.partition(".")[0], set()).add(one or "")
    for name, spec in model.sensors.items():
        if spec.type != "position":
            continue
        numbers = [k for k, one in enumerate(channels) if one.partition(".")[0] == name]
        for marker in (getattr(spec, "of", None), getattr(spec, "relative_to", None)):
            owner, _, place = (marker or "").partition(".")
            moved = places.get(owner, set())
            if owner == columns.name:
                moved = {marker_interface(model.bodies[owner], place) or ""}
            if owner == columns.name and not moved <= set(names):
                yield np.array(numbers), relative_motion(body, frame)[0] * body_length(body)
            elif owner != GROUND:
                for at in map(body.interface, sorted(moved)):
                    yield np.array(numbers), at.Phi_t - frame.at(at.position[None])[0]


def largest_sensor_change(
    body: FlexBody, sensors: Iterable[tuple[Array, Array]], ranges: Array, change: Array
) -> float | None:
    """Largest change of position sensors over their range, by a change (m,) of the deformation.

    Parameters
    ----------
    body : FlexBody
        The body.
    sensors : iterable
        As of `position_sensors`.
    ranges : (n,) array
        Of all channels in the run so far; () before the first row.
    change : (m,) array
        Of the modal coordinates.

    Returns
    -------
    float or None
        None if no such sensor moves.
    """
    changes = []
    for channels, motion in sensors if ranges.ndim else ():
        size = float(np.linalg.norm(ranges[channels]))
        if size > LEAST_MOTION * body.characteristic_length:
            changes.append(float(largest_lengths(change[None], motion)[0]) / size)
    return max(changes, default=None)


def body_length(body: FlexBody) -> float:
    """Length over which displacements of `relative_motion` are."""
    assert body.nodes is not None
    positions = np.vstack([body.nodes.position, *(one.position for one in body.interfaces)])
    return float(np.linalg.norm(np.ptp(positions, axis=0)))
