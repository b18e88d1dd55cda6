"""Built-in linear elastic, isotropic materials with their values and sources.

In: a name such as ``"steel"``. Out: a :class:`Material` with Young's modulus E [Pa], Poisson's
ratio nu [-] and density [kg/m^3], with where they are from. Typical values at room temperature, of
standards and handbooks (unit weights of a table are divided by 9.80665 m/s^2 and rounded to three
digits): grades differ by a few per cent, plastics by half, so give your own where that matters.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, sqrt

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import MaterialError, Problem

FloatArray = NDArray[np.float64]
Three = tuple[float, float, float]


def _positive(name: str, value: float, unit: str) -> list[Problem]:
    """The problem of a value that is not positive and finite."""
    if isfinite(value) and value > 0:
        return []
    return [Problem(f"material.{name}", f"must be positive, given {value:g} {unit}")]


class _Elastic:
    """Stiffness of a linear elastic material from its constants (E1, E2, E3), nu and G."""

    def constants(self) -> tuple[Three, Three, Three]:
        """(E1, E2, E3), (nu12, nu23, nu13) and (G12, G23, G13)."""
        raise NotImplementedError

    def stiffness(self) -> FloatArray:
        """(6, 6) stress per strain, order 11, 22, 33, 23, 31, 12, engineering shear strains."""
        E, nu, (G12, G23, G13) = self.constants()
        C = np.zeros((6, 6))
        C[:3, :3] = np.linalg.inv(_compliance(E, nu))
        C[3:, 3:] = np.diag([G23, G13, G12])
        return 0.5 * (C + C.T)

    def plane_stress(self) -> FloatArray:
        """(3, 3) stress per strain in the plane 1, 2 without stress across it: 11, 22, 12."""
        (E1, E2, _), (nu12, _, _), (G12, _, _) = self.constants()
        share = 1 - nu12 * (nu12 * E2 / E1)
        return np.array(
            [
                [E1 / share, nu12 * E2 / share, 0.0],
                [nu12 * E2 / share, E2 / share, 0.0],
                [0.0, 0.0, G12],
            ]
        )

    def transverse_shear(self) -> FloatArray:
        """(2, 2) shear stress 13, 23 per shear strain."""
        _, _, (_, G23, G13) = self.constants()
        return np.diag([G13, G23])


_DENSITY = (10.0, 25e3)  # kg/m^3: foam of polystyrene is 15, osmium 22.6e3
_SOLID = (500.0, 25e3)  # of what is no foam
_FASTEST = 18e3  # m/s, sqrt(E/density): beryllium 12.5e3, diamond 17.3e3
# From a density on [kg/m^3]: the least E [Pa] and the least speed [m/s]. Soft: silicones of 50 kPa
# at 1070 (7 m/s), foams of 10 kPa at 50 (14 m/s); polymers and wood whose E slipped by 1e6 have 4
# at most. Filled rubbers, soils: 1 MPa and more. Metals, glass: thallium 820 m/s, lead 1190.
_SLOWEST = ((0.0, 0.0, 6.0), (1500.0, 1e6, 0.0), (2600.0, 1e6, 800.0))
_KG = "kg/m^3"  # in scenes in cm-g-s, mm-kg-s and mm-t-s
_DENSITY_SLIPS = (
    *((1e-12, "t/mm^3"), (1e-9, "kg/mm^3"), (1e-3, "g/cm^3")),
    *((1e3, _KG), (1e9, _KG), (1e12, _KG)),
)
_MODULUS_SLIPS = ((1e-9, "GPa"), (1e-6, "MPa"), (1e-3, "MPa in place of GPa"))
_STIFF = (1e9, 1e12)  # Pa: what an E that slipped was meant to be


@dataclass(frozen=True)
class Material(_Elastic):
    """Linear elastic, isotropic material in SI units; its axes 1, 2, 3 are any."""

    name: str
    E: float  # Pa
    nu: float  # -
    density: float  # kg/m^3
    source: str = "given by the user"

    def __post_init__(self) -> None:
        problems = _positive("E", self.E, "Pa")
        if not -1.0 < self.nu < 0.5:
            what = f"must lie between -1 and 0.5, given {self.nu:g}"
            problems.append(Problem("material.nu", what))
        problems += _positive("density", self.density, "kg/m^3")
        if problems:
            raise MaterialError.from_problems(problems)

    @property
    def G(self) -> float:
        """Shear modulus [Pa]."""
        return self.E / (2 * (1 + self.nu))

    def constants(self) -> tuple[Three, Three, Three]:
        return (self.E,) * 3, (self.nu,) * 3, (self.G,) * 3


@dataclass(frozen=True)
class OrthotropicMaterial(_Elastic):
    """Linear elastic material with three planes of symmetry, SI units, material axes 1, 2, 3.

    Parameters
    ----------
    E : (E1, E2, E3)
        Young's moduli [Pa].
    nu : (nu12, nu23, nu13)
        Poisson's ratios; nu12 is the contraction along 2 under stress along 1.
    G : (G12, G23, G13)
        Shear moduli [Pa].

    Raises
    ------
    MaterialError
        Constants that no material can have: the compliance must be positive definite.
    """

    name: str
    E: Three
    nu: Three
    G: Three
    density: float
    source: str = "given by the user"

    def __post_init__(self) -> None:
        moduli = [("E", value) for value in self.E] + [("G", value) for value in self.G]
        problems = [problem for name, value in moduli for problem in _positive(name, value, "Pa")]
        problems += _positive("density", self.density, "kg/m^3")
        if not problems and not np.linalg.eigvalsh(_compliance(self.E, self.nu))[0] > 0:
            what = f"are impossible with E = {self.E}: strain energy would be negative"
            problems.append(Problem("material.nu", f"{what}, given {self.nu}"))
        if problems:
            raise MaterialError.from_problems(problems)

    def constants(self) -> tuple[Three, Three, Three]:
        return self.E, self.nu, self.G


AnyMaterial = Material | OrthotropicMaterial


def plausibility(material: AnyMaterial) -> list[str]:
    """What hints at a slip of units in E and density, in a sentence; empty for real materials."""
    E = material.E if isinstance(material, Material) else max(material.E)
    density = material.density
    if sentence := implausible_density(density):
        return [sentence]
    softest, slowest = [row[1:] for row in _SLOWEST if row[0] <= density][-1]
    speed = sqrt(E / density)
    if E < softest or speed < slowest:
        meant = max(_STIFF[0], slowest**2 * density), _STIFF[1]
        hint = _slip(E, meant, _MODULUS_SLIPS, "Pa")
        what = f"Young's modulus {E:g} Pa is implausible at a density of {density:g} kg/m^3"
        return [what + hint]
    if speed > _FASTEST:
        return [
            f"wave speed sqrt(E/density) = {speed:.4g} m/s is above {_FASTEST:g} m/s: "
            "E in Pa and density in kg/m^3 do not fit together"
        ]
    return []


def implausible_density(density: float, slips_only: bool = False) -> str:
    """A sentence about a density [kg/m^3] that no material has, with the likely slip, or none."""
    hint = _slip(density, _SOLID, _DENSITY_SLIPS, "kg/m^3")
    if _DENSITY[0] <= density <= _DENSITY[1] or (slips_only and not hint):
        return ""
    return f"density {density:g} kg/m^3 is not that of an engineering material{hint}"


def _slip(
    value: float, range_: tuple[float, float], slips: tuple[tuple[float, str], ...], unit: str
) -> str:
    for factor, name in slips:
        if range_[0] <= value / factor <= range_[1]:
            return f"; given in {name}? Then it is {value / factor:.4g} {unit}"
    return ""


def material_problems(where: str, value: object) -> list[Problem]:
    """A name or a table in place of a material."""
    if value is None or isinstance(value, AnyMaterial):
        return []
    what = f"expects a material, given {value!r}; flexmb.fe.resolve makes one of a name or a table"
    return [Problem(where, what)]


def _compliance(E: Three, nu: Three) -> FloatArray:
    """(3, 3) strains 11, 22, 33 per stress."""
    nu12, nu23, nu13 = nu
    S = np.diag(1 / np.array(E))
    S[0, 1] = S[1, 0] = -nu12 / E[0]
    S[1, 2] = S[2, 1] = -nu23 / E[1]
    S[0, 2] = S[2, 0] = -nu13 / E[0]
    return S


_EN1993 = "EN 1993-1-1:2005, 3.2.6 (E, nu); EN 1991-1-1:2002, table A.4 (density)"
_EN10088 = "EN 10088-1:2014, grade 1.4301 (E, density); EN 1993-1-4:2006, 2.1.3 (nu)"
_EN1999 = "EN 1999-1-1:2007, 3.2.5"
_EN1563 = "EN 1563, informative annex, ferritic grade EN-GJS-400-18"
_EN1992 = (
    "EN 1992-1-1:2004, C30/37, table 3.1 (E), 3.1.3 (nu); EN 1991-1-1:2002, table A.1 (density)"
)
_EN572 = "EN 572-1:2012, soda lime silicate glass"
_SHIGLEY = "Shigley's Mechanical Engineering Design, 10th ed., table A-5"
_ASHBY = (
    "Ashby, Materials Selection in Mechanical Design, appendix A: middle of the range (E, density);"
    " nu: 0.4 taken for all thermoplastics"
)

LIBRARY: dict[str, Material] = {
    entry.name: entry
    for entry in (
        Material("steel", 210e9, 0.3, 7850.0, _EN1993),
        Material("stainless steel", 200e9, 0.3, 7900.0, _EN10088),
        Material("aluminium", 70e9, 0.3, 2700.0, _EN1999),
        Material("titanium", 114e9, 0.34, 4430.0, _SHIGLEY + ", titanium alloys"),
        Material("cast iron", 100e9, 0.211, 7200.0, _SHIGLEY + ", gray cast iron"),
        Material("ductile iron", 169e9, 0.275, 7100.0, _EN1563),
        Material("brass", 106e9, 0.324, 8540.0, _SHIGLEY),
        Material("bronze", 111e9, 0.349, 8170.0, _SHIGLEY + ", phosphor bronze"),
        Material("copper", 119e9, 0.326, 8900.0, _SHIGLEY),
        Material("magnesium", 44.8e9, 0.35, 1790.0, _SHIGLEY),
        Material("inconel", 214e9, 0.29, 8490.0, _SHIGLEY),
        Material("concrete", 33e9, 0.2, 2450.0, _EN1992),
        Material("glass", 70e9, 0.2, 2500.0, _EN572),
        Material("abs", 2.0e9, 0.4, 1110.0, _ASHBY),
        Material("nylon", 2.9e9, 0.4, 1130.0, _ASHBY),
        Material("pom", 3.8e9, 0.4, 1410.0, _ASHBY),
    )
}
_ALIASES = {"aluminum": "aluminium", "grey cast iron": "cast iron", "gray cast iron": "cast iron"}

COLUMNS = ("material", "E [GPa]", "nu", "density [kg/m³]", "source of the typical values")
"""Headings of the rows of :func:`table`."""


def table() -> list[tuple[str, ...]]:
    """The library as rows of text, one for each material; columns as `COLUMNS` says."""
    return [
        (m.name, f"{m.E / 1e9:g}", f"{m.nu:g}", f"{m.density:g}", m.source)
        for m in LIBRARY.values()
    ]


def material(name: str | Material) -> Material:
    """The library material of that name; upper and lower case, ``_`` and ``-`` do not matter.

    Raises
    ------
    MaterialError
        Unknown name; lists those there are, nearest first.
    """
    if isinstance(name, Material):
        return name
    key = str(name).casefold().replace("_", " ").replace("-", " ").strip()
    key = _ALIASES.get(key, key)
    if key in LIBRARY:
        return LIBRARY[key]
    raise MaterialError.unknown_name("material", key, LIBRARY, "material")
