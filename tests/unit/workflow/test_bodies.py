"""The files of flexible bodies: one each, on systems too that do not tell "Rod" from "rod"."""

from __future__ import annotations

import numpy as np
import pytest

import flexmb
from flexmb.fe.reduction import fixed_interface, free_body
from flexmb.flexbody import FlexBody, load
from flexmb.flexbody.effects import rigid_twin
from flexmb.model import Model
from flexmb.workflow.flexible_bodies import flexible_bodies, reduction_input


def _body(mass: float) -> FlexBody:
    P, Mab = np.zeros((3, 3, 1)), np.zeros((3, 3, 1, 1))
    P[0, 0], Mab[0, 0] = 0.5, 1.0
    K = np.array([[1e4]])
    return FlexBody("part", mass, np.zeros(3), np.eye(3), np.zeros((3, 1)), P, Mab, K)


def test_bodies_whose_names_differ_in_case_only_have_files_of_their_own(tmp_path) -> None:
    model = Model("names")
    for name, mass in (("Rod", 1.0), ("rod", 2.0), ("ROD", 3.0), ("con", 4.0), ("plate", 5.0)):
        model.add_body(name, _body(mass))
    bodies, files, _ = flexible_bodies(model, tmp_path)
    names = [file.name for file in files.values()]
    assert len({name.casefold() for name in names}) == 5
    assert names[0] == "Rod.flexbody.h5"
    assert "con.flexbody.h5" not in names
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert [body.mass for body in bodies.values()] == [1.0, 2.0, 3.0, 4.0, 5.0]


def _disc(angle: str, duration: float = 0.01) -> Model:
    """A disc of shells that a driver turns about its axis."""
    model = Model("disc")
    mesh = {"type": "disk", "radius": 0.4, "inner": 0.1, "divisions": [4, 16]}
    model.add_body(
        "disc", mesh=mesh, material="steel", modes=4, interfaces={"hub": "inner"},
        sections={"all": {"type": "shell", "thickness": 0.01}},
    )  # fmt: skip
    model.add_joint("bearing", "revolute", between=["ground", "disc.hub"], axis="z")
    model.add_driver("motor", joint="bearing", angle=angle)
    model.set_dynamics(duration=duration)
    return model


@pytest.mark.parametrize(
    ("angle", "duration", "residual"),
    [("300*t", 0.001, "inertia"), ("300*t*t/0.02", 0.005, "inertia"), ("0.01*t", 2000.0, "none")],
    ids=["a twentieth of a turn", "an eighth of a turn, from rest", "three slow turns"],
)
def test_static_responses_to_inertia_join_by_speed_and_not_by_angle(
    angle, duration, residual, tmp_path
) -> None:
    """The disc grows by 300² ρ r³/8E, 2e-5 of its radius, or by 2e-14 of it."""
    model = _disc(angle, duration)
    bodies, files, _ = flexible_bodies(model, tmp_path)
    assert bodies["disc"].provenance["residual"] == residual
    before = files["disc"].stat().st_mtime_ns
    _, _, notes = flexible_bodies(model, tmp_path)
    assert files["disc"].stat().st_mtime_ns == before
    assert "reduction reused" in notes[0] and "--fresh" not in notes[0]  # `flexmb run` alone has it
    # another speed changes the modes where they do not answer it, whatever is there already
    other = "0.01*t" if residual == "inertia" else "300*t"
    flexible_bodies(_disc(other, duration), tmp_path)
    assert load(files["disc"]).provenance["residual"] != residual


def test_an_arm_whose_bending_modes_answer_its_rotation_needs_none(tmp_path) -> None:
    """Turned by a quarter within a second it bends a thousand times more than it stretches."""
    model = Model("arm")
    model.add_body(
        "arm", mesh={"type": "beam", "length": 1.0}, material="steel", modes=8,
        interfaces={"root": "start"},
        sections={"all": {"type": "rectangle", "y": 0.02, "z": 0.02}},
    )  # fmt: skip
    model.add_joint("hub", "revolute", between=["ground", "arm.root"], axis="z")
    model.add_driver("motor", joint="hub", angle="step(t, 0, 0, 1, 1.57)")
    model.set_dynamics(duration=1.0)
    bodies, _, _ = flexible_bodies(model, tmp_path)
    assert bodies["arm"].provenance["residual"] == "none"


