"""Forces and torques in the axes of any marker, and with their opposite on another body.

A force F at marker J with its opposite on the body of marker I, at the same point: the wrench on I
is (−F, −h × F), h = x_J − x_I, so that the two have no moment. A torque likewise.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.rotation import cross, transform
from flexmb.engine.kernels.bodies.inertia_tangent import add_skew
from flexmb.engine.kernels.joints.dots import separation


@kernel
def vector(load, markers, fun):
    """Force or torque on its marker, global axes."""
    f = load["fun"]
    x, y, z = fun[f[0], 0], fun[f[1], 0], fun[f[2], 0]
    if load["axes"] >= 0:
        return transform(markers[load["axes"]]["R"], x, y, z)
    return x, y, z


@kernel
def add_wrenches(load, markers, fun, sign, wi, wj):
    """Add sign times the wrenches to wj of its marker and wi of the other one."""
    x, y, z = vector(load, markers, fun)
    add_vector(load, markers, sign * x, sign * y, sign * z, wi, wj)


@kernel
def add_vector(load, markers, x, y, z, wi, wj):
    """The same of a given force or torque (x, y, z) on its marker."""
    o = 3 * load["torque"]
    wj[o] += x
    wj[o + 1] += y
    wj[o + 2] += z
    if load["other"] < 0:
        return
    if load["torque"] == 0:
        wi[0] -= x
        wi[1] -= y
        wi[2] -= z
        hx, hy, hz = separation(markers[load["other"]], markers[load["marker"]])
        x, y, z = cross(hx, hy, hz, x, y, z)
    wi[3] -= x
    wi[4] -= y
    wi[5] -= z


@kernel
def power(load, markers, fun):
    """Power of both, W."""
    x, y, z = vector(load, markers, fun)
    mj = markers[load["marker"]]
    u = mj["om"] if load["torque"] == 1 else mj["vx"]
    p = x * u[0] + y * u[1] + z * u[2]
    if load["other"] >= 0:
        mi = markers[load["other"]]
        if load["torque"] == 0:
            u = mi["vx"]
            p -= x * u[0] + y * u[1] + z * u[2]
            hx, hy, hz = separation(mi, mj)
            x, y, z = cross(hx, hy, hz, x, y, z)
        u = mi["om"]
        p -= x * u[0] + y * u[1] + z * u[2]
    return p


@kernel
def add_arm_tangent(load, markers, fun, H):
    """Add minus the change of the wrench on I with h to H (12, 12) of (I, J)."""
    if load["torque"] == 0:
        x, y, z = vector(load, markers, fun)
        add_skew(H, 3, 6, -1.0, x, y, z)
        add_skew(H, 3, 0, 1.0, x, y, z)


@kernel
def add_turn_of_marker(load, markers, fun, H):
    """Add minus the change of the wrench on J, rows 0 to 6, with the turn of `axes`, at 9."""
    x, y, z = vector(load, markers, fun)
    add_skew(H, 3 * load["torque"], 9, 1.0, x, y, z)


@kernel
def add_turn_of_other(load, markers, fun, H):
    """Add minus the change of the wrench on I, rows 0 to 6, with the turn of `axes`, at 9."""
    x, y, z = vector(load, markers, fun)
    add_skew(H, 3 * load["torque"], 9, -1.0, x, y, z)
    if load["torque"] == 0:
        hx, hy, hz = separation(markers[load["other"]], markers[load["marker"]])
        # −h̃ F̃ = (h·F) I − F hᵀ
        dot = hx * x + hy * y + hz * z
        for k in range(3):
            h = hx if k == 0 else hy if k == 1 else hz
            H[3 + k, 9 + k] += dot
            H[3, 9 + k] -= x * h
            H[4, 9 + k] -= y * h
            H[5, 9 + k] -= z * h
