"""Whether the mass matrix stays positive as a body deforms.

M(η) = M₀ + M₁ + M₂, where M₁ is linear in η and M₂ quadratic. Partial coupling leaves out M₂, and
constant coupling both. M₁ changes only the inertia of the frame, by the displaced centre of mass
p η and by ∫ρ s uᵀ: a matrix (6, 6). With Q = Z Zᵀ (6, 6), Z the frame's part of motions of unit
mass that the joints leave free, the eigenvalues λ of Q M₁ are the changes of the mass of some
motion over its mass. M₀ + M₁ is not positive from λ = −1 on, and such a motion then gains energy
as it slows down. In mean axes that takes a deflection of the size of the body, or of its section if
it turns about its own axis. In a frame at an interface the frame turns with each vibration, against
the rest of the body, so that Q is large and λ reaches −1 by deflections far smaller.

Full coupling without stiffening is positive. Stiffening takes tr(k) I − k, k = ηᵀK^{ab}η, from the
inertia of the frame, as its mean rotation needs it; a frame at an interface lacks it also in its
vibrations, whose mass is smaller.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES
from flexmb.analysis.assembly.mechanism_modes import MechanismModes
from flexmb.analysis.linear.linearization import Linearization
from flexmb.analysis.linear.state_equations import StateEquations
from flexmb.analysis.monitors import Indicator
from flexmb.analysis.validity.linear_elasticity import (
    LARGEST_DEFLECTION,
    flexible_columns,
    joined_frame,
    largest_lengths,
    relative_motion,
)
from flexmb.analysis.validity.pose_vibrations import OmittedTerms
from flexmb.engine.compile import Compiled, compile_system
from flexmb.engine.tables import BodyColumns
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, skew
from flexmb.model.flexible_body import MEAN_AXIS, FlexibleBodySpec
from flexmb.model.markers import rotation_matrix
from flexmb.model.model import Model
from flexmb.model.scenes.effects import with_words
from flexmb.results.output_block import OutputBlock

_LOST = 1.0  # change over the mass at which the mass of a motion is lost


@dataclass(frozen=True, eq=False)
class _WatchedBody:
    """A body whose mass matrix may lose its sign."""

    columns: BodyColumns
    coupling: str
    interface: str | None  # at which its frame is fixed
    root: Array  # (6, 6) with root rootᵀ = Q
    change: Array  # (6, 6, m) M₁ per unit eta
    stiffening: Array | None  # (3, 3, m, m) K^{ab} of a body with full coupling
    deflection: Array  # (3 k, m) displacements of points per unit eta, over its length

    def changes(self, eta: Array) -> Array:
        """(t, 6, 6) changes of the inertia of the frame that may take its sign."""
        if self.stiffening is None:
            return np.asarray(np.einsum("abm,tm->tab", self.change, eta))
        k = np.einsum("abij,ti,tj->tab", self.stiffening, eta, eta)
        change = np.zeros((len(eta), 6, 6))
        change[:, 3:, 3:] = k - np.trace(k, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        return change

    def lossy_deflection(self, change: float, deflection: float) -> float:
        """Deflection over the length from which on a mass is lost, if one changes it so."""
        return float(deflection / change ** (1.0 if self.stiffening is None else 0.5))


class DeformedInertiaMonitor:
    """Evaluates the change of the mass of bodies whose inertia coupling is not full.

    Those with constant coupling are evaluated only in a frame at an interface, as those with full
    coupling and stiffening.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    q : (nq,) array
        First positions.
    """

    def __init__(self, compiled: Compiled, model: Model, q: Array) -> None:
        self._units, self._bodies = model.units, list[_WatchedBody]()
        motions = None
        for columns, body in flexible_columns(compiled):
            spec = model.bodies[columns.name]
            if not isinstance(spec, FlexibleBodySpec) or spec.deformation == "quasi-static":
                continue
            stiffening = body.centrifugal_stiffness if spec.inertia_coupling == "full" else None
            if spec.frame_interface is None and spec.inertia_coupling != "partial":
                continue
            if spec.inertia_coupling == "full" and stiffening is None:
                continue
            motions = _unit_motions(compiled, q) if motions is None else motions
            frame = motions[columns.iv : columns.iv + 6].copy()
            frame[:3] = rotation_matrix(q[columns.iq + 3 : columns.iq + 7]).T @ frame[:3]
            U, sizes, _ = np.linalg.svd(frame, full_matrices=False)
            root = U * sizes
            deflection, _ = relative_motion(body, joined_frame(body, columns.name, model))
            coupling, interface = spec.inertia_coupling, spec.frame_interface
            change = first_order_inertia(body)
            self._bodies.append(
                _WatchedBody(columns, coupling, interface, root, change, stiffening, deflection)
            )
        # change of the mass over the mass, its time, and the deflection over the length there
        self._largest = np.zeros((3, len(self._bodies)))

    def add(self, rows: OutputBlock) -> None:
        """Evaluate the next rows."""
        for k, one in enumerate(self._bodies if len(rows.t) else ()):
            first = one.columns.iq + 7
            eta = rows.q[:, first : first + one.columns.m]
            values = np.linalg.eigvalsh(one.root.T @ one.changes(eta) @ one.root)
            if not values.shape[1]:
                continue
            lost = np.abs(values).max(axis=1) if one.coupling == "constant" else -values[:, 0]
            row = int(lost.argmax())
            if lost[row] > self._largest[0, k]:
                deflection = largest_lengths(eta[row : row + 1], one.deflection)[0]
                largest = self._largest.copy()
                largest[:, k] = lost[row], rows.t[row], deflection
                self._largest = largest

    def indicators(self) -> Iterator[Indicator]:
        """The change of the mass of each body; constant coupling has no note of its own."""
        for k, one in enumerate(self._bodies):
            change, t, _ = self._largest[:, k]
            warning = np.inf if one.coupling == "constant" else _LOST
            text = partial(self._sentence, one, k)
            yield Indicator(one.columns.name, "inertia", float(change), float(t), warning, text)

    def diverging(self) -> str:
        """The sentence on a body whose mass is lost by small deflections or its frame, or ""."""
        for k, one in enumerate(self._bodies):
            change, _, deflection = self._largest[:, k]
            small = one.lossy_deflection(max(change, _LOST), deflection) < LARGEST_DEFLECTION
            if change > _LOST and (small or one.stiffening is not None):
                return self._sentence(one, k)
        return ""

    def making_energy(self) -> str:
        """The sentence on a body of constant coupling in a frame at an interface, or "".

        It is the cause where a run misses energy.
        """
        for k, one in enumerate(self._bodies):
            if one.interface is not None and one.stiffening is None:
                return self._sentence(one, k)
        return ""

    def _sentence(self, one: _WatchedBody, k: int) -> str:
        change, t, deflection = self._largest[:, k]
        where, at = f"bodies.{one.columns.name}", self._units.say(t, "s", 4)
        frame = "" if one.interface is None else f' in its frame at interface "{one.interface}"'
        cures = [] if one.coupling == "full" else ['inertia_coupling = "full"']
        cures += [] if one.interface is None else [f'frame = "{MEAN_AXIS}"']
        cure = "take " + ", or ".join(cures)
        if change <= _LOST:
            return f"{where}: {one.coupling} coupling{frame} does not keep energy; {cure}"
        from_on = f"a deflection of {one.lossy_deflection(change, deflection):.2g} of its length"
        what = "geometric stiffening" if one.coupling == "full" else "partial coupling"
        if one.coupling == "constant":
            return (
                f"{where}: constant coupling{frame} leaves out changes of its mass that are larger "
                f"than the mass from {from_on} on (t = {at}), and makes energy; {cure}"
            )
        return (
            f"{where}: the mass matrix of {what}{frame} is not positive from {from_on} "
            f"on (t = {at}), and the equations diverge; {cure}"
        )


def omitted_coupling(made: Linearization, names: Sequence[str]) -> Iterator[OmittedTerms]:
    """The inertia coupling that these bodies leave out, with the motion and loads of the state."""
    words = {name: {"inertia_coupling": "full"} for name in names}
    own, full = (
        StateEquations(
            compile_system(with_words(made.model, one), made.compiled.flexbodies), made.state
        ).tangents()
        for one in ({}, words)
    )
    for columns in made.compiled.layout.bodies:
        part = slice(columns.iv, columns.iv + 6 + columns.m)
        if columns.name in names:
            M, D, K = ((two - one)[part, part] for one, two in zip(own[:3], full[:3], strict=True))
            cause = "inertia coupling is left out, Coriolis and centrifugal forces"
            cure = 'take inertia_coupling = "full"'
            yield OmittedTerms(columns.name, cause, cure, part, M, D, K)


def _unit_motions(compiled: Compiled, q: Array) -> Array:
    """(nv, k) motions of unit mass that the joints leave; of too large models those of no body."""
    if compiled.layout.nv > MAX_COORDINATES:
        return np.zeros((compiled.layout.nv, 1))
    return MechanismModes(compiled, q, list(range(len(compiled.layout.bodies)))).unit_motions()


def first_order_inertia(body: FlexBody) -> Array:
    """(6, 6, m) M₁ per unit eta: translation and rotation of the frame, in body axes."""
    M = np.zeros((6, 6, body.m))
    for k in range(body.m):
        S = body.P[:, :, k] + body.P[:, :, k].T
        M[:3, 3:, k] = -skew(body.p[:, k])
        M[3:, :3, k] = M[:3, 3:, k].T
        M[3:, 3:, k] = np.trace(S) * np.eye(3) - S
    return M
