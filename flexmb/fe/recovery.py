"""What a body keeps for the recovery of stress: at its nodes, of its beams and shells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.shell_resultants import shell_force_modes
from flexmb.fe.stress import section_force_modes, stress_modes, stress_option
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.stress_modes import OmittedStress, SectionForceModes
from flexmb.progress import Progress, silent


def with_recovery(
    body: FlexBody,
    fe: FEMatrices,
    Phi: FloatArray,
    stress: bool | str = True,
    progress: Progress = silent,
    omitted: FloatArray | None = None,
) -> FlexBody:
    """The body with its stress, the section forces of its beams and the resultants of its shells.

    Parameters
    ----------
    body : FlexBody
        With a surface: its nodes are those of ``"surface"``.
    fe, Phi
        The model and its modes (n, m).
    stress : bool or str
        ``"surface"`` (or True): at the nodes of the skin, where stress is largest; ``"all"``: also
        at the nodes inside solids; ``"none"`` (or False): neither stress nor section forces.
    progress : Progress
        Called with the phase ``"stress"``.
    omitted : (n, 12) float, optional
        What the modes lack of the static responses to the body's inertia loads.

    Raises
    ------
    ReductionError
        An unknown option.
    """
    where = stress_option(stress)
    if where == "none":
        return body
    m = Phi.shape[1]
    U = Phi if omitted is None else np.concatenate([Phi, omitted], axis=1)
    skin = None if where == "all" or body.surface is None else np.unique(body.surface.node_ids)
    beams, stresses = section_force_modes(fe, U), stress_modes(fe, U, skin, progress)
    shells = shell_force_modes(fe, U, skin)
    lines = len(beams.nodes) > 0
    forces = SectionForceModes(beams.nodes, beams.axes, beams.ends[..., :m]) if lines else None
    rest = None
    if omitted is not None:
        rest = OmittedStress(
            None if stresses is None else stresses.modes[..., m:],
            beams.ends[..., m:] if lines else None,
            None if shells is None else shells.modes[..., m:],
        )
    return replace(
        body,
        stress=None if stresses is None else replace(stresses, modes=stresses.modes[..., :m]),
        shell_forces=None if shells is None else replace(shells, modes=shells.modes[..., :m]),
        section_forces=forces,
        omitted_stress=rest,
    )
