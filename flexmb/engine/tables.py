"""The compiled model as flat tables: what the kernels read, and nothing else.

`System` is constant during a run. A table whose feature the model does not use is `None`; Numba
compiles nothing of a branch on `None` when the field is passed on as an argument. All numbers are
SI. Offsets `iq`, `iv` point into q and v; `pool` holds all data whose size depends on the number of
modes, addressed by offsets in the body and marker tables.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine.sensor_tables import Sensors

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
        ("damped", _I),  # 1 if D is not zero
        ("z", _I),  # offset of its deformation integrals (12 m) in Now.Z
        ("panel", _I),  # its panel of the KKT matrix
    ],
    align=True,
)
# Blocks of the pool of one flexible body, in this order, with their sizes (rows, columns).
FLEX_LAYOUT = (
    ("p", 3),  # int rho N_b Phi: (3, m)
    ("P", 9),  # P[a, b] at row 3 a + b: (9, m)
    ("M", "9m"),  # Mab[b, a] at row block 3 a + b, so that Z_ab = P_ab + block eta: (9 m, m)
    ("G", "3m"),  # G_x = M_yz - M_zy and cyclic: (3 m, m)
    ("M_eta", "m"),
    ("K", "m"),
    ("D", "m"),
)

# One marker. body = -1: fixed in the global frame. `modes` < 0: rigid; else the pool offset of
# Phi_t (3, m) followed by Phi_r (3, m). `arm` turns with the node.
MARKER = np.dtype(
    [
        ("body", _I),
        ("modes", _I),
        ("rho", _F, (3,)),  # node position in body axes
        ("arm", _F, (3,)),  # from the node to the marker, body axes, undeformed
        ("R", _F, (3, 3)),  # marker axes in body axes, undeformed
    ],
    align=True,
)

# One scalar coordinate s beside the bodies: m s'' + c s' + k (s - s0) = u(t) + reactions of the
# rows that follow it. Without mass it is a parameter that rows decide; with mass and damping its
# velocity is a first-order state.
COORDINATE = np.dtype(
    [
        ("iq", _I),
        ("iv", _I),
        ("m", _F),
        ("c", _F),
        ("k", _F),
        ("s0", _F),  # where the spring is free
        ("fun", _I),  # u(t), or -1
        ("panel", _I),
        ("state", _I),  # 1: its velocity is a state of a controller, no motion: without energy
    ],
    align=True,
)

# One constraint row between markers I and J; `fun` < 0: no function of time.
ROW = np.dtype(
    [
        ("kind", _I),
        ("I", _I),
        ("J", _I),
        ("a", _I),  # axis of marker I (0, 1, 2)
        ("b", _I),  # axis of marker J
        ("fun", _I),
        ("jac_I", _I),  # offset of its Jacobian row for the body of I in Dense.jac, or -1
        ("jac_J", _I),
        ("in_group", _I),  # its place in its group
        ("follows", _I),  # number of scalar coordinates that it follows in place of `fun`
        ("offset", _F),  # constant that its measure keeps
    ],
    align=True,
)

# One scalar coordinate that a row follows, times a factor: the row's slot in Constraints.fun holds
# the sum and its rate. The entries of a row stand together, the one that begins it with first = 1.
FOLLOW = np.dtype(
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
        ("link_I", _I),  # where its Jacobian goes in the KKT matrix (LINK), -1: ground
        ("link_J", _I),
        ("couple", _I),  # LINK between the two bodies for the tangent, -1: none
        ("reversed", _I),  # 1: marker I of its rows is marker J of the joint
    ],
    align=True,
)

# Spring-damper along the line between two markers.
SPRING = np.dtype(
    [
        ("I", _I),
        ("J", _I),
        ("k", _F),  # N/m
        ("c", _F),  # N s/m
        ("d0", _F),  # m
        ("couple", _I),
    ],
    align=True,
)

# Force or torque at a marker; `follower` = 1: components in the marker's axes.
LOAD = np.dtype(
    [("marker", _I), ("torque", _I), ("follower", _I), ("fun", _I, (3,))],
    align=True,
)

# One contact between a round side I (a sphere, or a point of radius 0) and a side J. Depth d > 0:
# normal force K d^n (1 + c d'/d0'), d0' the speed of approach at the onset, at least `slow`.
# The last fields are those of JOINT_FRICTION. Memory from `kept` on: d0', and with friction
# whether it slides, then the bristle (3) in axes of J.
FRICTION_FIELDS = [
    ("model", _I),  # NO_FRICTION, BRISTLE, SMOOTH
    ("static", _F),
    ("dynamic", _F),
    ("stribeck", _F),  # m/s
    ("viscous", _F),  # s/m, coefficient per speed
    ("k", _F),  # N/m of the bristle
    ("c", _F),  # N s/m of the bristle
    ("creep", _F),  # m/s, of the smooth model
    ("kept", _I),
]
CONTACT = np.dtype(
    [
        ("I", _I),
        ("J", _I),
        ("kind", _I),  # BALL, PLANE, CYLINDER, BORE: of side J
        ("ri", _F),
        ("rj", _F),
        ("half", _F),  # half the length of a cylinder, m
        ("K", _F),  # N/m^n
        ("n", _F),
        ("damping", _F),
        ("slow", _F),  # m/s
        ("couple", _I),
        *FRICTION_FIELDS,
    ],
    align=True,
)
# Friction in a joint, on a scalar coordinate s that follows the joint's; the surface moves by
# radius times s. Memory from `kept` on: the anchor of the bristle (m), and whether it slides.
JOINT_FRICTION = np.dtype(
    [
        ("group", _I),  # of the joint
        ("coordinate", _I),
        ("row", _I),  # by which the coordinate follows the joint
        ("link", _I),  # LINK of the joint's rows with the coordinate
        ("axis", _I),  # of marker I, along which or about which it moves
        ("radius", _F),  # m, or 1 of a stroke
        ("length", _F),  # of the bearing, m; 0: it bears no moment
        ("width", _F),  # of the guide, m; 0: it bears no torque about its axis
        ("preload", _F),  # N
        *FRICTION_FIELDS,
    ],
    align=True,
)

# One panel of the factor: `nc` columns, `nr` rows below, values at `at` with row stride nc,
# `col` the first permuted index, `rows` the offset of its permuted row indices.
PANEL = np.dtype(
    [
        ("at", _I),
        ("nc", _I),
        ("nr", _I),
        ("col", _I),
        ("rows", _I),
        ("update", _I),
        ("n_update", _I),
        ("sign", _F),
    ],
    align=True,
)
# Rectangular update of a later panel: rows x times rows y of a panel, both counted from its top.
UPDATE = np.dtype(
    [("x", _I), ("nx", _I), ("y", _I), ("ny", _I), ("at", _I), ("stride", _I), ("diagonal", _I)],
    align=True,
)
# Place of an off-diagonal block: entry (i, j) at at + i stride + j, transposed if flipped.
LINK = np.dtype([("at", _I), ("stride", _I), ("flipped", _I)], align=True)


# One curve marker: a row of the marker table that slides along a curve carried by the marker it
# begins as. The pool holds n + 1 places along the curve from `at` on, then for each piece between
# them the six coefficients of x, of y and of z.
SLIDER = np.dtype(
    [
        ("marker", _I),
        ("coordinate", _I),  # its place s along the curve, m
        ("at", _I),
        ("n", _I),
        ("closed", _I),
        ("turns", _I),  # 1: its x and y are tangent and normal of a curve in the plane x, y
        ("group", _I),
        ("side", _I),  # whether it is marker I (0) or J (1) of the group
        ("link", _I),  # LINK of the group with s
        ("link_I", _I),  # LINK of the body of I with s, -1: ground
        ("link_J", _I),
        ("other", _I),  # the second curve marker of the group
        ("link_other", _I),  # LINK of the two coordinates, in the row of the first of the two
    ],
    align=True,
)


class Parts(NamedTuple):
    """Bodies and what is fixed to them."""

    bodies: np.ndarray  # BODY
    pool: np.ndarray  # modal data of bodies and markers
    markers: np.ndarray  # MARKER
    gravity: np.ndarray  # (3,) m/s^2
    coordinates: object  # COORDINATE or None
    sliders: object  # SLIDER or None


class Kkt(NamedTuple):
    """Symbolic factorisation of the KKT matrix (block minimum degree, supernodal panels)."""

    panels: np.ndarray  # PANEL, in elimination order
    rows: np.ndarray  # permuted row indices of all panels
    updates: np.ndarray  # UPDATE
    links: np.ndarray  # LINK
    place: np.ndarray  # (nv + nc,) permuted index of each unknown; one past the end: left out
    column: np.ndarray  # (nv,) column in its panel, -1: left out


class System(NamedTuple):
    """Everything constant during a run.

    What costs to compile is None where the model does not use it. Functions, loads and sensors are
    always tables, empty ones if need be: most models have them, and each choice of features is
    compiled apart.
    """

    parts: Parts
    rows: np.ndarray  # ROW
    follows: np.ndarray  # FOLLOW
    groups: np.ndarray  # GROUP
    kkt: Kkt
    weights: np.ndarray  # (nv,) size of one unit of each velocity coordinate's increment
    row_weights: np.ndarray  # (nc,) size of one unit of each constraint row
    lines: object  # one number if there are rows about lines, or None
    functions: object  # FunctionTable
    springs: object  # SPRING or None
    loads: np.ndarray  # LOAD
    elements: object  # Elements or None
    kinks: object  # (n, 2) times just before and after kinks of functions, in order, or None
    sensors: Sensors
    further: object  # one number if sensors read more than motions along axes and angles, or None
    signals: object  # Signals or None
    contacts: object = None  # CONTACT
    frictions: object = None  # JOINT_FRICTION
    stops: object = None  # (n,) the rows of elements.laws that are stops


# Kinds of constraint rows.
POINT, DOT1, DOT2, DISTANCE, ANGLE, TWIST, RADIAL, MOMENT = 0, 1, 2, 3, 4, 5, 6, 7
LINES = (TWIST, RADIAL, MOMENT)
# Sides J of contacts.
BALL, PLANE, CYLINDER, BORE = 0, 1, 2, 3
# Models of friction, and what its memory says.
NO_FRICTION, BRISTLE, SMOOTH = 0, 1, 2
OPEN, STICKS, SLIDES = 0.0, 1.0, 2.0
