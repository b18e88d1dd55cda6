"""Stress of a stored result: against the full model, envelopes, hot spots, histories."""

from __future__ import annotations

import csv

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app
from flexmb.errors import FlexmbError, OutputError
from flexmb.results import crash_safe_file, export_stress, reader, recovery

SHELL = {"surface": {"type": "shell", "thickness": 0.01}}
BAR = {"all": {"type": "rectangle", "y": 0.02, "z": 0.03}}
PLATE = ({"type": "plate", "length": 1, "width": 0.3, "divisions": [6, 2]}, SHELL, "x0")
BEAM = ({"type": "beam", "length": 1, "divisions": 4}, BAR, "start")
BOX = ({"type": "box", "size": [1, 0.1, 0.05], "divisions": [6, 1, 1]}, None, "x0")


def joined(shape, gravity=None, **options):
    """A blade whose root is an interface, with two modes that do not answer its own inertia."""
    mesh, sections, group = shape
    model = flexmb.Model("blade", gravity=gravity)
    model.set_validity(inertia_loads="any")
    words = {"sections": sections} if sections else {}
    model.add_body(
        "blade", mesh=mesh, material="steel", interfaces={"root": group}, modes=2,
        residual="none", **words, **options,
    )  # fmt: skip
    return model


def full_model(shape, load):
    mesh, sections, group = shape
    return flexmb.part(
        mesh, material="steel", sections=sections, interfaces={"root": group},
        supports={"root": {"interface": "root", "type": "clamped"}}, loads={"inertia": load},
    )  # fmt: skip


def largest_error(result, full, correction):
    """Of stress and section forces at the end, relative to the largest of the full model."""
    t = float(result.time[-1])
    one = result.stress("blade", t, mode_acceleration=correction)
    exact = full.stresses()[np.isin(full.stress.ids, one.node)]
    errors = [np.abs(one.values - exact).max() / np.abs(exact).max()]
    e = full.column()
    if full.section_forces is not None:
        forces = result.section_forces("blade", t, mode_acceleration=correction)
        exact = full.section_forces.at(e)
        values = np.concatenate([forces.force, forces.moment], axis=-1)
        errors.append(np.abs(values - exact).max() / np.abs(exact).max())
    if full.shell_forces is not None:
        values = result.shell_forces("blade", t, mode_acceleration=correction).values
        exact = full.shell_forces.at(e)
        errors.append(np.abs(values - exact).max() / np.abs(exact).max())
    return max(errors)


SHAPES = [pytest.param(BEAM, id="beam"), pytest.param(PLATE, id="plate"),
          pytest.param(BOX, id="box", marks=pytest.mark.slow)]  # fmt: skip


@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
@pytest.mark.parametrize("shape", SHAPES)
def test_mode_acceleration_gives_the_stress_of_the_full_model_that_spins(shape):
    model = joined(shape, deformation="quasi-static")
    model.add_joint("hinge", "revolute", between=["ground", "blade.root"], axis="z")
    model.add_driver("motor", joint="hinge", angle="30*t")
    result = flexmb.simulate(model, duration=1e-3, outputs=2)
    full = full_model(shape, {"type": "spin", "angular_velocity": [0, 0, 30.0]})
    assert largest_error(result, full, False) > 0.9  # two modes know nothing of it
    assert largest_error(result, full, True) < 2e-7  # single precision


@pytest.mark.parametrize("shape", SHAPES)
def test_mode_acceleration_gives_the_stress_under_the_weight(shape):
    g = [0, 0, -1e-2]  # so small that the sag turns nothing
    model = joined(shape, gravity=g)
    model.add_joint("weld", "fixed", between=["ground", "blade.root"])
    result = flexmb.statics(model)
    full = full_model(shape, {"type": "gravity", "acceleration": g})
    assert largest_error(result, full, False) > 0.02
    assert largest_error(result, full, True) < 1e-5


@pytest.fixture(scope="module")
def swinging(tmp_path_factory):
    model = joined(PLATE, gravity=[0, 0, -9.81])
    model.add_joint("hinge", "revolute", between=["ground", "blade.root"], axis="y")
    folder = tmp_path_factory.mktemp("swing")
    return flexmb.simulate(model, duration=0.1, outputs=40, output=folder)


