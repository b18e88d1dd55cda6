"""``deformation = "automatic"``: the frequency band of dynamic modes, from the motion of the scene.

In: a scene, and its run with rigid bodies. Out: the scene with the band instead of the word. The
frequencies are those of drivers and loads (`model.excitation`), and of the inertia forces in that
run, since springs, gears, contacts and spins move bodies faster than the drivers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from flexmb.errors import FlexmbError
from flexmb.flexbody.arrays import Array
from flexmb.model.excitation import BAND_FACTOR, cutoff_frequency
from flexmb.model.flexible_body import DeformationSpec, FlexibleBodySpec
from flexmb.model.scenes.effects import with_words

if TYPE_CHECKING:
    from flexmb.model import Model
    from flexmb.results import Result


_OUTPUTS = 2000  # outputs of the run with rigid bodies
_ENERGY_ABOVE = 1e-3  # fraction of the energy of a motion that may be at frequencies above the band
_MIN_ACCELERATION = 1e-3  # accelerations below this fraction of the scene's largest are ignored
# a body that moves less than this fraction of the flexible bodies' size is at rest
_MIN_MOTION = 1e-9


def with_motion_band(model: Model, run: Callable[[Model], Result]) -> tuple[Model, list[str]]:
    """The model with the band of its "automatic" bodies, and a sentence on it.

    Parameters
    ----------
    model : Model
        With a section ``[dynamics]`` and "automatic" bodies.
    run : callable
        Runs a model.
    """
    specs = model.bodies.items()
    flexible = {name: spec for name, spec in specs if isinstance(spec, FlexibleBodySpec)}
    names = [name for name, spec in flexible.items() if spec.deformation == "automatic"]
    assert model.dynamics is not None
    rigid = with_words(model, dict.fromkeys(flexible, {"deformation": "rigid"}))
    rows = {"outputs": _OUTPUTS, "verify": False}
    rigid.dynamics = model.dynamics.model_copy(update=rows)
    try:
        gravity = np.array(model.gravity or (0.0, 0.0, 0.0))
        fastest = max(motion_frequencies(run(rigid), names, gravity), default=0.0)
    except FlexmbError:  # the scene can only move if bodies are flexible
        return model, []
    by_drivers = cutoff_frequency(model)
    cutoff = max(BAND_FACTOR * fastest, by_drivers if math.isfinite(by_drivers) else 0.0)
    if cutoff == 0.0:
        return model, []
    band = {"deformation": DeformationSpec(band=(0.0, cutoff))}
    what = "drivers and loads" if cutoff == by_drivers else "the motion with rigid bodies"
    note = (
        f'deformation = "automatic" of bodies.{", bodies.".join(names)}: modes up to {cutoff:.4g} '
        f"Hz vibrate, {BAND_FACTOR:g} times the frequency of {what}"
    )
    return with_words(model, dict.fromkeys(names, band)), [note]


def motion_frequencies(run: Result, names: Collection[str], gravity: Array) -> Iterator[float]:
    """Frequencies [Hz] of the inertia loads of these bodies of a run, and of the motion of all
    others.

    The loads are the accelerations minus gravity in axes of the body, and the angular and
    centrifugal accelerations; for other bodies the accelerations. The frequency of a load is that
    below which it has nearly all of its energy.
    """
    from flexmb.flexbody import load

    t = run.time * run.units.scale("s")
    q, v, vd = (run.part(name, slice(None)) for name in ("q", "v", "vd"))
    size = max(load(file).characteristic_length for file in run.flexbodies.values())
    loads: list[Array] = []  # m/s^2; angular ones are multiplied by the bodies' size
    for body in run.layout.bodies:
        place = q[:, body.iq : body.iq + 7] / np.repeat([size, 1.0], [3, 4])
        if np.ptp(place, axis=0).max() < _MIN_MOTION:
            continue
        a, spin = vd[:, body.iv : body.iv + 3], v[:, body.iv + 3 : body.iv + 6]
        if body.name in names:
            turn = Rotation.from_quat(np.roll(q[:, body.iq + 3 : body.iq + 7], -1, axis=1))
            a = turn.inv().apply(a - gravity)
            loads += [size * vd[:, body.iv + 3 : body.iv + 6], size * spin**2]
        loads.append(a)
    changes = [float(np.ptp(one, axis=0).max()) for one in loads]
    for one, change in zip(loads, changes, strict=True):
        if change > _MIN_ACCELERATION * max(changes):
            yield _frequency(t, one)


def _frequency(t: Array, c: Array) -> float:
    """Frequency below which c (n, k), minus the line through its ends, has nearly all of its
    energy."""
    line = c[:1] + (c[-1:] - c[:1]) * ((t - t[0]) / (t[-1] - t[0]))[:, None]
    energy = (np.abs(np.fft.rfft(c - line, axis=0)) ** 2).sum(axis=1)
    whole = np.cumsum(energy)
    if not whole[-1] > 0.0:
        return 0.0
    return float(np.searchsorted(whole, (1.0 - _ENERGY_ABOVE) * whole[-1]) / (t[-1] - t[0]))
