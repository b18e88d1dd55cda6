"""A supported model: static solution, natural frequencies, buckling, and recovery of the results.

With u = G z (:mod:`flexmb.fe.assembly.supports`) and some z prescribed, G^T K G z = G^T f is solved
for the others; the residual of the equations of the prescribed z is the reactions. Under preload
the stiffness is K + K_g of the static stress, minus the spin softening: with B = omega~^2, u^T B u
is the work of the centrifugal load that grows with the displacement. Coriolis forces are left out.
Buckling: K v = -factor K_g v. Loads keep their direction, also a pressure. Source: Bathe, Finite
Element Procedures, ch. 4 and 6.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from flexmb.errors import FlexmbWarning, Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices, geometric_stiffness
from flexmb.fe.assembly.interfaces import ModelInterface, RigidInterface, interface_stiffness
from flexmb.fe.assembly.loads import condensed_load
from flexmb.fe.assembly.mass import component_masses
from flexmb.fe.assembly.numbering import Accumulator
from flexmb.fe.assembly.springs import turning_share
from flexmb.fe.assembly.supports import Supports
from flexmb.fe.displacements import node_modes, surface
from flexmb.fe.large_displacements import displacement_notes
from flexmb.fe.linear_solver import SingularMatrix
from flexmb.fe.recovery import shell_force_modes
from flexmb.fe.reduction.eigenmodes import (
    dense_modes,
    lowest_modes,
    mode_signs,
    polynomial_fields,
    start_vector,
)
from flexmb.fe.reduction.fixed_interface import BorderedSolver
from flexmb.fe.reduction.free_body import dense_free_modes
from flexmb.fe.reduction.inertia_relief import InertiaRelief
from flexmb.fe.reduction.reduced_basis import FREE_HINGE, moving_nodes
from flexmb.fe.stress import section_force_modes, stress_modes
from flexmb.flexbody.arrays import FloatArray, IntArray, skew
from flexmb.flexbody.mesh_options import GravityLoad, PressureLoad
from flexmb.flexbody.part_options import InterfaceLoad, PartAnalysisOptions, SpinLoad, is_static
from flexmb.flexbody.part_result import STATIC, PartResult, Resultant
from flexmb.flexbody.parts import Interface
from flexmb.flexbody.stress_modes import SectionForceModes, von_mises
from flexmb.progress import Progress

_DENSE = 300  # number of unknowns up to which full matrices are faster
# a force is round-off below this fraction of the sum of the magnitudes of its terms
_FORCE_ROUND_OFF = 1e-13
# Springs whose axes turn have second-order work that the geometric stiffness leaves out. Above this
# ratio of it to the rotational stiffness (`turning_share`) at the lowest load factor, a note says
# so.
_SPRING_SHARE = 0.1
_BALANCE_TOLERANCE = 1e-6  # reactions that miss the loads by more than this fraction are reported
# no load factor is looked for where stress exceeds this multiple of Young's modulus; beside
# concentrated loads stress is large
_STRAIN = 10.0
_MAX_MODES = 2000  # largest number of modes computed for a frequency band


def spin_field(load: SpinLoad) -> tuple[FloatArray, FloatArray]:
    """A (3, 3) and p (3,) of the acceleration A (s - p) [m/s^2] of a point at s under a spin."""
    w, alpha = (skew(np.array(v)) for v in (load.angular_velocity, load.angular_acceleration))
    return w @ w + alpha, np.array(load.position)


@dataclass(frozen=True, eq=False)
class _Modes:
    numbers: IntArray
    omega2: FloatArray
    z: FloatArray  # (k, v) modes over the coordinates z


class SupportedModel:
    """One supported model, its matrices over the coordinates z, and the solutions with them."""

    def __init__(
        self,
        fe: FEMatrices,
        ends: tuple[ModelInterface, ...],
        supports: Supports,
        options: PartAnalysisOptions,
        progress: Progress,
    ) -> None:
        self.fe, self.ends, self.supports, self.options = fe, ends, supports, options
        self.progress, self.free = progress, supports.free
        self.K = csr_array(supports.G.T @ fe.K @ supports.G)
        self.M = self._inner(csr_array(supports.G.T @ fe.M @ supports.G))
        self.W = csr_array(supports.W[:, self.free])
        size = float(np.ptp(fe.mesh.points[fe.numbering.nodes], axis=0).max())
        self.R = supports.rigid[self.free] @ supports.free_motions(size, means=False)
        self.moves = bool(supports.free_motions(size).shape[1])

    def result(
        self,
        name: str,
        loads: Mapping[str, FloatArray],
        notes: list[str],
        provenance: Mapping[str, str],
    ) -> PartResult:
        """Solve under the loads (n_all,) each, and recover displacements, stress and reactions."""
        fe, supports, options = self.fe, self.supports, self.options
        fields: list[str] = []
        columns = [np.zeros((supports.G.shape[1], 0))]
        solver = self._solver(self._inner(self.K)) if self._needs_stiffness() else None
        reactions: tuple[Resultant, ...] = ()
        Kg, spin = None, np.zeros((3, 3))
        acting = {k: condensed_load(fe, f) for k, f in loads.items()}
        total = sum(acting.values(), np.zeros(fe.numbering.n))
        if is_static(options):
            assert solver is not None
            z = self._static(solver, total)
            reactions = self._reactions(z, total)
            columns.append(z[:, None])
            fields.append(STATIC)
            notes += displacement_notes(fe, self.ends, supports, solver, z)
            if options.buckling or options.preload:
                inside = [f for k, f in acting.items()
                          if not isinstance(options.loads[k], InterfaceLoad)]  # fmt: skip
                links = fe.K @ (supports.G @ z) - sum(inside, np.zeros(fe.numbering.n))
                Kg, spin = self._stressed(supports.G @ z, links, loads)
        factors = np.zeros(0)
        shapes = np.zeros((supports.G.shape[1], 0))
        if options.buckling:
            assert solver is not None and Kg is not None
            limit = self._elastic_limit(z)
            if np.isfinite(limit) and self._is_stable(Kg, limit):
                what = "the loads do not buckle the part: there is no load factor below "
                notes.append(
                    f"{what}{limit:.3g}, where stress is {_STRAIN:g} times Young's modulus"
                )
            else:
                factors, shapes = self._buckling(solver, Kg)
                if not len(factors):
                    notes.append("the loads do not buckle the part, however large they are")
            every = fe.expand(supports.G @ z)
            for spring in fe.springs if len(factors) else ():
                share = turning_share(spring, fe.numbering, fe.mesh.points, every)
                if share * factors[0] ** 2 > _SPRING_SHARE:
                    what = (
                        f'spring "{spring.name}" yields so far at the load factor {factors[0]:.4g} '
                    )
                    what += (
                        "that its axes turn with it: factors, which are linear in the loads, are "
                    )
                    notes.append(f"{what}not to be trusted there; a bushing between two bodies is")
            if any(isinstance(load, PressureLoad) for load in options.loads.values()):
                what = (
                    "pressures keep their direction as the part buckles: where they turn with the "
                )
                notes.append(f"{what}surface, as of a fluid, it can buckle earlier, a ring at 3/4")
        if options.frequencies is not None:
            modes = self._vibration(solver, Kg if options.preload else None, spin)
            columns.append(modes.z)
            fields += [f"mode {k}" for k in modes.numbers]
        else:
            modes = _Modes(np.zeros(0, int), np.zeros(0), np.zeros((supports.G.shape[1], 0)))
        columns.append(shapes)
        fields += [f"buckling {k + 1}" for k in range(len(factors))]
        Z = np.concatenate(columns, axis=1)
        made = PartResult(
            name,
            fe.inertia.mass,
            tuple(fields),
            modes.numbers,
            np.sqrt(np.maximum(modes.omega2, 0.0)) / (2 * np.pi),
            self._effective_mass(modes),
            factors,
            reactions,
            tuple(self._resultant_at(k, fe.center, self._total(f)) for k, f in acting.items()),
            notes=tuple(notes),
            provenance=provenance,
            **self._recovered(Z),
        )
        if made.supports and made.imbalance > _BALANCE_TOLERANCE:
            what = f"rounding leaves reactions and loads out of balance by {made.imbalance:.1e} of "
            what += "the largest of them: the part is very slender, or its stiffnesses differ much"
            warnings.warn(what, FlexmbWarning, stacklevel=3)
        return made

    def _elastic_limit(self, z: FloatArray) -> float:
        """The load factor at which the largest stress of the static solution is `_STRAIN` times
        Young's modulus; infinite if there is no stress."""
        sections = [block.section for block in self.fe.blocks]
        layers = [part for section in sections for part in getattr(section, "layers", (section,))]
        E = max(max(part.material.constants()[0]) for part in layers)
        stress = stress_modes(self.fe, self.supports.G @ z[:, None])
        if stress is None:  # beams without stress points
            return np.inf
        largest = von_mises(stress.at(np.ones(1))).max(initial=0.0)
        return float(_STRAIN * E / largest) if largest > 0 else np.inf

    def _is_stable(self, Kg: csr_array, factor: float) -> bool:
        """Whether the part resists all motions under its loads times ``factor``."""
        try:
            self._solver(csr_array(self._inner(self.K) + factor * self._inner(Kg)))
        except ReductionError:
            return False
        return True

    def _needs_stiffness(self) -> bool:
        return is_static(self.options) or not self.options.preload

    def _inner(self, matrix: csr_array) -> csr_array:
        return csr_array(matrix[self.free][:, self.free])

    def _solver(self, K: csr_array) -> BorderedSolver:
        """The factorised stiffness over the coordinates that are not prescribed.

        Raises
        ------
        ReductionError
            A part of the mesh moves freely; names its nodes.
        """
        try:
            points = self.supports.points[self.free]
            return BorderedSolver(K, self.W, self.R, points, self.progress)
        except SingularMatrix as error:
            z = np.zeros((self.supports.G.shape[1], 1))
            z[self.free[error.dofs]] = 1.0
            if not self.supports.names:
                raise ReductionError(FREE_HINGE) from error
            where = moving_nodes(self.fe, self.supports.G @ z)
            what = "with its supports held, a part of the mesh still moves freely: "
            raise ReductionError(f"supports: {what}{where}") from error

    def _static(self, solver: BorderedSolver, f: FloatArray) -> FloatArray:
        """(k,) coordinates z under the loads f and the prescribed displacements."""
        z = np.zeros(self.supports.G.shape[1])
        z[self.supports.fixed] = self.supports.value
        right = (self.supports.G.T @ f - self.K @ z)[self.free]
        z[self.free] = solver.solve(right, self.supports.mean)
        return z

    def _reactions(self, z: FloatArray, f: FloatArray) -> tuple[Resultant, ...]:
        """Forces and moments of the supports on the part."""
        supports, rest = self.supports, self.K @ z - self.supports.G.T @ f
        noise = _FORCE_ROUND_OFF * (abs(self.K) @ np.abs(z))
        is_small = np.abs(rest[supports.fixed]) <= noise[supports.fixed]
        if not self._total(f).any() and is_small.all():
            rest[supports.fixed] = 0.0  # loads in balance or a rigid motion: only round-off
        reactions = np.zeros((len(supports.names), len(z)))
        reactions[:, supports.fixed] = supports.shares * rest[supports.fixed]
        if supports.W.shape[0]:
            dense = self.W.toarray()
            forces = np.linalg.lstsq(dense.T, rest[self.free], rcond=None)[0]
            reactions += supports.mean_shares @ (forces[:, None] * supports.W.toarray())
        totals = reactions @ supports.rigid  # (supports, 6)
        least = ((reactions != 0.0) * noise) @ np.abs(supports.rigid)
        least = np.repeat(least.reshape(-1, 2, 3).max(axis=2), 3, axis=1)
        totals[np.abs(totals) <= least] = 0.0
        places = zip(supports.names, supports.positions, totals, strict=True)
        return tuple(self._resultant_at(name, x, total) for name, x, total in places)

    def _resultant_at(self, name: str, at: FloatArray, total: FloatArray) -> Resultant:
        """A resultant (6,) about the centre of mass, moved to the point ``at``."""
        force = total[:3]
        moment = total[3:] - np.cross(at - self.fe.center, force)
        return Resultant(name, np.asarray(at), force, moment)

    def _total(self, f: FloatArray) -> FloatArray:
        """(6,) resultant of loads about the centre of mass; components that are round-off are
        zero."""
        total, parts = self.fe.rigid.T @ f, np.abs(self.fe.rigid.T) @ np.abs(f)
        parts = np.repeat(parts.reshape(2, 3).max(axis=1), 3)
        return np.where(np.abs(total) <= _FORCE_ROUND_OFF * parts, 0.0, total)

    def _stressed(
        self, u: FloatArray, links: FloatArray, loads: Mapping[str, FloatArray]
    ) -> tuple[csr_array, FloatArray]:
        """Geometric stiffness of the static solution over z, and B = omega~^2 of its spin.

        ``links`` (n,) are the forces of supports and interfaces on the model, ``loads`` (n_all,)
        each load.
        """
        field, B = np.zeros((3, 4)), np.zeros((3, 3))
        direct = np.zeros(self.fe.numbering.n_all)
        for name, load in self.options.loads.items():
            if isinstance(load, SpinLoad):
                A, p = spin_field(load)
                field -= np.column_stack([A, -A @ p])
                w = skew(np.array(load.angular_velocity))
                B += w @ w
            elif isinstance(load, GravityLoad):
                field[:, 3] += load.acceleration
            else:
                direct += loads[name]
        Kg = geometric_stiffness(self.fe, u, field, direct)
        Kg = csr_array(self.supports.G.T @ Kg @ self.supports.G)
        for end in self.ends:
            S = interface_stiffness(self.fe, end, links)
            dofs, values = end.loads()
            arms = np.abs(self.fe.mesh.points[end.nodes] - end.position).max()
            if np.abs(S).max() > _BALANCE_TOLERANCE * arms * np.abs(links[dofs]).sum():
                turns = csr_array(values.T[3:] @ self.supports.G[dofs])
                Kg = csr_array(Kg + turns.T @ csr_array(S) @ turns)
        return Kg, B

    def _spin_softening(self, B: FloatArray) -> csr_array:
        """(k, k) sum of B_ab M_ab over z: the (negative) stiffness of the spin."""
        fe, total = self.fe, Accumulator(self.fe.numbering.n_all)
        points, numbering = fe.mesh.points, fe.numbering
        blocks = () if fe.lumped else fe.blocks
        for mass, dofs in (
            *component_masses(blocks, numbering, points), *fe.nodal.masses(numbering, points)
        ):  # fmt: skip
            element = np.einsum("ab,eabij->eij", B, mass.Mab)
            total.add(0.5 * (element + element.transpose(0, 2, 1)), dofs)
        matrix, scalar = total.matrix(), fe.inertia.scalar.tocoo()
        for a in range(3):
            for b in range(3):
                rows, columns = numbering.table[scalar.row, a], numbering.table[scalar.col, b]
                data = (B[a, b] * scalar.data, (rows, columns))
                matrix = matrix + csr_array(data, shape=matrix.shape)
        return csr_array(self.supports.G.T @ fe.condensed(matrix) @ self.supports.G)

    def _vibration(
        self, solver: BorderedSolver | None, Kg: csr_array | None, spin: FloatArray
    ) -> _Modes:
        """The requested modes, numbered from 1, with unit modal mass."""
        wanted, K = self.options.frequencies, self._inner(self.K)
        assert wanted is not None
        if Kg is not None:
            K = csr_array(K + self._inner(Kg))
            if spin.any():
                K = csr_array(K + self._inner(self._spin_softening(spin)))
            try:
                solver = self._solver(K)
            except ReductionError as error:
                what = "the part is not stable under its loads: they exceed those that buckle it"
                raise ReductionError(f"preload: {what} ({error})") from error
        assert solver is not None
        count = wanted.count or 20
        limit = K.shape[0] - self.W.shape[0] - (self.R.shape[1] if self.moves else 0)
        while True:
            if wanted.count is not None and count > limit:
                what = f"{count} requested, but the part has only {limit} degrees of freedom"
                raise ReductionError.from_problems([Problem("frequencies.count", what)])
            omega2, V = self._lowest(solver, K, min(count, limit))
            if wanted.band is None:
                rows = np.arange(len(omega2))
                break
            low, high = ((2 * np.pi * f) ** 2 for f in wanted.band)
            if count >= limit or omega2[-1] > high:
                rows = np.flatnonzero((omega2 >= low) & (omega2 <= high))
                if not len(rows):
                    raise ReductionError.from_problems([_empty_band(omega2, low)])
                break
            if count >= _MAX_MODES:
                what = f"holds more than {_MAX_MODES} frequencies: take a narrower band"
                raise ReductionError.from_problems([Problem("frequencies.band", what)])
            count *= 2
        z = np.zeros((self.supports.G.shape[1], len(omega2)))
        z[self.free] = V
        U = self.supports.G @ z
        z = z @ mode_signs(omega2, polynomial_fields(self.fe).T @ (self.fe.M @ U))
        return _Modes(rows + 1, omega2[rows], z[:, rows])

    def _lowest(
        self, solver: BorderedSolver, K: csr_array, count: int
    ) -> tuple[FloatArray, FloatArray]:
        n = K.shape[0]
        if not self.moves:
            if not self.W.shape[0] and (n <= _DENSE or 2 * count >= n):
                return dense_modes(K.toarray(), self.M.toarray(), count)
            start = solver.solve(start_vector(n))
            return lowest_modes(self.M, solver.solve, count, self.progress, start)
        relief = InertiaRelief(self.M, self.R)
        if n <= _DENSE or 2 * count >= n:
            return dense_free_modes(K.toarray(), self.M.toarray(), self.R, count)

        def deform(f: FloatArray) -> FloatArray:
            return relief.fields(solver.solve(relief.loads(f)))

        return lowest_modes(self.M, deform, count, self.progress, deform(start_vector(n)))

    def _buckling(self, solver: BorderedSolver, Kg: csr_array) -> tuple[FloatArray, FloatArray]:
        """Positive buckling load factors, ascending, and their shapes over z."""
        K, stress = self._inner(self.K), -self._inner(Kg)
        n, count = K.shape[0], self.options.buckling
        count = min(count, n - self.W.shape[0] - 1)
        if n <= _DENSE and not self.W.shape[0]:
            mu, V = eigh(stress.toarray(), K.toarray(), subset_by_index=[n - count, n - 1])
        else:
            inverse = LinearOperator(
                (n, n), matvec=lambda b: solver.solve(np.ravel(b)), dtype=float
            )
            start = solver.solve(start_vector(n))
            try:
                mu, V = eigsh(stress, count, M=K, Minv=inverse, which="LA", v0=start, tol=1e-10)
            except ArpackError as error:
                what = f"the lowest {count} load factors were not found ({error})"
                raise ReductionError(f"buckling: {what}") from error
        scale = np.abs(mu).max(initial=0.0)
        order = [k for k in np.argsort(-mu) if mu[k] > 1e-9 * max(scale, 1e-300)]
        z = np.zeros((self.supports.G.shape[1], len(order)))
        z[self.free] = V[:, order]
        slides = np.abs((self.supports.G @ z)[self._translations()]).max(axis=0, initial=1e-300)
        U = self.supports.G @ z
        sign = np.where((polynomial_fields(self.fe).T @ U).sum(axis=0) < 0, -1.0, 1.0)
        return 1.0 / mu[order], z * (sign / slides)

    def _translations(self) -> IntArray:
        table = self.fe.numbering.table[:, :3]
        return table[(table >= 0) & (table < self.fe.numbering.n)]

    def _effective_mass(self, modes: _Modes) -> FloatArray:
        U = self.supports.G @ modes.z
        return np.asarray((U.T @ (self.fe.M @ self.fe.rigid[:, :3])) ** 2)

    def _recovered(self, Z: FloatArray) -> dict[str, Any]:
        """Recover interfaces, nodes, surface and stress of the fields Z (k, number) over z."""
        fe, U = self.fe, self.supports.G @ Z
        rigid = tuple(end for end in self.ends if isinstance(end, RigidInterface))
        motions = {end.name: end.motion(U) for end in self.ends}
        turns = np.array([motions[end.name][3:] for end in rigid]).reshape(-1, 3, Z.shape[1])
        nodes = node_modes(fe, U, rigid, turns, self.progress)
        forces = section_force_modes(fe, U)
        beams = SectionForceModes(forces.nodes, forces.axes, forces.ends)
        return {
            "interfaces": tuple(
                Interface(end.name, end.position, motions[end.name][:3], motions[end.name][3:])
                for end in self.ends
            ),
            "nodes": nodes,
            "surface": surface(fe, nodes),
            "stress": stress_modes(fe, U, progress=self.progress),
            "section_forces": beams if len(forces.nodes) else None,
            "shell_forces": shell_force_modes(fe, U),
        }


def _empty_band(omega2: FloatArray, low: float) -> Problem:
    """What is said of a band without a natural frequency; ``omega2`` ascend."""
    f = np.sqrt(np.maximum(omega2, 0.0)) / (2 * np.pi)
    near = [*f[omega2 < low][-1:], *f[omega2 > low][:1]]
    text = " and ".join(f"{value:.4g} Hz" for value in near)
    what = f"holds no natural frequency; the nearest {'is' if len(near) == 1 else 'are'} {text}"
    return Problem("frequencies.band", what)