def test_envelopes_and_hot_spots_are_the_extremes_of_the_histories(swinging, monkeypatch):
    whole = swinging.stress("blade")
    mises = swinging.von_mises("blade").values
    monkeypatch.setattr(reader, "_READ_AT_ONCE", 0)  # as if the run were long
    monkeypatch.setattr(recovery, "_BATCH_BYTES", 8 * 6 * len(whole.node) * 7)  # seven rows
    run = flexmb.load_result(swinging.path)
    envelope = run.stress_envelope("blade")
    np.testing.assert_array_equal(envelope.largest, mises.max(axis=0))
    np.testing.assert_array_equal(envelope.time_of_largest, run.time[mises.argmax(axis=0)])
    pair = run.stress_envelope("blade", "principal")
    tensor = whole.values[..., [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    principal = np.linalg.eigvalsh(tensor)
    np.testing.assert_allclose(pair.largest, principal[..., 2].max(axis=0), rtol=1e-12)
    np.testing.assert_allclose(pair.least, principal[..., 0].min(axis=0), rtol=1e-12)
    spots = run.hot_spots("blade", 3)
    assert spots[0].value == mises.max() >= spots[1].value >= spots[2].value
    places = np.array([spot.position for spot in spots])
    gaps = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(3, 1)]
    assert gaps.min() > 0.05 * np.hypot(1, 0.3)
    assert len(run.hot_spots("blade", 5, distance=10.0)) == 1
    assert "q" not in run._tables  # only rows were read


def test_histories_envelopes_and_moments_are_written(swinging, tmp_path, monkeypatch):
    history = swinging.stress("blade", node=4, layer="top").values[:, 0]
    monkeypatch.setattr(recovery, "_BATCH_BYTES", 8 * 6 * 9)  # nine rows at once
    table = export_stress(swinging, tmp_path / "a.csv", "blade", nodes=[4], layer="top")
    with table.open() as file:
        rows = list(csv.reader(file))
    assert rows[0][:3] == ["time [s]", "4.top.xx [Pa]", "4.top.yy [Pa]"]
    last = 4 * np.finfo(float).eps * np.abs(history).max()  # products of other sizes
    np.testing.assert_allclose(np.array(rows[1:], float)[:, 1:7], history, rtol=0, atol=last)
    stored = export_stress(swinging, tmp_path / "a.h5", "blade", nodes=[4, 7], layer="top")
    with h5py.File(stored) as file:
        np.testing.assert_allclose(file["4.top.xy"], history[:, 5], rtol=0, atol=last)
        assert len(file["7.top.von_mises"]) == 41 and file["time"].attrs["unit"] == "s"
    envelope = export_stress(swinging, tmp_path / "b.h5", "blade")
    moment = export_stress(swinging, tmp_path / "c.csv", "blade", time=0.05)
    with h5py.File(envelope) as file, moment.open() as text:
        assert len(file["node"]) == len(swinging.von_mises("blade", 0.0).node)
        assert file["layer"].asstr()[0] in ("bottom", "top")
        rows = list(csv.DictReader(text))
        mises = np.array([float(row["von_mises [Pa]"]) for row in rows])
        assert (mises <= file["von_mises"][:] * (1 + 1e-12)).all()
    np.testing.assert_allclose(mises, swinging.von_mises("blade", 0.05).values, rtol=1e-12)


def test_a_full_disk_ends_no_process_and_leaves_nothing(swinging, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(crash_safe_file.DiskFile, "_write_all", full)
    with pytest.raises(OutputError, match="No space left"):
        export_stress(swinging, tmp_path / "a.h5", "blade", nodes=[4], layer="top")
    assert not list(tmp_path.iterdir())


def test_the_command_shows_and_refuses(swinging, tmp_path):
    run = CliRunner()
    shown = run.invoke(app, ["stress", str(swinging.path), "--hot-spots", "2"])
    assert shown.exit_code == 0, shown.output
    assert "hot spot" in shown.output and "shell force Mx" in shown.output
    file = tmp_path / "x.csv"
    for words, sentence in (
        (["--body", "blad"], "nearest: blade"),
        (["--nodes", "hot"], "give --output"),
        (["--time", "7"], "0.1"),
        (["--layer", "topp"], "nearest: top"),
        (["--output", str(tmp_path / "x.xls")], '".xls"'),
        (["--nodes", "999", "--output", str(file)], "no stress at node 999"),
    ):
        wrong = run.invoke(app, ["stress", str(swinging.path), *words])
        assert wrong.exit_code == 2 and sentence in wrong.output, wrong.output
        assert not file.exists()
    file.write_text("mine")
    wrong = run.invoke(app, ["stress", str(swinging.path), "--output", str(file)])
    assert wrong.exit_code == 2 and "--force" in wrong.output


def test_an_old_body_says_what_it_lacks(swinging):
    import dataclasses

    run = flexmb.load_result(swinging.path)
    body = run.flexbody("blade")
    stamp = run._bodies["blade"][0]
    run._bodies["blade"] = (stamp, dataclasses.replace(body, omitted_stress=None))
    with pytest.raises(FlexmbError, match="reduce the mesh again"):
        run.stress("blade", mode_acceleration=True)
