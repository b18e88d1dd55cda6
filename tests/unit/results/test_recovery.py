"""Stress and section forces along a run: superposed, then von Mises; peaks, channels, mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from femeshes import line
from resultfiles import SCENE, block, writer

from flexmb.errors import ResultFileError
from flexmb.fe import rectangle, reduce
from flexmb.flexbody import rigid_body, save, von_mises
from flexmb.results import Result, recovery

SWING = np.array([[0.0, 0.0], [1.0, -2.0], [-3.0, 0.5], [0.5, 0.5]]) * 1e-6


@pytest.fixture(scope="module")
def body():
    """Two bending modes of a free beam."""
    sections = {"all": rectangle(0.02, 0.03)}
    return reduce(line(4), material="steel", sections=sections, modes=2, name="rod")


def run(folder: Path, body, **scene) -> Result:
    """Four rows 0.01 s apart in which the rod's two modal coordinates are those of SWING."""
    rows = block(0, 4)
    rows.q[:, 14:16] = SWING
    save(body, folder / "rod.flexbody.h5")
    told = {"scene": {**SCENE, **scene}, "flexbodies": {"rod": "rod.flexbody.h5"}}
    with writer(folder / "result.h5", **told) as out:
        out.append(rows)
    return Result(out.path)


@pytest.fixture
def result(tmp_path: Path, body) -> Result:
    return run(tmp_path, body)


def test_stress_is_superposed_before_von_mises(result: Result, body) -> None:
    modes = body.stress.modes.astype(float)
    for row, eta in enumerate(SWING):
        wanted = modes @ eta
        scale = np.abs(wanted).max() + 1.0
        found = result.stress("rod", 0.01 * row)
        np.testing.assert_allclose(found.values, wanted, atol=1e-12 * scale)
        np.testing.assert_allclose(
            result.von_mises("rod", 0.01 * row).values, von_mises(wanted), atol=1e-12 * scale
        )
    whole = result.stress("rod")
    assert whole.values.shape == (4, len(body.stress.ids), 6)
    np.testing.assert_array_equal(whole.node, body.stress.ids)
    assert set(whole.layer) == set(body.stress.layers)
    assert set(whole.part) == {"all"}


def test_between_rows_stress_is_linear(result: Result) -> None:
    middle = result.stress("rod", 0.015).values
    np.testing.assert_allclose(
        middle, result.stress("rod").values[1:3].mean(axis=0), atol=1e-9 * np.abs(middle).max()
    )


def test_nodes_and_layers_are_chosen(result: Result) -> None:
    one = result.stress("rod", node=2, layer="+y+z")
    assert one.values.shape == (4, 1, 6)
    assert (list(one.node), one.layer) == ([2], ("+y+z",))
    top = result.von_mises("rod", layer="+y+z")
    assert top.values.shape == (4, 5)
    np.testing.assert_allclose(top.values[:, 2], von_mises(one.values[:, 0]))


def test_peaks_are_the_largest_of_all_rows_however_they_are_cut(
    result: Result, monkeypatch
) -> None:
    whole = result.von_mises("rod").values
    monkeypatch.setattr(recovery, "_BATCH_BYTES", 1.0)  # one row at a time
    peak = result.peak_von_mises("rod")
    np.testing.assert_allclose(peak.values, whole.max(axis=0), rtol=1e-12)
    moved = peak.values > 0
    np.testing.assert_allclose(peak.time[moved], 0.01 * whole.argmax(axis=0)[moved])
    assert peak.values[peak.place] == whole.max()


def test_section_forces_are_those_of_the_modes(result: Result, body) -> None:
    found = result.section_forces("rod")
    assert found.force.shape == (4, 4, 2, 3)
    wanted = body.section_forces.modes @ SWING[2]
    np.testing.assert_allclose(found.force[2], wanted[:, :, :3], atol=1e-9)
    np.testing.assert_allclose(found.moment[2], wanted[:, :, 3:], atol=1e-9)
    free_end = np.abs(found.moment[:, 0, 0]).max() / np.abs(found.moment).max()
    assert free_end < 0.1  # the inertia next to it, of one element in four


