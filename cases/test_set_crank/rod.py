"""The connecting rod of the IVP test set's slider-crank as arrays, into rod.flexbody.h5.

Two sine modes of bending, q1 and q2, and a quadratic bar element of stretch, q3 of its middle and
q4 of its end; the body frame lies at the crank pin, x through both pins. Matrices as printed by
Simeon: the block of the bar in the mass matrix lacks the factor 1/15 of such an element, which
lowers its frequencies from 26.5 and 95.3 to 6.8 and 24.6 krad/s. The stored reference has it so.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexmb.flexbody import FlexBody, Interface, Surface, save

LENGTH, WIDTH = 0.3, 0.008  # m
YOUNG, DENSITY, MASS, J = 2e11, 7870.0, 0.151104, 0.0045339259  # J about the pin
PI = 3.1415927  # as printed
AREA = WIDTH**2
SECTIONS = 25  # that are drawn


def shapes(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement along x and y, and rotation about z, of the line: (n, 4) each."""
    s, zero = x / LENGTH, 0 * x
    k = np.array([1, 2]) * np.pi
    along = np.stack([zero, zero, 4 * s * (1 - s), s * (2 * s - 1)], axis=1)
    across = np.hstack([np.sin(np.outer(s, k)), np.zeros((len(x), 2))])
    turn = np.hstack([k / LENGTH * np.cos(np.outer(s, k)), np.zeros((len(x), 2))])
    return along, across, turn


def point(name: str, x: float) -> Interface:
    """An interface on the line."""
    along, across, turn = shapes(np.array([x]))
    zero = 0 * turn
    return Interface(
        name, [x, 0, 0], np.vstack([along, across, zero]), np.vstack([zero, zero, turn])
    )


def surface() -> Surface:
    """The square bar: four corners of each section, and how they move."""
    x = np.repeat(np.linspace(0, LENGTH, SECTIONS), 4)
    y, z = (np.tile(np.array(c) * WIDTH / 2, SECTIONS) for c in ([-1, 1, 1, -1], [-1, -1, 1, 1]))
    along, across, turn = shapes(x)
    modes = np.stack([along - y[:, None] * turn, across, 0 * across], axis=1)
    corner = np.arange(4 * (SECTIONS - 1))
    beside = corner - corner % 4 + (corner + 1) % 4
    faces = np.vstack([
        np.stack([corner, beside, beside + 4], axis=1),
        np.stack([corner, beside + 4, corner + 4], axis=1),
        [[0, 1, 2], [0, 2, 3]], len(x) - 1 - np.array([[0, 1, 2], [0, 2, 3]]),
    ])  # fmt: skip
    points = np.stack([x, y, z], axis=1)
    return Surface(points, faces, np.zeros((0, 2), int), modes, np.repeat(np.arange(SECTIONS), 4))


def rod() -> FlexBody:
    """Integrals of the inertia, and stiffness."""
    bar = DENSITY * AREA * LENGTH
    p, P, M = np.zeros((3, 4)), np.zeros((3, 3, 4)), np.zeros((3, 3, 4, 4))
    p[0, 2:], p[1, 0] = [2 / 3, 1 / 6], 2 / PI
    P[0, 0, 2:], P[0, 1, :2] = [1 / 3, 1 / 6], [1 / PI, -1 / (2 * PI)]
    M[0, 0, 2:, 2:] = [[8, 1], [1, 2]]  # over 15, were it a quadratic element
    M[1, 1, :2, :2] = np.eye(2) / 2
    M[0, 1, 2:, :2] = [[16 / PI**3, 0], [1 / PI - 8 / PI**3, -1 / (2 * PI)]]
    M[1, 0] = M[0, 1].T
    K = np.zeros((4, 4))
    K[:2, :2] = np.diag([PI**4 / 24, PI**4 * 2 / 3]) * (WIDTH / LENGTH) ** 2
    K[2:, 2:] = np.array([[16, -8], [-8, 7]]) / 3
    return FlexBody(
        "rod", MASS, np.array([MASS * LENGTH / 2, 0, 0]), np.diag([J, 0, bar * WIDTH**2 / 12]),
        bar * p, bar * LENGTH * P, bar * M, YOUNG * AREA / LENGTH * K,
        interfaces=(point("crank", 0), point("middle", LENGTH / 2), point("slider", LENGTH)),
        surface=surface(),
    )  # fmt: skip


if __name__ == "__main__":
    print("written:", save(rod(), Path(__file__).with_name("rod.flexbody.h5")))
