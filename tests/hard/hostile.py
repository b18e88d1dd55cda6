"""Hostile inputs by kind: each makes a file or a text from a number and lets flexmb read it.

What reads is the command line, as a user would call it, so that what it prints is judged too.
"""

from __future__ import annotations

import datetime as dt
import json
import os
import shutil
import tomllib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

from flexmb import untrusted
from flexmb.errors import FlexmbError
from tests.hard.hostile_seeds import MANY, SCENE
from tests.hard.mutation import (
    NUMBERS,
    VALUES,
    WORDS,
    mutate_bytes,
    mutate_hdf5,
    mutate_parquet,
    mutate_table,
)


@cache
def seed_files(folder: Path, pattern: str) -> list[tuple[Path, bytes]]:
    return [(path, path.read_bytes()) for path in sorted(folder.glob(pattern))]


@cache
def mesh_seeds(folder: Path) -> dict[str, list[tuple[Path, bytes]]]:
    """By ending, so that each format has its share."""
    endings: dict[str, list[tuple[Path, bytes]]] = {}
    for path, data in seed_files(folder / "seeds", "*-*.*"):
        endings.setdefault("".join(path.suffixes), []).append((path, data))
    return endings


@cache
def scenes(folder: Path) -> list[tuple[Path, str, dict[str, Any]]]:
    read = []
    for path, data in seed_files(folder / "cases", "*/*.toml"):
        with suppress(tomllib.TOMLDecodeError, UnicodeDecodeError):
            if not path.name.startswith("fuzz"):
                read.append((path, data.decode(), tomllib.loads(data.decode())))
    return read


