"""The flexible body: everything the multibody half needs to know of a reduced mesh.

In: inertia integrals, reduced stiffness and damping, interfaces. Out: one immutable, validated
object, in SI and in the body frame (the frame of the undeformed mesh). With s the undeformed
position, N the displacement interpolation, Phi the modes and a, b in x, y, z: S1 = int rho s, S0 =
int rho s s^T, p = int rho N_b Phi, P = int rho s_a N_b Phi, Mab = Phi^T (int rho N_a^T N_b) Phi. A
rigid body has zero modes. Source of the integrals: Shabana, Dynamics of Multibody Systems, ch. 5,
in second-moment form.

:func:`rigid_body` makes a body without modes from mass [kg], centre of mass [m] and inertia about
it [kg m^2] in body axes; its second moment of mass is S0 = tr(J)/2 I - J + m c c^T.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from flexmb.errors import Problem, ReductionError, nearest
from flexmb.flexbody.arrays import Checker, FloatArray, is_nonzero
from flexmb.flexbody.damping import DampingOptions
from flexmb.flexbody.membrane_stiffness import MembraneStiffness
from flexmb.flexbody.parts import Interface, LoadVector, ModeInfo, NodeModes, Surface
from flexmb.flexbody.static_response import (
    InertiaResponse,
    LoadResponse,
    OmittedModes,
    OmittedStiffening,
)
from flexmb.flexbody.stress_modes import (
    OmittedStress,
    SectionForceModes,
    ShellForceModes,
    StressModes,
)

_Part = TypeVar("_Part", Interface, LoadVector)
# relative asymmetry allowed; sums of 1e5 terms leave 1e-12, a wrong matrix leaves 1
_SYMMETRY = 1e-8
_RIGID = 1e-10  # smallest fraction of the modal mass that must remain after rigid motion is removed
_SEMIDEFINITE = 1e-9  # relative; a negative eigenvalue smaller than this is round-off
_PLANES = ((1, 2), (2, 0), (0, 1))  # axes b, c of component a of a cross product


@dataclass(frozen=True, eq=False)
class FlexBody:
    """A body with m modal coordinates (m = 0: a rigid body).

    Parameters
    ----------
    name : str
        Name of the body.
    mass : float
        kg.
    S1 : (3,) float
        First moment of mass about the body-frame origin [kg m].
    S0 : (3, 3) float
        Second moment of mass about the origin, int rho s s^T [kg m^2].
    p : (3, m) float
        int rho N_b Phi.
    P : (3, 3, m) float
        P[a, b] = int rho s_a N_b Phi.
    Mab : (3, 3, m, m) float
        Mab[a, b] = Phi^T int rho N_a^T N_b Phi.
    K : (m, m) float
        Modal stiffness.
    D : (m, m) float, optional
        Modal damping; none by default.
    interfaces : tuple of Interface
        Reference points for joints and loads.
    modes : tuple of ModeInfo
        All candidate modes, retained or dropped, for the reader.
    surface : Surface, optional
        The surface that is drawn.
    nodes : NodeModes, optional
        Motion of all mesh nodes.
    stress : StressModes, optional
        Stress at places of the body.
    section_forces : SectionForceModes, optional
        Section forces of its beams.
    shell_forces : ShellForceModes, optional
        Force and moment resultants of its shells.
    omitted_stress : OmittedStress, optional
        Stress under its own inertia loads that its modes lack.
    loads : tuple of LoadVector
        Loads on the mesh, reduced to the modes.
    provenance : mapping of str to str
        Where the body comes from: hashes, material, options, versions.
    centrifugal_stiffness : (3, 3, m, m) float, optional
        Geometric stiffness of the six loads per mass (e_a s_b + e_b s_a)/2. Together with the
        second-order displacement (``bend``) of the interfaces it is the geometric stiffening of the
        body. None: no geometric stiffening.
    damping : DampingOptions, optional
        Damping ratios of its modes in the scene, which replace D.
    inertia_response : InertiaResponse, optional
        The part of the static response to the body's own inertia that its modes lack.
    load_response : LoadResponse, optional
        The same for loads at mesh nodes.
    omitted_modes : OmittedModes, optional
        The lowest modes that the reduction leaves out.
    omitted_stiffening : OmittedStiffening, optional
        Geometric stiffness of fields that the modes leave out.
    membrane_stiffness : MembraneStiffness, optional
        Of a plate or shell: strain energy of its stretching as it bends, which the equations of
        motion leave out.

    Raises
    ------
    ReductionError
        Arrays whose shapes disagree, entries that are not finite, inertia and stiffness that
        cannot be, or modes that contain rigid motion; all problems at once.
    """

    name: str
    mass: float
    S1: FloatArray
    S0: FloatArray
    p: FloatArray
    P: FloatArray
    Mab: FloatArray
    K: FloatArray
    D: FloatArray | None = None
    interfaces: tuple[Interface, ...] = ()
    modes: tuple[ModeInfo, ...] = ()
    surface: Surface | None = None
    nodes: NodeModes | None = None
    stress: StressModes | None = None
    section_forces: SectionForceModes | None = None
    shell_forces: ShellForceModes | None = None
    omitted_stress: OmittedStress | None = None
    loads: tuple[LoadVector, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)
    centrifugal_stiffness: FloatArray | None = None
    damping: DampingOptions | None = None
    inertia_response: InertiaResponse | None = None
    load_response: LoadResponse | None = None
    omitted_modes: OmittedModes | None = None
    omitted_stiffening: OmittedStiffening | None = None
    membrane_stiffness: MembraneStiffness | None = None

    def __post_init__(self) -> None:
        check = Checker(f"body {self.name}")
        _convert(self, check)
        check.raise_problems()
        _check_inertia(self, check)
        _check_modal(self, check)
        _check_parts(self, check)
        check.raise_problems()
        _check_rigid_motion(self, check)
        check.raise_problems()

    @property
    def m(self) -> int:
        """Number of modal coordinates."""
        return int(self.K.shape[0])

    @property
    def answers_inertia(self) -> bool:
        """Whether the part of the inertia response that its modes lack is known, in mean axes."""
        return self.inertia_response is not None and (
            self.omitted_stress is not None
            or max(self.inertia_response.missing_shares.values(), default=0.0) < 1e-6
        )

    @property
    def M_eta(self) -> FloatArray:
        """(m, m) modal mass, the sum of Mab[b, b]."""
        return np.asarray(np.einsum("bbij->ij", self.Mab))

    @property
    def center(self) -> FloatArray:
        """(3,) undeformed centre of mass, body frame [m]."""
        return self.S1 / self.mass

    @property
    def inertia_about_center(self) -> FloatArray:
        """(3, 3) undeformed inertia about the centre of mass, body axes [kg m^2]."""
        S = self.S0 - np.outer(self.S1, self.S1) / self.mass
        return np.asarray(np.trace(S) * np.eye(3) - S)

    @property
    def frequencies(self) -> FloatArray:
        """(m,) natural frequencies of the free body, ascending [Hz]."""
        if self.m == 0:
            return np.zeros(0)
        L = np.linalg.cholesky(self.M_eta)
        half = np.linalg.solve(L, self.K)
        values = np.linalg.eigvalsh(np.linalg.solve(L, half.T))
        return np.sqrt(np.maximum(values, 0.0)) / (2 * np.pi)

    def __repr__(self) -> str:
        ends = ", ".join(one.name for one in self.interfaces) or "no interface"
        return f'<FlexBody "{self.name}": {self.mass:.4g} kg, {self.m} modes, {ends}>'

    @property
    def characteristic_length(self) -> float:
        """Length of the uniform bar with the body's largest radius of gyration [m]."""
        S = self.S0 - np.outer(self.S1, self.S1) / self.mass
        return float(np.sqrt(12 * max(np.linalg.eigvalsh(S)[-1], 0.0) / self.mass))

    def interface(self, name: str) -> Interface:
        """The interface of that name.

        Raises
        ------
        ReductionError
            There is none; lists those there are, nearest first.
        """
        return self._part("interface", self.interfaces, name)

    def load(self, name: str) -> LoadVector:
        """The load of that name.

        Raises
        ------
        ReductionError
            There is none; lists those there are, nearest first.
        """
        return self._part("load", self.loads, name)

    def _part(self, noun: str, parts: tuple[_Part, ...], name: str) -> _Part:
        names = tuple(part.name for part in parts)
        if name in names:
            return parts[names.index(name)]
        what = f'the body has no {noun} "{name}"'
        problem = Problem(f"body {self.name}", what, names, nearest(name, names))
        raise ReductionError.from_problems([problem])


