"""What there is to choose from for flexible bodies: elements, meshes, sections, materials, ways.

In: nothing. Out: a :class:`Listing` each, read off the tables that the program itself works with.
"""

from __future__ import annotations

from flexmb.workflow.listings import Listing, Table, fields_tables

__all__ = ["elements", "materials", "meshes", "reductions", "sections"]


def elements() -> Listing:
    """Kinds of elements."""
    from flexmb.fe import ELEMENTS

    table = Table(("in the mesh", "what it is"), list(ELEMENTS.items()))
    about = "Elements that make up a flexible body: solids always, surfaces and lines where a "
    about += "section names them (flexmb list sections); others only name groups:"
    return Listing("elements of flexible bodies", ((about, table),))


def meshes() -> Listing:
    """Simple shapes."""
    from flexmb.model.bodies.mesh_body import MESH_TYPES

    about = 'A mesh is a file, "rod.msh", or the table of a simple shape, such as '
    about += '{ type = "box", size = [1, 0.1, 0.1] }. Elements not told by divisions: along the '
    about += "longest edge 10 (20 of first order), along the others as many as make their edges as "
    about += "long, at least 2; around circles 16 (32):"
    return Listing(
        "meshes: [bodies.name] mesh = ...", ((about, Table((), [])), *fields_tables(MESH_TYPES))
    )


def sections() -> Listing:
    """Sections of beams, shells and solids."""
    from flexmb.flexbody.section_options import LayerOptions, ReleasesOptions
    from flexmb.model.bodies.mesh_body import SECTION_TYPES
    from flexmb.model.bodies.option_specs import spec_of

    about = "The section of each element group of a mesh; all takes what no other names:"
    kinds = {**SECTION_TYPES, "a layer": spec_of(LayerOptions)}
    kinds["releases"] = spec_of(ReleasesOptions)
    return Listing(
        "sections: [bodies.name] sections.group = { ... }",
        ((about, Table((), [])), *fields_tables(kinds)),
    )


def reductions() -> Listing:
    """How meshes become modes."""
    from flexmb.flexbody.mesh_options import REDUCTIONS, MassOptions, NodeSpringOptions, TieOptions
    from flexmb.model.bodies.mesh_body import LOAD_TYPES, InterfaceSpec, MeshBodySpec, ModesSpec
    from flexmb.model.bodies.option_specs import spec_of

    kinds = {
        "a body": MeshBodySpec,
        "modes": ModesSpec,
        "an interface": InterfaceSpec,
        "a tie": spec_of(TieOptions),
        "a mass": spec_of(MassOptions),
        "a spring": spec_of(NodeSpringOptions),
        **LOAD_TYPES,
    }
    about = "How the mesh of a flexible body becomes modes:"
    table = Table(("reduction", "what it keeps"), list(REDUCTIONS.items()))
    return Listing("flexible bodies: [bodies.name]", ((about, table), *fields_tables(kinds)))


def materials() -> Listing:
    """The library, and what a table of a material holds."""
    from flexmb.materials import LIBRARY
    from flexmb.model.bodies.option_specs import MATERIAL_KINDS

    rows = [
        (entry.name, f"{entry.E / 1e9:g}", f"{entry.nu:g}", f"{entry.density:g}", entry.source)
        for entry in LIBRARY.values()
    ]
    about = "Linear elastic and isotropic; typical values, give your own where grades matter:"
    columns = ("material", "E [GPa]", "nu", "density [kg/m^3]", "source")
    return Listing("materials", ((about, Table(columns, rows)), *fields_tables(MATERIAL_KINDS)))
