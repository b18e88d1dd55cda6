"""Pictures of the modes of a whole machine: it is drawn displaced by each mode.

In: a `Linearization`. Out: one PNG file per mode, and the result file that it is drawn from, whose
rows go once through the vibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexmb.folders import writable_folder

if TYPE_CHECKING:
    from flexmb.analysis.linear.linearization import Linearization

_AMPLITUDE = 0.12  # of the model's size, or rad
_PHASES = 24  # rows of one vibration


def render_mode_shapes(
    made: Linearization, folder: str | Path, modes: Sequence[int] = (1, 2, 3, 4, 5, 6)
) -> list[Path]:
    """Draw a machine displaced by some of its modes.

    Parameters
    ----------
    made : Linearization
        The model.
    folder : path
        Gets `mode_1.png`, ... and `mode_1.h5`, ...
    modes : sequence of int
        Which, from 1; those that there are not are left out.

    Returns
    -------
    list of Path
        The pictures.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    from flexmb.flexbody import save
    from flexmb.results import OutputBlock, Result, ResultWriter
    from flexmb.view import render

    target, compiled = writable_folder(Path(folder)), made.compiled
    files = {name: f"{name}.flexbody.h5" for name in compiled.flexbodies}
    for name, body in compiled.flexbodies.items():
        save(body, target / files[name])
    scene = made.model.to_scene_dict(target, files)
    for section in ("check", "dynamics", "kinematics", "statics", "study", "results", "view"):
        scene.pop(section, None)
    layout, pictures = compiled.layout, []
    for k in modes:
        if not 1 <= k <= len(made.eigenvalues):
            continue
        title = made.model.title or "mode"
        scene["title"] = f"{title}: mode {k}, {made.frequencies[k - 1]:.4g} Hz"
        phases = 2.0 * np.pi * np.arange(_PHASES + 1) / _PHASES
        q = np.array([made.displaced(k - 1, _AMPLITUDE, phase) for phase in phases])
        n = len(phases)
        widths = {
            "v": layout.nv, "vd": layout.nv, "lam": layout.nc, "drift": 2,
            "reactions": 12 * len(layout.reactions), "sensors": len(layout.channels),
            "energy": len(layout.energies),
        }  # fmt: skip
        zeros = {name: np.zeros((n, width)) for name, width in widths.items()}
        rows = OutputBlock(t=phases / (2.0 * np.pi), q=q, **zeros)
        path = target / f"mode_{k}.h5"
        with ResultWriter(path, layout, n, scene=scene, flexbodies=files) as writer:
            writer.append(rows)
            writer.finish({}, "finished", "")
        picture = target / f"mode_{k}.png"
        pictures.append(render(Result(path), 0.0, exaggeration=1.0, output=picture))
    return pictures