@pytest.mark.parametrize("shape", ["beam", "disk"])
def test_a_rigid_mesh_has_its_mass_properties_without_a_reduction(shape, tmp_path) -> None:
    """Whatever is said of modes; the reduced body remains beside it, and is used again."""
    words = {"mesh": {"type": "beam", "length": 1.0, "divisions": 6}, "material": "steel",
             "interfaces": {"root": "start", "tip": "end"},
             "sections": {"all": {"type": "rectangle", "y": 0.02, "z": 0.03}}}  # fmt: skip
    if shape == "disk":
        words |= {"mesh": {"type": "disk", "radius": 0.4, "inner": 0.1, "divisions": [4, 16]},
                  "interfaces": {"hub": "inner"},
                  "sections": {"all": {"type": "shell", "thickness": 0.01}},
                  "masses": {"weight": {"at": 3, "mass": 2.0}}}  # fmt: skip

    def made(**more):
        model, phases = Model("one body"), set()
        model.add_body("part", **words, **more)
        bodies, files, notes = flexible_bodies(
            model, tmp_path, progress=lambda phase, *_: phases.add(phase)
        )
        return bodies["part"], files["part"].name, notes, phases

    flexible, file, _, phases = made(modes=4)
    assert "modes" in phases
    rigid, simulated, _, phases = made(modes=4, deformation="rigid")
    assert not {"factor", "modes"} & phases
    assert simulated != file
    assert rigid.m == 0
    twin = rigid_twin(flexible)
    for name in ("mass", "S1", "S0", "p", "P", "Mab"):
        np.testing.assert_array_equal(getattr(rigid, name), getattr(twin, name))
    for part, same in zip(rigid.interfaces, twin.interfaces, strict=True):
        np.testing.assert_array_equal(part.position, same.position)
    np.testing.assert_array_equal(rigid.nodes.position, twin.nodes.position)
    np.testing.assert_array_equal(rigid.surface.points, twin.surface.points)
    other = {"modes": 9, "deformation": "rigid", "reduction": "free-interface", "damping": 0.01}
    assert "reused" in made(**other)[2][0]
    assert "reused" in made(modes=4)[2][0]


@pytest.mark.parametrize("reduction", ["craig-bampton", "free-interface", "free body"])
@pytest.mark.parametrize(("speed", "residual"), [(300.0, "inertia"), (0.01, "none")])
def test_a_body_that_turns_is_factorised_once(reduction, speed, residual, tmp_path, monkeypatch):
    """It was reduced twice, with static responses to inertia and without, where it needs none."""
    model, solved = _disc(f"{speed}*t"), []
    spec = model.bodies["disc"]
    if reduction == "free body":
        model = Model("disc")
        model.bodies["disc"] = spec.model_copy(
            update={"interfaces": {}, "angular_velocity": [0, 0, speed]}
        )
        model.set_dynamics(duration=0.01)
    else:
        model.bodies["disc"] = spec.model_copy(update={"reduction": reduction})
    for place in (fixed_interface, free_body):
        counted = lambda *args, plain=place.factor: solved.append(args[0]) or plain(*args)  # noqa: E731
        monkeypatch.setattr(place, "factor", counted)
    bodies, _, _ = flexible_bodies(model, tmp_path)
    assert bodies["disc"].provenance["residual"] == residual
    assert len(solved) == 1
    mesh, words = reduction_input(model, "disc", residual)
    twin = flexmb.reduce(mesh, **words)
    assert twin.provenance["key"] == bodies["disc"].provenance["key"]
    for name in ("K", "Mab", "P", "p"):
        np.testing.assert_array_equal(getattr(bodies["disc"], name), getattr(twin, name))


def test_reductions_of_an_audit_are_reused(tmp_path) -> None:
    """By later runs in its folder, and by later audits."""
    model, first = _disc("0.01*t"), tmp_path / "audit" / "deformation"
    for folder in (first, tmp_path, tmp_path / "audit" / "further_modes"):
        folder.mkdir(parents=True, exist_ok=True)
        _, files, notes = flexible_bodies(model, folder)
        assert any(str(first) in note for note in notes) == (folder != first)
        assert load(files["disc"]).m == 4
