"""A clamped circular plate under pressure by von Karman's equations.

Radius 1, in terms of the slope w' and the radial displacement u (Timoshenko and Woinowsky-Krieger,
Theory of Plates and Shells, section 97); as a boundary value problem from the middle to the rim.
Prints the deflection [m] at the end of each pressure of the scene.
"""

from functools import partial

import numpy as np
from scipy.integrate import solve_bvp

RADIUS = 0.02  # m
E, NU, THICKNESS = 190e9, 0.3, 0.0002 / RADIUS  # thickness over the radius
D, C = E * THICKNESS**3 / (12 * (1 - NU**2)), E * THICKNESS / (1 - NU**2)
PRESSURES, TIMES = (6250, 12500, 25000, 50000), (0.0195, 0.0395, 0.0595, 0.0795)


def rates(r, y, pressure):
    u, force, _, slope, bent = y
    hoop = NU * force + (1 - NU**2) * C * u / r
    stretch = force / C - NU * u / r - 0.5 * slope**2
    third = force * slope / D + 0.5 * pressure * r / D - bent / r + slope / r**2
    return np.array([stretch, (hoop - force) / r, slope, bent, third])


def ends(a, b):
    return np.array([a[0], a[3], b[0], b[2], b[3]])


def deflections(pressures):
    """At rising pressures, each from the solution of the one before."""
    r, y = np.linspace(1e-4, 1, 400), np.zeros((5, 400))
    for pressure in pressures:
        found = solve_bvp(partial(rates, pressure=pressure), ends, r, y, tol=1e-8, max_nodes=100000)
        assert found.success
        r, y = found.x, found.y
        yield abs(y[2][0])


if __name__ == "__main__":
    for time, middle in zip(TIMES, deflections(PRESSURES), strict=True):
        print(f"middle.z {time:g} {-RADIUS * middle:.9f}")