def _convert(body: FlexBody, check: Checker) -> None:
    m = np.shape(body.K)[0] if np.ndim(body.K) == 2 else 0
    shapes: dict[str, tuple[int, ...]] = {"S1": (3,), "S0": (3, 3), "p": (3, m), "P": (3, 3, m)}
    shapes |= {"Mab": (3, 3, m, m), "K": (m, m), "D": (m, m)}
    if body.centrifugal_stiffness is not None:
        shapes["centrifugal_stiffness"] = (3, 3, m, m)
    for name, shape in shapes.items():
        value = getattr(body, name)
        value = np.zeros(shape) if value is None else value
        object.__setattr__(body, name, check.floats(name, value, shape))
    object.__setattr__(body, "mass", float(body.mass))
    object.__setattr__(body, "interfaces", tuple(body.interfaces))
    object.__setattr__(body, "modes", tuple(body.modes))
    object.__setattr__(body, "loads", tuple(body.loads))
    provenance = {str(key): str(value) for key, value in body.provenance.items()}
    object.__setattr__(body, "provenance", MappingProxyType(provenance))


def _check_inertia(body: FlexBody, check: Checker) -> None:
    if not (np.isfinite(body.mass) and body.mass > 0):
        check.add("mass", f"must be positive, is {body.mass:g} kg")
        return
    if not _symmetric(body.S0):
        check.add("S0", "is not symmetric")
        return
    S = body.S0 - np.outer(body.S1, body.S1) / body.mass
    if np.linalg.eigvalsh(S)[0] < -_SEMIDEFINITE * np.trace(body.S0):
        check.add("S0", "is impossible: the second moment of mass about the centre is negative")


