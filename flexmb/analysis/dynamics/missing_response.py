"""What the modes of a flexible body cannot answer of the loads that act on it in a run.

A body that turns and accelerates loads itself; the share of its response that its modes lack is the
strain energy of that share over all of it (:class:`flexmb.flexbody.InertiaResponse`), its root,
since stress and displacement go with it. What moves less than a tenth of a millionth of the body's
length is not worth a word. The motion is that of the frame of the body's joints: vibrations move
the mean axes too, but load a body otherwise. Compared are the largest values of the run so far.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from flexmb.analysis.dynamics.linear_elasticity import flexible_columns, joined_frame
from flexmb.analysis.monitors import Indicator
from flexmb.engine.compile import Compiled
from flexmb.flexbody import InertiaResponse
from flexmb.model.model import Model
from flexmb.results import OutputBlock

Array = NDArray[np.float64]

#: Share of the response to inertia loads that may be missing without a word.
LARGEST_SHARE = 0.1
_WINDOW = 3  # rows in each of which as much must be missing: no jolt, no vibration
_SETTLED = 0.1  # share of a run before which little can be said of the whole of it
_LEAST_MOTION = 1e-7  # displacement over the body's length: what moves less does not matter


class InertiaLoadMonitor:
    """The share of the response to its own inertia that the modes of each body lack.

    Parameters
    ----------
    compiled, model : Compiled, Model
        What is run.
    """

    def __init__(self, compiled: Compiled, model: Model) -> None:
        self._units = model.units
        self._gravity = np.array(model.gravity or (0.0, 0.0, 0.0))
        self._bodies = [
            (columns, body, body.inertia_response, joined_frame(body, columns.name, model))
            for columns, body in flexible_columns(compiled)
            if body.inertia_response is not None
        ]
        n = len(self._bodies)
        self._whole = np.zeros(n)  # largest strain energy so far, of the response too, twice
        self._last = np.zeros((_WINDOW - 1, n))  # what was missing in the last rows
        self._largest = np.zeros((3, n))  # what was missing most, its time and angular velocity
        self._now, self._begin = np.zeros(1), np.full(1, np.nan)
        self._settled = _SETTLED * model.dynamics.duration if model.dynamics else 0.0

    def add(self, rows: OutputBlock) -> None:
        """Take the next rows."""
        self._begin[:] = np.where(np.isnan(self._begin), rows.t[0], self._begin)
        self._now[:] = rows.t[-1]
        for k, (columns, body, response, frame) in enumerate(self._bodies):
            iq, iv, m = columns.iq, columns.iv, columns.m
            eta = rows.q[:, iq + 7 : iq + 7 + m]
            strain = np.einsum("ti,ij,tj->t", eta, body.K, eta).max()
            rate, further = rows.v[:, iv + 6 : iv + 6 + m], rows.vd[:, iv + 6 : iv + 6 + m]
            alpha = rows.vd[:, iv + 3 : iv + 6] + further @ frame.turn.T
            omega = rows.v[:, iv + 3 : iv + 6] + rate @ frame.turn.T
            a = in_body_axes(rows.q[:, iq + 3 : iq + 7], rows.vd[:, iv : iv + 3] - self._gravity)
            a = a + np.cross(rows.vd[:, iv + 3 : iv + 6], body.center)
            a = a + np.cross(omega, np.cross(omega, body.center))
            a = a + further @ frame.at(body.center[None])[0].T
            c = InertiaResponse.factors(a, alpha, omega)
            full, missing, motion = (
                np.einsum("ti,ij,tj->t", c, form, c).clip(0.0)
                for form in (response.energy, response.missing, response.motion)
            )
            least = (_LEAST_MOTION * body.characteristic_length) ** 2 * body.mass
            self._whole[k] = max(self._whole[k], strain, full.max())
            missing = np.where(motion > least, missing, 0.0)
            missing = np.concatenate([self._last[:, k], missing])
            self._last[:, k] = missing[len(missing) - _WINDOW + 1 :]
            missing = sliding_window_view(missing, _WINDOW).min(axis=1)
            row = int(missing.argmax())
            if missing[row] > self._largest[0, k]:
                self._largest[:, k] = missing[row], rows.t[row], np.linalg.norm(omega[row])

    def indicators(self) -> Iterator[Indicator]:
        """The share of each body."""
        for k, (columns, *_) in enumerate(self._bodies):
            missing, t, speed = self._largest[:, k]
            early = self._now[0] - self._begin[0] < self._settled
            share = 0.0 if early or not missing else float(np.sqrt(missing / self._whole[k]))
            text = partial(self._sentence, columns.name, share, t, speed)
            yield Indicator(columns.name, "inertia_loads", share, t, LARGEST_SHARE, text)

    def _sentence(self, name: str, share: float, t: float, speed: float) -> str:
        return (
            f"bodies.{name}: its modes lack {100 * min(share, 1.0):.3g} % of the response to its "
            f"own inertia at t = {self._units.say(t, 's', 4)}, where it turns with "
            f"{self._units.say(speed, 'rad/s', 3)}: stress and growth are too small; reduce it "
            'with residual = "inertia"'
        )


def in_body_axes(p: Array, vectors: Array) -> Array:
    """(t, 3) global vectors in the axes of a body with the Euler parameters p (t, 4)."""
    e0, e = p[:, :1], p[:, 1:]
    across = np.cross(e, vectors)
    return np.asarray(vectors + 2.0 * (np.cross(e, across) - e0 * across))
