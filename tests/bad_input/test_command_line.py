"""Mistakes as a person meets them: one clear message on the error stream, exit code 2.

Every test here goes through the command line. What a scene may get wrong in other ways, and the
exact wording, is tested beside this file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import pytest
from goodscene import GOOD
from hdf5edit import edit_hdf5
from meshfiles import write_box
from typer.testing import CliRunner

from flexmb.cli import app
from flexmb.flexbody import load, rigid_body, save

BEAM = """
[bodies.beam]
mesh = "box.msh"
material = "steel"
interfaces = { a = "left", b = "right" }
modes = 2
[joints.wall]
type = "fixed"
between = ["ground", "beam.a"]
[dynamics]
duration = 1e-3
step = 1e-4
"""
REDUCE = ("--interface", "a=left", "--interface", "b=right", "--modes", "2")


def call(*words: str | Path) -> Any:
    return CliRunner().invoke(app, [str(word) for word in words])


def refused(*words: str | Path) -> list[str]:
    """Lines of the message of a command that must fail by a mistake of the input."""
    done = call(*words)
    assert done.exit_code == 2, done.output
    assert "error: " in done.stderr, done.stderr  # below the lines of long phases, if any
    assert "Traceback" not in done.output
    return done.stderr.partition("error: ")[2].strip().splitlines()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, which is also the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def scene(folder: Path, *changes: tuple[str, str], text: str = GOOD) -> Path:
    """A good scene after replacing pieces of it."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "scene.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("command", ["check", "run"])
def test_all_mistakes_of_a_scene_at_once_a_line_each(folder: Path, command: str) -> None:
    path = scene(
        folder,
        ("mass = 1", "mass = -1"),
        ("inertia = [1, 1, 1]", "inertia = [1, 1, 3]"),
        ('type = "revolute"', 'type = "revolut"'),
        ('"crank.tip", "rod"', '"crank.tip", "rd"'),
        ('"rod.center"', '"rod.centr"'),
        ('"speed*t"', '"speed*(t"'),
    )
    lines = refused(command, path)
    starts = [
        "bodies.crank.mass: must be positive, is -1 kg",
        "bodies.crank.inertia: the inertia is impossible",
        'joints.bearing.type: unknown joint type "revolut"; nearest: revolute; allowed: ',
        "drivers.motor.angle: syntax error",
        "    speed*(t",
        "          ^",
        'joints.guide.between[1]: body "rod" has no marker "centr"; nearest: center; allowed: ',
        'joints.pin.between[1]: unknown body "rd"; nearest: rod; allowed: ',
    ]
    assert len(lines) == len(starts), "\n".join(lines)
    for start in starts:
        assert any(line.startswith(start) for line in lines), start


def test_nothing_is_written_for_a_scene_with_mistakes(folder: Path) -> None:
    refused("run", scene(folder, ("mass = 1", "mass = -1")))
    assert [path.name for path in folder.iterdir()] == ["scene.toml"]


def test_misspelt_mesh_groups(folder: Path) -> None:
    write_box(folder / "box.msh")
    lines = refused("reduce", "box.msh", "--material", "steel", "--interface", "a=lefft")
    assert lines == [
        'interfaces.a: box.msh has no group "lefft"; nearest: left; allowed: left, right, body'
    ]


@pytest.mark.parametrize("command", ["check", "run"])
def test_misspelt_mesh_groups_of_a_scene(folder: Path, command: str) -> None:
    write_box(folder / "box.msh")
    path = scene(folder, ('"left"', '"lft"'), ('"right"', '"rigt"'), text=BEAM)
    lines = refused(command, path)
    assert lines == [
        'bodies.beam.interfaces.a: box.msh has no group "lft"; nearest: left; '
        "allowed: left, right, body",
        'bodies.beam.interfaces.b: box.msh has no group "rigt"; nearest: right; '
        "allowed: left, right, body",
    ]


def test_a_mesh_without_volume_elements(folder: Path) -> None:
    write_box(folder / "box.msh", solid=False)
    what = "box.msh: has no volume elements, and no lines or surfaces with a section; it has"
    assert refused("reduce", "box.msh", "--material", "steel")[0].startswith(what)
    for command in ("check", "run"):
        first = refused(command, scene(folder, text=BEAM))[0]
        assert "has no volume elements" in first
        assert first.startswith("bodies.beam")


