"""A square plate, clamped to a hub that turns about its normal, by Ritz' method.

Kirchhoff's plate with the membrane stress of the centrifugal load rho W^2 (R + x, y), which plane
stress gives first: the model of Yoo and Kim (2002), International Journal for Numerical Methods in
Engineering 55, 785. Deflections are along the axis, so rotation only stiffens. Lengths in units of
the side a, frequencies in units of sqrt(D/(rho h a^4)); products of Legendre polynomials, times x^2
for the deflection and x in the plane. Prints `linear_mode=...,eta=...,delta=... value`.
"""

import numpy as np
from numpy.polynomial import Legendre

NU, COUNT = 0.3, 12
RATE = 0.01 * np.sqrt(70e9 / (12 * 2700 * (1 - NU**2)))  # rad/s
RIGIDITY = 70e9 * 0.01**3 / (12 * (1 - NU**2))  # N m

nodes, weights = np.polynomial.legendre.leggauss(2 * COUNT + 6)
S = (nodes + 1) / 2
X, Y = (a.ravel() for a in np.meshgrid(S, S - 0.5, indexing="ij"))
W = np.outer(weights, weights).ravel() / 4


def shapes(power, x, y):
    """x^power P_i(x) P_j(y), and its derivatives by x, y, xx, yy, xy: (6, COUNT^2, points)."""

    def line(z, d):
        return np.array([2.0**d * Legendre.basis(k).deriv(d)(z) for k in range(COUNT)])

    p = [line(2 * x - 1, d) for d in range(3)]
    q = [line(2 * y, d) for d in range(3)]
    f = x**power
    f1 = power * x ** (power - 1)
    f2 = power * (power - 1) * np.ones_like(x)
    x0, x1, x2 = f * p[0], f1 * p[0] + f * p[1], f2 * p[0] + 2 * f1 * p[1] + f * p[2]
    pairs = (x0, q[0]), (x1, q[0]), (x0, q[1]), (x2, q[0]), (x0, q[2]), (x1, q[1])
    return np.array([np.einsum("ip,jp->ijp", a, b).reshape(COUNT**2, -1) for a, b in pairs])


def product(a, b, weight=1.0):
    return (a * (W * weight)) @ b.T


def membrane(delta):
    """Nx, Ny, Nxy of unit speed, over rho h W^2 a^2."""
    f, fx, fy = shapes(1, X, Y)[:3]
    shear = (1 - NU) / 2
    coupling = NU * product(fx, fy) + shear * product(fy, fx)
    K = np.block([
        [product(fx, fx) + shear * product(fy, fy), coupling],
        [coupling.T, product(fy, fy) + shear * product(fx, fx)],
    ])  # fmt: skip
    load = np.concatenate([f @ (W * (delta + X)), f @ (W * Y)])
    u, v = np.split(np.linalg.solve(K, load), 2)
    ex, ey, exy = u @ fx, v @ fy, u @ fy + v @ fx
    return ex + NU * ey, ey + NU * ex, shear * exy


F, FX, FY, FXX, FYY, FXY = shapes(2, X, Y)
MASS = product(F, F)
BEND = (product(FXX, FXX) + product(FYY, FYY) + NU * (product(FXX, FYY) + product(FYY, FXX))
        + 2 * (1 - NU) * product(FXY, FXY))  # fmt: skip
BASIS = np.linalg.inv(np.linalg.cholesky(MASS))


def stiffness(eta, delta):
    """For unit mass, rigidity and side."""
    Nx, Ny, Nxy = membrane(delta)
    stress = product(FX, FX, Nx) + product(FY, FY, Ny)
    stress += product(FX, FY, Nxy) + product(FY, FX, Nxy)
    return BASIS @ (BEND + eta**2 * stress) @ BASIS.T


if __name__ == "__main__":
    for eta, delta in ((0, 0), (2, 0), (5, 0), (10, 0), (5, 1)):
        values = np.sqrt(np.linalg.eigvalsh(stiffness(eta, delta))[:5])
        for mode, value in enumerate(values, start=1):
            hertz = value * RATE / (2 * np.pi)
            print(f"linear_mode={mode},eta={eta},delta={delta},force=0 {hertz:.6f}")
    corner = BASIS @ shapes(2, np.ones(1), np.full(1, 0.5))[0, :, 0]
    deflection = corner @ np.linalg.solve(stiffness(5, 0), corner)
    print(f"corner.z 0.05 {200 / RIGIDITY * deflection:.9f}")
