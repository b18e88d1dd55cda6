"""How the package is cut: files, lines, import circles, names, and what runs for the main job.

``python -m tests.benchmarks.structure`` prints the figures, with ``--list`` what they are made of.
"""

from __future__ import annotations

import argparse
import ast
import collections
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "flexmb"
#: Participles say what happened to a thing, not what it is.
PARTICIPLES = {
    "found", "told", "kept", "held", "given", "chosen",
    "asked", "known", "placed", "laid", "lay", "said",
}  # fmt: skip
_LAYERS_OF_ONE_CONCEPT = 2


def files():
    """Python files of the package."""
    return sorted(PACKAGE.rglob("*.py"))


def line_count():
    """Lines of all Python files of the package."""
    return sum(len(file.read_text().splitlines()) for file in files())


def participles():
    """Identifiers (names, arguments, attributes, functions, keywords) that are participles.

    Returns
    -------
    collections.Counter
        Occurrences, by ``(identifier, file)``.
    """
    count = collections.Counter()
    for file in files():
        for node in ast.walk(ast.parse(file.read_text())):
            names = [
                getattr(node, field, None) for field in ("id", "arg", "attr", "name", "asname")
            ]
            for name in names:
                if isinstance(name, str) and PARTICIPLES & set(name.strip("_").split("_")):
                    count[name, str(file.relative_to(ROOT))] += 1
    return count


def repeated_base_names():
    """Base names that more than two files share (the two of one concept), with the files."""
    by_name = collections.defaultdict(list)
    for file in files():
        if file.stem not in ("__init__", "__main__"):
            by_name[file.stem].append(str(file.relative_to(PACKAGE)))
    return {name: paths for name, paths in by_name.items() if len(paths) > _LAYERS_OF_ONE_CONCEPT}


def imports():
    """Modules of the package that each imports: when loaded, within functions, for types."""
    names = {module_of(file): file for file in files()}
    edges = {}
    for module, file in names.items():
        package = module if file.name == "__init__.py" else module.rpartition(".")[0]
        edges[module] = set()
        for node in ast.walk(ast.parse(file.read_text())):
            for name in _targets(node, package):
                target = name
                while target and target not in names:
                    target = target.rpartition(".")[0]
                if target and target != module and not module.startswith(target + "."):
                    edges[module].add(target)
    return edges


def module_of(file):
    """Dotted name of a file of the package."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def circles():
    """Sets of modules that import one another, the largest first (Tarjan)."""
    edges, index, low, stack, circles = imports(), {}, {}, [], []
    sys.setrecursionlimit(10_000)

    def visit(module):
        index[module] = low[module] = len(index)
        stack.append(module)
        for target in edges[module]:
            if target not in index:
                visit(target)
                low[module] = min(low[module], low[target])
            elif target in stack:
                low[module] = min(low[module], index[target])
        if low[module] == index[module]:
            circle = stack[stack.index(module) :]
            del stack[stack.index(module) :]
            if len(circle) > 1:
                circles.append(sorted(circle))

    for module in edges:
        if module not in index:
            visit(module)
    return sorted(circles, key=len, reverse=True)


def files_of_main_job():
    """Files and functions that run from mesh to picture: the flexible beam that ``new`` writes.

    Returns
    -------
    dict of str to list of str
        Functions by file. Neither bodies of modules and classes count, which run when they are
        imported, nor generators and lambdas within functions; compiled functions are not seen.
    """
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [sys.executable, "-c", _PROFILED, folder],
            check=True, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdout=subprocess.DEVNULL,
        )  # fmt: skip
        return json.loads((Path(folder) / "seen.json").read_text())


_PROFILED = """
import collections, inspect, json, sys, threading
from pathlib import Path
import flexmb
root = str(Path(flexmb.__file__).parent)
seen = collections.defaultdict(set)
def profile(frame, event, _):
    code = frame.f_code
    function = code.co_flags & inspect.CO_OPTIMIZED and not code.co_name.startswith("<")
    if event == "call" and function and code.co_filename.startswith(root):
        seen[code.co_filename[len(root) + 1:]].add(code.co_qualname)
from flexmb.cli import main
def call(*words):
    sys.argv = ["flexmb", *words]
    try:
        main()
    except SystemExit as end:
        assert not end.code, words
folder = Path(sys.argv[1])
import os
os.chdir(folder)
call("new", "beam", "--template", "flexible-beam")
threading.setprofile(profile)
sys.setprofile(profile)
call("run", *map(str, folder.rglob("*.toml")), "--output", str(folder / "out"))
sys.setprofile(None)
assert any(file.startswith("fe") for file in seen), "no mesh was reduced"
json.dump({file: sorted(names) for file, names in seen.items()}, open(folder / "seen.json", "w"))
"""


def seconds_of(*words, times=3):
    """Least wall seconds of a new Python process, which reads its modules as bytecode."""
    least = float("inf")
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": ""}
    for _ in range(times):
        begin = time.perf_counter()
        subprocess.run([sys.executable, *words], check=True, cwd=ROOT, env=environment,
                       stdout=subprocess.DEVNULL)  # fmt: skip
        least = min(least, time.perf_counter() - begin)
    return least


def _targets(node, package):
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        base = node.module or ""
        if node.level:
            above = package.rsplit(".", node.level - 1)[0] if node.level > 1 else package
            base = f"{above}.{base}".rstrip(".")
        return [f"{base}.{alias.name}" for alias in node.names]
    return []


def main():
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--list", action="store_true", help="what the figures are made of")
    parser.add_argument("--static", action="store_true", help="run nothing")
    options = parser.parse_args()
    names, around, repeated = participles(), circles(), repeated_base_names()
    print(f"files of the package          {len(files())}")
    print(f"lines of the package          {line_count()}")
    print(
        f"largest import circle         {len(around[0]) if around else 0} ({len(around)} circles)"
    )
    print(f"identifiers: participles      {names.total()}")
    print(f"base names of three and more  {len(repeated)}")
    print(f"lines of README               {len((ROOT / 'README.md').read_text().splitlines())}")
    by_floor = collections.Counter()
    for file in files():
        parts = file.relative_to(PACKAGE).parts
        by_floor[parts[0] if len(parts) > 1 else "."] += 1
    print("files by floor                " + ", ".join(f"{k} {v}" for k, v in by_floor.items()))
    if not options.static:
        seen = files_of_main_job()
        functions = sum(map(len, seen.values()))
        print(f"run from mesh to picture      {len(seen)} files, {functions} functions")
        print(f"import flexmb                 {seconds_of('-c', 'import flexmb'):.2f} s")
        check = seconds_of("-m", "flexmb", "check", "cases/slider_crank/scene.toml")
        print(f"check of the slider-crank     {check:.2f} s")
    if options.list:
        for circle in around:
            print("circle:", *circle)
        for name, paths in repeated.items():
            print(f"{name}:", *paths)
        for (name, file), count in sorted(names.items(), key=lambda item: (item[0][1], -item[1])):
            print(f"{file}: {name} {count}")


if __name__ == "__main__":
    main()
