"""Force elements: wrenches on their markers, tangents, energy and power.

Spring–damper: attraction f = k (d − d0) + c ḋ along the line between the markers. Load: a force
or a torque with three functions of time as components, in global axes or turning with its marker.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.rotation import transform
from flexmb.engine.kernels.bodies.inertia_tangent import add_skew
from flexmb.engine.kernels.joints.primitive import separation


@kernel
def add_spring_wrenches(springs, markers):
    """Add the wrenches of all spring–dampers; returns the index of one of no length, or −1."""
    if springs is not None:
        for k in range(springs.shape[0]):
            mi, mj = markers[springs[k]["I"]], markers[springs[k]["J"]]
            d, nx, ny, nz = direction(mi, mj)
            if not d > 0.0:
                return k
            f = spring_force(springs[k], mi, mj, d, nx, ny, nz)
            add_pair(mi["W"], mj["W"], f * nx, f * ny, f * nz)
    return -1


@kernel
def add_pair(wi, wj, x, y, z):
    """Force (x, y, z) on marker I, the opposite on J."""
    wi[0] += x
    wi[1] += y
    wi[2] += z
    wj[0] -= x
    wj[1] -= y
    wj[2] -= z


@kernel
def direction(mi, mj):
    """Distance of two markers and the unit vector from I to J."""
    hx, hy, hz = separation(mi, mj)
    d = math.sqrt(hx * hx + hy * hy + hz * hz)
    return d, hx / d, hy / d, hz / d


@kernel
def spring_rate(mi, mj, nx, ny, nz):
    """ḋ of one spring."""
    u, v = mi["vx"], mj["vx"]
    return nx * (v[0] - u[0]) + ny * (v[1] - u[1]) + nz * (v[2] - u[2])


@kernel
def spring_force(spring, mi, mj, d, nx, ny, nz):
    """Attraction of one spring–damper, N."""
    f = spring["k"] * (d - spring["d0"])
    if spring["c"] != 0.0:
        f += spring["c"] * spring_rate(mi, mj, nx, ny, nz)
    return f


@kernel
def spring_energy(springs, markers):
    """Energy stored in all springs, J."""
    e = 0.0
    if springs is not None:
        for k in range(springs.shape[0]):
            d, _, _, _ = direction(markers[springs[k]["I"]], markers[springs[k]["J"]])
            e += 0.5 * springs[k]["k"] * (d - springs[k]["d0"]) ** 2
    return e


@kernel
def damper_power(springs, markers):
    """Power of all dampers on the system (never positive), W."""
    p = 0.0
    if springs is not None:
        for k in range(springs.shape[0]):
            mi, mj = markers[springs[k]["I"]], markers[springs[k]["J"]]
            _, nx, ny, nz = direction(mi, mj)
            p -= springs[k]["c"] * spring_rate(mi, mj, nx, ny, nz) ** 2
    return p


@kernel
def load_vector(load, markers, fun):
    """Force or torque of one load, global axes."""
    f = load["fun"]
    x, y, z = fun[f[0], 0], fun[f[1], 0], fun[f[2], 0]
    if load["follower"] == 1:
        return transform(markers[load["marker"]]["R"], x, y, z)
    return x, y, z


@kernel
def add_load_wrenches(loads, markers, fun):
    """Add all forces and torques to the wrenches of their markers."""
    for k in range(loads.shape[0]):
        W, o = markers[loads[k]["marker"]]["W"], 3 * loads[k]["torque"]
        x, y, z = load_vector(loads[k], markers, fun)
        W[o] += x
        W[o + 1] += y
        W[o + 2] += z


@kernel
def load_power(loads, markers, fun):
    """Power of all forces and torques on the system, W."""
    p = 0.0
    for k in range(loads.shape[0]):
        mn = markers[loads[k]["marker"]]
        x, y, z = load_vector(loads[k], markers, fun)
        u = mn["om"] if loads[k]["torque"] == 1 else mn["vx"]
        p += x * u[0] + y * u[1] + z * u[2]
    return p


@kernel
def add_load_tangent(load, markers, fun, H):
    """Add minus the change of a follower load with its marker's rotation to H (12, 12)."""
    if load["follower"] == 1:
        x, y, z = load_vector(load, markers, fun)
        # δF = δφ × F, so −∂F/∂φ = F~
        add_skew(H, 3 * load["torque"], 3, 1.0, x, y, z)


@kernel
def add_spring_tangent(spring, mi, mj, cv, cp, H):
    """Add −(cp ∂w/∂position + cv ∂w/∂velocity) of one spring–damper to H (12, 12)."""
    d, nx, ny, nz = direction(mi, mj)
    r = spring_rate(mi, mj, nx, ny, nz)
    f = spring_force(spring, mi, mj, d, nx, ny, nz)
    n = (nx, ny, nz)
    along = cp * spring["k"] + cv * spring["c"]
    for a in range(3):
        for b in range(3):
            across = (1.0 if a == b else 0.0) - n[a] * n[b]
            # ∂ḋ/∂h = (u − ḋ n)/d
            slope = (mj["vx"][b] - mi["vx"][b] - r * n[b]) / d
            e = along * n[a] * n[b] + cp * (f * across / d + spring["c"] * n[a] * slope)
            H[a, b] += e
            H[6 + a, 6 + b] += e
            H[a, 6 + b] -= e
            H[6 + a, b] -= e