@pytest.mark.parametrize(
    ("values", "warned"),
    [
        (
            "{E = 210, nu = 0.3, density = 7850}",
            "Young's modulus 210 Pa is implausible at a density of",
        ),
        (
            "{E = 210e9, nu = 0.3, density = 7.85e-9}",
            "density 7.85e-09 kg/m^3 is not that of an engineering material; given in t/mm^3?",
        ),
        ("{E = 1.2e12, nu = 0.3, density = 600}", "wave speed sqrt(E/density) = 4.472e+04 m/s is"),
    ],
)
def test_implausible_materials_are_warned_about_with_the_likely_slip(
    folder: Path, values: str, warned: str
) -> None:
    write_box(folder / "box.msh")
    done = call("reduce", "box.msh", "--material", values, *REDUCE)
    assert done.exit_code == 0, done.output
    assert f"warning: {warned}" in done.stderr
    assert load(folder / "box.flexbody.h5").m == 8


def test_a_mesh_in_millimetres_read_in_metres_is_warned_about(folder: Path) -> None:
    write_box(folder / "box.msh", size=(1000.0, 100.0, 100.0))
    done = call("reduce", "box.msh", "--material", "steel", *REDUCE)
    assert done.exit_code == 0
    assert "warning: the mesh extends over 1000 m: is its unit system" in done.stderr


def test_load_points_are_nodes_of_a_mesh_file(folder: Path) -> None:
    from flexmb.flexbody import load

    write_box(folder / "box.msh")
    words = ("--material", "steel", *REDUCE, "--geometric-stiffening", "full", "--load-point", "5")
    assert call("reduce", "box.msh", *words, "-o", "box.h5").exit_code == 0
    nodes = load(folder / "box.h5").nodes
    assert nodes is not None and nodes.bend_nodes is not None and nodes.bend_nodes.tolist() == [5]
    (folder / "scene.toml").write_text("")
    for option, value in (("--load-point", "5"), ("--geometric-stiffening", "full")):
        done = call("reduce", "scene.toml", option, value)
        assert done.exit_code == 2 and f"{option}: belongs to a mesh file" in done.stderr


def test_positions_that_cannot_be_assembled(folder: Path) -> None:
    """The guide holds the rod's centre at a height that crank and rod do not reach."""
    far = ('between = ["ground", "rod.center"]', 'between = ["ground.rail", "rod.center"]')
    rail = ("[joints.bearing]", "[ground.markers.rail]\nposition = [0, 3, 0]\n[joints.bearing]")
    lines = refused("run", scene(folder, far, rail), "--output", "out")
    assert lines[0].startswith("assembly: the initial positions cannot be assembled")
    assert 3 <= len(lines) <= 5
    for line in lines[1:-1]:
        assert line.startswith(("joints.", "drivers."))
        assert "stays open by" in line and " m and " in line and " deg" in line
    assert lines[-1].startswith("assembly: moved in vain: ")


def test_an_output_folder_that_is_a_file(folder: Path) -> None:
    (folder / "out").write_text("")
    lines = refused("run", scene(folder), "--output", "out")
    assert lines == ["cannot write to the output folder out: out is a file"]
    lines = refused("run", scene(folder), "--output", "out/below")
    assert lines == ["cannot write to the output folder out/below: out is a file"]
    lines = refused("run", scene(folder), "--output", "/proc/flexmb")
    assert lines[0].startswith("cannot write to the output folder /proc/flexmb: ")


def test_a_body_file_that_cannot_be_written(folder: Path) -> None:
    write_box(folder / "box.msh")
    (folder / "file").write_text("")
    lines = refused("reduce", "box.msh", "--material", "steel", *REDUCE, "-o", "file/b.h5")
    assert lines == ["file/b.h5: cannot write the flexible body: Not a directory"]


@pytest.mark.seconds
def test_files_that_are_not_ours(folder: Path) -> None:
    (folder / "text.h5").write_text("hello")
    with h5py.File(folder / "strange.h5", "w") as file:
        file["data"] = [1, 2, 3]
    for command in ("info", "render"):
        assert "text.h5: is not an HDF5 file" in refused(command, "text.h5")[0]
        assert "strange.h5: " in refused(command, "strange.h5")[0]
        assert "flexmb" in refused(command, "strange.h5")[0]
    assert (
        "b.flexbody.h5" in refused("render", save(rigid_body(1.0, inertia=1.0), "b.flexbody.h5"))[0]
    )


