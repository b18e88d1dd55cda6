"""Reading is strict, and poses between rows are what they should be."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from hdf5edit import edit_hdf5
from resultfiles import block, writer

from flexmb.errors import FlexmbError, ResultFileError
from flexmb.results import Result, load_result


@pytest.fixture
def path(tmp_path: Path) -> Path:
    with writer(tmp_path / "result.h5") as out:
        out.append(block(0, 11))
        out.finish({}, "finished")
    return out.path


def test_a_pose_between_two_rows(path: Path) -> None:
    pose = Result(path).pose("rod", 0.055)
    np.testing.assert_allclose(pose.r, 5.5)
    np.testing.assert_allclose(pose.eta, [5.5, 5.5])
    angle = 0.55  # 0.1 rad a row, evenly along the arc
    c, s = np.cos(angle), np.sin(angle)
    np.testing.assert_allclose(pose.A, [[c, -s, 0], [s, c, 0], [0, 0, 1]], atol=1e-14)


def test_a_pose_at_the_ends(path: Path) -> None:
    result = Result(path)
    assert result.pose("crank", 0.1).r[0] == 10.0
    assert result.pose("crank", 0.0).r[0] == 0.0
    assert len(result.pose("crank", 0.1).eta) == 0


def test_the_shorter_arc_is_taken_when_euler_parameters_change_sign(tmp_path: Path) -> None:
    rows = block(0, 2)
    rows.q[1, 3:7] *= -1.0  # the same orientation, other sign
    with writer(tmp_path / "r.h5") as out:
        out.append(rows)
    A = Result(out.path).pose("crank", 0.005).A
    np.testing.assert_allclose(np.arctan2(A[1, 0], A[0, 0]), 0.05)


@pytest.mark.parametrize("time", [-0.01, 0.11])
def test_a_time_outside_the_run_is_refused(path: Path, time: float) -> None:
    with pytest.raises(ResultFileError, match="covers 0 to 0.1 s"):
        Result(path).pose("rod", time)


def test_unknown_names_list_those_there_are(path: Path) -> None:
    result = load_result(path)
    with pytest.raises(ResultFileError, match='no channel "slidr.x"; nearest: slider.x'):
        result["slidr.x"]
    with pytest.raises(ResultFileError, match='no body "rodd"; nearest: rod'):
        result.pose("rodd", 0.0)


@pytest.mark.parametrize("key", [0, slice(0, 3), ["slider.x"], None, 2.5])
def test_what_is_no_name_is_no_channel(path: Path, key: object) -> None:
    """An index of a list, such as `result[0]`, ended as an AttributeError of a str."""
    result = load_result(path)
    with pytest.raises(ResultFileError, match="a channel is asked for by its name, such as"):
        result[key]
    assert key not in result


def test_channels_know_their_units(path: Path) -> None:
    result = Result(path)
    assert result.unit("slider.x") == "m"
    assert result.unit("turn") == "rad"


def test_a_channel_in_other_units_by_their_name(path: Path) -> None:
    result = Result(path)
    np.testing.assert_allclose(result.in_units("slider.x", "mm-t-s"), 1e3 * result["slider.x"])
    with pytest.raises(FlexmbError, match='"mm"; allowed: SI, mm-t-s'):
        result.in_units("slider.x", "mm")


def test_who_asks_for_the_reaction_of_a_force_is_told_of_its_sensor(path: Path) -> None:
    with pytest.raises(ResultFileError, match="a sensor records that of a force"):
        Result(path).reaction("spring")


def test_arrays_of_a_result_cannot_be_changed_by_accident(path: Path) -> None:
    with pytest.raises(ValueError, match="read-only"):
        Result(path).q[0, 0] = 1.0


def test_a_file_written_anew_is_noticed(path: Path) -> None:
    result = Result(path)
    with writer(path) as out:
        out.append(block(0, 11))
    with pytest.raises(ResultFileError, match="replaced by another run"):
        _ = result.q


def _no_hdf5(path: Path) -> None:
    path.write_bytes(b"time,x\n0,1\n")


def _other_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["x"] = 1.0


def _flexbody(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "flexmb-flexbody"


def _next_version(path: Path) -> None:
    with edit_hdf5(path) as file:
        file.attrs["version"] = 99


def _no_q(path: Path) -> None:
    with edit_hdf5(path) as file:
        del file["q"]


def _wrong_q(path: Path) -> None:
    with edit_hdf5(path) as file:
        del file["q"]
        file["q"] = np.zeros((11, 3))


def _half(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (_no_hdf5, "not an HDF5 file"),
        (_other_hdf5, "an HDF5 file of another program"),
        (_flexbody, 'a "flexmb-flexbody" file'),
        (_next_version, "format version 99; this flexmb reads version 3"),
        (_no_q, "damaged result file .q is missing"),
        (_wrong_q, "damaged result file .q has shape"),
        (_half, "does not match its checksum"),
        (_folder, "is a folder without a result.h5"),
        (Path.unlink, "there is no such file"),
    ],
)
def test_what_is_not_a_result_is_refused_in_one_sentence(path, damage, sentence) -> None:
    copy = Path(shutil.copy(path, path.with_name("copy.h5")))
    damage(copy)
    with pytest.raises(ResultFileError, match=sentence) as caught:
        Result(copy)
    assert "\n" not in str(caught.value)
