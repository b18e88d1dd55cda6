"""The rooms of the package and their doors: who may import whom, and what a light import costs."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = (
    "numpy", "scipy", "skfem", "meshio", "pyvista", "vtkmodules", "matplotlib", "numba", "h5py",
    "pydantic", "typer", "rich",
)  # fmt: skip
MOST_LINES = 450
TOP_LEVEL = {"pyproject.toml", "README.md", "LICENSE", "flexmb", "meshes", "cases", "tests"}


def _sources(project: Path, folder: str) -> list[Path]:
    return sorted((project / folder).rglob("*.py"))


def test_the_import_contracts_hold(project: Path) -> None:
    lint = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports())"
    done = subprocess.run(
        [sys.executable, "-c", lint], cwd=project, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_importing_flexmb_loads_nothing_heavy() -> None:
    code = "import sys, flexmb; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert not loaded & set(HEAVY)


def test_importing_the_view_loads_no_renderer() -> None:
    views = ("film", "history", "modes", "part_pictures", "picture", "plot", "window")
    modules = ", ".join(["flexmb.cli", *(f"flexmb.view.{name}" for name in views)])
    code = f"import sys, {modules}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert not loaded & {"pyvista", "vtkmodules", "matplotlib", "skfem", "meshio", "numba"}


def test_every_public_name_resolves() -> None:
    import flexmb

    found = [name for _, name, _ in pkgutil.walk_packages(flexmb.__path__, "flexmb.")]
    assert len(found) > 20
    for name in ["flexmb", *found]:
        module = importlib.import_module(name)
        for public in getattr(module, "__all__", ()):
            assert hasattr(module, public), f"{name}.__all__ names {public}, which is not there"


def test_kernels_import_numpy_the_tables_and_each_other(project: Path) -> None:
    outside = ("__future__", "collections.abc", "dataclasses", "math", "typing", "numpy")
    tables = (
        "flexmb.engine.tables",
        "flexmb.engine.state",
        "flexmb.engine.method",
        "flexmb.engine.kind",
        "flexmb.engine.lowering",
        "flexmb.engine.jit",
    )
    rooms = ("algebra", "bodies", "joints", "forces", "sensors")
    equations = ("function", "equations_of_motion", "iteration_matrix", "projection")
    engine = (*tables, *(f"flexmb.engine.{name}" for name in (*rooms, *equations)))
    files = [path for room in rooms for path in _sources(project, f"flexmb/engine/{room}")]
    files += [project / f"flexmb/engine/{name}.py" for name in equations]
    kernels = [
        path
        for path in files
        if re.search("^@(unit|kernel)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert len(kernels) > 20
    for path in kernels:
        assert _strangers(path, (*outside, *engine)) == [], path.name
    for table in tables:
        path = project / (table.replace(".", "/") + ".py")
        assert _strangers(path, (*outside, *tables, "functools", "types")) == [], table


def _strangers(path: Path, allowed: tuple[str, ...]) -> list[str]:
    """Modules that a file imports to run, from outside the allowed ones."""

    def known(module: str) -> bool:
        return any(module == name or module.startswith(f"{name}.") for name in allowed)

    return [module for module in _imported(path) if not known(module)]


def _imported(path: Path) -> list[str]:
    """Modules that a file imports, but for types alone."""
    modules: list[str] = []
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for_types = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if node in for_types:
            continue
        if isinstance(node, ast.Import):
            modules += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            modules.append("." * node.level + (node.module or ""))
    return modules


@pytest.mark.parametrize("folder", ["flexmb", "tests"])
def test_files_stay_small_enough_to_be_read(project: Path, folder: str) -> None:
    lengths = {
        str(path.relative_to(project)): path.read_text(encoding="utf-8").count("\n")
        for path in _sources(project, folder)
    }
    assert {name: n for name, n in lengths.items() if n > MOST_LINES} == {}


def test_the_library_never_prints(project: Path) -> None:
    # a program of its own, which answers its parent so
    compiler = project / "flexmb" / "engine" / "compiler.py"
    assert compiler.is_file()
    for path in _sources(project, "flexmb"):
        text = path.read_text(encoding="utf-8")
        if path == compiler or "print" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            called = node.func if isinstance(node, ast.Call) else None
            printing = isinstance(called, ast.Name) and called.id == "print"
            assert not printing, f"{path.relative_to(project)}:{node.lineno} prints"


def test_the_top_level_holds_what_it_should(project: Path) -> None:
    if not (project / ".git").exists():
        pytest.skip("no checkout")
    done = subprocess.run(
        ["git", "ls-files"], cwd=project, capture_output=True, text=True, check=False
    )
    if done.returncode:
        pytest.skip("git cannot read the checkout")
    names = {line.split("/")[0] for line in done.stdout.splitlines()}
    assert {name for name in names if not name.startswith(".")} <= TOP_LEVEL