def test_files_of_another_version(folder: Path, result: Path) -> None:
    body = save(rigid_body(1.0, inertia=1.0), folder / "b.flexbody.h5")
    copy = folder / "result.h5"
    copy.write_bytes(result.read_bytes())
    for path in (body, copy):
        with edit_hdf5(path) as file:
            file.attrs["version"] = 99
        lines = refused("info", path)
        assert len(lines) == 1
        assert path.name in lines[0] and "version 99" in lines[0]
    assert "version 99" in refused("render", copy)[0]
    text = '[bodies.b]\nflexbody = "b.flexbody.h5"\n[dynamics]\nduration = 1\nstep = 0.1\n'
    lines = refused("run", scene(folder, text=text))
    assert "b.flexbody.h5" in lines[0] and "version 99" in lines[0]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    import slidercrank

    return slidercrank.make(tmp_path_factory.mktemp("run"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "a.toml", "--vary", "r=1"], "--vary; it is an option of modes, statics, study"),
        (["run", "a.toml", "--debug"], "it stands before the command: flexmb --debug ..."),
        (["run", "a.toml", "--out", "b"], "--out (Possible options: --output)"),
        (
            ["run", "a.toml", "--method", "radau"],
            "--method; it is given as --set dynamics.method=VALUE",
        ),
        (["render", "a.h5", "--labels", "all"], "--labels; it is given as --view labels=VALUE"),
        (["linearize", "a.toml"], 'No such command "linearize"; its word is in the help of modes'),
        (["modess", "a.toml"], "No such command 'modess'. Did you mean 'modes'"),
        (["rum", "a.toml"], "No such command 'rum'. Did you mean 'run'"),
        (["scene.toml"], "No such command 'scene.toml'."),  # nearly every help has the word
    ],
)
def test_options_and_words_of_other_commands_are_told(words: list[str], said: str) -> None:
    done = call(*words)
    assert done.exit_code == 2
    assert said in done.stderr


def test_an_interface_may_be_a_table(tmp_path: Path) -> None:
    mesh = write_box(tmp_path / "box.msh")
    words = ["reduce", mesh, "--material", "steel", "--modes", "2", "--output", tmp_path / "box.h5"]
    ends = "a={center = [0, 0, 0], radius = %s}"
    assert "hold all its nodes" in refused(*words, "--interface", ends % 9)[0]
    assert "is no table" in call(*words, "--interface", "a={center = [0").stderr
    assert refused(*words, "--interface", "a={centre = 3}")[0].startswith("interfaces.a.centre: ")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--frequencies", "nan"], "frequencies [Hz] are not negative, such as"),
        (["--frequencies", "1,abc"], "given abc"),
        (["--frequencies=-2"], "given -2"),
        (
            ["--frequencies", "1..x", "--input", "push.x", "--sensor", "x.x"],
            "must have two numbers",
        ),
        (["--output", "x.txt"], "must end in .png or .pdf or .svg"),
        (["--input", "push.x"], "--sensor: is missing"),
        (["--output", "x.png"], "--input and --sensor: is missing"),
    ],
)
def test_wrong_options_of_a_response_are_told_before_it(words: list[str], said: str) -> None:
    """Even where only the names of inputs and sensors would be shown."""
    done = call("response", "nothing.toml", *words)
    assert done.exit_code == 2
    assert said in " ".join(done.stderr.split())


def test_a_response_that_is_not_finite_is_told(folder: Path) -> None:
    """A free mass: x = f/(m (2 pi f)^2), without bound at 0 Hz."""
    (folder / "free.toml").write_text(
        """
[bodies.m]
mass = 2
inertia = [1, 1, 1]
[forces.push]
type = "force"
at = "m"
value = [0, 0, 0]
[sensors.x]
type = "position"
of = "m"
[dynamics]
duration = 1
"""
    )
    words = ["--input", "push.x", "--sensor", "x.x", "--frequencies", "0,1"]
    done = call("response", folder / "free.toml", *words)
    assert done.exit_code == 0
    assert "nan" not in done.output
    assert "no steady response at 0 Hz" in done.output
    assert f"largest: {1 / (2 * (2 * 3.141592653589793) ** 2):.5g} at 1 Hz" in done.output


@pytest.mark.seconds
def test_a_folder_named_as_a_scene_is_told_once(folder: Path) -> None:
    (folder / "all" / "dir.toml").mkdir(parents=True)
    (said,) = refused("check-all", folder / "all")
    assert said.count("dir.toml") == 1
