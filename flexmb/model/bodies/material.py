"""Materials of a scene: a name of the library, or a table of values.

In: ``"steel"``, ``{E = 70e9, nu = 0.33, density = 2700}``, or with three directions
``{E = [..], nu = [..], G = [..], density = 1600}`` in the order 1, 2, 3 (nu and G: 12, 23, 13).
Out: a :class:`Material` or :class:`OrthotropicMaterial` in SI.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Any

from pydantic import BeforeValidator, SerializationInfo, ValidationInfo

from flexmb.errors import FlexmbError, Problem
from flexmb.materials import LIBRARY, AnyMaterial, Material, OrthotropicMaterial, material
from flexmb.model.values.quantities import Number, Quantity, plain
from flexmb.model.values.reading import Reader, Spec, choice, fail, names_of, read_entry, reference

__all__ = ["MATERIAL_KINDS", "MaterialField"]

Modulus = Annotated[float, Quantity("Pa", "positive")]
Density = Annotated[float, Quantity("kg/m^3", "positive")]
_Three = Annotated[tuple[Modulus, Modulus, Modulus], BeforeValidator(plain)]
_Ratios = Annotated[tuple[Number, Number, Number], BeforeValidator(plain)]


class MaterialSpec(Spec):
    """The same in all directions: Young's modulus, Poisson's ratio, density."""

    name: str = "given"
    E: Modulus
    nu: Number
    density: Density
    source: str = "given by the user"


class OrthotropicSpec(Spec):
    """Three directions 1, 2, 3: E of each, nu and G of the planes 12, 23, 13, density."""

    name: str = "given"
    E: _Three
    nu: _Ratios
    G: _Three
    density: Density
    source: str = "given by the user"


MATERIAL_KINDS: dict[str, type[Spec]] = {
    "isotropic": MaterialSpec,
    "orthotropic": OrthotropicSpec,
}
"""What a table of a material may be."""


def _read_material(value: Any, info: ValidationInfo) -> AnyMaterial:
    try:
        if isinstance(value, OrthotropicMaterial):
            return value
        if isinstance(value, str | Material):
            return material(value)
        directed = isinstance(value, Mapping) and (
            "G" in value or isinstance(plain(value.get("E")), list)
        )
        kind = OrthotropicSpec if directed else MaterialSpec
        values, problems = read_entry(kind, value, names_of(info))
        if values is None:
            raise fail(*problems)
        made = OrthotropicMaterial if directed else Material
        return made(**values.model_dump())
    except FlexmbError as error:
        places = (p.where.removeprefix("material").removeprefix(".") for p in error.problems)
        found = zip(places, error.problems, strict=True)
        raise fail(*(Problem(at, p.what, p.allowed, p.nearest) for at, p in found)) from None


def _write_material(value: AnyMaterial, info: SerializationInfo) -> Any:
    if LIBRARY.get(value.name) == value:
        return value.name
    kind = MaterialSpec if isinstance(value, Material) else OrthotropicSpec
    return kind.model_construct(**asdict(value)).model_dump(mode="json", context=info.context)


_MATERIAL = {"anyOf": [*choice(LIBRARY)["anyOf"], *map(reference, MATERIAL_KINDS.values())]}
MaterialField = Annotated[AnyMaterial, Reader(_read_material, _write_material, _MATERIAL)]
"""A name of the library, or a table of values in the scene's units."""