def test_channels_by_name(result: Result, tmp_path: Path) -> None:
    assert result.channels("stress") == ("rod.von_mises",)
    whole = result.von_mises("rod")
    np.testing.assert_array_equal(result["rod.von_mises"], whole.values.max(axis=1))
    at_node = whole.values[:, whole.node == 3].max(axis=1)
    np.testing.assert_allclose(result["rod.von_mises.3"], at_node, rtol=1e-12)
    one = result.stress("rod", node=3, layer="+y+z").values[:, 0, 0]
    np.testing.assert_array_equal(result["rod.stress.3.+y+z.xx"], one)
    moment = result.section_forces("rod").moment[:, 1, 0, 2]
    np.testing.assert_array_equal(result["rod.section_force.1.1.Mz"], moment)
    assert result.unit("rod.von_mises.3") == "Pa"
    assert (result.unit("rod.section_force.1.1.N"), result.unit("rod.section_force.1.1.Mz")) == (
        "N",
        "N m",
    )
    text = result.to_csv(tmp_path / "a.csv", ["rod.von_mises"]).read_text()
    assert text.startswith("time [s],rod.von_mises [Pa]\n")


def test_numbers_are_told_in_the_units_of_the_scene(tmp_path: Path, body) -> None:
    result = run(tmp_path, body, units="mm-t-s")
    wanted = von_mises(body.stress.modes.astype(float) @ SWING[1]).max() * 1e-6
    assert result["rod.von_mises"][1] == pytest.approx(wanted)
    assert result.unit("rod.von_mises") == "MPa"
    np.testing.assert_array_equal(result["rod.stress.3.+y.all.xx"], result["rod.stress.3.+y.xx"])
    np.testing.assert_array_equal(result["rod.von_mises.3.all"], result["rod.von_mises.3"])
    moment = (body.section_forces.modes @ SWING[1])[0, 1, 5] * 1e3  # N mm
    assert result["rod.section_force.0.2.Mz"][1] == pytest.approx(moment)


@pytest.mark.parametrize(
    ("ask", "sentence"),
    [
        (lambda r: r.stress("rot"), 'no flexible body "rot"; nearest: rod'),
        (lambda r: r.stress("crank"), 'no flexible body "crank"'),
        (lambda r: r.stress("rod", node=77), "no stress at node 77; it has stress at 5 nodes"),
        (lambda r: r.stress("rod", layer="+y+s"), 'layer "\\+y\\+s"; nearest: \\+y'),
        (lambda r: r.stress("rod", 1.0), "outside the run"),
        (lambda r: r["rod.stress.3.xx"], "has 8 stresses at node 3 .*name a layer"),
        (lambda r: r.stress("rod", section="al"), 'no stress in a section "al"; nearest: all'),
        (lambda r: r["rod.stress.3.+y.xz"], '"xz" is no component of stress; allowed: xx'),
        (lambda r: r["rod.stress.xx"], "is not of the form rod.stress.17.xx"),
        (lambda r: r["rod.stress.a.xx"], '"a" is no number of a node'),
        (
            lambda r: r["rod.von_mises.1.2.3"],
            'no stress in a layer or section "2.3"; allowed: .*all',
        ),
        (lambda r: r["rod.section_force.9.1.N"], "no beam element 9; it has those from 0 to 3"),
        (lambda r: r["rod.section_force.1.3.N"], '"3" is no end of a beam element'),
        (lambda r: r["rod.section_force.1"], "is not of the form"),
        (lambda r: r.channels("stres"), "nearest: stress"),
    ],
)
def test_mistakes_are_told(result: Result, ask, sentence) -> None:
    with pytest.raises(ResultFileError, match=sentence):
        ask(result)


def test_a_body_without_stress_and_one_that_is_too_large(tmp_path, body, monkeypatch) -> None:
    import dataclasses

    bare = run(tmp_path, dataclasses.replace(body, stress=None, section_forces=None))
    for ask in (bare.stress, bare.von_mises, bare.peak_von_mises):
        with pytest.raises(ResultFileError, match="holds no stress; reduce the mesh with stress"):
            ask("rod")
    with pytest.raises(ResultFileError, match="holds no section forces"):
        bare.section_forces("rod")
    assert bare.channels("stress") == ()
    monkeypatch.setattr(recovery, "_MAX_BYTES", 100.0)
    save(body, tmp_path / "rod.flexbody.h5")
    with pytest.raises(ResultFileError, match="GB: give a time, a node or a layer"):
        Result(tmp_path).stress("rod")


def test_another_body_than_that_of_the_run_is_refused(result: Result, tmp_path: Path) -> None:
    save(rigid_body(1.0, inertia=1.0, name="rod"), tmp_path / "rod.flexbody.h5")
    with pytest.raises(ResultFileError, match="has 0 modes, the run was made with 2"):
        result.flexbody("rod")
