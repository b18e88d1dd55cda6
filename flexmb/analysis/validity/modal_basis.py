"""Missing response of the modes of a body: to its inertia, to loads at nodes, of omitted modes.

In: rows of a run, in order. Out: indicators. Rotation and acceleration load a body by its inertia;
forces outside its interfaces load it at mesh nodes. The missing share of the static response is the
square root of the ratio of strain energies, missing to whole
(:mod:`flexmb.flexbody.static_response`): stress and displacement are proportional to it.
Displacements below 1e-7 of the length of the body are ignored. The motion is that of the frame of
the body's joints, since vibrations move the mean axes as well but load the body in another way. The
largest values of the run so far are compared.

The lowest omitted modes are integrated together with the run, as oscillators that its accelerations
and loads drive; exactly for forces that are linear between rows (Biggs, Introduction to Structural
Dynamics, 1964, ch. 2). Their response beyond the static one is the truncation error, which
resonates near their frequencies. A modal coordinate y moves some point of the body by 2 y/√m (the
free end of a beam of mass m). An interface, which is at rest in it, moves by its inertia alone, as
the joints of the scene let it, and it pulls at that with the force of this inertia. Positions may
be wrong by that, velocities and accelerations by ω and ω² times that, joint forces by this force. A
run is refused by this error over the range of its sensors, or, without such sensors, by the share
of the deformation.

What a shock excites is first seen in the fast modes, and in all others within a period of the body
as it is joined. So no run is refused before such a period, or its end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, n_free
from flexmb.analysis.linear.linearization import Linearization
from flexmb.analysis.monitors import Indicator
from flexmb.analysis.validity.body_accelerations import (
    BodyAccelerations,
    LackingBody,
    OmittedOscillators,
)
from flexmb.analysis.validity.linear_elasticity import (
    JoinedFrame,
    carrier_node,
    constraint_jacobian,
    flexible_columns,
    in_body_axes,
    joined_frame,
    joined_interfaces,
    joined_modes,
)
from flexmb.analysis.validity.load_factor import LARGEST_ERROR
from flexmb.analysis.validity.pose_vibrations import (
    energies_of_vibrations,
    errors_at_nodes,
    most_of_vibrations,
    update_largest,
)
from flexmb.engine import initial_conditions
from flexmb.engine.allocation import new_run, new_state, new_work
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_units import call, packed_record, prepare_units
from flexmb.engine.stage_tables import units_of
from flexmb.engine.tables import BodyColumns
from flexmb.flexbody import FlexBody, InertiaResponse, LoadResponse
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.flexbody.static_response import LARGEST_SHARE, LEAST_MOTION
from flexmb.model.excitation import (
    fastest_drives,
    loads_beside_interfaces,
    nodes_of_sensor,
    slowest_oscillation,
)
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock
from flexmb.units import percent

# Successive rows in which the missing response must be as large: not a shock or vibration.
_ROWS_IN_SUCCESSION = 3
_MIN_SHARE_OF_RUN = 0.1  # share of a run after which the first indicators are given
_AT_REST = 1e-3  # rad/s below which a message does not mention the rotation of a body
_ROUND_OFF = 2e-14  # displacement over the distance from the origin that is round-off
# Power of ω in the error of a sensor.
_POWER_OF_OMEGA = {"position": 0, "distance": 0, "velocity": 1, "acceleration": 2, "reaction": 2}
_CURE = "name the point as an interface, or give the body a force there among its loads"
_VISIBLE = 1e-3  # change of a sensor over its range that is told
_LEAST_RANGE = 1e-7  # range of a sensor, by the size of the model and the run, that is a motion


@dataclass(frozen=True, eq=False)
class _MonitoredBody:
    """A body with the frame of its joints and the data of its missing responses."""

    columns: BodyColumns
    body: FlexBody
    accelerations: BodyAccelerations
    frame: JoinedFrame
    period: float  # of its lowest natural frequency as joined, s
    lacking: LackingBody | None
    pulls: Array  # (o,) largest force at joined interfaces by each omitted mode
    markers: IntArray  # markers of the engine at which loads act on nodes
    places: IntArray  # first of six columns of each in `load_response`; -1: the node is not in it
    least: float  # mass × square of the least displacement that counts, kg m^2

    @property
    def name(self) -> str:
        """Its name."""
        return self.columns.name


INERTIA, LOADS, TRUNCATION = range(3)


class ModalBasisMonitor:
    """Missing response of the modes of each body: to inertia, to loads at nodes, of omitted modes.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    is_motion : bool
        Whether the rows are a motion, not separate equilibria.

    Attributes
    ----------
    beyond : dict of str to str
        A sentence on each body that is driven faster than its omitted modes are known.
    """

    def __init__(self, compiled: Compiled, model: Model, is_motion: bool = True) -> None:
        self._units, self._window = model.units, _ROWS_IN_SUCCESSION if is_motion else 1
        self._compiled = compiled
        self._paths: dict[str, str] = {}
        for path, owner, _ in loads_beside_interfaces(model):
            paths = self._paths.get(owner, "").split(", ")
            self._paths[owner] = ", ".join(dict.fromkeys(filter(None, (*paths, path))))
        pairs = list(flexible_columns(compiled))
        Cq = constraint_jacobian(compiled, compiled.initial_q) if pairs else np.zeros((0, 0))
        self._bodies = [
            _monitored_body(compiled, columns, body, model, columns.name in self._paths, Cq)
            for columns, body in pairs
        ]
        drives = fastest_drives(model) if is_motion else {}
        lacking = [one.lacking for one in self._bodies if one.lacking and one.name in drives]
        beyond = {one.name: one.beyond(*drives[one.name], model.units) for one in lacking}
        self.beyond = {name: sentence for name, sentence in beyond.items() if sentence}
        n = len(self._bodies)
        # twice the largest strain energy so far, of modes or of missing responses; of modes or
        # whole responses
        self._strain = np.zeros(n)
        self._whole = np.zeros(n)
        self._last = np.zeros((2, self._window - 1, n))  # missing energies in the last rows
        self._largest = np.zeros((3, 3, n))  # largest missing energy, its time, a number for texts
        self._began = np.zeros((3, 2, n))  # missing energy, and its time, when it last was fourfold
        self._now, self._begin = np.zeros(1), np.full(1, np.nan)
        whole = model.dynamics.duration if model.dynamics and is_motion else 0.0
        self._settled, self._end = _MIN_SHARE_OF_RUN * whole, whole
        drive = slowest_oscillation(model) if self._bodies else 0.0
        self._oscillators = [OmittedOscillators(one.body, drive) for one in self._bodies]
        most = max([1, *(len(one.omega) for one in self._oscillators)])
        self._vibration = np.full((n, most, 5), np.nan)  # state of the omitted modes
        self._tensions = np.full((n, 3), np.nan)  # states of the mean tensions
        # Largest energy of each and its time: without acting back, and with, and since when.
        self._alone, self._acting = np.zeros((n, most, 2)), np.full((n, most, 3), np.inf)
        self._sensors = [
            (
                [k for k, one in enumerate(compiled.layout.channels) if one.split(".")[0] == name],
                _POWER_OF_OMEGA[spec.type] + getattr(spec, "derivative", 0),
                None
                if spec.type == "reaction"
                else {marker.partition(".")[0] for marker in nodes_of_sensor(model, spec)},
            )
            for name, spec in (model.sensors if self._bodies else {}).items()
            if spec.type in _POWER_OF_OMEGA and getattr(spec, "quantity", "force") == "force"
        ]
        self._size, self._slowest = compiled.length, 2.0 * np.pi / (whole or np.inf)
        self._least, self._most = np.array(np.inf), np.array(-np.inf)  # range of all channels
        self._pose: dict[int, OutputBlock] = {}  # the row in which an omitted mode vibrates most
        none = np.zeros(len(compiled.layout.channels))
        self._changes: tuple[tuple[int, int, float], Array] = (-1, 0, 0.0), none
        self._unknown = np.zeros(n)  # largest force at a node that is not in `load_response`
        self._work: tuple[Any, Any, Any] | None = None
        self._loads: tuple[Array, list[Array]] = np.zeros(0), []  # loads at nodes in the last rows
        if any(len(one.markers) for one in self._bodies):
            state, work = new_state(compiled.system), new_work(compiled.system)
            prepare_units([initial_conditions.solve_stage, *units_of(compiled.system)])
            self._work = packed_record(new_run(compiled.system, state, work)), state, work

    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
        self._begin[:] = np.where(np.isnan(self._begin), rows.t[0], self._begin)
        self._now[:] = rows.t[-1]
        if rows.sensors.shape[1]:
            self._least = np.minimum(self._least, rows.sensors.min(axis=0))
            self._most = np.maximum(self._most, rows.sensors.max(axis=0))
        loads = self.node_loads(rows)
        for k, one in enumerate(self._bodies):
            eta = rows.q[:, one.columns.iq + 7 : one.columns.iq + 7 + one.columns.m]
            strain = np.einsum("ti,ij,tj->t", eta, one.body.K, eta).max()
            self._strain[k] = max(self._strain[k], strain)
            self._whole[k] = max(self._whole[k], strain)
            c, omega = one.accelerations.of_joints(rows, one.frame)
            if one.body.inertia_response is not None:
                speed = np.linalg.norm(omega, axis=1)
                self._compare(INERTIA, k, rows.t, one.body.inertia_response, c, speed)
            if one.body.load_response is not None:
                size = np.abs(loads[k]).max(axis=1, initial=0.0)
                self._compare(LOADS, k, rows.t, one.body.load_response, loads[k], size)
            if one.body.omitted_modes is not None:
                x = one.accelerations.of_material(rows)
                self._integrate_omitted_modes(k, rows, x, loads[k])

    def _compare(
        self, what: int, k: int, t: Array, response: InertiaResponse | LoadResponse, c: Array,
        beside: Array,
    ) -> None:  # fmt: skip
        """Update the missing energy of a response to loads c (t, columns)."""
        full, missing, motion = (
            np.einsum("ti,ij,tj->t", c, form, c).clip(0.0)
            for form in (response.energy, response.missing, response.motion)
        )
        self._strain[k] = max(self._strain[k], missing.max())
        self._whole[k] = max(self._whole[k], full.max())
        missing = np.where(motion > self._bodies[k].least, missing, 0.0)
        last = self._last[what, :, k]
        missing = np.concatenate([last, missing])
        last[:] = missing[len(missing) - len(last) :]
        missing = sliding_window_view(missing, self._window).min(axis=1)
        row = int(missing.argmax())
        if missing[row] > self._largest[what, 0, k]:
            self._update_largest(what, k, missing[row], t[row], beside[row])

    def _update_largest(self, what: int, k: int, missing: float, t: float, beside: float) -> None:
        """Replace the largest missing energy of a body, and when its growth began if it is new."""
        self._largest[what, :, k] = missing, t, beside
        if missing > 4.0 * self._began[what, 0, k]:
            self._began[what, :, k] = missing, t

    def _integrate_omitted_modes(self, k: int, rows: OutputBlock, x: Array, loads: Array) -> None:
        """Integrate the omitted modes of a body, and update their largest energy."""
        t, one, lacking = rows.t, self._bodies[k], self._bodies[k].lacking
        assert lacking is not None
        force = x @ lacking.force.T + lacking.load_forces(loads)
        tension, oscillators = lacking.mean_tension(rows, self._tensions[k]), self._oscillators[k]
        state = self._vibration[k, : len(oscillators.omega)]
        beyond = oscillators.integrate(t, force, state, tension)
        energy = energies_of_vibrations(oscillators.omega, beyond)
        energy = np.where(energy > one.least * oscillators.omega**2, energy, 0.0)
        update_largest(self._alone[k], energy, t)
        row, mode = np.unravel_index(int(energy.argmax()), energy.shape)
        if energy[row, mode] > self._largest[TRUNCATION, 0, k]:
            self._update_largest(TRUNCATION, k, energy[row, mode], t[row], float(mode))
            self._pose[k] = rows.part(int(row), int(row) + 1)

    def act_back(self, k: int, energy: Array, t: Array, since: Array) -> None:
        """Add energies (t, o) of modes of body k that act back on it, as known since times (o,)."""
        acting = self._acting[k, : len(since)]
        acting[acting[:, 2] != since, :2] = 0.0
        acting[:, 2] = since
        update_largest(acting, energy, t)

    def _vibrations(self, k: int) -> tuple[float, float, int, float]:
        return most_of_vibrations(self._alone[k], self._acting[k], self._strain[k])

    def node_loads(self, rows: OutputBlock) -> list[Array]:
        """For each body the forces and moments (t, 6 r) at its nodes, in body axes."""
        responses = [one.body.load_response for one in self._bodies]
        loads = [np.zeros((len(rows.t), 6 * len(one.nodes) if one else 0)) for one in responses]
        if self._work is None:
            return loads
        t, before = self._loads
        if len(rows.t) <= len(t) and np.array_equal(rows.t, t[: len(rows.t)]):
            return [part[: len(rows.t)] for part in before]
        run, state, work = self._work
        now, at = work.now.marker, [one.markers for one in self._bodies]
        wrenches = [np.zeros((len(rows.t), len(markers), 6)) for markers in at]
        arms = [np.zeros((len(rows.t), len(markers), 3)) for markers in at]
        for row in range(len(rows.t)):
            state.t[0] = rows.t[row]
            for name in ("q", "v", "vd", "lam"):
                getattr(state, name)[:] = getattr(rows, name)[row]
            call(initial_conditions.solve_stage, run, initial_conditions.RESIDUAL)
            for markers, w, arm in zip(at, wrenches, arms, strict=True):
                w[row], arm[row] = now["W"][markers], now["arm"][markers]
        for k, one in enumerate(self._bodies):
            p = rows.q[:, one.columns.iq + 3 : one.columns.iq + 7]
            for i, place in enumerate(one.places):
                force, moment = (in_body_axes(p, wrenches[k][:, i, c : c + 3]) for c in (0, 3))
                moment = moment + np.cross(arms[k][:, i], force)
                if place < 0:
                    self._unknown[k] = max(self._unknown[k], np.abs(force).max(initial=0.0))
                else:
                    loads[k][:, place : place + 6] += np.hstack([force, moment])
        self._loads = rows.t.copy(), loads
        return loads

    def indicators(self) -> Iterator[Indicator]:
        """The missing shares of each body."""
        early = self._now[0] - self._begin[0] < self._settled
        words = ("inertia_loads", "node_loads", "truncation")
        for k, one in enumerate(self._bodies):
            for what, texts in enumerate((self._inertia, self._load, self._truncation)):
                missing, t, beside = self._largest[what, :, k]
                if what == TRUNCATION:
                    missing, t, beside, _ = self._vibrations(k)
                whole = self._strain[k] if what == TRUNCATION else self._whole[k]
                share = 0.0 if early or not missing else float(np.sqrt(missing / whole))
                text = partial(texts, one, share, t, beside)
                bound = self._sensor_change(one, share, beside) if what == TRUNCATION else None
                lasts = self._now[0] - self._began[what, 1, k] >= one.period
                if not lasts and self._now[0] - self._begin[0] < self._end:
                    bound = 0.0
                yield Indicator(one.name, words[what], share, t, LARGEST_SHARE, text, bound)

    def _sensor_change(self, one: _MonitoredBody, share: float, mode: float) -> float | None:
        """Largest error of sensors by an omitted mode, over their range; None: none such moves."""
        k, j = self._bodies.index(one), int(mode)
        if not share or not self._sensors or not self._most.ndim:
            return None
        omega, moves = self._oscillators[k].omega[j], self._carried(k, j)
        y, changes = (np.sqrt(self._vibrations(k)[3]) / omega, list[float]())
        for columns, power, beside in self._sensors:
            size = float((self._most - self._least)[columns].max())
            moved = y * moves[columns].max()
            still = _LEAST_RANGE * self._size * self._slowest**power
            if beside is None:
                moved, still = y * one.pulls[j] * omega**2, still * one.body.mass
            elif one.name in beside:
                moved = 2.0 * y / np.sqrt(one.body.mass) * omega**power
            if size > still:
                changes.append(moved / size)
        return max(changes, default=None)

    def _carried(self, k: int, mode: int) -> Array:
        """(channels,) change of sensors as the scene moves by the inertia of an omitted mode."""
        lacking, row = self._bodies[k].lacking, self._pose.get(k)
        if row is None or lacking is None or n_free(self._compiled) > MAX_COORDINATES:
            return np.zeros(len(self._compiled.layout.channels))
        key = k, mode, float(row.t[0])
        if self._changes[0] != key:
            self._changes = key, lacking.sensor_changes(self._compiled, row, mode)
        return self._changes[1]

    def notes(self) -> Iterator[str]:
        """Sentences on bodies whose missing response to the loads of the run is not known."""
        for k, one in enumerate(self._bodies):
            if self._unknown[k] > 0.0:
                yield self._not_known(one)
        yield from self.beyond.values()

    def notes_of_modes(self, made: Linearization) -> Iterator[str]:
        """Sentences on bodies whose nodes with joints spoil natural frequencies of a scene at rest.

        Of those below the modes that are left out.
        """
        for one in self._bodies if not made.state.v.any() else ():
            response, omitted = one.body.load_response, one.body.omitted_modes
            if not len(one.markers) or made.compiled.layout.nv > MAX_COORDINATES:
                continue
            if response is None or (one.places < 0).any():
                yield self._not_known(one)
                continue
            R, hertz = response.missing, made.frequencies
            errors = errors_at_nodes(made, one.columns, R, one.markers, one.places)
            last = np.inf if omitted is None else omitted.frequency.min(initial=np.inf)
            for k in np.flatnonzero((hertz < last) & (errors > LARGEST_ERROR))[:1]:
                yield (
                    f"bodies.{one.name}: for want of modes that answer the load of "
                    f"{self._paths.get(one.name)}, which acts beside its interfaces, natural "
                    f"frequencies from {self._units.say(hertz[k], 'Hz', 3)} on are too high, this "
                    f"one by about {percent(errors[k])}; {_CURE}"
                )

    def _not_known(self, one: _MonitoredBody) -> str:
        what = self._paths.get(one.name, "a load")
        return (
            f"bodies.{one.name}: {what} acts beside its interfaces, and its file does not tell "
            "whether its modes answer that: name the point as an interface, or reduce it again "
            "with that node among its load_points"
        )

    def _inertia(self, one: _MonitoredBody, share: float, t: float, speed: float) -> str:
        cure = 'reduce it with residual = "inertia"'
        if one.body.provenance.get("reduction") == "user":
            cure = "add the static responses to it to your modes, or take another reduction"
        turns = f", where it turns with {self._units.say(speed, 'rad/s', 3)}"
        return (
            f"bodies.{one.name}: its modes lack {100 * min(share, 1.0):.3g} % of the response to "
            f"its own weight and inertia at t = {self._units.say(t, 's', 4)}"
            f"{turns if speed > _AT_REST else ''}: stress and growth are too small; {cure}"
        )

    def _load(self, one: _MonitoredBody, share: float, t: float, _: float) -> str:
        what = self._paths.get(one.name)
        place = f"of {what}, which acts beside its interfaces"
        cure = _CURE
        if what is None or one.body.provenance.get("reduction") == "user":
            place = "of its joints and forces" if what is None else f"of {what}"
            cure = "add the static responses to it to your modes, or take another reduction"
        return (
            f"bodies.{one.name}: its modes lack {100 * min(share, 1.0):.3g} % of the response to "
            f"the load {place}, at t = {self._units.say(t, 's', 4)}: the deflection there is too "
            f"small by about {100 * min(share, 1.0) ** 2:.3g} %, stress by more; {cure}"
        )

    def _truncation(self, one: _MonitoredBody, share: float, t: float, mode: float) -> str:
        change = self._sensor_change(one, share, mode) or 0.0
        hertz = self._oscillators[self._bodies.index(one)].omega[int(mode)] / (2.0 * np.pi)
        sensors = f", and change sensors by up to {percent(change)}" if change > _VISIBLE else ""
        return (
            f"bodies.{one.name}: a mode of {self._units.say(hertz, 'Hz', 3)} that it does not have "
            f"would vibrate with {percent(share)} of its deformation at t = "
            f"{self._units.say(t, 's', 4)}{sensors}: its motion or loads come near that frequency; "
            "reduce it with more modes"
        )


def _monitored_body(
    compiled: Compiled, columns: BodyColumns, body: FlexBody, model: Model, loaded: bool,
    Cq: Array,
) -> _MonitoredBody:  # fmt: skip
    frame = joined_frame(body, columns.name, model)
    response, m = body.load_response, columns.m
    markers, places = [], []
    parts = compiled.system.parts
    number = int(np.flatnonzero(parts.bodies["iv"] == columns.iv)[0])
    nodes = [] if response is None else response.nodes.tolist()
    mine = np.flatnonzero((parts.markers["body"] == number) & (parts.markers["modes"] >= 0))
    for k in mine if loaded or min(nodes, default=0) < 0 else ():
        rho, at = parts.markers["rho"][k], parts.markers["modes"][k]
        node = carrier_node(body, rho, parts.pool[at : at + 3 * m].reshape(3, m))
        if node in nodes or node >= 0:
            markers.append(int(k))
            places.append(6 * nodes.index(node) if node in nodes else -1)
    accelerations = BodyAccelerations(columns, body, np.array(model.gravity or (0.0, 0.0, 0.0)))
    away = float(np.abs(compiled.initial_q[columns.iq : columns.iq + 3]).max())
    least = max(LEAST_MOTION * body.characteristic_length, _ROUND_OFF * away)
    frequencies, _ = joined_modes(body, columns, compiled.initial_q, Cq)
    lacking = LackingBody.of(columns, body, np.zeros(3))
    pulls = np.zeros(0)
    if lacking is not None:
        pulls = lacking.interface_forces(joined_interfaces(body, columns.name, model))
    return _MonitoredBody(
        columns, body, accelerations, frame, 2.0 * np.pi / frequencies.min(initial=np.inf),
        lacking, pulls, np.array(markers, np.int64), np.array(places, np.int64),
        least**2 * body.mass,
    )  # fmt: skip
