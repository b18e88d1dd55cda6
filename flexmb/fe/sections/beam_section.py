"""A beam's cross-section: values, place on the element, material, end releases, stress points.

y and z are principal centroidal axes, x runs along the beam from its first to its second node; Iy =
int z^2 dA bends in the xz plane, Iz = int y^2 dA in the xy plane. At a :class:`StressPoint` the
axial stress is N/A + My z/Iy - Mz y/Iz; the point stores the shear stresses per torque and shear
forces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from flexmb.errors import MaterialError, Problem, ReductionError, nearest
from flexmb.flexbody.arrays import FloatArray
from flexmb.materials import AnyMaterial, Material, material_problems
from flexmb.units import say_length

Place = tuple[float, float]
Three = tuple[float, float, float]


@dataclass(frozen=True)
class StressPoint:
    """One place of a section where stress is evaluated.

    Parameters
    ----------
    name : str
        Name of the stress layer.
    y, z : float
        From the centroid, principal axes [m].
    xy, xz : (3,) float
        Shear stress along y and z per torque T [1/m^3] and per shear forces Vy, Vz [1/m^2].
    """

    name: str
    y: float
    z: float
    xy: Three = (0.0, 0.0, 0.0)
    xz: Three = (0.0, 0.0, 0.0)


def rotated(place: Place, angle: float) -> Place:
    """A place in axes turned by ``angle`` [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return c * place[0] + s * place[1], c * place[1] - s * place[0]


Vector = tuple[float, float, float]


MOTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
"""Motions of a node in the section's axes, x along the beam."""


@dataclass(frozen=True)
class Releases:
    """Released motions (hinges) of the two ends of a chain, by their names in ``MOTIONS``.

    Raises
    ------
    ReductionError
        Unknown names.
    """

    start: tuple[str, ...] = ()
    end: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        problems = [
            Problem(f"section.releases.{end}", f'unknown "{name}"', MOTIONS, nearest(name, MOTIONS))
            for end in ("start", "end")
            for name in getattr(self, end)
            if name not in MOTIONS
        ]
        if problems:
            raise ReductionError.from_problems(problems)

    def __bool__(self) -> bool:
        return bool(self.start or self.end)


def join_releases(releases: Releases | Mapping[str, Any] | None) -> Releases:
    """Releases from ``{start = ["ry", "rz"], end = ["rx"]}``.

    Raises
    ------
    ReductionError
        Unknown words.
    """
    if releases is None:
        return Releases()
    if isinstance(releases, Releases):
        return releases
    words, names = dict(releases), ("start", "end")
    problems = [
        Problem(f"section.releases.{key}", "unknown key", names, nearest(key, names))
        for key in words
        if key not in names
    ]
    if problems:
        raise ReductionError.from_problems(problems)
    return Releases(**{key: tuple(str(name) for name in value) for key, value in words.items()})


@dataclass(frozen=True)
class BeamSection:
    """A beam's cross-section.

    Parameters
    ----------
    A : float
        Area [m^2].
    Iy, Iz : float
        int z^2 dA and int y^2 dA, principal axes [m^4].
    J : float
        Torsion constant [m^4].
    ky, kz : float
        Shear coefficients for forces along y and z; infinity means no shear deformation.
    orientation : (3,) float, optional
        Direction, body frame, whose part perpendicular to the beam is the section's y. By default
        y is perpendicular to the z axis of the body frame (and is its y axis for a beam along z).
    material : Material, optional
        The body's by default; isotropic.
    offset : (2,) float
        Place of the centroid from the line between the nodes, along the section's y and z [m]; a
        rigid arm joins them.
    nonstructural : float
        Additional mass per length, at the centroid [kg/m].
    releases : Releases
        Motions that are released (hinges) at the first and the last node of the group.
    angle : float
        From the section's axes to the principal ones, about x [rad].
    shear_center : (2,) float
        Place of the shear centre from the centroid, principal axes [m]; the section twists about
        it.
    points : tuple of StressPoint
        Where stress is reported.
    shape : Shape, optional
        The dimensions from which all these values were computed.
    by_shape : bool
        Whether ky and kz are computed by the shape's formula from Poisson's ratio of the material.

    Raises
    ------
    ReductionError
        Values that no section can have, all at once.
    """

    A: float
    Iy: float
    Iz: float
    J: float
    ky: float = math.inf
    kz: float = math.inf
    orientation: Vector | None = None
    material: AnyMaterial | None = None
    offset: Place = (0.0, 0.0)
    nonstructural: float = 0.0
    releases: Releases = field(default_factory=Releases)
    angle: float = 0.0
    shear_center: Place = (0.0, 0.0)
    points: tuple[StressPoint, ...] = ()
    shape: object = None
    by_shape: bool = False

    dimension = 1

    def __post_init__(self) -> None:
        problems = [
            Problem(f"section.{name}", f"must be positive, given {getattr(self, name)}")
            for name in ("A", "Iy", "Iz", "J", "ky", "kz")
            if not getattr(self, name) > 0
        ]
        problems += [
            Problem(f"section.{name}", f"must be finite, given {getattr(self, name)}")
            for name in ("A", "Iy", "Iz", "J")
            if not math.isfinite(getattr(self, name))
        ]
        if not 0 <= self.nonstructural < math.inf:
            what = f"must not be negative, given {self.nonstructural} kg/m"
            problems.append(Problem("section.nonstructural", what))
        problems += material_problems("section.material", self.material)
        problems += _vector_problems("offset", self.offset, 2)
        if self.orientation is not None:
            problems += _vector_problems("orientation", self.orientation, 3)
            if not problems and not np.linalg.norm(self.orientation) > 0:
                what = "must be three numbers, not all zero"
                problems.append(Problem("section.orientation", what))
        if problems:
            raise ReductionError.from_problems(problems)

    def with_material(self, default: AnyMaterial | None) -> BeamSection:
        """The section with its material known, and the shear coefficients that follow from it.

        Raises
        ------
        MaterialError
            The material is not isotropic.
        """
        material = self.material if self.material is not None else default
        if material is None:
            return self
        if not isinstance(material, Material):
            what = f'beams need an isotropic material, "{material.name}" is not: give the section'
            raise MaterialError(f"{what} a material of its own")
        if not self.by_shape:
            return replace(self, material=material)
        ky, kz = self.shape.shear(material.nu)  # type: ignore[attr-defined]
        return replace(self, material=material, ky=ky, kz=kz)

    def at(self, fraction: float) -> BeamSection:
        """The section itself, everywhere along its group."""
        return self


def general(
    A: float,
    Iy: float,
    Iz: float,
    J: float,
    *,
    Iyz: float = 0.0,
    points: Mapping[str, Place] | None = None,
    ky: float = math.inf,
    kz: float = math.inf,
    shear_center: Place = (0.0, 0.0),
    orientation: Vector | None = None,
    material: AnyMaterial | None = None,
    offset: Place = (0.0, 0.0),
    nonstructural: float = 0.0,
    releases: Releases | Mapping[str, object] | None = None,
) -> BeamSection:
    """Section by its values about the centroid.

    Parameters
    ----------
    A, Iy, Iz, J
        Area [m^2], int z^2 dA, int y^2 dA and torsion constant [m^4].
    Iyz : float
        int y z dA [m^4]; the principal axes are found from it.
    points : mapping of str to (y, z), optional
        Places from the centroid where stress is reported [m]: axial stress only.
    ky, kz : float
        Shear coefficients along the principal axes.
    shear_center : (y, z)
        From the centroid [m].
    orientation, material, offset, nonstructural, releases
        As in :class:`BeamSection`.

    Raises
    ------
    ReductionError
        Values that no section can have.
    """
    first, second, angle = principal(Iy, Iz, Iyz)
    named = tuple(
        StressPoint(name, *rotated((place[0], place[1]), angle))
        for name, place in (points or {}).items()
    )
    return BeamSection(
        A,
        first,
        second,
        J,
        ky,
        kz,
        orientation,
        material,
        offset,
        nonstructural,
        join_releases(releases),
        angle,
        rotated(shear_center, angle),
        named,
    )


def principal(Iy: float, Iz: float, Iyz: float) -> tuple[float, float, float]:
    """Principal second moments and the angle to their axes, the smallest one that diagonalises.

    The first stays the one nearer to Iy, so that the angle is between -45 and 45 degrees.
    """
    if Iyz == 0:
        return Iy, Iz, 0.0
    angle = 0.5 * math.atan2(2 * Iyz, Iz - Iy)
    if abs(angle) > math.pi / 4 * (1 + 1e-9):  # the legs of an equal angle differ by round-off
        angle -= math.copysign(math.pi / 2, angle)
    c, s = math.cos(angle), math.sin(angle)
    first = Iy * c * c + Iz * s * s - 2 * Iyz * s * c
    second = Iy * s * s + Iz * c * c + 2 * Iyz * s * c
    return first, second, angle


def _vector_problems(name: str, value: object, size: int) -> list[Problem]:
    words = {2: "two", 3: "three"}[size]
    try:
        values = np.asarray(value, dtype=float)
        good = values.shape == (size,) and bool(np.isfinite(values).all())
    except (TypeError, ValueError):
        good = False
    if good:
        return []
    return [Problem(f"section.{name}", f"must be {words} numbers, given {value}")]


class Shape(Protocol):
    """Dimensions of a section, and what follows from them."""

    def values(self) -> tuple[float, float, float, float]:
        """A, Iy, Iz, J in principal axes."""
        ...

    def shear(self, nu: float) -> tuple[float, float]:
        """Shear coefficients ky, kz in principal axes."""
        ...

    def points(self) -> tuple[StressPoint, ...]:
        """Where stress is reported."""
        ...

    def outline(self) -> list[FloatArray]:
        """Convex polygons (p, 2) that make up the section, anticlockwise, for pictures [m]."""
        ...

    def tilt(self) -> tuple[float, Place]:
        """Angle of the principal axes [rad], and the shear centre from the centroid in them."""
        ...


def section_of(
    shape: Shape,
    *,
    shear: bool = True,
    ky: float | None = None,
    kz: float | None = None,
    orientation: Vector | None = None,
    material: AnyMaterial | None = None,
    offset: Place = (0.0, 0.0),
    nonstructural: float = 0.0,
    releases: Releases | Mapping[str, Any] | None = None,
) -> BeamSection:
    """The section of a shape.

    Its shear coefficients are those at Poisson's ratio 0 until its material is known.

    Raises
    ------
    ReductionError
        Values that no section can have.
    """
    A, Iy, Iz, J = shape.values()
    own_coefficients = ky is not None or kz is not None
    own = shape.shear(0.0) if shear else (math.inf, math.inf)
    angle, center = shape.tilt()
    return BeamSection(
        A,
        Iy,
        Iz,
        J,
        own[0] if ky is None else ky,
        own[1] if kz is None else kz,
        orientation,
        material,
        offset,
        nonstructural,
        join_releases(releases),
        angle,
        center,
        shape.points(),
        shape,
        shear and not own_coefficients,
    )


def positive(**values: Any) -> None:
    """Refuse dimensions that are not positive numbers.

    Raises
    ------
    ReductionError
        With all of them.
    """
    problems = []
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float | np.number):
            problems.append(Problem(f"section.{name}", f"must be a number, given {value!r}"))
        elif not 0 < value < math.inf:
            problems.append(
                Problem(f"section.{name}", f"must be positive, given {say_length(value)}")
            )
    if problems:
        raise ReductionError.from_problems(problems)


def outline(section: BeamSection) -> list[FloatArray]:
    """Polygons (p, 2), y and z from the centroid along the principal axes [m], anticlockwise.

    A section that is known by its values alone is drawn as the rectangle with its radii of
    gyration.
    """
    shape: Any = section.shape
    if shape is None:
        y, z = (math.sqrt(12 * value / section.A) for value in (section.Iz, section.Iy))
        return [polygon(-y / 2, -z / 2, y, z)]
    parts = shape.outline()
    areas = np.array([np.prod(np.ptp(part, axis=0)) for part in parts])
    middle = areas @ [part.mean(axis=0) for part in parts] / areas.sum()
    c, s = math.cos(section.angle), math.sin(section.angle)
    return [(part - middle) @ np.array([[c, -s], [s, c]]) for part in parts]


def polygon(y: float, z: float, width: float, height: float) -> FloatArray:
    """(4, 2) corners of a rectangle with its lower left corner at y, z."""
    return np.array([[y, z], [y + width, z], [y + width, z + height], [y, z + height]])
