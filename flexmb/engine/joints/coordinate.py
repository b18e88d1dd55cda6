"""Scalar coordinates in addition to the bodies: m s̈ + c ṡ + k (s − s0) = u(t) + reactions.

A row can follow scalar coordinates in place of a function of time: C = (measure) − Σ f s, with
factors f. Its multiplier then acts on each s with the factor f. Two rows that follow the same
coordinate are coupled, as those of gears are. A coordinate without mass is an auxiliary variable
that its rows determine. A state has mass one and no row: ṡ is the state and u its rate of change;
it has no energy. Values and rates of the sums Σ f s are stored with those of the functions of time,
in Constraints.fun.

Couplers: an equation Σ a x = c between n joint coordinates x becomes n rows with n − 1 massless
coordinates s: x_i = s_i for all but the last, x_n = (c − Σ a_i s_i)/a_n. So it removes one degree
of freedom, its angles count turns, and the multiplier of each row is the torque (force) of the
coupler on that joint; these are in proportion to a. A screw couples its own angle and stroke.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.jit import unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import DAMPER_POWER, KINETIC_ENERGY, LOAD_POWER, SPRING_ENERGY, Point, Run
from flexmb.engine.tables import COORDINATE, CURVE_MARKER

if TYPE_CHECKING:
    from flexmb.engine.symbolic import Symbolic
    from flexmb.flexbody import FlexBody
    from flexmb.model.model import Model


@dataclass(frozen=True)
class Scalar:
    """m s'' + c s' + k (s − s0) = u(t); `function` is u in `Functions`, −1 for none."""

    name: str
    mass: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0
    free: float = 0.0
    function: int = -1
    angular: bool = True  # in radians, else in metres
    size: float = 0.0  # magnitude of a state, for error scales; 0: s is a motion, no state


class Contact(NamedTuple):
    """A joint that can only push: its row normal to the curve, and the sign of λ in pushing."""

    joint: str
    row: int
    compressed: float


class CurvePoint(NamedTuple):
    """One curve marker before its table is made; fields as in `tables.CURVE_MARKER`."""

    joint: str
    marker: int
    at: int
    pieces: int
    closed: bool
    turns: bool
    group: int
    side: int
    other: int
    start: float
    breaks: int


@dataclass
class CurvePoints:
    """The curve markers of a model, and the contacts among their joints."""

    points: list[CurvePoint] = field(default_factory=list)
    contacts: list[Contact] = field(default_factory=list)

    @property
    def events(self) -> int:
        """Number of event functions: one for each curve marker, if a curve has breaks."""
        return len(self.points) if any(point.breaks for point in self.points) else 0

    def scalars(self) -> list[Scalar]:
        """The scalar coordinates s of the curve markers."""
        words = ("position", "second_position")
        return [
            Scalar(f"joints.{s.joint}.{words[s.other >= 0 and s.other < k]}", angular=False)
            for k, s in enumerate(self.points)
        ]

    def number(self, joint: str, on: str) -> int:
        """Number of the curve marker of a joint whose curve is on the joint's marker I or J."""
        mine = [k for k, s in enumerate(self.points) if s.joint == joint]
        return mine[1 if on == "J" else 0]

    def couples(self, groups: list[tuple[int, int, int, int]], first: int) -> list[tuple[int, int]]:
        """Pairs of blocks whose tangents couple; `first` is the block of the first coordinate."""
        pairs = []
        for k, s in enumerate(self.points):
            pairs += [(body, first + k) for body in groups[s.group][2:] if body >= 0]
            if s.other > k:
                pairs.append((first + k, first + s.other))
        return pairs

    def table(
        self,
        groups: list[tuple[int, int, int, int]],
        symbolic: Symbolic,
        blocks: int,
        scalars: int,
        event: int,
    ) -> NDArray[np.void]:
        """CURVE_MARKER rows, and an event function each from number `event` on.

        `blocks` bodies and `scalars` other coordinates come before theirs.
        """
        rows = []
        for k, s in enumerate(self.points):
            mine = blocks + scalars + k
            links = [
                symbolic.couple_links.get((body, mine), -1) if body >= 0 else -1
                for body in groups[s.group][2:]
            ]
            other = symbolic.couple_links.get((mine, blocks + scalars + s.other), -1)
            link = symbolic.coordinate_links[s.group, mine]
            rows.append(
                (s.marker, scalars + k, s.at, s.pieces, s.closed, s.turns, s.group, s.side, link,
                 *links, s.other, other if s.other > k else -1, s.breaks,
                 event + k)
            )  # fmt: skip
        return np.array(rows, CURVE_MARKER)


