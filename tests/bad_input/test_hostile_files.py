"""Files from elsewhere: nothing outside them is read or written, nothing loops, no memory is taken.

The contents are made with h5py, and with a seal of another user, as a hostile sender would do.
"""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from hdf5edit import edit_hdf5, seal_again
from resultfiles import block, writer

from flexmb import untrusted
from flexmb.errors import (
    BodyFileError,
    FlexmbError,
    MeshError,
    ResultFileError,
    SceneError,
    printable,
)
from flexmb.fe.meshes.mesh_file import _read, read_mesh
from flexmb.flexbody import load, rigid_body, save
from flexmb.model.functions.tabulated import Columns, read_columns
from flexmb.results import Result
from flexmb.results.reader import DAMPING
from flexmb.results.writer import ResultWriter
from flexmb.units import SI
from flexmb.workflow.run_report import PROVENANCE, provenance


@pytest.fixture
def body(tmp_path: Path) -> Path:
    """The file of a body."""
    return save(rigid_body(2.0, inertia=1.0), tmp_path / "b.flexbody.h5")


def from_elsewhere(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the file the right checksum and the tag of another user."""
    monkeypatch.setattr(untrusted, "_tag", lambda _: "0" * 64)
    seal_again(path)
    monkeypatch.undo()


def write_result(path: Path, **options) -> Path:
    """A finished run of a few rows."""
    with writer(path, **options) as out:
        out.append(block(0, 5))
        out.finish({"steps": 5}, "finished")
    return path


def external_storage(file: h5py.File, secret: Path) -> None:
    del file["inertia/S1"]
    file.create_dataset("inertia/S1", shape=(3,), dtype="f8", external=[(str(secret), 0, 24)])


def external_link(file: h5py.File, secret: Path) -> None:
    del file["inertia/S1"]
    file["inertia/S1"] = h5py.ExternalLink(str(secret), "/inertia/S1")


def soft_link(file: h5py.File, secret: Path) -> None:
    del file["inertia/S1"]
    file["inertia/S1"] = h5py.SoftLink("/inertia/S2")


def virtual(file: h5py.File, secret: Path) -> None:
    del file["inertia/S1"]
    layout = h5py.VirtualLayout((3,), "f8")
    layout[:] = h5py.VirtualSource(str(secret), "inertia/S1", shape=(3,))
    file.create_virtual_dataset("inertia/S1", layout)


def immense(file: h5py.File, secret: Path) -> None:
    del file["inertia/S1"]
    file.create_dataset("inertia/S1", shape=(10**15, 3), dtype="f8", chunks=(1024, 3))


def bomb(file: h5py.File, secret: Path) -> None:
    file.create_dataset("bomb", data=np.zeros(1 << 20), compression="gzip")


def deep(file: h5py.File, secret: Path) -> None:
    file.create_group("/".join("g" * 1 for _ in range(30)))


def ring(file: h5py.File, secret: Path) -> None:
    file["inertia/again"] = file["inertia"]  # a hard link: the group is inside itself


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("attack", "sentence"),
    [
        (external_storage, "stores /inertia/S1 in other files"),
        (external_link, "a link to another place at /inertia/S1"),
        (soft_link, "a link to another place at /inertia/S1"),
        (virtual, "stores /inertia/S1 in other files"),
        (immense, "more values at /inertia/S1 than the file has room for"),
        (bomb, "stores /bomb through a filter"),
        (deep, "groups inside each other"),
        (ring, "groups inside each other"),
    ],
)
def test_a_body_from_elsewhere_reads_nothing_but_itself(
    body: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, attack, sentence: str
) -> None:
    secret = save(rigid_body(7.0, inertia=1.0), tmp_path / "secret.h5")
    with edit_hdf5(body) as file:
        attack(file, secret)
    from_elsewhere(body, monkeypatch)
    with pytest.raises(BodyFileError, match=sentence):
        load(body)


@pytest.mark.seconds
def test_a_body_from_elsewhere_that_is_whole_is_read(body: Path, monkeypatch) -> None:
    from_elsewhere(body, monkeypatch)
    assert load(body).mass == 2.0


@pytest.mark.seconds
def test_a_result_from_elsewhere_writes_into_no_other_file(tmp_path: Path, monkeypatch) -> None:
    target = tmp_path / "diary.txt"
    target.write_bytes(b"mine" * 100)
    path = write_result(tmp_path / "result.h5")
    with edit_hdf5(path) as file:
        del file["progress"]
        file.create_dataset("progress", shape=(2,), dtype="i8", external=[(str(target), 0, 16)])
    from_elsewhere(path, monkeypatch)
    for use in (Result, lambda place: Result(place).save(tmp_path / "copy")):
        with pytest.raises(ResultFileError, match="stores /progress in other files"):
            use(path)
    assert target.read_bytes() == b"mine" * 100


@pytest.mark.parametrize("name", ["../secret.h5", "/etc/passwd", "..\\secret.h5", "a/b.h5", ".."])
def test_a_result_names_bodies_in_its_own_folder_only(tmp_path: Path, name: str) -> None:
    path = write_result(tmp_path / "result.h5", flexbodies={"rod": name})
    with pytest.raises(ResultFileError, match="flexible body rod is not in this folder"):
        Result(path)


@pytest.mark.parametrize("kind", ["body", "result"])
def test_each_flipped_bit_is_noticed(tmp_path: Path, body: Path, kind: str) -> None:
    path = body if kind == "body" else write_result(tmp_path / "result.h5")
    whole = path.read_bytes()
    rng = np.random.default_rng(7)
    for place in rng.integers(untrusted.USER_BLOCK, len(whole), 40):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        with pytest.raises(FlexmbError, match="does not match its checksum"):
            load(path) if kind == "body" else Result(path)


@pytest.mark.seconds
def test_damaged_files_of_other_users_end_in_a_sentence(body: Path, monkeypatch) -> None:
    whole, rng = body.read_bytes(), np.random.default_rng(3)
    for number in range(6):
        damaged = bytearray(whole)
        for place in rng.integers(untrusted.USER_BLOCK, min(len(whole), 6000), 30):
            damaged[place] = int(rng.integers(256))
        path = body.with_name(f"{number}.h5")
        path.write_bytes(damaged)
        from_elsewhere(path, monkeypatch)
        with suppress(BodyFileError):  # what it says may also be a body
            assert load(path).m == 0


def test_reading_that_never_ends_is_cut_off(body: Path, monkeypatch) -> None:
    from_elsewhere(body, monkeypatch)
    monkeypatch.setattr(untrusted, "_PATIENCE", 1e-3)
    with pytest.raises(BodyFileError, match="cannot be read to its end within 0 s"):
        load(body)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
def test_a_pipe_is_no_file(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.h5"
    os.mkfifo(pipe)
    with pytest.raises(BodyFileError, match="is no regular file"):
        load(pipe)
    with pytest.raises(ResultFileError, match="is no regular file"):
        Result(pipe)


def test_control_characters_stay_in_their_file() -> None:
    title = "\x1b]0;owned\x07 \x9b31m\u202e red\tand\nblue \u00e9\u4e2d"
    assert printable(title) == "\\x1b]0;owned\\x07 \\x9b31m\\u202e red\tand\nblue \u00e9\u4e2d"


@pytest.mark.parametrize("secret", ["password=hunter2-and-a-long-salt,x", "one-word-only"])
def test_messages_on_tables_quote_no_text_of_other_files(tmp_path: Path, secret: str) -> None:
    (tmp_path / "motion.csv").write_text(f"{secret}\n1,2\n")
    columns = Columns(("t", "y"), None)
    with pytest.raises(SceneError) as caught:
        read_columns(tmp_path / "motion.csv", columns, SI, "m")
    assert "hunter2" not in str(caught.value) and "one-word" not in str(caught.value)
    columns = Columns((1, 2), None)
    (tmp_path / "motion.csv").write_text(f"1,2\n{secret}\n")
    with pytest.raises(SceneError) as caught:
        read_columns(tmp_path / "motion.csv", columns, SI, "m")
    assert "hunter2" not in str(caught.value) and "salt" not in str(caught.value)


MESHES = {  # what loops or takes memory in the parsers of meshio 5.3
    "cut.off": "OFF\n8 6 12\n0 0 0\n1 0 0\n",
    "cut.ply": "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\n",
    "cut.node": "8 3 0 0\n1 0 0 0\n",
    "cut.dat": "TITLE = x\nVARIABLES = X, Y, Z\nZONE N=8, E=1, F=FEPOINT, ET=TETRAHEDRON\n0 0 0\n",
    "nodes.msh": (
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1\n900000000 0 0 0\n$EndNodes\n"
        "$Elements\n1\n1 4 2 1 1 900000000 900000000 900000000 900000000\n$EndElements\n"
    ),
}


@pytest.mark.seconds
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name in ("cut.dat", "cut.ply") else name
        for name in MESHES
    ],
)
def test_cut_and_lying_meshes_end_in_a_sentence(tmp_path: Path, monkeypatch, name: str) -> None:
    monkeypatch.setattr(untrusted, "_SECONDS", 1.5)  # of the processor: two parsers loop until then
    (tmp_path / name).write_text(MESHES[name])
    with pytest.raises(MeshError, match=f"{name}: the mesh file"):
        read_mesh(tmp_path / name)


@pytest.mark.seconds
def test_a_mesh_is_read_apart_once(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("FLEXMB_CACHE_DIR", str(tmp_path / "cache"))
    path = tmp_path / "one.msh"
    path.write_text(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n"
        "$EndNodes\n$Elements\n1\n1 4 2 1 1 1 2 3 4\n$EndElements\n"
    )
    assert len(read_mesh(path).points) == 4
    monkeypatch.setattr(untrusted, "_first_reading", lambda *_: "is read apart again")
    assert len(read_mesh(path).points) == 4
    path.write_text(path.read_text() + "\n")
    with pytest.raises(MeshError, match="is read apart again"):
        read_mesh(path)


def test_the_mark_of_a_mesh_holds_for_its_format_alone(tmp_path: Path, monkeypatch) -> None:
    """Bytes that are well in one format may loop in the parser of another one."""
    monkeypatch.setenv("FLEXMB_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(untrusted, "_first_reading", lambda *_: None)
    for name in ("a.obj", "a.ele"):
        (tmp_path / name).touch()
    assert untrusted.check_reading(tmp_path / "a.obj", "meshes") is None
    monkeypatch.setattr(untrusted, "_first_reading", lambda *_: "is read apart")
    assert untrusted.check_reading(tmp_path / "a.obj", "meshes") is None
    assert untrusted.check_reading(tmp_path / "a.ele", "meshes") == "is read apart"


@pytest.mark.seconds
def test_a_flexmb_that_only_this_program_finds_reads_as_well(
    body: Path, tmp_path: Path, monkeypatch, project: Path
) -> None:
    """A script may have changed the path of modules; the process that reads first has it too."""
    from_elsewhere(body, monkeypatch)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    program = f"import sys; sys.path[:0] = {[str(project), *filter(None, sys.path)]!r}\n"
    program += f"from flexmb.flexbody import load; print(load({str(body)!r}).mass)"
    done = subprocess.run(
        [sys.executable, "-S", "-c", program], capture_output=True, text=True, encoding="utf-8",
        cwd=tmp_path, check=False,
    )  # fmt: skip
    assert done.stdout.strip() == "2.0", done.stderr


TETRAHEDRON = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n*ELEMENT, TYPE=C3D4\n1,1,2,3,4\n"


@pytest.mark.slow
def test_a_mesh_includes_files_of_its_own_folder_alone(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("FLEXMB_CACHE_DIR", str(tmp_path / "cache"))
    folder = tmp_path / "here"
    folder.mkdir()
    for place in (tmp_path, folder):
        (place / "part.inp").write_text(TETRAHEDRON)
    mesh = folder / "whole.inp"
    mesh.write_text("*INCLUDE, INPUT=../part.inp\n")
    with pytest.raises(
        MeshError, match=r"names .*part\.inp: flexmb reads a mesh from its own folder"
    ):
        read_mesh(mesh)
    mesh.write_text("*INCLUDE, INPUT=part.inp\n")
    assert len(read_mesh(mesh).points) == 4
    (folder / "part.inp").write_text("*INCLUDE, INPUT=/etc/hostname\n")  # changed since
    with pytest.raises(MeshError, match="hostname: flexmb reads a mesh from its own folder"):
        read_mesh(mesh)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("short.xdmf", "<Xdmf Version='3.0'><Domain>"),
        ("vector.mesh", "MeshVersionFormatted 1\nDimension 3\nTetrahedra\n1\n1 1 1 1 1\nEnd"),
        ("empty.vtu", "<VTKFile type='UnstructuredGrid' version='0.1'></VTKFile>"),
    ],
)
def test_what_parsers_let_through_is_a_sentence(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(MeshError, match=f"{name}: the mesh file is damaged"):
        _read(tmp_path / name)


@pytest.mark.seconds
def test_hdf5_of_a_mesh_has_no_links(tmp_path: Path) -> None:
    secret = tmp_path / "secret.bin"
    secret.write_bytes(np.arange(12.0).tobytes())
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file.create_dataset("x", shape=(4, 3), dtype="f8", external=[(str(secret), 0, 96)])
    grid = (
        '<Xdmf Version="3.0"><Domain><Grid><Geometry GeometryType="XYZ">'
        '<DataItem DataType="Float" Dimensions="4 3" Format="HDF" Precision="8">data.h5:/x'
        "</DataItem></Geometry></Grid></Domain></Xdmf>"
    )
    (tmp_path / "mesh.xdmf").write_text(grid)
    with pytest.raises(MeshError, match="stores /x in other files"):
        read_mesh(tmp_path / "mesh.xdmf")


def many_modes(file: h5py.File) -> None:
    file["layout/m"][:] = 10**9


def far_columns(file: h5py.File) -> None:
    file["layout/kept/q"][-1] = 99


def no_tables(file: h5py.File) -> None:
    del file["scene"]
    file["scene"] = '{"sensors": {"slider": 3}}'


def no_units(file: h5py.File) -> None:
    del file["scene"]
    file["scene"] = '{"units": "cubits"}'


def no_scalars(file: h5py.File) -> None:
    file.attrs["format"] = [1, 2]


@pytest.mark.parametrize("attack", [many_modes, far_columns, no_tables, no_units, no_scalars])
def test_a_result_that_contradicts_itself_is_refused(tmp_path: Path, attack) -> None:
    path = write_result(tmp_path / "result.h5")
    with edit_hdf5(path) as file:
        attack(file)
    with pytest.raises(FlexmbError):
        Result(path)


def test_damaged_texts_and_states_of_a_result_are_a_sentence(tmp_path: Path) -> None:
    with writer(tmp_path / "result.h5", texts={DAMPING: "{", PROVENANCE: "["}) as out:
        out.save_state({"v": np.zeros(3)})
        out.append(block(0, 5))
    run = Result(tmp_path / "result.h5")
    for use in (lambda: run.damping, lambda: provenance(run)):
        with pytest.raises(ResultFileError, match="is a damaged result file"):
            use()
    with edit_hdf5(run.path) as file:
        del file["state/arrays"]
    with pytest.raises(ResultFileError, match="is a damaged result file"):
        ResultWriter.reopen(run.path)


def test_a_group_is_no_dataset_of_a_body(body: Path) -> None:
    with edit_hdf5(body) as file:
        del file["modes/why"]
        file.create_group("modes/why")
    with pytest.raises(BodyFileError, match="is damaged"):
        load(body)


def test_a_key_that_others_may_write_is_none(body: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("FLEXMB_CACHE_DIR", str(tmp_path / "cache"))
    seal_again(body)
    monkeypatch.setattr(untrusted, "_first_reading", lambda *_: "is read apart")
    assert load(body).mass == 2.0
    (tmp_path / "cache" / "seal.key").chmod(0o666)
    untrusted._checked.clear()
    with pytest.raises(BodyFileError, match="is read apart"):
        load(body)
