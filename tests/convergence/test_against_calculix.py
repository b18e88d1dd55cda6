"""The first twelve clamped frequencies against CalculiX (ccx), if it is installed."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from femeshes import held_frequencies, solid_box

from flexmb.fe import assemble, resolve
from flexmb.fe.elements import element_blocks as registry
from flexmb.fe.elements.element_family import tetrahedron_rule, wedge_rule

STEEL = resolve("steel")
PRINTED = 6e-7  # ccx prints seven digits, so the last is uncertain by 5e-7 at worst
TYPES = {"tetra": "C3D4", "tetra10": "C3D10", "hexahedron20": "C3D20", "wedge15": "C3D15"}
MASS_RULES = {  # those of ccx
    "tetra": tetrahedron_rule(1),
    "tetra10": tetrahedron_rule(2),
    "wedge15": wedge_rule(2, 5),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*first-order tetrahedra")
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not on PATH")
@pytest.mark.parametrize("kind", TYPES)
def test_twelve_clamped_frequencies(kind, tmp_path, monkeypatch):
    family = registry.FAMILIES[kind]
    if kind in MASS_RULES:
        family = replace(family, mass_rule=MASS_RULES[kind])
        monkeypatch.setitem(registry.FAMILIES, kind, family)
    mesh = solid_box(kind, (6, 3, 2), (3.0, 1.0, 0.7), distort=0.2, shape=twisted)
    fe = assemble(mesh, STEEL)
    held = fe.numbering.table[mesh.node_sets["x0"], :3].ravel()
    found = held_frequencies(fe, held, 12) / (2 * np.pi)
    wanted = calculix(kind, mesh, tmp_path)
    np.testing.assert_allclose(found, wanted, rtol=PRINTED)


def twisted(points):
    """A block twisted about x, so that its elements are curved or warped."""
    x, y, z = points.T
    angle = 0.1 * x
    return np.stack(
        [x, np.cos(angle) * y - np.sin(angle) * z, np.sin(angle) * y + np.cos(angle) * z], 1
    )


def calculix(kind, mesh, folder):
    """Frequencies [Hz] that ccx finds."""
    cells = mesh.blocks[kind] + 1
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n + 1}, " + ", ".join(f"{c:.17g}" for c in p) for n, p in enumerate(mesh.points)]
    lines += [f"*ELEMENT, TYPE={TYPES[kind]}, ELSET=BODY"]
    for number, nodes in enumerate(cells, start=1):
        words = [str(word) for word in (number, *nodes)]
        lines += [", ".join(words[:11]) + ("," if words[11:] else "")]
        lines += [", ".join(words[11:])] if words[11:] else []
    lines += ["*NSET, NSET=ROOT", *(f"{n + 1}," for n in mesh.node_sets["x0"])]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{STEEL.E:.17g}, {STEEL.nu}"]
    lines += ["*DENSITY", f"{STEEL.density:.17g}", "*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL"]
    lines += ["*BOUNDARY", "ROOT, 1, 3", "*STEP", "*FREQUENCY", "12", "*END STEP", ""]
    (folder / "block.inp").write_text("\n".join(lines))
    run = subprocess.run(
        ["ccx", "block"], cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    assert run.returncode == 0, run.stdout[-2000:]
    rows = [line.split() for line in (folder / "block.dat").read_text().splitlines()]
    table = [row for row in rows if len(row) == 5 and row[0].isdigit()]
    return np.array([float(row[3]) for row in table[:12]])