def _check_modal(body: FlexBody, check: Checker) -> None:
    if body.m == 0:
        return
    for name in ("K", "D"):
        matrix = getattr(body, name)
        if not _symmetric(matrix):
            check.add(name, "is not symmetric")
        elif np.linalg.eigvalsh(matrix)[0] < -_SEMIDEFINITE * np.abs(matrix).max():
            check.add(name, "has a negative eigenvalue")
    if not _symmetric(body.Mab.transpose(0, 2, 1, 3).reshape(3 * body.m, 3 * body.m)):
        check.add("Mab", "is not symmetric: Mab[a, b] must be the transpose of Mab[b, a]")
    elif np.linalg.eigvalsh(body.M_eta)[0] <= 0:
        check.add("Mab", "gives a modal mass that is not positive definite")


def _check_rigid_motion(body: FlexBody, check: Checker) -> None:
    """The modes and the six motions of the body frame must be independent. Otherwise the mass
    matrix at rest is singular. About the centre of mass and in principal axes its rigid block is
    diagonal. The modal mass that remains without rigid motion is compared with all of it.
    """
    if body.m == 0:
        return
    about_center = body.P - body.center[:, None, None] * body.p
    turning = np.array([about_center[a, b] - about_center[b, a] for a, b in _PLANES])
    moments, axes = np.linalg.eigh(body.inertia_about_center)
    has_mass = is_nonzero(moments)  # points on a line have no inertia about it
    turning = (axes.T @ turning)[has_mass] / np.sqrt(moments[has_mass])[:, None]
    rigid = np.vstack([body.p / np.sqrt(body.mass), turning])
    L = np.linalg.cholesky(body.M_eta)
    share = np.linalg.svd(np.linalg.solve(L, rigid.T), compute_uv=False)[0] ** 2
    if 1.0 - share < _RIGID:
        what = "contain rigid motion of the whole body, which its frame has already"
        check.add("modes", f"{what}: the mass matrix is singular; take it out of the modes")


def _check_parts(body: FlexBody, check: Checker) -> None:
    bends = {part.bend is not None for part in body.interfaces}
    if body.m and bends | {body.centrifugal_stiffness is not None} == {False, True}:
        what = "geometric stiffening needs both the centrifugal loads and a bend of each interface"
        check.add("centrifugal_stiffness", f"{what}: one of them alone is wrong")
    forms = {"centrifugal_stiffness": body.centrifugal_stiffness}
    forms |= {f"interface {part.name}.bend": part.bend for part in body.interfaces}
    forms["nodes.bend"] = None if body.nodes is None else body.nodes.bend
    for name, form in forms.items():
        if form is not None and not all(
            _symmetric(one) for one in form.reshape(-1, *form.shape[-2:])
        ):
            check.add(name, "is not symmetric in the modes: the body would make energy")
    for field_ in ("interfaces", "loads"):
        names = [part.name for part in getattr(body, field_)]
        for name in sorted({name for name in names if names.count(name) > 1}):
            check.add(field_, f'the name "{name}" is used twice')
    columns = {f"interface {part.name}": part.Phi_t.shape[1] for part in body.interfaces}
    columns |= {f"load {load.name}": len(load.modal) for load in body.loads}
    columns |= {
        f"load {load.name}.{point.name}": point.Phi_t.shape[1]
        for load in body.loads for point in load.points
    }  # fmt: skip
    arrays = dict.fromkeys(("surface", "stress", "section_forces", "shell_forces"), "modes")
    arrays |= {"nodes": "Phi_t", "membrane_stiffness": "shapes"}
    arrays |= dict.fromkeys(("omitted_modes", "omitted_stiffening"), "modes")
    for name, array in arrays.items():
        if (owner := getattr(body, name)) is not None:
            columns[name] = getattr(owner, array).shape[-1]
    for part, count in columns.items():
        if count != body.m:
            check.add(part, f"has {count} modes where the body has {body.m}")
    numbers = [mode.index for mode in body.modes if mode.kept]
    if body.modes and numbers != list(range(body.m)):
        check.add("modes", f"must number the kept modes 0 to {body.m - 1} in order")


