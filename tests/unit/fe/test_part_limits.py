"""Parts asked for what they do not have: frequencies in an empty band, buckling under tension, and
known answers of what was not computed."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.errors import ReductionError, SceneError
from flexmb.fe import part
from flexmb.workflow.part_analysis import run_part

BAR = {"type": "box", "size": [0.2, 0.02, 0.01], "divisions": [10, 1, 1]}
HELD = {"wall": {"group": "x0", "type": "clamped"}}
STEEL = {"E": 210e9, "nu": 0.3, "density": 7850.0}


def test_a_band_without_frequencies_names_the_nearest():
    f = part(BAR, material=STEEL, supports=HELD, frequencies=2).frequencies
    options = {"material": STEEL, "supports": HELD}
    below = f"frequencies.band: holds no natural frequency; the nearest is {f[0]:.4g} Hz"
    with pytest.raises(ReductionError, match=below):
        part(BAR, **options, frequencies={"band": [1.0, 2.0]})
    between = f"the nearest are {f[0]:.4g} Hz and {f[1]:.4g} Hz"
    with pytest.raises(ReductionError, match=between):
        part(BAR, **options, frequencies={"band": [1.01 * f[0], 0.99 * f[1]]})


def test_a_part_under_tension_does_not_buckle_elastically():
    """Local compression beside its support has factors far beyond elasticity, which took minutes
    or were not found."""
    options = {"material": STEEL, "supports": HELD, "buckling": 1}
    load = {"type": "traction", "group": "x1", "traction": [1.0, 0.0, 0.0]}
    pulled = part(BAR, **options, loads={"pull": load})
    assert not len(pulled.load_factors)
    (limit,) = [note for note in pulled.notes if "the loads do not buckle the part" in note]
    largest = pulled.quantity("von_mises")
    assert f"no load factor below {10 * 210e9 / largest:.3g}, where stress is 10 times" in limit
    pushed = part(BAR, **options, loads={"push": {**load, "traction": [-1.0, 0.0, 0.0]}})
    euler = np.pi**2 * 210e9 * 0.02 * 0.01**3 / 12 / (4 * 0.2**2) / (0.02 * 0.01)
    assert pushed.load_factors[0] == pytest.approx(euler, rel=0.03)
    assert not pushed.notes


def test_a_column_without_stress_points_buckles():
    """Euler's load of a clamped column of a section that states no points for stress."""
    column = part(
        {"type": "beam", "length": 1.0, "divisions": 8},
        material=STEEL,
        sections={"all": {"type": "general", "A": 1e-4, "Iy": 1e-9, "Iz": 2e-9, "J": 1e-9}},
        supports={"foot": {"group": "start", "type": "clamped"}},
        loads={"weight": {"type": "force", "group": "end", "force": [-1.0, 0.0, 0.0]}},
        buckling=1,
    )
    assert column.load_factors[0] == pytest.approx(np.pi**2 * 210.0 / 4, rel=1e-4)


def test_all_known_answers_that_a_part_does_not_have_are_told(tmp_path):
    scene = """title = "a bar"
[bodies.bar]
mesh = { type = "box", size = [0.2, 0.02, 0.01], divisions = [10, 1, 1] }
material = "steel"
[part]
frequencies = { count = 2 }
[part.supports]
wall = { group = "x0", type = "clamped" }
"""
    for quantity in ("frequency.1", "frequency.9", "displacement.x1.z"):
        scene += f'[[check]]\npart = "{quantity}"\nvalue = 1\ntolerance = 1\nsource = "none"\n'
    (tmp_path / "scene.toml").write_text(scene)
    with pytest.raises(SceneError) as told:
        run_part(tmp_path / "scene.toml", pictures=False, output=tmp_path / "out")
    text = str(told.value)
    assert "check[1].part: bar: has no natural frequency 9; it has 2" in text
    assert "check[2].part: bar: has no static solution, since nothing loads it" in text
    assert "check[0]" not in text
