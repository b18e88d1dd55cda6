"""Rigid motions in words: translations, rotations about axes through points, screws."""

from __future__ import annotations

import numpy as np

from flexmb.flexbody.arrays import FloatArray

_AXES = "xyz"


def motions_in_words(N: FloatArray, center: FloatArray, size: float) -> list[str]:
    """Sentences for rigid motions (6, r) about the centre of mass: translations and rotations.

    Parameters
    ----------
    N : (6, r) float
        Independent translations [m] and rotations [rad].
    center : (3,) float
        Centre of mass [m].
    size : float
        Of the part [m].
    """
    rows = (N * np.array([1.0] * 3 + [size] * 3)[:, None]).T[:, [3, 4, 5, 0, 1, 2]]
    words = []
    for row in _echelon(rows):
        w, t = row[:3], row[3:]
        if np.abs(w).max() < 1e-6 * np.abs(t).max():
            words.append(f"translation along {_direction(t)}")
            continue
        w = w / size
        rate = float(np.linalg.norm(w))
        point = center + np.cross(w, t) / rate**2
        pitch = float(w @ t) / rate**2
        point[np.abs(point) < 1e-9 * size] = 0.0
        place = ", ".join(f"{x:.4g}" for x in point)
        screw = f", sliding {pitch:.3g} m along it per rad" if abs(pitch) > 1e-6 * size else ""
        words.append(f"rotation about {_direction(w)} through ({place}) m{screw}")
    return words


def _echelon(rows: FloatArray) -> FloatArray:
    """Reduced row echelon form with pivots of largest size."""
    rows, at = rows.copy(), 0
    for column in range(rows.shape[1]):
        if at == len(rows):
            break
        pivot = at + int(np.abs(rows[at:, column]).argmax())
        if abs(rows[pivot, column]) < 1e-6:
            rows[at:, column] = 0.0
            continue
        rows[[at, pivot]] = rows[[pivot, at]]
        rows[at] /= rows[at, column]
        others = np.arange(len(rows)) != at
        rows[others] -= np.outer(rows[others, column], rows[at])
        at += 1
    rows[np.abs(rows) < 1e-9] = 0.0
    return rows


def _direction(vector: FloatArray) -> str:
    unit = vector / np.linalg.norm(vector)
    unit *= np.sign(unit[np.abs(unit).argmax()])
    axis = int(np.abs(unit).argmax())
    if np.abs(np.delete(unit, axis)).max() < 1e-6:
        return _AXES[axis]
    return "(" + ", ".join(f"{x:.4g}" for x in unit) + ")"
