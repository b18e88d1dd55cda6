"""Sections and materials from tables; solid sections, and solid and round sections of beams.

The words of a table, ``{type = "rectangle", y = 0.02}``, are the parameters of the functions in
``SECTIONS``; ``material`` is a name, a table or a material. Dimensions of beams are in metres,
along the section's axes y and z; with the default orientation z is up for a level beam. Words for
all beams: ``shear`` (False: no shear deformation), ``ky`` and ``kz`` (instead of the shape's own),
``orientation``, ``offset``, ``nonstructural``, ``material``, ``releases``, as in
:class:`BeamSection`.
Sources: torsion of a rectangle, Timoshenko and Goodier, Theory of Elasticity, 3rd ed., section
109; shear coefficients of rectangle, circle and tube, Cowper (1966), J. Appl. Mech. 33, with
Poisson's ratio; thin walls in :mod:`flexmb.fe.sections.thin_walls`.

A material is a name in the library, a dictionary with E [Pa], nu [-] and density [kg/m^3], with
G [Pa] and three of each where it is orthotropic, or a material. The section of a solid is its
material and the directions of its axes: a :class:`SolidSection`.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexmb.errors import FlexmbError, FlexmbWarning, MaterialError, Problem, ReductionError
from flexmb.fe.sections import thin_walls
from flexmb.fe.sections.beam_chain import TaperedSection, tapered
from flexmb.fe.sections.beam_section import (
    BeamSection,
    Place,
    Releases,
    StressPoint,
    general,
    polygon,
    positive,
    section_of,
)
from flexmb.fe.sections.shell_section import Layer, ShellSection, layered, shell
from flexmb.flexbody.arrays import FloatArray, unit_vector
from flexmb.flexbody.mesh_options import MaterialOptions, OrthotropicOptions
from flexmb.flexbody.options import kind_of, option_values, read_options, rooted
from flexmb.flexbody.section_options import SECTIONS as OPTIONS
from flexmb.materials import AnyMaterial, Material, OrthotropicMaterial, material
from flexmb.units import say_length

MaterialLike = str | AnyMaterial | Mapping[str, Any]


def resolve(words: MaterialLike) -> AnyMaterial:
    """The material that was meant.

    Raises
    ------
    MaterialError
        Unknown name, missing or unknown key, or a value that cannot be; all at once.
    """
    if isinstance(words, OrthotropicMaterial):
        return words
    if not isinstance(words, Mapping):
        return material(words)
    directed = "G" in words or (
        hasattr(words.get("E"), "__len__") and not isinstance(words["E"], str)
    )
    options = read_options(
        OrthotropicOptions if directed else MaterialOptions, words, "material", MaterialError
    )
    values = {name: _as_floats(value) for name, value in vars(options).items()}
    return OrthotropicMaterial(**values) if directed else Material(**values)


def _as_floats(value: Any) -> Any:
    if isinstance(value, str):
        return value
    return tuple(map(float, value)) if isinstance(value, tuple) else float(value)


Vector = tuple[float, float, float]

_MAX_BULK_RATIO = 49.0  # bulk over shear modulus: nu = 0.49


@dataclass(frozen=True)
class SolidSection:
    """What solid elements are made of.

    Parameters
    ----------
    material : Material or OrthotropicMaterial, optional
        The body's if none is given.
    axis1, axis2 : (3,) float, optional
        Material axis 1, and a direction in the plane of axes 1 and 2, body frame; by default the
        axes of the body frame. Without meaning for isotropic materials.

    Raises
    ------
    ReductionError
        Directions that are no directions, or parallel ones.
    """

    material: AnyMaterial | None = None
    axis1: Vector | None = None
    axis2: Vector | None = None

    dimension = 3

    def __post_init__(self) -> None:
        problems = [
            Problem(f"section.{name}", f"must be three numbers, not all zero, given {axis!r}")
            for name, axis in (("axis1", self.axis1), ("axis2", self.axis2))
            if axis is not None and not _is_direction(axis)
        ]
        if problems:
            raise ReductionError.from_problems(problems)
        first, second = self._unit_axes()
        if np.linalg.norm(np.cross(first, second)) < 1e-6:
            what = f"is parallel to axis1, {tuple(first)}: give another direction of their plane"
            raise ReductionError.from_problems([Problem("section.axis2", what)])

    def with_material(self, default: AnyMaterial | None) -> SolidSection:
        """The section with its material known; warns if the material is nearly incompressible."""
        section = self if self.material is not None else replace(self, material=default)
        ratio = 0.0 if section.material is None else _bulk_over_shear(section.material)
        if ratio > _MAX_BULK_RATIO:
            warnings.warn(
                f'material "{section.material.name}": its bulk modulus is {ratio:.3g} times its '
                "shear modulus; solid elements, which interpolate displacements alone, may be too "
                "stiff then: use first-order hexahedra, whose incompatible modes keep them soft, "
                "or second-order tetrahedra, and compare two meshes",
                FlexmbWarning,
                stacklevel=2,
            )
        return section

    def axes(self) -> FloatArray:
        """(3, 3) the material axes as columns, body frame."""
        first, second = self._unit_axes()
        third = np.cross(first, second)
        third /= np.linalg.norm(third)
        return np.stack([first, np.cross(third, first), third], axis=1)

    def stiffness(self) -> FloatArray:
        """(6, 6) stress per strain in body axes [Pa], order xx, yy, zz, yz, zx, xy."""
        C = self.material.stiffness()
        if isinstance(self.material, Material):
            return C
        T = _strain_turn(self.axes())
        C = T.T @ C @ T
        return 0.5 * (C + C.T)

    def _unit_axes(self) -> tuple[FloatArray, FloatArray]:
        """Unit vectors along axis1 and axis2."""
        first = np.array((1.0, 0.0, 0.0) if self.axis1 is None else self.axis1, dtype=float)
        second = np.array((0.0, 1.0, 0.0) if self.axis2 is None else self.axis2, dtype=float)
        return first / np.linalg.norm(first), second / np.linalg.norm(second)


def _is_direction(value: Vector) -> bool:
    try:
        values = np.array(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return values.shape == (3,) and bool(np.isfinite(values).all()) and bool(values.any())


def _bulk_over_shear(material: AnyMaterial) -> float:
    """Bulk modulus (resistance to a change of volume) over the smallest shear modulus."""
    C = material.stiffness()
    return float(1 / np.linalg.inv(C[:3, :3]).sum() / np.diag(C)[3:].min())


def _strain_turn(axes: FloatArray) -> FloatArray:
    """(6, 6) transformation of strains from body axes to ``axes`` (columns)."""
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
    T = np.empty((6, 6))
    for row, (p, q) in enumerate(pairs):
        for column, (a, b) in enumerate(pairs):
            both = axes[a, p] * axes[b, q] + axes[b, p] * axes[a, q]
            T[row, column] = both * (0.5 if p == q else 1.0)
    return T


_AROUND = 16  # number of corners of a drawn circle
_ODD = np.arange(1, 40, 2)


@dataclass(frozen=True)
class Rectangle:
    """Solid rectangle, ``y`` by ``z`` [m]."""

    y: float
    z: float

    def __post_init__(self) -> None:
        positive(**vars(self))

    def values(self) -> tuple[float, float, float, float]:
        long, short = max(self.y, self.z), min(self.y, self.z)
        series = np.sum(np.tanh(_ODD * np.pi * long / (2 * short)) / _ODD**5.0)
        J = long * short**3 * (1 / 3 - 64 / np.pi**5 * short / long * series)
        return self.y * self.z, self.y * self.z**3 / 12, self.z * self.y**3 / 12, float(J)

    def shear(self, nu: float) -> tuple[float, float]:
        k = 10 * (1 + nu) / (12 + 11 * nu)
        return k, k

    def points(self) -> tuple[StressPoint, ...]:
        A, _, _, J = self.values()
        y, z = self.y / 2, self.z / 2
        corners = [
            StressPoint(f"{a}y{b}z", i * y, j * z)
            for a, i in (("+", 1), ("-", -1))
            for b, j in (("+", 1), ("-", -1))
        ]
        long, short = max(self.y, self.z), min(self.y, self.z)
        at = np.pi * long / (2 * short)
        far = 1 - 8 / np.pi**2 * np.sum(1 / (_ODD**2 * np.cosh(np.minimum(_ODD * at, 300.0))))
        signs = (-1.0) ** ((_ODD - 1) // 2)
        near = 8 / np.pi**2 * np.sum(signs * np.tanh(_ODD * at) / _ODD**2)
        # factors of the shear stress in the middle of the long sides (far) and of the short sides
        # (near)
        at_y, at_z = (near, far) if self.y >= self.z else (far, near)
        by_y, by_z = float(short / J * at_y), float(short / J * at_z)
        sides = [
            StressPoint(f"{a}y", i * y, 0.0, xz=(i * by_y, 0.0, 1.5 / A))
            for a, i in (("+", 1), ("-", -1))
        ]
        sides += [
            StressPoint(f"{a}z", 0.0, i * z, xy=(-i * by_z, 1.5 / A, 0.0))
            for a, i in (("+", 1), ("-", -1))
        ]
        return (*corners, *sides)

    def outline(self) -> list[FloatArray]:
        return [polygon(-self.y / 2, -self.z / 2, self.y, self.z)]

    def tilt(self) -> tuple[float, Place]:
        return 0.0, (0.0, 0.0)


@dataclass(frozen=True)
class Tube:
    """Round tube with outer ``radius`` and ``inner`` radius [m]; a solid bar with 0."""

    radius: float
    inner: float

    def __post_init__(self) -> None:
        positive(radius=self.radius)
        if not 0 <= self.inner < self.radius:
            what = f"must lie between 0 and the outer radius {say_length(self.radius)}, given "
            what += say_length(self.inner)
            raise ReductionError.from_problems([Problem("section.inner", what)])

    def values(self) -> tuple[float, float, float, float]:
        I = math.pi / 4 * (self.radius**4 - self.inner**4)  # noqa: E741
        return math.pi * (self.radius**2 - self.inner**2), I, I, 2 * I

    def shear(self, nu: float) -> tuple[float, float]:
        m2 = (self.inner / self.radius) ** 2
        q = (1 + m2) ** 2
        k = 6 * (1 + nu) * q / ((7 + 6 * nu) * q + (20 + 12 * nu) * m2)
        return k, k

    def points(self) -> tuple[StressPoint, ...]:
        r, (_, I, _, J) = self.radius, self.values()  # noqa: E741
        # shear stress V Q/(I b) across the middle, Q of half the section
        by_force = (r**2 + r * self.inner + self.inner**2) / (3 * I)
        by_torque = r / J
        return (
            StressPoint("+y", r, 0.0, xz=(by_torque, 0.0, by_force)),
            StressPoint("-y", -r, 0.0, xz=(-by_torque, 0.0, by_force)),
            StressPoint("+z", 0.0, r, xy=(-by_torque, by_force, 0.0)),
            StressPoint("-z", 0.0, -r, xy=(by_torque, by_force, 0.0)),
        )

    def outline(self) -> list[FloatArray]:
        angles = 2 * np.pi * np.arange(_AROUND) / _AROUND
        return [self.radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)]

    def tilt(self) -> tuple[float, Place]:
        return 0.0, (0.0, 0.0)


def rectangle(y: float, z: float, **common: Any) -> BeamSection:
    """Solid rectangle, ``y`` by ``z`` [m]; ``common`` words as the module says."""
    return section_of(Rectangle(y, z), **common)


def tube(radius: float, inner: float, **common: Any) -> BeamSection:
    """Round tube with outer ``radius`` and ``inner`` radius [m]."""
    return section_of(Tube(radius, inner), **common)


def circle(radius: float, **common: Any) -> BeamSection:
    """Solid round bar of that ``radius`` [m]."""
    return section_of(Tube(radius, 0.0), **common)


Section = BeamSection | TaperedSection | ShellSection | SolidSection


SECTIONS: dict[str, Callable[..., Section]] = {
    "rectangle": rectangle,
    "tube": tube,
    "circle": circle,
    **thin_walls.SECTIONS,
    "general": general,
    "tapered": tapered,
    "shell": shell,
    "layered": layered,
    "solid": SolidSection,
}
"""What makes a section of each type."""

_VECTORS = ("orientation", "axis1", "axis2")


def sections_from(sections: Mapping[str, Any] | None) -> dict[str, Section]:
    """Sections by mesh group.

    Raises
    ------
    ReductionError, MaterialError
        What is wrong with all of them.
    """
    made: dict[str, Section] = {}
    errors: list[FlexmbError] = []
    for group, words in (sections or {}).items():
        try:
            made[group] = section_from(words, f"sections.{group}")
        except (ReductionError, MaterialError) as error:
            errors.append(error)
    if errors:
        problems = [problem for error in errors for problem in error.problems]
        raise type(errors[0]).from_problems(problems)
    return made


def section_from(words: Any, where: str = "section") -> Section:
    """The section itself, or that of ``{type = "rectangle", y = 0.02, z = 0.03}``.

    Raises
    ------
    ReductionError, MaterialError
        Unknown type, missing or unknown key, or impossible values; all at once.
    """
    if isinstance(words, Section):
        return words
    kind = kind_of("section", tuple(SECTIONS), words, where, ReductionError)
    values = option_values(read_options(OPTIONS[kind], words, where, ReductionError))
    problems: list[Problem] = []
    for name, value in values.items():
        place = f"{where}.{name}"
        try:
            values[name] = _value(name, value, place)
        except FlexmbError as error:
            problems += error.problems
    if problems:
        raise ReductionError.from_problems(problems)
    try:
        return SECTIONS[kind](**values)
    except FlexmbError as error:
        raise type(error).from_problems(rooted(where, error.problems)) from None
    except (TypeError, ValueError) as error:
        problem = Problem(where, f"cannot be understood: {error}")
        raise ReductionError.from_problems([problem]) from None


def _value(name: str, value: Any, where: str) -> Any:
    """The value of an option in the form that the function of a section takes."""
    if name == "material":
        return _material(value, where)
    if name == "releases":
        return value if isinstance(value, Releases) else Releases(value.start, value.end)
    if name in ("start", "end"):
        return section_from(value if isinstance(value, Section) else _as_words(value), where)
    if name == "layers":
        return [_layer(layer, f"{where}[{k}]") for k, layer in enumerate(value)]
    if name in _VECTORS and isinstance(value, str):
        return tuple(unit_vector(value, where))
    return tuple(value) if name in _VECTORS and isinstance(value, list) else value


def _as_words(options: Any) -> dict[str, Any]:
    return {"type": options.type, **option_values(options)}


def _layer(options: Any, where: str) -> Layer:
    if isinstance(options, Layer):
        return options
    values = option_values(options)
    if "material" in values:
        values["material"] = _material(values["material"], f"{where}.material")
    return Layer(**values)


def _material(value: Any, where: str) -> AnyMaterial:
    try:
        return resolve(value)
    except MaterialError as error:
        raise MaterialError.from_problems(rooted(where, error.problems)) from None
