"""Rings of hinged links that move although they are overconstrained: Bricard, Bennett, Sarrus."""

from __future__ import annotations

import numpy as np
from mechanisms import Sketch, X, Y, Z


def ring(title, points, axes):
    """A closed ring of revolute joints at global points with global axes, one link on ground."""
    sketch = Sketch(title)
    n = len(points)
    for k in range(n - 1):
        sketch.body(f"link{k + 1}", (np.array(points[k]) + np.array(points[k + 1])) / 2)
    names = ["ground", *(f"link{k}" for k in range(1, n)), "ground"]
    for k in range(n):
        sketch.joint(f"hinge{k}", "revolute", names[k], names[k + 1], points[k], axis=axes[k])
    return sketch.model


def bricard():
    """Bricard's six-bar ring of 1 m links at right angles (IFToMM benchmark A04)."""
    points = [[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1]]
    return ring("Bricard's ring", points, [Y, Z, X, Y, Z, X])


def bennett(theta=1.1, alpha=0.5, beta=1.2, a=0.4, skewed=0.0):
    """Bennett's ring of four skew hinges; ``skewed`` [rad] turns one axis out of its place.

    Opposite links are equal, of lengths a, b and twists α, β with sin α / a = sin β / b; then
    tan θ1/2 tan θ2/2 = sin((β + α)/2) / sin((β − α)/2) (G. T. Bennett, Engineering 76, 1903, 777).
    """
    b = a * np.sin(beta) / np.sin(alpha)
    ratio = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
    second = 2 * np.arctan(ratio / np.tan(theta / 2))
    frame = np.eye(4)
    points, axes = [], []
    for angle, length, twist in (
        (theta, a, alpha), (second, b, beta), (-theta, a, alpha), (-second, b, beta),
    ):  # fmt: skip
        points.append(frame[:3, 3].copy())
        axes.append(frame[:3, 2].copy())
        frame = frame @ _hinge(angle, length, twist)
    np.testing.assert_allclose(frame, np.eye(4), atol=1e-12)
    axes[2] = np.cos(skewed) * axes[2] + np.sin(skewed) * np.cross(axes[2], points[2]) / (
        np.linalg.norm(np.cross(axes[2], points[2]))
    )
    return ring("Bennett's ring", points, axes)


def _hinge(angle, length, twist):
    """Denavit–Hartenberg transformation: turn about z, then length along x and twist about it."""
    c, s, d, e = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
    return np.array(
        [[c, -s * d, s * e, length * c], [s, c * d, -c * e, length * s], [0, e, d, 0], [0, 0, 0, 1]]
    )


def sarrus(height=0.6):
    """Sarrus' linkage: two hinged chains at right angles lift a plate without turning it.

    P. F. Sarrus, Comptes Rendus 36 (1853) 1036: six hinges, one freedom.
    """
    out = np.sqrt(0.5**2 - (height / 2) ** 2)
    points = [
        [1, 0, 0], [1 + out, 0, height / 2], [1, 0, height],
        [0, 1, height], [0, 1 + out, height / 2], [0, 1, 0],
    ]  # fmt: skip
    return ring("Sarrus' linkage", points, [Y, Y, Y, X, X, X])