def unit_weight(scalar: Scalar, length: float) -> float:
    """Weight that makes a scalar coordinate dimensionless in error norms.

    1 per radian, 1/`length` (the size of the model) per metre, 1/size for a state.
    """
    if scalar.size > 0.0:
        return 1.0 / scalar.size
    return 1.0 if scalar.angular else 1.0 / length


def coordinate_table(scalars: list[Scalar], nq: int, nv: int) -> NDArray[np.void]:
    """COORDINATE rows, after the nq, nv coordinates of the bodies; panels are filled in later."""
    rows = [
        (nq + k, nv + k, s.mass, s.damping, s.stiffness, s.free, s.function, -1, s.size > 0.0)
        for k, s in enumerate(scalars)
    ]
    return np.array(rows, COORDINATE)


class Coordinates(NamedTuple):
    """Scalar coordinates (`Parts.coordinates`, `System.coupled`)."""


@unit
def put_values(run: Run, of: Coordinates, at: Point) -> int:
    """Put Σ f s of all rows that follow coordinates into the values of their slots."""
    sys, q, fun = run.system, at.q, run.work.con.fun
    coupled, coordinates = sys.coupled, sys.parts.coordinates
    for k in range(coupled.shape[0]):
        entry = coupled[k]
        slot = sys.rows[entry["row"]]["fun"]
        if entry["first"] == 1:
            fun[slot, 0] = 0.0
            fun[slot, 2] = 0.0  # s̈ is an unknown of the equations, not part of γ
        fun[slot, 0] += entry["factor"] * q[coordinates[entry["coordinate"]]["iq"]]
    return SUCCESS


@unit
def put_rates(run: Run, of: Coordinates, at: Point) -> int:
    """Put Σ f ṡ of all rows that follow coordinates into the rates of their slots."""
    sys, v, fun = run.system, at.v, run.work.con.fun
    coupled, coordinates = sys.coupled, sys.parts.coordinates
    for k in range(coupled.shape[0]):
        entry = coupled[k]
        slot = sys.rows[entry["row"]]["fun"]
        if entry["first"] == 1:
            fun[slot, 1] = 0.0
        fun[slot, 1] += entry["factor"] * v[coordinates[entry["coordinate"]]["iv"]]
    return SUCCESS


@unit
def put_forces(run: Run, of: Coordinates, at: Point) -> int:
    """res = m s̈ + c ṡ + k (s − s0) − u + Cqᵀ λ of all coordinates."""
    sys, res, fun = run.system, run.work.trial.res, run.work.con.fun
    coordinates, coupled, q, v, vd = sys.parts.coordinates, sys.coupled, at.q, at.v, at.vd
    for k in range(coordinates.shape[0]):
        s = coordinates[k]
        i = s["iv"]
        res[i] = s["m"] * vd[i] + s["c"] * v[i] + s["k"] * (q[s["iq"]] - s["s0"])
        if s["fun"] >= 0:
            res[i] -= fun[s["fun"], 0]
    for k in range(coupled.shape[0]):
        entry = coupled[k]
        i = coordinates[entry["coordinate"]]["iv"]
        res[i] -= entry["factor"] * at.lam[entry["row"]]
    return SUCCESS


@unit
def add_tangents(run: Run, of: Coordinates, at: Point, cv: float, cp: float) -> int:
    """Add m + cv c + cp k to the diagonal of the iteration matrix.

    At the acceleration level, cv = 0, stiffness is added to the mass so that stiff modes do not
    spoil reactions; for a massless coordinate it is left out, as it has no such mode.
    """
    panels, low, up = run.system.kkt.panels, run.work.factor.low, run.work.factor.up
    coordinates = run.system.parts.coordinates
    for k in range(coordinates.shape[0]):
        s = coordinates[k]
        place = panels[s["panel"]]["at"]
        diagonal = s["m"] + cv * s["c"]
        if s["m"] > 0.0 or cv != 0.0:
            diagonal += cp * s["k"]
        low[place] += diagonal
        up[place] += diagonal
    return SUCCESS


@unit
def put_jacobian_entries(run: Run, of: Coordinates, at: Point) -> int:
    """Put −f of the rows that follow coordinates into the Jacobian part of the matrix."""
    sys, factor = run.system, run.work.factor
    coupled = sys.coupled
    for k in range(coupled.shape[0]):
        entry = coupled[k]
        link, r = sys.kkt.links[entry["link"]], sys.rows[entry["row"]]["in_group"]
        place = link["at"] + r * (1 if link["flipped"] == 1 else link["stride"])
        factor.low[place] = -entry["factor"]
        if factor.symmetric[0] == 0:
            factor.up[place] = -entry["factor"]
    return SUCCESS


