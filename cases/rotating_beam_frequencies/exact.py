"""A cantilever on a hub that turns steadily: frequencies and static deflections by Ritz' method.

Slender, without shear and rotary inertia. In units of L, rhoA and EI, with W the speed, delta the
radius of the hub, T = W^2 (delta (1 - x) + (1 - x^2)/2) the tension, alpha^2 = A L^2/I:

    flapwise    w'''' - (T w')' + w_tt = 0
    chordwise   v'''' - (T v')' + v_tt - W^2 v + 2 W s_t = 0
    stretch     -alpha^2 s'' + s_tt - W^2 s - 2 W v_t = 0

Yoo and Shin (1998), Vibration analysis of rotating cantilever beams, Journal of Sound and Vibration
212, 807. The flapwise frequencies agree with tests/references/geometric_stiffening.json.
"""

import numpy as np

ALPHA = 100 * np.sqrt(12)  # square section, a hundredth of the length
RATE = np.sqrt(210e9 / 7850) * 0.01 / np.sqrt(12)  # sqrt(EI/(rhoA L^4)), rad/s
COUNT = 12  # shape functions

nodes, weights = np.polynomial.legendre.leggauss(40)
x, w = (nodes + 1) / 2, weights / 2


def shapes(first):
    """Orthonormal polynomials with a factor x^first: values, two derivatives, values at 1."""
    legendre = [np.polynomial.Legendre.basis(k) for k in range(COUNT)]

    def at(points):
        z = 2 * points - 1
        p = np.array([f(z) for f in legendre])
        d = np.array([2 * f.deriv()(z) for f in legendre])
        dd = np.array([4 * f.deriv(2)(z) for f in legendre])
        f, f1, f2 = points**first, first * points ** (first - 1), (first - 1) * first
        return f * p, f1 * p + f * d, f2 * p + 2 * f1 * d + f * dd

    values = at(x)
    basis = np.linalg.inv(np.linalg.cholesky((values[0] * w) @ values[0].T))
    return [basis @ v for v in values], basis @ at(np.ones(1))[0][:, 0]


BEND, TIP = shapes(2)
STRETCH, _ = shapes(1)
K = (BEND[2] * w) @ BEND[2].T
COUPLING = (STRETCH[0] * w) @ BEND[0].T
K_STRETCH = ALPHA**2 * (STRETCH[1] * w) @ STRETCH[1].T


def tension(delta):
    """Geometric stiffness at unit speed."""
    return (BEND[1] * w * (delta * (1 - x) + (1 - x**2) / 2)) @ BEND[1].T


def flapwise(eta, delta):
    """Frequencies over RATE."""
    return np.sqrt(np.linalg.eigvalsh(K + eta**2 * tension(delta)))


def chordwise(eta, delta):
    """Frequencies over RATE, of the gyroscopic problem."""
    eye, zero = np.eye(COUNT), np.zeros((COUNT, COUNT))
    bending = K + eta**2 * (tension(delta) - eye)
    stiffness = np.block([[bending, zero], [zero, K_STRETCH - eta**2 * eye]])
    gyroscopic = 2 * eta * np.block([[zero, COUPLING.T], [-COUPLING, zero]])
    n = 2 * COUNT
    system = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -gyroscopic]])
    values = np.linalg.eigvals(system).imag
    return np.sort(values[values > 1e-6])


def deflection(eta, delta, chord):
    """Of the tip by a unit force there, across the plane of rotation or in it, over L^3/EI."""
    return TIP @ np.linalg.solve(K + eta**2 * (tension(delta) - chord * np.eye(COUNT)), TIP)


if __name__ == "__main__":
    for eta, delta in ((2, 0), (5, 0), (12, 0), (2, 1), (5, 1), (12, 1), (5, 5)):
        flap, lag = flapwise(eta, delta), chordwise(eta, delta)
        for mode, value in enumerate((lag[0], flap[0], lag[1], flap[1]), start=1):
            hertz = value * RATE / (2 * np.pi)
            print(f"linear_mode={mode},eta={eta},delta={delta},force=0 {hertz:.8f}")
    over = 210e9 * 0.01**4 / 12  # EI
    for sensor, chord in (("tip.y", 1), ("tip.z", 0)):
        print(f"{sensor} 0.1 {10 / over * deflection(5, 1, chord):.10f}")
