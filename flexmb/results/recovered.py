"""Stress and section forces of flexible bodies along a run, from modal coordinates.

In: the modal coordinates of a result and the files of its flexible bodies. Out: stress, von Mises
stress and section forces at a time or at all output times, and peaks over the run, in the scene's
units. Components are superposed first; the von Mises stress is taken of their sum.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import Problem, ResultFileError, nearest
from flexmb.flexbody import FlexBody, SectionForceModes, StressModes, load, von_mises
from flexmb.results.pose import locate
from flexmb.results.stored import Stored

__all__ = ["PeakStress", "Recovered", "SectionForces", "Stress"]

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_CHUNK = 6.4e7  # bytes of stress components at once
_MOST = 2e9  # bytes of an answer that still fit into most machines


class Stress(NamedTuple):
    """Stress at places of a body, in the scene's units."""

    values: Array  # (k, 6) or (n, k, 6) components in STRESS, body axes; von Mises: (k,) or (n, k)
    node: IntArray  # (k,) mesh node of each place
    layer: tuple[str, ...]  # (k,) such as "top"
    part: tuple[str, ...]  # (k,) mesh group of its section


class PeakStress(NamedTuple):
    """The largest von Mises stress at each place over a run, and when, in the scene's units."""

    values: Array  # (k,)
    time: Array  # (k,)
    node: IntArray  # (k,)
    layer: tuple[str, ...]
    part: tuple[str, ...]

    @property
    def place(self) -> int:
        """Row of the place with the largest stress of all."""
        return int(np.argmax(self.values))


class SectionForces(NamedTuple):
    """Section forces at both ends of beam elements, in the scene's units, local axes."""

    force: Array  # (b, 2, 3) or (n, b, 2, 3): N, Vy, Vz
    moment: Array  # the same of T, My, Mz
    elements: IntArray  # (b, 2) mesh nodes