@unit
def add_energies(run: Run, of: Coordinates, at: Point) -> int:
    """Σ ½ m ṡ² of coordinates that are no states, and Σ ½ k (s − s0)²."""
    coordinates, out = run.system.parts.coordinates, run.work.energies
    for k in range(coordinates.shape[0]):
        s = coordinates[k]
        if s["state"] == 0:
            out[KINETIC_ENERGY] += 0.5 * s["m"] * at.v[s["iv"]] ** 2
        stretch = at.q[s["iq"]] - s["s0"]
        out[SPRING_ENERGY] += 0.5 * s["k"] * stretch * stretch
    return SUCCESS


@unit
def add_powers(run: Run, of: Coordinates, at: Point) -> int:
    """−Σ c ṡ² of dampers, Σ u ṡ of applied forces."""
    coordinates, out, fun = run.system.parts.coordinates, run.work.powers, run.work.con.fun
    for k in range(coordinates.shape[0]):
        s = coordinates[k]
        rate = at.v[s["iv"]]
        out[DAMPER_POWER] -= s["c"] * rate * rate
        if s["fun"] >= 0 and s["state"] == 0:
            out[LOAD_POWER] += fun[s["fun"], 0] * rate
    return SUCCESS


@unit
def multiply_mass(run: Run, of: Coordinates, at: Point) -> int:
    """Factor.sol = m Trial.res, for the coordinates."""
    coordinates, place = run.system.parts.coordinates, run.system.kkt.place
    for k in range(coordinates.shape[0]):
        i = coordinates[k]["iv"]
        run.work.factor.sol[place[i]] = coordinates[k]["m"] * run.work.trial.res[i]
    return SUCCESS


COORDINATES = Kind(
    "coordinates",
    Coordinates,
    {
        "position": put_values,
        "velocity": put_rates,
        "force": put_forces,
        "matrix": add_tangents,
        "jacobian": put_jacobian_entries,
        "mass": multiply_mass,
        "energy": add_energies,
        "power": add_powers,
    },
    does_work=True,
    stiff=True,
)


Factors = tuple[tuple[str, float], ...]


class CoupledRow(NamedTuple):
    """One joint coordinate equal to offset + Σ factor · scalar coordinate."""

    owner: str  # name of its reaction
    joint: str
    coordinate: str
    factors: Factors
    offset: float
    relative: bool  # the joint coordinate is counted from the initial pose


def coupled_scalars(model: Model) -> Iterator[tuple[str, bool]]:
    """Names of the scalar coordinates of couplers and screws, and whether they are angles."""
    for name, spec in model.couplers.items():
        owners = spec.reaction_names(name)
        for owner, (_, coordinate) in zip(owners[:-1], spec.coordinates, strict=False):
            yield f"couplers.{owner}", coordinate != "stroke"
    for name, joint_spec in model.joints.items():
        if joint_spec.type == "screw":
            yield f"joints.{name}", True


def coupled_rows(model: Model, flexbodies: Mapping[str, FlexBody]) -> Iterator[CoupledRow]:
    """The rows of all couplers."""
    for name in model.couplers:
        coupling = model.couplers[name].equation(model, flexbodies)
        keys = tuple((term.joint, term.coordinate) for term in coupling.terms)
        owners = [f"couplers.{owner}" for owner in model.couplers[name].reaction_names(name)]
        last = coupling.terms[-1].factor
        for owner, key in zip(owners[:-1], keys, strict=False):
            yield CoupledRow(owner, *key, ((owner, 1.0),), 0.0, coupling.relative)
        factors = tuple(
            (owner, -term.factor / last)
            for owner, term in zip(owners[:-1], coupling.terms, strict=False)
        )
        yield CoupledRow(
            owners[-1], *keys[-1], factors, coupling.constant / last, coupling.relative
        )


def screw_rows(model: Model, name: str) -> tuple[CoupledRow, ...]:
    """Rows that couple angle and stroke of a screw by its pitch; none for other joints."""
    pitch = model.joints[name].pitch
    if pitch is None:
        return ()
    owner = f"joints.{name}"
    along = ((owner, pitch / (2.0 * math.pi)),)
    return (
        CoupledRow(owner, name, "angle", ((owner, 1.0),), 0.0, True),
        CoupledRow(owner, name, "stroke", along, 0.0, True),
    )
