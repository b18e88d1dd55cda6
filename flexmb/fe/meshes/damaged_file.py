"""A sentence on a mesh file that no parser can read, which says what is wrong and what to do.

In: the file and the error of its parser, whose message is about arrays and Python. Out: the file is
empty, truncated at some place, or not of the format that its suffix says.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree.ElementTree import ParseError

_GMSH_NUMBERS = (b"Nodes", b"Elements")  # sections of a Gmsh file that hold nothing but numbers
_HDF5 = (".med", ".h5", ".cgns")
_HDF5_HEAD = b"\x89HDF\r\n\x1a\n"
_HDF5_SIZES = re.compile(r"eof = (\d+).*stored_eof = (\d+)")


def damage(source: Path, error: BaseException | None) -> str:
    """A sentence on the file without its name."""
    data = source.read_bytes()
    suffix = source.suffix.lower()
    if not data.strip():
        return "the mesh file is empty"
    if isinstance(error, ModuleNotFoundError) and error.name:
        package, cure = error.name.split(".")[0], "export it as .msh, .vtu, .med, .inp or .bdf"
        return f"{suffix} files need the package {package}, which is not installed; or {cure}"
    sentence = ""
    if suffix == ".msh":
        sentence = _gmsh_damage(data)
    elif suffix in _HDF5:
        sizes = _HDF5_SIZES.search(str(error))
        if not data.startswith(_HDF5_HEAD):
            sentence = f"the mesh file is no HDF5 file, which {suffix} files are"
        elif sizes is not None:
            sentence = f"the mesh file is truncated: it has {sizes[1]} of {sizes[2]} bytes"
    elif isinstance(error, ParseError):
        line = error.position[0]
        begins = data.lstrip().startswith(b"<")
        what = f"its XML breaks off or is wrong at line {line}"
        sentence = f"the mesh file is damaged: {what if begins else 'it is no XML file'}"
    if not sentence:
        other = f"not the {suffix} format that its suffix says, or has what is not read of it"
        cure = "export it again, or as .msh, .vtu, .med, .inp or .bdf"
        return f"the mesh file is damaged, truncated, {other}; {cure}"
    return f"{sentence}; export it again"


def _gmsh_damage(data: bytes) -> str:
    """Sections of a Gmsh file that do not end, are missing, or contain something else than
    numbers."""
    if not data.lstrip().startswith(b"$"):
        return "the mesh file is no Gmsh file: it does not begin with $MeshFormat"
    begins = list(re.finditer(rb"^\$(?!End)(\w+)", data, re.M))
    for begin in begins:
        name = begin[1]
        end = re.compile(rb"^\$End" + name + rb"\b", re.M).search(data, begin.end())
        line = data.count(b"\n", 0, begin.start()) + 1
        where = f"section ${name.decode('ascii', 'replace')} (line {line})"
        if end is None:
            total = data.count(b"\n") + (not data.endswith(b"\n"))
            return f"the mesh file is truncated: its {where} has no end; the file has {total} lines"
        if name in _GMSH_NUMBERS and not _is_binary(data):
            for k, row in enumerate(data[begin.end() : end.start()].splitlines()):
                if not _numbers(row):
                    word = row.decode("utf-8", "replace").strip()[:40]
                    return f'the mesh file is damaged: line {line + k} has "{word}" for numbers'
    present = {begin[1] for begin in begins}
    missing = [f"${name.decode()}" for name in _GMSH_NUMBERS if name not in present]
    if missing:
        return f"the mesh file has no section {' and '.join(missing)}: it is truncated or no mesh"
    what = "its sections do not hold as many numbers as they say"
    return f"the mesh file is damaged: {what}"


def _is_binary(data: bytes) -> bool:
    head = re.search(rb"\$MeshFormat\s+\S+\s+(\d)", data)
    return head is not None and head[1] == b"1"


def _numbers(row: bytes) -> bool:
    try:
        return all(math.isfinite(float(word)) for word in row.split())
    except ValueError:
        return False