class Recovered(Stored):
    """What follows from modal coordinates and the flexible bodies; see `Result`."""

    _bodies: dict[str, tuple[int, FlexBody]] | None = None

    def flexbody(self, name: str) -> FlexBody:
        """The flexible body of that name, from its file.

        Raises
        ------
        ResultFileError
            No such flexible body, or its file is not the one of this run.
        BodyFileError
            The file is missing or damaged.
        """
        if name not in self.flexbodies:
            names = tuple(self.flexbodies)
            what = f'the result has no flexible body "{name}"'
            raise ResultFileError.from_problems([Problem("", what, names, nearest(name, names))])
        path, m = self.flexbodies[name], self.layout.body(name).m
        stamp = path.stat().st_mtime_ns if path.exists() else 0
        self._bodies = self._bodies or {}
        if self._bodies.get(name, (None,))[0] != stamp:
            body = load(path)
            if body.m != m:
                raise ResultFileError(
                    f"{path}: has {body.m} modes, the run was made with {m}; "
                    "run the scene again, or bring back the flexible-body file of the run"
                )
            self._bodies[name] = (stamp, body)
        return self._bodies[name][1]

    def stress(
        self,
        body: str,
        time: float | None = None,
        *,
        node: int | None = None,
        layer: str | None = None,
    ) -> Stress:
        """Stress components of a flexible body, averaged at the nodes of each section.

        Parameters
        ----------
        body : str
            Name of the body.
        time : float, optional
            In the scene's units; all output times by default.
        node : int, optional
            Mesh node, from 0; all places by default.
        layer : str, optional
            Such as ``"top"``; all by default.

        Returns
        -------
        Stress
            ``values`` (k, 6) or (n, k, 6): xx yy zz yz zx xy in body axes.

        Raises
        ------
        ResultFileError
            No such body, node, layer or time, a body without stress, or an answer that does not fit
            into memory.
        """
        modes, rows = self._places(body, node, layer)
        eta = self._eta(body, time)
        self._fits(6 * len(rows) * math.prod(eta.shape[:-1]), body)
        return Stress(self.told(modes.at(eta, rows), "Pa"), *_labels(modes, rows))

    def von_mises(
        self,
        body: str,
        time: float | None = None,
        *,
        node: int | None = None,
        layer: str | None = None,
    ) -> Stress:
        """The von Mises stress of a flexible body; parameters and errors as for `stress`.

        Returns
        -------
        Stress
            ``values`` (k,) at a time, (n, k) over all output times.
        """
        modes, rows = self._places(body, node, layer)
        eta = self._eta(body, time)
        self._fits(len(rows) * math.prod(eta.shape[:-1]), body)
        values = np.empty((*eta.shape[:-1], len(rows)))
        for part in _batches(eta, len(rows)):
            values[part] = von_mises(modes.at(eta[part], rows))
        return Stress(self.told(values, "Pa"), *_labels(modes, rows))

    def peak_von_mises(self, body: str, *, layer: str | None = None) -> PeakStress:
        """The largest von Mises stress over the run at each place, and when.

        Parameters
        ----------
        body : str
            Name of the body.
        layer : str, optional
            Such as ``"top"``; all by default.

        Returns
        -------
        PeakStress
            Also `place`, the row of the largest of all.

        Raises
        ------
        ResultFileError
            No such body or layer, a body without stress, or a result without rows.
        """
        modes, rows = self._places(body, None, layer)
        eta = self._eta(body, None)
        peak, when = np.full(len(rows), -1.0), np.zeros(len(rows), dtype=int)
        for part in _batches(eta, len(rows)):
            values = von_mises(modes.at(eta[part], rows))
            best = values.argmax(axis=0)
            found = values[best, np.arange(len(rows))]
            larger = found > peak
            peak[larger], when[larger] = found[larger], best[larger] + (part.start or 0)
        return PeakStress(self.told(peak, "Pa"), self.time[when], *_labels(modes, rows))

    def section_forces(self, body: str, time: float | None = None) -> SectionForces:
        """Section forces of the beams of a flexible body at both ends of each element.

        Parameters
        ----------
        body : str
            Name of the body.
        time : float, optional
            In the scene's units; all output times by default.

        Raises
        ------
        ResultFileError
            No such body or time, or a body without beams.
        """
        modes = self._beams(body)
        values = modes.at(self._eta(body, time))
        force, moment = self.told(values[..., :3], "N"), self.told(values[..., 3:], "N m")
        return SectionForces(force, moment, modes.elements)

    def close(self) -> None:
        """Let go of the arrays and bodies read so far."""
        super().close()
        self._bodies = None

    def _eta(self, body: str, time: float | None) -> Array:
        """(n, m) modal coordinates at all output times, or (m,) at one."""
        columns = self.layout.body(body)
        start = columns.iq + 7
        eta = self.part("q", slice(start, start + columns.m))
        if time is None and len(eta):
            return eta
        i, s = locate(self.time, time or 0.0, self.path, self.units.label("s"))
        return np.asarray((1.0 - s) * eta[i] + s * eta[min(i + 1, len(eta) - 1)])

    def _places(
        self, body: str, node: int | None, layer: str | None
    ) -> tuple[StressModes, IntArray]:
        modes = self.flexbody(body).stress
        if modes is None:
            what = (
                f'{self.flexbodies[body]}: holds no stress; reduce the mesh with stress = "surface"'
            )
            raise ResultFileError(what)
        if layer is not None and layer not in modes.layers:
            what = f'the body "{body}" has no stress in a layer "{layer}"'
            problem = Problem("", what, modes.layers, nearest(layer, modes.layers))
            raise ResultFileError.from_problems([problem])
        rows = modes.rows(node, layer)
        if not len(rows):
            where = f" in the layer {layer}" if layer is not None and node in modes.ids else ""
            what = f'the body "{body}" has no stress at node {node}{where}'
            raise ResultFileError(f"{what}; it tells it at {len(np.unique(modes.ids))} nodes")
        return modes, rows

    def _beams(self, body: str) -> SectionForceModes:
        modes = self.flexbody(body).section_forces
        if modes is None:
            raise ResultFileError(f"{self.flexbodies[body]}: holds no section forces of beams")
        return modes

    def _fits(self, numbers: float, body: str) -> None:
        if 8 * numbers > _MOST:
            what = f'the stress of "{body}" at all places and times takes {8e-9 * numbers:.3g} GB'
            raise ResultFileError(f"{what}: give a time, a node or a layer, or ask for the peaks")


def _labels(
    modes: StressModes, rows: IntArray
) -> tuple[IntArray, tuple[str, ...], tuple[str, ...]]:
    layer = tuple(modes.layers[i] for i in modes.layer[rows])
    return modes.ids[rows], layer, tuple(modes.parts[i] for i in modes.part[rows])


def _batches(eta: Array, places: int) -> list[slice]:
    """Rows of eta (n, m) in batches whose stress fits into memory; all of eta (m,)."""
    if eta.ndim == 1:
        return [slice(None)]
    size = max(1, int(_CHUNK / (48 * max(places, 1))))
    return [slice(start, start + size) for start in range(0, len(eta), size)]