def toml(value: Any) -> str:
    """A value as TOML writes it; whole scenes are one inline table per section."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{toml(str(k))} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, dt.date | dt.time):
        return value.isoformat()
    return '"' + "".join(
        c if c.isalnum() or c in " ._-+*/()" else f"\\U{ord(c) & 0x10FFFF:08x}"
        if not 0xD800 <= ord(c) < 0xE000 else "?" for c in str(value)
    ) + '"'  # fmt: skip


def command(*words: str | Path) -> None:
    """Run a command of flexmb in this process; its mistakes are `SystemExit` or alike."""
    import typer

    from flexmb.cli import app

    application = _command(app, typer)
    application.main([*map(str, words)], prog_name="flexmb", standalone_mode=True)


@cache
def _command(app: Any, typer: Any) -> Any:
    return typer.main.get_command(app)


def scene(rng: Random, folder: Path) -> None:
    """A scene with mutated text or tables: read, and one of ten checked."""
    path, text, tables = rng.choice(scenes(folder))
    if rng.random() < 0.4:
        others = [rng.choice(scenes(folder))[1].encode() for _ in range(2)]
        data = mutate_bytes(text.encode(), rng, others)
    else:
        mutated = mutate_table(tables, rng, rng.choice(scenes(folder))[2])
        data = "\n".join(f"{toml(str(k))} = {toml(v)}" for k, v in mutated.items()).encode()
    target = path.with_name(f"fuzz{os.getpid()}.toml")
    target.write_bytes(data)
    if rng.random() < 0.15:
        command("check", target)
    else:
        from flexmb.model import load_scene

        load_scene(target).problems()


def grammar(rng: Random, folder: Path) -> None:
    """A scene whose text is TOML throughout: odd numbers, names and forms, depth and length."""
    _, _, tables = rng.choice(scenes(folder))
    tables = mutate_table(tables, rng, rng.choice(scenes(folder))[2])
    lines = []
    for section, inside in tables.items():
        if not isinstance(inside, dict) or rng.random() < 0.2:
            lines.insert(0, f"{toml(str(section))} = {_form(inside, rng)}")
            continue
        lines.append(f"[{toml(str(section))}]")
        for name, value in inside.items():
            lines += [f"{toml(str(name))} = {_form(value, rng)}"] * (1 + (rng.random() < 0.003))
            if rng.random() < 0.02:
                lines.append(f"{toml(str(name).swapcase())} = {_form(value, rng)}")
        if rng.random() < 0.02:
            lines.append(f"[[{toml(str(section))}.{rng.choice(('a', 'x.y', toml('')))}]]")
    target = folder / "cases" / "hub_beam" / f"fuzz{os.getpid()}.toml"
    target.write_text("\n".join(lines), encoding="utf-8", errors="replace")
    from flexmb.model import load_scene

    load_scene(target).problems()


def _form(value: Any, rng: Random) -> str:
    """A value, or seldom something else, as TOML may write it."""
    what = rng.random()
    if what < 0.985:
        return toml(value)
    odd = ("nan", "-inf", "+1e308", "1e400", "0x7fffffffffffffff", "0b1", "1_0.0_1", "1979-05-27",
           "07:32:00", "1979-05-27T00:32:00.999999-07:00", "'''a\nb'''", '"""\\\n a"""', "[[], {}]",
           "true", "{}", "-0", '"\\U0010FFFF"', "9" * 4000)  # fmt: skip
    depth, length = rng.choice((3, 50, 400, 3000)), rng.choice((0, 1, 1000, 30_000))
    return rng.choice((
        rng.choice(odd), rng.choice(odd), toml(rng.choice(VALUES)),
        "[" * depth + "]" * depth, "{a = " * min(depth, 400) + "1" + "}" * min(depth, 400),
        f"[{'1, ' * length}]", f"[{toml(value)}, {toml(value)}]", toml("x" * length),
        "{" + ", ".join(f"k{i} = {i}" for i in range(length)) + "}",
    ))  # fmt: skip


_ATOMS = (
    "t", "pi", "sin(t)", "step(t,0,0,1,2)", "if(t<1,0,1)", "abs(t-1)", "1e308", "-1", "0", "1/t",
    "sqrt(t-1)", "asin(2*t)", "exp(1e3*t)", "t**t", "t^2", "t**0.5", "mod(t,1)", "min(t,1)",
    "hypot(t,1)", "atan2(t,0)", "sign(t-1)", "2 deg", "swing", "rod.x", "t if t else 1", "log(t)",
)  # fmt: skip
_ATTACKS = (
    "__import__('os').system('touch owned')", "().__class__.__bases__[0].__subclasses__()",
    "open('owned','w')", "lambda: 1", "[x for x in (1,)]", "t.__class__", "f'{t}'", "t:=1", "'a'*9",
    "9**9**9**9", "(" * 300 + "t" + ")" * 300, "-" * 5000 + "t", "t" + "+t" * 5000, "1_0", "0x1F",
    "1j", "...", "t[0]", "*t", "**t", "sin(*[t])", "sin(x=t)", "sin", "sin()", "eval('1')", "t;t",
    "t\nt", "#", "not t", "t and t", "t<t<t", "1<<99999", "10**10**5", "t**1e9", "t**-400",
    "sin(" * 95,
)  # fmt: skip


def formula(rng: Random, depth: int = 0) -> str:
    """A random expression, mostly well formed."""
    what = rng.random()
    if depth > 4 or what < 0.25:
        return rng.choice(_ATOMS[:18]) if rng.random() < 0.96 else rng.choice(NUMBERS + _ATOMS)
    if what < 0.6:
        operator = rng.choice(("+", "-", "*", "/", "**", "+", "-", "*", "/", "<", "and"))
        return f"{formula(rng, depth + 1)}{operator}{formula(rng, depth + 1)}"
    if what < 0.9:
        names = "sin cos tan exp log sqrt abs sign asin acos atan tanh min max atan2 hypot step f"
        name = rng.choice(names.split())
        many = 5 if name == "step" else 2 if name in ("min", "max", "atan2", "hypot") else 1
        inside = [formula(rng, depth + 1) for _ in range(many + (rng.random() < 0.05))]
        return f"{name}({','.join(inside)})"
    return rng.choice((f"({formula(rng, depth + 1)})", f"-{formula(rng, depth + 1)}"))


def expression(rng: Random, folder: Path) -> None:
    """An expression as a driver, a force, a parameter, a controller and a sensor."""
    from flexmb.model import Model

    what = rng.random()
    text = formula(rng) if what < 0.7 else rng.choice(_ATTACKS + WORDS)
    if what < 0.2 or what > 0.85:
        text = mutate_bytes(text.encode(), rng, [b"sin(2*pi*t)", b"1e-3*step(t,0,0,1,1)"]).decode(
            "utf-8", "replace"
        )
    where = rng.choice((
        {"parameters": {"a": text}, "drivers": {"m": {"joint": "pin", "angle": "a*t"}}},
        {"drivers": {"m": {"joint": "pin", "angle": text}}},
        {"drivers": {"m": {"joint": "pin", "angle": text, "prescribes": "velocity"}}},
        {"forces": {"f": {"type": "force", "at": "rod", "value": [text, 0, 0]}}},
        {"forces": {"f": {"type": "torque", "at": "rod", "value": [0, 0, text]}}},
        {"sensors": {"s": {"type": "expression", "value": text}}},
        {"bodies": {"rod": {"mass": text, "inertia": [1, 1, 1]}}},
        {"gravity": [0, text, 0]},
    ))  # fmt: skip
    scene = tomllib.loads(SCENE) | where
    Model.from_scene_dict(scene, folder).problems()


def words(rng: Random, folder: Path) -> None:
    """Units, materials, values of sweeps and overrides."""
    from flexmb.cli.app import parse_numbers, parse_size, parse_table
    from flexmb.materials import material
    from flexmb.model.scenes.study import override, sweep_values
    from flexmb.units import parse_unit, unit_system

    seeds = (b"1e-2..1e-6", b"1, 2, 3", b"N/mm^2", b"kg*m^2/s", b"deg/s", b"1e-3..1e-5:5",
             b"{E = 70e9, nu = 0.33, density = 2700}", b"steel", b"[1, 2]", b"0.1*pi", b"mm-t-s",
             b"a.b.c")  # fmt: skip
    text = mutate_bytes(rng.choice(seeds), rng, list(seeds)).decode("utf-8", "replace")
    what = rng.randrange(7)
    if what == 0:
        sweep_values(text)
    elif what == 1:
        parse_unit(text)
    elif what == 2:
        unit_system(text)
    elif what == 3:
        material(text)
    elif what == 4:
        parse_table(text, "--material")
    elif what == 5:
        parse_size(text), parse_numbers(text, "--modes")
    else:
        tables = tomllib.loads(SCENE)
        name = rng.choice(("dynamics.step", "bodies.rod.mass", "a", text, "joints.pin.axis"))
        _, problems = override(tables, {name: text})
        if problems:
            raise FlexmbError.from_problems(problems)


def section(rng: Random, folder: Path) -> None:
    """A scene with a mutated [study] or [sweep], or one of the cases with a mutated [part]."""
    from flexmb.model import Model
    from flexmb.studies.study_settings import StudySource, make_settings
    from flexmb.studies.sweeps.parameter_sweep import _plan

    tables, place = tomllib.loads(SCENE), folder
    sections = {
        "study": {"vary": {"dynamics.step": "1e-3..1e-5", "dynamics.method": ["auto", "radau"]},
                  "target": 0.01, "repeats": 2, "sensors": ["swing"]},
        "sweep": {"vary": {"bodies.rod.mass": "normal(1, 0.1)", "dynamics.step": "1e-4..1e-3:3",
                           "gravity": ["earth -y", [0, 0, 0]]},
                  "method": "latin-hypercube", "samples": 8, "seed": 3, "sensors": ["swing:max"],
                  "quantiles": [0.05, 0.95]},
        "part": {},
    }  # fmt: skip
    name = rng.choice(sorted(sections))
    if name == "part":
        parts = [(path.parent, one) for path, _, one in scenes(folder) if "part" in one]
        place, tables = rng.choice(parts)
        sections["part"] = tables["part"]
    other = rng.choice(scenes(folder))[2]
    tables = tables | {name: mutate_table({name: sections[name]}, rng, other).get(name, {})}
    model = Model.from_scene_dict(tables, place)
    if model.problems() or name == "part":
        return
    target = folder / "fuzz.toml"
    target.write_text("\n".join(f"{toml(k)} = {toml(v)}" for k, v in tables.items()))
    source = StudySource.of(target, None, folder / "study", "study")
    if name == "sweep":
        _plan(source, None, {}, False)
    elif model.study is not None:
        make_settings(source, model.study.vary)


def records(rng: Random, folder: Path) -> None:
    """The folder of a study, sweep or budget with a mutated file: shown, or done again."""
    name = rng.choice(sorted(MANY))
    place = folder / "records"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(folder / "seeds" / name, place)
    endings = ("parquet", "parquet", "parquet", "csv", "md", "json")
    files = [path for ending in endings for path in sorted(place.rglob(f"*.{ending}"))]
    target = rng.choice(files)
    data = target.read_bytes()
    if target.suffix == ".parquet" and rng.random() < 0.8:
        data = mutate_parquet(data, rng, [data])
    elif target.suffix == ".parquet":  # as a killed command leaves it
        import pyarrow.parquet as pq

        read = {"rows": pq.read_table(target).to_pylist()}
        rows = mutate_table(read, rng, read).get("rows")
        about = pq.read_schema(target).metadata[b"flexmb"]
        each = rows if isinstance(rows, list) else ()
        data = b"\n".join((about, *(json.dumps(row, default=str).encode() for row in each)))
        if rng.random() < 0.5:
            data = mutate_bytes(data, rng, [data])
        target.unlink()
        target = place / "runs.parts" / "journal.jsonl"
        target.parent.mkdir(exist_ok=True)
    elif target.suffix == ".json" and rng.random() < 0.6:
        tables = mutate_table({"json": json.loads(data)}, rng, rng.choice(scenes(folder))[2])
        data = json.dumps(tables.get("json"), default=str).encode()
    else:
        data = mutate_bytes(data, rng, [data, b"[" * 99_999])
    target.write_bytes(data)
    if rng.random() < 0.4:
        command("report", place, "--output", place / "r.html", "--force")
    else:
        words = (*map(str, MANY[name]), "--workers", "1", "--output", str(place))
        command(name, folder / "seeds" / "short.toml", *words)


def table(rng: Random, folder: Path) -> None:
    """A table of a function or of a curve."""
    from flexmb.model.functions.tabulated import Columns, read_columns
    from flexmb.units import SI

    rows = "\n".join(f"{k / 10},{k % 7},{-k}" for k in range(rng.choice((1, 3, 40))))
    header = rng.choice(("", "t,y,z\n", "# c\n", "t;y\n"))
    data = mutate_bytes((header + rows).encode(), rng, [b"1,2\n3,4\n", b"t\ty\n0\t1\n"])
    path = folder / "fuzz.csv"
    path.write_bytes(data)
    if rng.random() < 0.5:
        names: tuple[Any, Any] = rng.choice(((1, 2), ("t", "y"), (2, 9), ("y", 1)))
        read_columns(path, Columns(names, rng.choice((None, ("s", "m"), ("ms", "x")))), SI, "m")
        return
    from flexmb.model import Model

    form = rng.choice(("cubic-spline", "akima-spline", "table"))
    function = {"type": form, "file": "fuzz.csv", "columns": [1, 2], "beyond": rng.choice(
        ("error", "hold", "extrapolate", "periodic"))}  # fmt: skip
    if rng.random() < 0.3:
        function = mutate_table(function, rng, function)
    scene = tomllib.loads(SCENE) | {"drivers": {"m": {"joint": "pin", "angle": function}}}
    Model.from_scene_dict(scene, folder).problems()


def mesh(rng: Random, folder: Path) -> None:
    """A mesh of any format: shown, and reduced if it can be."""
    endings = mesh_seeds(folder)
    ending = rng.choice(sorted(endings))
    path, data = rng.choice(endings[ending])
    others = [other for _, other in endings[ending]] + [rng.choice(seeds)[1] for seeds in
                                                        endings.values()]  # fmt: skip
    data = mutate_bytes(data, rng, others)
    place = folder / "mesh"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    target = place / f"fuzz{rng.choice((ending, ending, ending, rng.choice(sorted(endings))))}"
    target.write_bytes(data)
    for partner in path.parent.glob(f"{path.name.split('.')[0]}.*"):  # .node beside .ele
        if partner.suffix != path.suffix:
            shutil.copy(partner, place / f"fuzz{partner.suffix}")
    if rng.random() < 0.5:
        command("info", target)
    else:
        group = rng.choice(("A", "root", "1:1", "x"))
        command("reduce", target, "--material", "steel", "--modes", "2", "--output",
                place / "fuzz.flexbody.h5", "--interface", f"a={group}")  # fmt: skip


def _hdf5(rng: Random, data: bytes, target: Path, begin: int) -> None:
    """A mutated HDF5 file with a checksum that is right, as another user would make it."""
    what = rng.random()
    if what < 0.55:
        data = mutate_hdf5(data, rng)
    elif what < 0.9:  # mostly in the structures of HDF5, which stand before the numbers
        changed = bytearray(data)
        for _ in range(rng.choice((1, 1, 3, 30))):
            place = rng.randrange(begin, len(data) if rng.random() < 0.3 else min(len(data), 9000))
            changed[place] = rng.randrange(256)
        data = bytes(changed)
    else:
        data, what = mutate_bytes(data, rng, [data]), 0.0
    target.write_bytes(data)
    if what > 0.02:
        with target.open("r+b") as disk:
            line = untrusted.seal(disk)
            disk.seek(0)
            disk.write(line[: line.index(b"tag=") + 4] + b"0" * 64 + b"\n")


def body(rng: Random, folder: Path) -> None:
    """A file of a flexible body."""
    path, data = rng.choice(seed_files(folder / "seeds", "flexible/*.flexbody.h5"))
    target = folder / "fuzz.flexbody.h5"
    _hdf5(rng, data, target, untrusted.USER_BLOCK)
    command("info", target)
    from flexmb.model import Model

    text = {"flexbody": target.name, "position": [0, 0, 0]}
    scene = {"bodies": {"rod": text}, "dynamics": {"duration": 1, "step": 0.1}}
    Model.from_scene_dict(scene, folder).problems()


def result(rng: Random, folder: Path) -> None:
    """A result file: shown, exported, resumed as far as nothing is integrated."""
    name = rng.choice(("short", "flexible"))
    place = folder / "result"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(folder / "seeds" / name, place)
    target = place / "result.h5"
    _hdf5(rng, target.read_bytes(), target, untrusted.USER_BLOCK)
    what = rng.randrange(6)
    if what < 2:
        command("info", place)
    elif what == 5:
        name = rng.choice(("plot", "stress", "audit", "modes", "compare", "response", "report"))
        parts = ("--parts", "summary,plots,model,effects,accuracy,provenance")  # without VTK
        also = {"compare": (folder / "seeds" / "short",), "report": parts}
        command(name, place, *also.get(name, ()))
    elif what == 2:
        kind = rng.choice(("sensors", "energy", "drift", "reactions", "motion", "coordinates"))
        command("export", place, "--what", kind, "--output", place / "x.csv")
    elif what == 3:
        from flexmb.results.writer import ResultWriter

        with ResultWriter.reopen(target) as writer:
            assert writer.rows_written >= 0
    else:
        from flexmb.workflow.resume import resume_run

        resume_run(place, pictures=False)


def unit(rng: Random, folder: Path) -> None:
    """A file of compiled code: damaged ones count as missing."""
    from flexmb.engine.unit_cache import read_unit, write_unit

    path = folder / "fuzz.unit"
    write_unit(path, b"code" * 50, ("a.b", "c.d"))
    whole = path.read_bytes()
    data = mutate_bytes(whole, rng, [whole, b'{"format": "flexmb unit 1"}'])
    path.write_bytes(data)
    stored = read_unit(path)
    assert stored is None or stored[0] == b"code" * 50


KINDS: dict[str, tuple[int, Callable[[Random, Path], None]]] = {
    "expression": (40_000, expression),
    "scene": (12_000, scene),
    "words": (14_000, words),
    "table": (8_000, table),
    "section": (6_000, section),
    "grammar": (6_000, grammar),
    "records": (1_500, records),
    "mesh": (6_000, mesh),
    "body": (2_000, body),
    "result": (2_000, result),
    "unit": (4_000, unit),
}
"""How many inputs of each kind, and what makes and reads one."""
