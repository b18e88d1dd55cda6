"""Tables of force elements between two markers or on a coordinate, as `tables` has the others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_I = "i8"
_F = "f8"

# Measures of laws.
DISTANCE_OF, COMPONENT_OF, COORDINATE_OF = 0, 1, 2

# Six forces and moments between two markers by a law linear in their relative motion (bushing,
# beam). `at` is the offset in Elements.pool of u0 (3), p0 (6), K (6, 6), C (6, 6).
FRAME = np.dtype(
    [("I", _I), ("J", _I), ("couple", _I), ("at", _I), ("damped", _I)],
    align=True,
)

# A force by a law of one measure s and its rate: the distance of two markers, the component of
# their separation along z of I, or a scalar coordinate. It resists the growth of s with
# k (s - free) + c s' + spring(s - free) + damper(s') - u(t), or as a stop does (see kernels.law).
LAW = np.dtype(
    [
        ("measure", _I),  # DISTANCE_OF, COMPONENT_OF, COORDINATE_OF
        ("I", _I),
        ("J", _I),
        ("coordinate", _I),  # the scalar coordinate, or -1
        ("couple", _I),
        ("stop", _I),  # 1: a stop; then k, c are at full depth, free is not used
        ("k", _F),
        ("c", _F),
        ("free", _F),
        ("fun", _I),  # u(t), or -1
        ("spring", _I),  # program, or -1
        ("stored", _I),  # program of the integral of the spring, or -1: by Gauss's rule
        ("damper", _I),  # program, or -1
        ("exponent", _F),
        ("depth", _F),
        ("lower", _F),
        ("upper", _F),
    ],
    align=True,
)

# Force or torque at a marker with components in the axes of another one, or with its opposite on
# another body at the same point (-1: none, of `axes`: global ones).
MUTUAL = np.dtype(
    [
        ("marker", _I),
        ("other", _I),
        ("axes", _I),
        ("torque", _I),
        ("fun", _I, (3,)),
        ("couple", _I),  # LINK between the bodies of other and marker
        ("couple_marker", _I),  # between those of marker and axes
        ("couple_other", _I),  # between those of other and axes
    ],
    align=True,
)


class Elements(NamedTuple):
    """Force elements between two markers or on a coordinate; each table is None if unused."""

    frames: object  # FRAME
    laws: object  # LAW
    mutual: object  # MUTUAL
    pool: np.ndarray  # numbers of frames
    programs: object  # FunctionTable of laws, their variable in place of time
