"""What membrane forces would change in plates and shells, or what those of a run lack.

A plate whose edges are held stretches as it bends, and a shell does so everywhere: its deflection
then grows less than its load, or more. A row has the deformation η of linear elasticity. The
deformation η' under the same load has η' + C g(η') = η, with the compliance C of the modes in the
mechanism and the forces g of membrane stiffness. The difference is told over the deflection, and at
the position sensors over their range. A body with geometric stiffening has the membrane forces of
its loads and interfaces; what is left are those within a single interface.
Bodies that bend as bars between two joints are left to `omitted_stiffening`.

With `membrane_forces = "full"` a run has those of a few shapes. A plate that stretches bends in
other shapes than the linear one; the error of these few is about the square of the share by which
the deflection changes without those that the linear one hardly needs. What a deformation has in
none of the shapes is not stiffened at all.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, one_blas_thread
from flexmb.analysis.monitors import Indicator
from flexmb.analysis.validity.joined_body import (
    ModalCompliance,
    body_length,
    largest_sensor_change,
    position_sensors,
)
from flexmb.analysis.validity.linear_elasticity import (
    flexible_columns,
    joined_frame,
    largest_lengths,
    relative_motion,
)
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import BodyColumns
from flexmb.flexbody import FlexBody, MembraneStiffness
from flexmb.flexbody.arrays import Array
from flexmb.flexbody.membrane_stiffness import small_load
from flexmb.flexbody.static_response import LEAST_MOTION
from flexmb.model.flexible_body import stretches
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock
from flexmb.units import percent

#: Change over the deflection of the body, and of a sensor over its range, from which a run says so.
LARGEST_CHANGE, LARGEST_SENSOR_CHANGE = 0.1, 0.01
#: Words of both sentences on bodies without them.
LEFT_OUT = "membrane forces are left out"
_VISIBLE = 1e-3  # change of a sensor below which that of the deflection does not matter
_CURED = 0.2  # share of the change that geometric stiffening may leave, if it is the cure
_QUANTITY = "membrane_forces"
_GROWTH = 1.05  # of the estimate by energies of a row, from which on the change is computed again


@dataclass(frozen=True, eq=False)
class _Plate:
    """A body with membrane stiffness."""

    columns: BodyColumns
    body: FlexBody
    whole: MembraneStiffness
    points: Array  # (3 k, m) displacements relative to the joints, over the length
    sensors: tuple[tuple[Array, Array], ...]  # channels; (3 k, m) motion of their markers
    has_forces: bool  # whether the equations have them

    @cached_property
    def beside(self) -> MembraneStiffness:
        """What of it geometric stiffening has not."""
        return self.whole.beside_geometric_stiffness(self.body.K)

    @cached_property
    def beside_shapes(self) -> Array:
        """(m, m) the part of a deformation that is in none of the shapes."""
        shapes = self.stiffness.deformations(self.body.K)
        return np.eye(self.columns.m) - shapes @ self.stiffness.shapes

    @cached_property
    def hardening(self) -> float:
        """Energy of stretching over that of bending, per square of the displacement over the
        length, of the shape where it is largest."""
        shapes = self.stiffness.deformations(self.body.K).T
        bending = 0.5 * np.einsum("ki,ij,kj->k", shapes, self.body.K, shapes)
        y = self.stiffness.products(shapes)
        stretching = 0.5 * np.einsum("ki,ij,kj->k", y, self.stiffness.quadratic, y)
        return float((stretching / bending / largest_lengths(shapes, self.points) ** 2).max())

    def lacking(self, eta: Array) -> Array:
        """(t,) what membrane forces would change of the part of eta (t, m) in none of the shapes,
        over the length, if they hardened it as they do a shape."""
        moved = largest_lengths(eta @ self.beside_shapes.T, self.points)
        harder = 2.0 * self.hardening * moved**2
        return np.asarray(moved * harder / (1.0 + harder))

    @property
    def stiffness(self) -> MembraneStiffness:
        """What of it the equations leave out, or have."""
        divided = self.has_forces or self.body.centrifugal_stiffness is None
        return self.whole if divided else self.beside


class MembraneForcesMonitor:
    """Estimates what membrane stiffness would change in plates and shells, or what it lacks.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    bows : set of str
        Bodies that bend as bars, whose tension another monitor knows.
    """

    def __init__(self, compiled: Compiled, model: Model, bows: set[str]) -> None:
        self._units = model.units
        self._plates = [one for one in _plates(compiled, model) if one.columns.name not in bows]
        if compiled.layout.nv > MAX_COORDINATES:
            self._plates = []
        n, most = len(self._plates), max((one.columns.m for one in self._plates), default=0)
        self._mechanism = ModalCompliance(compiled) if n else None
        self._deflection = np.zeros(n)  # largest so far, over the length
        self._about = np.zeros(n)  # estimate by energies of the row of the largest change
        # change, over the length, negative if it deflects less; time; deflection there, and that up
        # to which the change is small; change that geometric stiffening would leave
        self._largest = np.zeros((5, n))
        self._change = np.zeros((n, most))  # of the modes, in that row
        self._snaps = np.full(n, np.nan)  # time at which the body snaps through
        self._share = np.zeros(n)  # of membrane forces in the strain energy, largest so far
        self._least, self._most = np.array(np.inf), np.array(-np.inf)  # range of all channels

    @one_blas_thread()
    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
        if not self._plates or not len(rows.t):
            return
        if rows.sensors.shape[1]:
            self._least = np.minimum(self._least, rows.sensors.min(axis=0))
            self._most = np.maximum(self._most, rows.sensors.max(axis=0))
        for k, one in enumerate(self._plates):
            first = one.columns.iq + 7
            eta = rows.q[:, first : first + one.columns.m]
            deflection = largest_lengths(eta, one.points)
            self._deflection[k] = max(self._deflection[k], deflection.max())
            linear = 0.5 * np.einsum("ti,ij,tj->t", eta, one.body.K, eta)
            share = np.abs(one.stiffness.energy(eta)) / linear.clip(np.finfo(float).tiny)
            self._share[k] = max(self._share[k], float((share / (1.0 + share)).max()))
            about = np.minimum(share, 1.0) * deflection
            if one.has_forces:
                about = np.maximum(about, one.lacking(eta))
            row = int(about.argmax())
            if about[row] > _GROWTH * self._about[k]:
                self._about[k] = about[row]
                self._solve(k, rows, row, eta[row], deflection[row])

    def _solve(self, k: int, rows: OutputBlock, row: int, eta: Array, deflection: float) -> None:
        """Compute the change of one row, in its pose, and keep it if it is the largest."""
        assert self._mechanism is not None
        one = self._plates[k]
        compliance = self._mechanism.of(rows.q[row], [one.columns.name])
        if one.has_forces:
            self._compare_shapes(k, float(rows.t[row]), eta, compliance)
            return
        balanced = one.stiffness.equilibrium(eta, compliance)
        if balanced is None:
            self._snaps[k] = np.fmin(self._snaps[k], rows.t[row])
            return
        moved, after = largest_lengths(np.array([balanced - eta, balanced]), one.points)
        if moved > abs(self._largest[0, k]):
            small = deflection * _small_load(one, eta, compliance)
            stiffened = one.beside.equilibrium(eta, compliance)
            rest = eta if stiffened is None else stiffened - eta
            left = float(largest_lengths(rest[None], one.points)[0])
            signed = moved if after > deflection else -moved
            self._largest[:, k] = signed, rows.t[row], deflection, small, left
            self._change[k, : one.columns.m] = balanced - eta

    def _compare_shapes(self, k: int, t: float, eta: Array, compliance: Array) -> None:
        """Compare a row with the deformation of the main shapes alone, and keep the difference."""
        one = self._plates[k]
        linear = eta + compliance @ one.stiffness.forces(eta)[0]
        balanced = one.stiffness.main_shapes(linear, one.body.K).equilibrium(linear, compliance)
        few = np.zeros_like(eta) if balanced is None else balanced - eta
        beside = one.beside_shapes @ eta
        sizes = largest_lengths(np.array([few, beside, eta]), one.points)
        shares = sizes[:2] / sizes[2]
        lacking = float(one.lacking(eta[None])[0])
        factors = min(shares[0], 1.0), lacking / sizes[1] if lacking else 0.0
        which = int(lacking > shares[0] * factors[0] * sizes[2])
        error = shares[which] * factors[which]
        if error * sizes[2] > self._largest[0, k]:
            small = min((LARGEST_SENSOR_CHANGE / error) ** 0.25, 1.0)
            self._largest[:, k] = error * sizes[2], t, sizes[2], small, 0.0
            self._change[k, : one.columns.m] = factors[which] * (few, beside)[which]

    def _of_run(self, k: int) -> Iterator[Indicator]:
        """What the membrane forces that the equations have lack, and stress outputs of them."""
        one = self._plates[k]
        error, t, deflection, small, _ = self._largest[:, k]
        name, share = one.columns.name, self._share[k]
        if error > LEAST_MOTION:
            seen = self._sensor_change(k)
            value = error / self._deflection[k] if seen is None else seen
            text = partial(self._few_shapes, one, value, t, (deflection, small))
            yield Indicator(name, "membrane_shapes", value, t, LARGEST_SENSOR_CHANGE, text)
        if one.body.stress is not None or one.body.shell_forces is not None:
            text = partial(_no_stress, name, share)
            yield Indicator(name, "membrane_stress", share, t, LARGEST_SENSOR_CHANGE, text)

    def _sensor_change(self, k: int) -> float | None:
        """Largest change of the position sensors on a body, over their range; None: no sensor."""
        one = self._plates[k]
        change, ranges = self._change[k, : one.columns.m], self._most - self._least
        return largest_sensor_change(one.body, one.sensors, ranges, change)

    def _few_shapes(
        self, one: _Plate, share: float, t: float, deflections: tuple[float, float]
    ) -> str:
        length, (deflection, small) = body_length(one.body), deflections
        return (
            f"bodies.{one.columns.name}: its membrane forces are those of "
            f"{len(one.whole.shapes)} shapes, for want of others it may be off by about "
            f"{percent(min(share, 1.0))} (t = {self._units.say(t, 's', 4)}: deflection "
            f"{self._units.say(deflection * length, 'm', 2)}); that is less than 1 % up to a "
            f"deflection of about {self._units.say(small * deflection * length, 'm', 2)}"
        )

    def indicators(self) -> Iterator[Indicator]:
        """The change of each body: at its sensors, or else over its deflection."""
        for k, one in enumerate(self._plates):
            if one.has_forces:
                yield from self._of_run(k)
                continue
            moved, t, deflection, small, left = self._largest[:, k]
            if abs(moved) <= LEAST_MOTION:
                continue
            share = abs(moved) / self._deflection[k]
            seen = self._sensor_change(k)
            value, level = share, LARGEST_CHANGE
            if seen is not None and (seen > LARGEST_SENSOR_CHANGE or seen < _VISIBLE):
                value, level = seen, LARGEST_SENSOR_CHANGE
            verb = "reduce" if moved < 0.0 else "increase"
            cured = one.body.centrifugal_stiffness is None and left < _CURED * abs(moved)
            text = partial(self._sentence, one, verb, (share, seen), t, (deflection, small), cured)
            bound = share if seen is None else min(share, seen)
            yield Indicator(one.columns.name, _QUANTITY, value, t, level, text, bound)
        for k, t in enumerate(self._snaps):
            if not np.isnan(t):
                text = partial(self._snapped, self._plates[k].columns.name, t)
                yield Indicator(self._plates[k].columns.name, _QUANTITY, 1.0, t, 0.0, text)

    def _sentence(
        self,
        one: _Plate,
        verb: str,
        shares: tuple[float, float | None],
        t: float,
        deflections: tuple[float, float],
        cured: bool,
    ) -> str:
        length, (deflection, small) = body_length(one.body), deflections
        sensors, cure = "", 'reduce it with geometric_stiffening = "full"'
        if shares[1]:
            sensors = f", and change a sensor by {percent(shares[1])} of its range"
        at = self._units.say(t, "s", 4)
        if not cured:
            cure = 'membrane_forces = "full" has them, and without the change is less than 1 % up '
            cure += f"to a deflection of about {self._units.say(small * length, 'm', 2)}"
        return (
            f"bodies.{one.columns.name}: membrane forces are left out, which would {verb} its "
            f"deflection by about {percent(shares[0])}{sensors} (t = {at}: "
            f"deflection {self._units.say(deflection * length, 'm', 2)}); {cure}"
        )

    def _snapped(self, name: str, t: float) -> str:
        return (
            f"bodies.{name}: membrane forces are left out, with which it would snap through at "
            f"t = {self._units.say(t, 's', 4)} or before: its deflection is that of linear "
            "elasticity"
        )


def _no_stress(name: str, share: float) -> str:
    return (
        f"bodies.{name}: its stress outputs lack the stress of its membrane forces, which hold "
        f"{percent(share)} of its strain energy"
    )


def _small_load(one: _Plate, eta: Array, compliance: Array) -> float:
    """Share of the load of a row up to which the change is below that of sensors which is told.

    Where modes stretch by themselves, as those of solids, they do so before they stiffen bending.
    """

    def excess(load: float) -> float:
        own = one.stiffness.linear @ one.stiffness.products(load * eta)
        change = compliance @ one.stiffness.forces(load * eta - compliance @ own)[0]
        moved, deflection = largest_lengths(np.array([change, load * eta]), one.points)
        return float(moved / deflection) - LARGEST_SENSOR_CHANGE

    return small_load(excess, 1.0)


def _plates(compiled: Compiled, model: Model) -> Iterator[_Plate]:
    """The bodies with membrane stiffness."""
    for columns, body in flexible_columns(compiled):
        stiffness = body.membrane_stiffness
        if stiffness is not None and body.nodes is not None:
            points = relative_motion(body, joined_frame(body, columns.name, model))[0]
            sensors = tuple(position_sensors(compiled, model, columns, body))
            has_forces = stretches(model.bodies[columns.name])
            yield _Plate(columns, body, stiffness, points, sensors, has_forces)