def _symmetric(matrix: FloatArray) -> bool:
    return bool(
        np.abs(matrix - matrix.T).max(initial=0) <= _SYMMETRY * np.abs(matrix).max(initial=0)
    )


_ROUNDING = 1e-9  # relative tolerance: for a rod or a plate the triangle inequality is an equality


def rigid_body(
    mass: float, center: ArrayLike = (0, 0, 0), inertia: ArrayLike = 0.0, name: str = "rigid"
) -> FlexBody:
    """Build a rigid body from its mass properties.

    Parameters
    ----------
    mass : float
        kg.
    center : (3,) float
        Centre of mass, body frame [m].
    inertia : (3, 3), (3,) or float
        About the centre of mass, body axes [kg m^2]; three numbers are the diagonal.
    name : str
        Name of the body.

    Raises
    ------
    ReductionError
        Mass that is not positive, or an inertia no body can have.
    """
    check = Checker(f"body {name}")
    c = check.floats("center", center, (3,))
    moments = np.asarray(inertia, dtype=float)
    J = check.floats(
        "inertia", moments if moments.ndim == 2 else np.diag(moments * np.ones(3)), (3, 3)
    )
    if not mass > 0:
        check.add("mass", f"must be positive, is {mass:g} kg")
    check.raise_problems()
    if np.abs(J - J.T).max() > _ROUNDING * np.abs(J).max():
        check.add("inertia", "is not symmetric")
        check.raise_problems()
    moments = np.linalg.eigvalsh(J)
    if moments[0] < -_ROUNDING * moments[2]:
        check.add("inertia", f"has a negative principal moment {moments[0]:g} kg m^2")
    elif moments[2] > (1 + _ROUNDING) * (moments[0] + moments[1]):
        text = ", ".join(f"{moment:g}" for moment in moments)
        check.add("inertia", f"is impossible: of {text} kg m^2 the largest exceeds the others' sum")
    check.raise_problems()
    S0 = 0.5 * np.trace(J) * np.eye(3) - 0.5 * (J + J.T) + mass * np.outer(c, c)
    none = np.zeros
    return FlexBody(
        name, mass, mass * c, S0, none((3, 0)), none((3, 3, 0)), none((3, 3, 0, 0)), none((0, 0))
    )


MODE_COLUMNS = ("mode", "kind", "f [Hz]", "mostly", "interfaces", "x/y/z", "kept or why dropped")


def mode_table(body: FlexBody) -> list[tuple[str, ...]]:
    """Rows of text under ``MODE_COLUMNS``: all candidate modes in the order of the body."""
    return [_mode_row(mode) for mode in body.modes]


def _mode_row(mode: ModeInfo) -> tuple[str, ...]:
    return (
        str(mode.index) if mode.kept else "-",
        mode.kind,
        f"{mode.frequency:.1f}" if mode.frequency >= 100.0 else f"{mode.frequency:.3g}",
        mode.mostly,
        "" if math.isnan(mode.interface_share) else f"{round(100 * mode.interface_share):d} %",
        _along_axes(mode.kinetic_share),
        f"{'kept' if mode.kept else 'dropped'}{': ' if mode.why else ''}{mode.why}",
    )


def _along_axes(shares: tuple[float, ...]) -> str:
    complete = bool(shares) and not any(math.isnan(value) for value in shares)
    return "/".join(f"{round(100 * value):d}" for value in shares) + " %" if complete else ""
