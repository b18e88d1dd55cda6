"""A rigid body as a flexible body with zero modes.

In: mass [kg], centre of mass [m] in body axes, inertia about it [kg m^2] in body axes. Out: a
:class:`FlexBody`, whose second moment of mass is S0 = tr(J)/2 I - J + m c c^T.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from flexmb.flexbody.arrays import Checker
from flexmb.flexbody.body import FlexBody

__all__ = ["rigid_body"]

_ROUNDING = 1e-9  # relative room for a rod or a plate, whose triangle inequality is an equality


def rigid_body(
    mass: float, center: ArrayLike = (0, 0, 0), inertia: ArrayLike = 0.0, name: str = "rigid"
) -> FlexBody:
    """Build a rigid body from its mass properties.

    Parameters
    ----------
    mass : float
        kg.
    center : (3,) float
        Centre of mass, body frame [m].
    inertia : (3, 3), (3,) or float
        About the centre of mass, body axes [kg m^2]; three numbers are the diagonal.
    name : str
        Name of the body.

    Raises
    ------
    ReductionError
        Mass that is not positive, or an inertia no body can have.
    """
    check = Checker(f"body {name}")
    c = check.floats("center", center, (3,))
    given = np.asarray(inertia, dtype=float)
    J = check.floats("inertia", given if given.ndim == 2 else np.diag(given * np.ones(3)), (3, 3))
    if not mass > 0:
        check.add("mass", f"must be positive, is {mass:g} kg")
    check.raise_problems()
    if np.abs(J - J.T).max() > _ROUNDING * np.abs(J).max():
        check.add("inertia", "is not symmetric")
        check.raise_problems()
    moments = np.linalg.eigvalsh(J)
    if moments[0] < -_ROUNDING * moments[2]:
        check.add("inertia", f"has a negative principal moment {moments[0]:g} kg m^2")
    elif moments[2] > (1 + _ROUNDING) * (moments[0] + moments[1]):
        text = ", ".join(f"{moment:g}" for moment in moments)
        check.add("inertia", f"is impossible: of {text} kg m^2 the largest exceeds the others' sum")
    check.raise_problems()
    S0 = 0.5 * np.trace(J) * np.eye(3) - 0.5 * (J + J.T) + mass * np.outer(c, c)
    none = np.zeros
    return FlexBody(
        name, mass, mass * c, S0, none((3, 0)), none((3, 3, 0)), none((3, 3, 0, 0)), none((0, 0))
    )
