"""Flexible-body files: the same numbers come back, and foreign or damaged files are refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

import h5py
import numpy as np
import pytest
from femeshes import block, line
from hdf5edit import edit_hdf5

from flexmb.errors import BodyFileError, OutputError, ReductionError
from flexmb.fe import rectangle, reduce
from flexmb.flexbody import (
    LoadPoint,
    LoadVector,
    MembraneStiffness,
    SectionForceModes,
    ShellForceModes,
    StressModes,
    load,
    rigid_body,
    save,
)
from flexmb.flexbody.body_file import TABLE
from flexmb.flexbody.static_response import OmittedModes
from flexmb.flexbody.stress_modes import OmittedStress

ENDS = {"left": "x0", "right": "x1"}


def solid():
    return reduce(block((2, 1, 1)), material="steel", interfaces=ENDS, modes=4, damping=0.01)


def beam(**options):
    sections = {"all": rectangle(0.02, 0.03)}
    ends = {"a": "root", "b": "tip"}
    return reduce(line(3), material="steel", interfaces=ends, sections=sections, modes=0, **options)


def loaded():
    """A beam with everything that a body can hold."""
    damping = {"preset": "adams", "modes": {1: 0.02}}
    body = beam(geometric_stiffening="full", damping=damping, residual="inertia", load_points=[1])
    rng = np.random.default_rng(0)
    motion, bend = rng.normal(size=(2, 3, body.m)), np.zeros((6, body.m, body.m))
    point = LoadPoint("force +x", (1, 2, 3), *motion, bend, np.arange(6.0))
    points = (point, replace(point, name="moment -y"))
    push = LoadVector("push", (1, 0, 0), (0, 0, 2), np.arange(float(body.m)), points, 0.25)
    axes, modes = np.tile(np.eye(3), (2, 1, 1)), rng.normal(size=(2, 8, body.m))
    shells = ShellForceModes(np.arange(2), np.zeros(2, int), ("skin",), axes, modes)
    places, beams = len(body.stress.ids), len(body.section_forces.elements)
    shapes = {"stress": (places, 6, 12), "section_forces": (beams, 2, 6, 12)}
    shapes["shell_forces"] = (2, 8, 12)
    omitted = OmittedStress(**{name: rng.normal(size=shape) for name, shape in shapes.items()})
    pair = (push, replace(push, name="pull"))
    forces, n = (rng.normal(size=(1, n)) for n in (12, body.m, 6)), 12 + body.m
    left_out = OmittedModes(np.array([100.0]), *forces, rng.normal(size=(n, n)))
    quadratic = rng.normal(size=(3, 3))
    membrane = MembraneStiffness(
        rng.normal(size=(2, body.m)), rng.normal(size=(body.m, 3)), quadratic @ quadratic.T
    )
    return replace(
        body, loads=pair, shell_forces=shells, omitted_stress=omitted, omitted_modes=left_out,
        membrane_stiffness=membrane,
    )  # fmt: skip


def plain():
    return rigid_body(2.0, (1, 2, 3), (1, 2, 2.5), "rigid one")


def assert_same(one, two):
    if isinstance(one, np.ndarray):
        assert one.dtype == two.dtype
        np.testing.assert_array_equal(one, two)
    elif hasattr(one, "__dataclass_fields__"):
        for field in fields(one):
            assert_same(getattr(one, field.name), getattr(two, field.name))
    elif isinstance(one, tuple):
        assert len(one) == len(two)
        for a, b in zip(one, two, strict=True):
            assert_same(a, b)
    elif isinstance(one, float):
        np.testing.assert_equal(two, one)
    elif isinstance(one, Mapping):
        assert list(one) == list(two)
        for name, value in one.items():
            assert_same(value, two[name])
    else:
        assert one == two


@pytest.mark.parametrize("make", [solid, beam, loaded, plain])
def test_what_is_written_is_read(make, tmp_path):
    body = make()
    path = save(body, tmp_path / "one.flexbody.h5")
    assert_same(body, load(path))
    assert list(tmp_path.iterdir()) == [path]


def test_writing_what_was_read_gives_the_same_bytes(tmp_path):
    one = save(loaded(), tmp_path / "one.h5")
    two = save(load(one), tmp_path / "two.h5")
    assert one.read_bytes() == two.read_bytes()


def test_points_of_loads_return_to_their_loads(tmp_path):
    body = loaded()
    short = replace(body.loads[1], points=body.loads[1].points[:1], missing_share=0.5)
    there = load(save(replace(body, loads=(body.loads[0], short)), tmp_path / "one.h5")).loads
    assert [len(one.points) for one in there] == [2, 1]
    assert [one.missing_share for one in there] == [0.25, 0.5]
    np.testing.assert_array_equal(there[1].points[0].wrench, np.arange(6.0))


def test_every_dataset_of_the_table_is_in_the_file_and_no_other(tmp_path):
    found = []
    with h5py.File(save(loaded(), tmp_path / "one.h5")) as file:
        file.visititems(lambda name, item: found.append(name) if hasattr(item, "shape") else None)
        assert file["frame"].attrs["choice"] == "mean-axis"
    assert sorted(found) == sorted(row.path for row in TABLE)


def edited(tmp_path, edit):
    path = save(solid(), tmp_path / "edited.h5")
    with edit_hdf5(path) as file:
        edit(file)
    return path


def put(path, value):
    def edit(file):
        del file[path]
        file[path] = value

    return edit


@pytest.mark.parametrize(
    ("edit", "sentence"),
    [
        (lambda f: f.attrs.update(format="other"), "not a flexible body of flexmb"),
        (lambda f: f.attrs.pop("format"), "not a flexible body of flexmb"),
        (lambda f: f.attrs.update(version=99), "file version 99; this flexmb reads 3"),
        (lambda f: f.attrs.pop("mass"), "is damaged"),
        (lambda f: f.pop("inertia/S0"), "dataset inertia/S0 is missing"),
        (lambda f: f.pop("surface/faces"), "the dataset surface/faces is missing"),
        (lambda f: f.__delitem__("frame"), "does not know .frame None"),
        (lambda f: f.pop("stress_recovery/layers"), "dataset stress_recovery/layers is missing"),
        (put("stress_recovery/part", np.full(42, 3)), "part: points outside the 1 names of parts"),
        (put("stress_recovery/ids", np.arange(42)[::-1]), "ids: must be ascending"),
        (put("stress_recovery/modes", np.full((42, 6, 10), np.nan)), "entries that are not finite"),
        (put("stress_recovery/modes", np.zeros((42, 6, 4))), "stress_recovery/modes has shape"),
        (put("inertia/S1", [0.0, np.nan, 0.0]), "inertia/S1 has entries that are not finite"),
        (put("inertia/S1", [0.0, 0.0]), r"inertia/S1 has shape \(2,\), not \(3,\)"),
        (put("stiffness/D", np.zeros((3, 3))), "stiffness/D has shape"),
        (
            lambda f: f.create_dataset("interfaces/bend", data=np.zeros((2, 3, 10, 10))),
            "interfaces/bend has .*: make the file again",
        ),
        (put("stiffness/K", -np.eye(10)), "K: has a negative eigenvalue"),
        (put("interfaces/name", [1, 2]), "is damaged"),
        (lambda f: f.attrs.update(mass=-1.0), "mass: must be positive"),
    ],
)
def test_foreign_and_damaged_contents(tmp_path, edit, sentence):
    with pytest.raises(BodyFileError, match=sentence):
        load(edited(tmp_path, edit))


@pytest.mark.parametrize("half", ["stiffness/centrifugal_stiffness", "interfaces/bend"])
def test_half_of_the_geometric_stiffness_is_refused(tmp_path, half):
    path = save(loaded(), tmp_path / "half.h5")
    with edit_hdf5(path) as file:
        del file[half]
    with pytest.raises(BodyFileError, match="geometric stiffening needs both"):
        load(path)


def test_fields_left_out_without_their_mass_are_refused_in_a_sentence(tmp_path):
    path = save(loaded(), tmp_path / "before.h5")
    with edit_hdf5(path) as file:
        del file["omitted_stiffening/mass"]
    with pytest.raises(BodyFileError) as refused:
        load(path)
    what = "is damaged; make it again (the dataset omitted_stiffening/mass is missing)"
    assert str(refused.value) == f"{path}: {what}"


@pytest.mark.parametrize("form", ["stiffness/centrifugal_stiffness", "interfaces/bend"])
def test_geometric_stiffness_that_would_make_energy_is_refused(tmp_path, form):
    path = save(loaded(), tmp_path / "damaged.h5")
    with edit_hdf5(path) as file:
        file[form][0, 0, 0, 1] += 1e3
    with pytest.raises(BodyFileError, match="is not symmetric in the modes"):
        load(path)


@pytest.mark.parametrize("factor", [-1.0, 0.0])
def test_fields_left_out_whose_mass_is_impossible_are_refused(tmp_path, factor):
    path = save(loaded(), tmp_path / "damaged.h5")
    with edit_hdf5(path) as file:
        file["omitted_stiffening/mass"][...] = factor * file["omitted_stiffening/mass"][...]
    with pytest.raises(BodyFileError, match="mass: must give every field a positive kinetic"):
        load(path)


def test_files_that_are_no_bodies(tmp_path):
    with pytest.raises(BodyFileError, match="there is no such file"):
        load(tmp_path / "none.h5")
    text = tmp_path / "text.h5"
    text.write_text("hello")
    with pytest.raises(BodyFileError, match="is not an HDF5 file"):
        load(text)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9, 0.999])
def test_a_truncated_file_is_refused(tmp_path, share):
    whole = save(solid(), tmp_path / "whole.h5").read_bytes()
    cut = tmp_path / "cut.h5"
    cut.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(
        BodyFileError, match="cut.h5: (is not an HDF5 file|does not match its checksum)"
    ):
        load(cut)


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(OutputError, match="cannot write the flexible body"):
        save(plain(), tmp_path / "nowhere" / "a.h5")


def test_loads_and_stress_of_another_number_of_modes_are_refused():
    body = beam()
    with pytest.raises(ReductionError, match='"push" is used twice'):
        replace(loaded(), loads=loaded().loads[:1] * 2)
    short = LoadVector("push", (1, 0, 0), (0, 0, 0), [1.0])
    with pytest.raises(ReductionError, match="load push: has 1 modes where the body has 6"):
        replace(body, loads=(short,))
    stress = StressModes([0], [0], [0], ("all",), ("top",), np.zeros((1, 6, 2)))
    with pytest.raises(ReductionError, match="stress: has 2 modes where the body has 6"):
        replace(body, stress=stress)
    forces = SectionForceModes([[0, 1]], [np.eye(3)], np.zeros((1, 2, 6, 5)))
    with pytest.raises(ReductionError, match="section_forces: has 5 modes"):
        replace(body, section_forces=forces)


def test_places_of_stress_by_node_and_layer():
    names = ("bottom", "top")
    stress = StressModes([3, 3, 8], [0, 0, 0], [0, 1, 1], ("all",), names, np.ones((3, 6, 2)))
    assert list(stress.rows(node=3)) == [0, 1]
    assert list(stress.rows(layer="top")) == [1, 2]
    assert list(stress.rows(node=3, layer="top")) == [1]
    assert len(stress.rows(layer="middle")) == 0
    np.testing.assert_array_equal(
        stress.at(np.array([1.0, 2.0]), np.array([2])), np.full((1, 6), 3)
    )


def test_groups_of_nodes_survive(tmp_path):
    bar = reduce(
        line(4, end=(1.0, 0, 0)), material="steel", interfaces={"tip": "tip"}, modes=2,
        sections={"all": rectangle(0.02, 0.02)},
    )  # fmt: skip
    assert set(bar.nodes.groups) >= {"root", "tip"}
    np.testing.assert_array_equal(bar.nodes.groups["tip"], [4])
    again = load(save(bar, tmp_path / "bar.flexbody.h5"))
    assert list(again.nodes.groups) == list(bar.nodes.groups)
    for name, nodes in bar.nodes.groups.items():
        np.testing.assert_array_equal(again.nodes.groups[name], nodes)
