"""The compiled model as flat tables, which the kernels read.

`System` is constant during a run. A table that the model does not use is empty. Elements that only
some models have (springs, contacts, friction ...) have their tables in the module of their kind
(`engine.kind`). All numbers are in SI units. `iq` and `iv` are indices into q and v. `pool` holds
all data whose size depends on the number of modes; body and marker tables have offsets into it.
Per body q = [r(3), p(4), eta(m)] and v = [r_dot(3), w(3), eta_dot(m)]. p are Euler parameters,
scalar part first; w is the angular velocity in body axes. `Layout` names the columns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmb.engine.jit import Integers, Matrix, Vector, array_of, kernel

if TYPE_CHECKING:
    from flexmb.model.functions.expression import Expression, Ops


_I = "i8"
_F = "f8"

# One body. Rigid: m = 0. `flex` is the offset of its modal data in the pool (see FLEX_LAYOUT).
BODY = np.dtype(
    [
        ("iq", _I),  # r at iq, Euler parameters at iq+3, eta at iq+7
        ("iv", _I),  # r_dot at iv, w at iv+3, eta_dot at iv+6
        ("m", _I),  # number of modal coordinates
        ("mass", _F),  # kg
        ("S1", _F, (3,)),  # int rho s, kg m
        ("S0", _F, (3, 3)),  # int rho s s^T, kg m^2
        ("flex", _I),
        ("damped", _I),  # 1 if D is not zero, 2 if it is diagonal too
        ("coupling", _I),  # how inertia depends on deformation: 0 not, 1 partly, 2 fully
        ("diagonal", _I),  # 1 if modal mass and stiffness are diagonal
        ("attached", _I),  # 1 if p or the antisymmetric part of P is not zero
        ("z", _I),  # offset of its deformation integrals in Now.Z
        ("shapes", _I),  # number of shapes with membrane forces
        ("membrane", _I),  # their pool offset
        ("panel", _I),  # its panel of the KKT matrix
    ],
    align=True,
)

# Blocks of the pool of one flexible body, in this order, with their sizes. With constant coupling
# the last two are omitted. With partial coupling D is followed by dJ/deta (6, m) and the
# `grouped_rows` of M_yy + M_zz and G_x, the same about y and z, M_xy + M_yx and cyclic.
FLEX_LAYOUT = (
    ("p", 3),  # int rho N_b Phi: (3, m)
    ("P", 9),  # P[a, b] at row 3 a + b: (9, m)
    ("M_eta", "m"),
    ("K", "m"),
    ("D", "m"),
    ("M", "9m"),  # Mab[b, a] at row block 3 a + b, so that Z_ab = P_ab + block eta: (9 m, m)
    ("G", "3m"),  # G_x = M_yz - M_zy and cyclic: (3 m, m)
)

# One marker. body = -1: fixed in the global frame. `modes` < 0: fixed to the undeformed body; else
# the pool offset of Phi_t (3, m), which Phi_r (3, m) follows. `arm` turns with the node. If the
# motion of the node has terms of second order in eta, `bend` is the pool offset of the `forms`
# coefficients K (`forms.rows_of_bend`): 3; 6 with its rotation; 4 if this is about the axis `turn`.
MARKER = np.dtype(
    [
        ("body", _I),
        ("modes", _I),
        ("bend", _I),
        ("forms", _I),
        ("turn", _F, (3,)),
        ("point", _I),  # 1: only its position is used, not its axes (`bodies.marker`)
        ("rho", _F, (3,)),  # node position in body axes
        ("arm", _F, (3,)),  # from the node to the marker, body axes, undeformed
        ("R", _F, (3, 3)),  # marker axes in body axes, undeformed
    ],
    align=True,
)

# One channel. `what`: its kind, a number in `engine.sensors`. The other fields depend on the kind:
# sums and angles: `n` terms from `first` on; `a`: number of one of three orientation angles;
# WRENCH: the element is row `first` (`n` rows from there on) of a kind, `kind` its number among
# those with element wrenches; force or moment (`quantity` 0, 1) on marker J or I (`side` 0, 1),
# component `a` in the axes of the marker `axes` (-1: global, -2: of the marker on that side);
# ENERGY: number `first` of the energies; BODY_ENERGY: the same of body `n`; EXPRESSION: program
# `first` of other channels; STATE, PLACE_RATE: velocity coordinate `first`; PLACE: position
# coordinate `first`; JOINT_ANGLE: scalar coordinate `kind` that counts its turns (-1: none).
CHANNEL = np.dtype(
    [(word, _I) for word in ["what", "first", "n", "side", "quantity", "axes", "a", "kind"]],
    align=True,
)

# One term of a channel: a factor times a measure between markers I and J; `measure`: number in
# `engine.sensors`. For the quantity of a constraint row, or its derivatives: `kind` and axes a and
# b of the row. For a motion of J: along axis a of I (-1: global). For orientation angles: number b
# of the angle and code a of the sequence of axes.
TERM = np.dtype(
    [
        ("measure", _I),
        ("kind", _I),  # kind of row, or -1
        ("I", _I),
        ("J", _I),
        ("a", _I),
        ("b", _I),
        ("channel", _I),  # channel of which it is a term
        ("factor", _F),
    ],
    align=True,
)

# One scalar coordinate s: m s'' + c s' + k (s - s0) = u(t) + reactions of the rows that follow it.
# Without mass it is an auxiliary variable that its rows determine (`joints.coordinate`).
COORDINATE = np.dtype(
    [
        ("iq", _I),
        ("iv", _I),
        ("m", _F),
        ("c", _F),
        ("k", _F),
        ("s0", _F),  # s at which the spring is free
        ("fun", _I),  # u(t), or -1
        ("panel", _I),
        ("state", _I),  # 1: its velocity is a state of a controller, no motion; it has no energy
    ],
    align=True,
)

# One constraint row between markers I and J; `fun` < 0: no function of time.
ROW = np.dtype(
    [
        ("kind", _I),  # number in `engine.joints`
        ("I", _I),
        ("J", _I),
        ("a", _I),  # axis of marker I (0, 1, 2)
        ("b", _I),  # axis of marker J
        ("fun", _I),
        ("jac_I", _I),  # offset of its Jacobian row for the body of I in Dense.jac, or -1
        ("jac_J", _I),
        ("in_group", _I),  # number of the row in its group
        ("coupled", _I),  # number of scalar coordinates that it follows, in place of a function
        ("offset", _F),  # constant: measure = offset + function
    ],
    align=True,
)

# One term `factor` · s of the scalar coordinates that a row follows. The row's slot in
# Constraints.fun holds the sum and its rate. The terms of a row are consecutive; the first has
# first = 1.
COUPLED_COORDINATE = np.dtype(
    [
        ("row", _I),
        ("coordinate", _I),
        ("link", _I),  # LINK of the row's group with the coordinate
        ("first", _I),
        ("factor", _F),
    ],
    align=True,
)

# One group of rows that share two bodies: a joint, or a driver.
GROUP = np.dtype(
    [
        ("row", _I),
        ("n", _I),
        ("body_I", _I),
        ("body_J", _I),
        ("panel", _I),
        ("link_I", _I),  # LINK of its Jacobian for the body of I, -1: ground
        ("link_J", _I),
        ("couple", _I),  # LINK between the two bodies, for the tangent; -1: none
        ("reversed", _I),  # 1: marker I of its rows is marker J of the joint
    ],
    align=True,
)

# One panel of the factor: `nc` columns, `nr` rows below its diagonal block, values from `at` on
# with row stride nc, `col` the first permuted index, `rows` the offset of its permuted row indices,
# `n_update` updates from `update` on, `sign` that of its pivots.
PANEL = np.dtype(
    [(word, _I) for word in ["at", "nc", "nr", "col", "rows", "update", "n_update"]]
    + [("sign", _F)],
    align=True,
)

# Rectangular update of a later panel: the product of `nx` rows from x on and `ny` rows from y on,
# both counted from the top of the panel, is subtracted from the values from `at` on, with row
# stride `stride`; `diagonal`: 1 if x and y are the same rows.
UPDATE = np.dtype(
    [(word, _I) for word in ["x", "nx", "y", "ny", "at", "stride", "diagonal"]], align=True
)

# Place of an off-diagonal block: entry (i, j) at at + i stride + j, transposed if flipped.
LINK = np.dtype([("at", _I), ("stride", _I), ("flipped", _I)], align=True)

# One curve marker: a marker that slides along a curve. Its row in the marker table is first that of
# the marker that carries the curve. From `at` on the pool has the n + 1 ends of pieces along the
# curve, then for each piece the eight coefficients of x, of y and of z.
CURVE_MARKER = np.dtype(
    [
        ("marker", _I),
        ("coordinate", _I),  # scalar coordinate s, its position along the curve, m
        ("at", _I),
        ("n", _I),
        ("closed", _I),
        ("turns", _I),  # 1: its x and y are tangent and normal of a curve in the plane x, y
        ("group", _I),
        ("side", _I),  # it is marker I (0) or J (1) of the group
        ("link", _I),  # LINK of the group with s
        ("link_I", _I),  # LINK of the body of I with s, -1: ground
        ("link_J", _I),
        ("other", _I),  # the second curve marker of the group
        ("link_other", _I),  # LINK of both coordinates, set for the first of the two; else -1
        ("breaks", _I),  # number of breaks of the curve, after its coefficients in the pool
        ("event", _I),  # its event function, zero at these breaks
    ],
    align=True,
)


class Parts(NamedTuple):
    """Bodies, markers on them, gravity, and scalar coordinates.

    Positions of bodies and of markers on ground are relative to `origin`, a point near the model.
    """

    bodies: array_of(BODY)
    pool: Vector  # modal data of bodies and markers
    markers: array_of(MARKER)
    gravity: Vector  # (3,) m/s^2
    origin: Vector  # (3,) m, global
    coordinates: array_of(COORDINATE)
    curve_markers: array_of(CURVE_MARKER)


class Kkt(NamedTuple):
    """Symbolic factorisation of the KKT matrix (block minimum degree, supernodal panels)."""

    panels: array_of(PANEL)  # in elimination order
    rows: Integers  # permuted row indices of all panels
    updates: array_of(UPDATE)
    links: array_of(LINK)
    place: Integers  # (nv + nc,) permuted index of each unknown; one past the end: it has none
    column: Integers  # (nv,) column of each velocity coordinate in its panel; -1: not in the matrix


class Sensors(NamedTuple):
    """Channels, those of the results first, then states that only expressions read."""

    channels: array_of(CHANNEL)
    terms: array_of(TERM)
    programs: FunctionTable  # of expressions; their variables are channels by number


class FunctionTable(NamedTuple):
    """Programs of all functions of a system, one after the other."""

    ops: array_of("i4")  # (n,) operation codes
    args: Vector  # (n,) argument of CONST and POWC, offset of PIECEWISE in data, number of VAR
    start: array_of("i4")  # (k + 1,) first operation of each program, and the end of the last
    depth: int  # stack depth of the deepest program
    data: Vector  # (m,) piecewise polynomials, one after the other
    live: array_of("i4")  # (k,) 1: the program has channels as variables (`sensors.feedback`)
    switches: array_of("i4")  # (n,) number of switches of each operation (`function._switches`)


class System(NamedTuple):
    """Everything constant during a run."""

    parts: Parts
    rows: array_of(ROW)
    coupled: array_of(COUPLED_COORDINATE)
    groups: array_of(GROUP)
    kkt: Kkt
    weights: Vector  # (nv,) factors that make increments of the velocity coordinates dimensionless
    row_weights: Vector  # (nc,) factors that make the constraint rows dimensionless
    part: Integers  # (nv,) part of the model, connected by equations, of each velocity coordinate
    driven: Integers  # (nv,) 1: constraints alone fix it, in a run with drivers
    functions: FunctionTable
    time_events: Matrix  # (n, 2) times just before and after jumps of functions, in order
    sensors: Sensors
    implicit_feedback: int  # 1: functions of channels depend on accelerations or reactions
    history: int  # number of internal variables of the elements, time first; 0: none
    events: int  # number of event functions that the step control watches
    program_depth: int  # stack depth that programs of the kinds need
    kinds: Mapping[str, Any]  # tables of the kinds that the model has, by name of the kind


@dataclass
class Pool:
    """A pool of numbers that grows while tables are made; tables keep the offset of their block."""

    blocks: list[NDArray[np.float64]] = field(default_factory=list)
    size: int = 0

    def add(self, values: ArrayLike) -> int:
        """Append the values, row by row; return their offset."""
        flat = np.ascontiguousarray(values, dtype=np.float64).ravel()
        offset = self.size
        self.blocks.append(np.pad(flat, (0, whole_vectors(flat.size) - flat.size)))
        self.size += self.blocks[-1].size
        return offset

    def array(self) -> NDArray[np.float64]:
        """All blocks in one array (with at least one number, so that it has an address)."""
        return aligned(np.concatenate([*self.blocks, np.zeros(1)]))


def aligned(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """A copy that begins at a cache line: vectors that cross lines are read at half the speed."""
    room = np.empty(values.size + 7)
    first = -(room.ctypes.data // 8) % 8
    room[first : first + values.size] = values.ravel()
    return room[first : first + values.size].reshape(values.shape)


def half_of_forms(m: int) -> NDArray[np.bool_]:
    """(M, M) mask of the stored part of symmetric forms of m modes, M = m in whole vectors."""
    places = np.arange(whole_vectors(m))
    return places >= places[:, None] // 8 * 8


@kernel
def whole_vectors(n):
    """n rounded up to a multiple of eight, the length of processor vectors."""
    return (n + 7) // 8 * 8


def deformation_room(bodies: NDArray[np.void]) -> NDArray[np.int64]:
    """(bodies,) length of each body's part of Now.Z.

    It holds Z_ab and M_ωη; with partial coupling also Σ f_s S_s and Σ w_k G_k, modal coordinates,
    their rates, their product in two parts, and the angular velocity for which the sums are.
    """
    m = np.asarray(bodies["m"], np.int64)
    padded = whole_vectors(m)
    return whole_vectors(12 * m) + (bodies["coupling"] == 1) * (padded * (padded + 12) + 8)


@dataclass
class Functions:
    """Functions of time and of channels, by index; equal programs share one index.

    `resolve` replaces names of channels in an expression by what they stand for.
    """

    resolve: Callable[[Expression], Expression]
    programs: list[Expression] = field(default_factory=list)
    _numbers: dict[Ops, int] = field(default_factory=dict)

    def add(self, expression: Expression) -> int:
        """Index of a function from the scene."""
        return self.put(self.resolve(expression))

    def put(self, expression: Expression) -> int:
        """Index of a function of measured channels and states, already resolved, in SI units."""
        k = self._numbers.setdefault(expression.ops, len(self.programs))
        if k == len(self.programs):
            self.programs.append(expression)
        return k


ENERGIES = ("kinetic", "strain", "gravity", "spring", "driver_work", "damper_work", "applied_work")


@dataclass(frozen=True)
class BodyColumns:
    """Name of a body, its first indices in q and v, and its number of modes."""

    name: str
    iq: int
    iv: int
    m: int


@dataclass(frozen=True)
class Layout:
    """Names and offsets of all columns of a compiled system.

    In q and v the scalar coordinates come after the bodies, in this order. A reaction is the wrench
    pair of a joint or driver, twelve numbers: force and moment on marker J in its axes, then force
    and moment on marker I in its axes.

    The equations are about points near the model and its bodies, so that what is far from the
    origin of the ground, or from the frame of its body, moves as exactly as near them: coordinates
    are the position of the reference point of each body, which is (n, 3) in its axes, relative to
    `origin` [m]. Result files hold the global positions and the motion of the frames of bodies.
    """

    bodies: tuple[BodyColumns, ...]
    coordinates: tuple[str, ...]
    nq: int
    nv: int
    nc: int
    rows: tuple[str, ...]
    reactions: tuple[str, ...]
    channels: tuple[str, ...]
    energies: tuple[str, ...]
    fingerprint: str
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    references: tuple[tuple[float, float, float], ...] = ()  # none: the frames

    @property
    def is_moved(self) -> bool:
        """Whether coordinates of the equations are not those of frames in global axes."""
        return any(self.origin) or len(self.references) > 0

    def of_frames(self, *rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """q, and if given v and v̇ (..., n), of the frames of bodies from those of the equations."""
        return self._moved(rows, 1.0)

    def of_equations(self, *rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """q, and if given v and v̇ (..., n), of the equations from those of the frames."""
        return self._moved(rows, -1.0)

    def _moved(
        self, rows: tuple[NDArray[np.float64], ...], sign: float
    ) -> tuple[NDArray[np.float64], ...]:
        moved = tuple(np.array(one, dtype=float) for one in rows)
        none = ((0.0, 0.0, 0.0),) * len(self.bodies)
        both = zip(self.bodies, self.references or none, strict=True)
        for body, reference in both if self.is_moved else ():
            place, turn = slice(body.iv, body.iv + 3), slice(body.iv + 3, body.iv + 6)
            moved[0][..., body.iq : body.iq + 3] += np.multiply(sign, self.origin)
            if any(reference):
                e0, e = np.split(moved[0][..., body.iq + 3 : body.iq + 7], [1], axis=-1)
                changes = [np.array(reference)]
                if len(rows) > 1:
                    changes.append(np.cross(moved[1][..., turn], reference))
                if len(rows) > 2:
                    changes.append(np.cross(moved[2][..., turn], reference))
                    changes[2] += np.cross(moved[1][..., turn], changes[1])
                for k, s in enumerate(changes):
                    x = 2.0 * np.cross(e, s)
                    own = slice(body.iq, body.iq + 3) if k == 0 else place
                    moved[k][..., own] -= sign * (s + e0 * x + np.cross(e, x))
        return moved
