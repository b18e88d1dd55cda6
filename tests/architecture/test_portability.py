"""Nothing that one operating system alone has, and no text in an encoding left to the machine."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

POSIX_CALLS = {
    "os.fork", "os.forkpty", "os.uname", "os.getuid", "os.geteuid", "os.getgid", "os.kill",
    "os.killpg", "os.setsid", "os.getpgid", "os.mkfifo", "os.symlink", "os.link", "os.chown",
    "os.nice", "os.sched_getaffinity", "os.getloadavg", "os.system", "os.wait", "os.waitpid",
    "signal.alarm", "signal.setitimer", "signal.pause", "time.tzset", "os.rename",
    "signal.SIGKILL", "signal.SIGALRM", "signal.SIGHUP", "signal.SIGUSR1", "signal.SIGSTOP",
}  # fmt: skip
LAST_NAMES = {call.rpartition(".")[2] for call in POSIX_CALLS}
ONE_SYSTEM = {"fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "msvcrt", "winreg"}
FORKING = {"multiprocessing.Process", "multiprocessing.Pool"}
PLACES = ("/tmp", "/dev/", "/proc/", "/var/", "/home/", "C:\\")
TEXT_METHODS = {"read_text", "write_text"}


def faults(source: str) -> list[str]:
    """What is not portable in a module, each with its line."""
    tree = ast.parse(source)
    guarded = set(_guarded(tree))
    found = []
    for node in ast.walk(tree):
        what = _fault(node, node in guarded)
        if what:
            found.append(f"{getattr(node, 'lineno', 0)}: {what}")
    return found


def _guarded(tree: ast.AST) -> Iterator[ast.AST]:
    """Everything below an `if` that asks for the platform, or a `try` that allows for absence."""
    for node in ast.walk(tree):
        asks = isinstance(node, ast.If) and "platform" in ast.unparse(node.test)
        tries = isinstance(node, ast.Try) and any(
            handler.type is not None and "ImportError" in ast.unparse(handler.type)
            for handler in node.handlers
        )
        if asks or tries:
            yield from ast.walk(node)


def _fault(node: ast.AST, guarded: bool) -> str:
    if isinstance(node, ast.Import | ast.ImportFrom) and not guarded:
        module = getattr(node, "module", None)
        names = {module or ""} if module else {alias.name for alias in node.names}
        return f"imports {names & ONE_SYSTEM}" if names & ONE_SYSTEM else ""
    if isinstance(node, ast.Attribute) and node.attr in LAST_NAMES and not guarded:
        return _dotted(node) if _dotted(node) in POSIX_CALLS else ""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        named = node.value.startswith(PLACES) and not guarded
        return f"the place {node.value}" if named else ""
    return _call_fault(node) if isinstance(node, ast.Call) else ""


def _dotted(node: ast.AST) -> str:
    """A name as it is written, what stands before its points left out where that is no name."""
    if isinstance(node, ast.Attribute):
        return f"{_dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def _call_fault(call: ast.Call) -> str:
    name = _dotted(call.func)
    keywords = {keyword.arg for keyword in call.keywords}
    method = name.rpartition(".")[2]
    if name in FORKING or (method == "ProcessPoolExecutor" and "mp_context" not in keywords):
        return f"{name} without a start method: use the context of spawn"
    starts = method in ("get_context", "set_start_method")
    if starts and [ast.unparse(arg) for arg in call.args] != ["'spawn'"]:
        return f"{name} must ask for spawn"
    if "encoding" in keywords:
        return ""
    if method in TEXT_METHODS or (method == "open" and _opens_text(name, call)):
        return f"{name} without encoding"
    return f"{name} of text without encoding" if {"text", "universal_newlines"} & keywords else ""


def _opens_text(name: str, call: ast.Call) -> bool:
    """Whether an `open` opens a text file: the builtin one, or that of a path."""
    if name in ("os.open", "h5py.File", "webbrowser.open"):
        return False
    at = 1 if name in ("open", "io.open") else 0
    modes = [k.value for k in call.keywords if k.arg == "mode"] or call.args[at : at + 1]
    return not (modes and isinstance(modes[0], ast.Constant) and "b" in str(modes[0].value))


@pytest.mark.parametrize("folder", ["flexmb", "meshes"])
def test_the_sources_run_on_every_system(project: Path, folder: str) -> None:
    paths = sorted((project / folder).rglob("*.py"))
    assert paths
    found = {
        path.relative_to(project).as_posix(): told
        for path in paths
        if (told := faults(path.read_text(encoding="utf-8")))
    }
    assert found == {}


def test_the_window_of_vtk_is_chosen_in_one_place(project: Path) -> None:
    homes = [
        path.name
        for path in (project / "flexmb").rglob("*.py")
        if "VTK_DEFAULT_OPENGL_WINDOW" in path.read_text(encoding="utf-8")
    ]
    assert homes == ["vtk_renderer.py"]


def test_text_files_of_the_package_have_one_kind_of_line_end(project: Path) -> None:
    endings = (".py", ".toml", ".msh", ".md")
    paths = [p for p in (project / "flexmb").rglob("*") if p.suffix in endings]
    assert [path for path in paths if b"\r" in path.read_bytes()] == []


@pytest.mark.parametrize(
    "source",
    [
        "open('a')",
        "open('a', 'w')",
        "path.open()",
        "path.open('a')",
        "path.read_text()",
        "path.write_text('x')",
        "subprocess.run(['a'], text=True)",
        "os.fork()",
        "os.kill(1, 9)",
        "os.rename(a, b)",
        "signal.signal(signal.SIGALRM, f)",
        "import fcntl",
        "from resource import getrlimit",
        "folder = '/tmp/x'",
        "multiprocessing.Process(target=f)",
        "multiprocessing.get_context('fork')",
        "ProcessPoolExecutor(2)",
    ],
)
def test_it_would_be_seen(source: str) -> None:
    assert len(faults(source)) == 1


@pytest.mark.parametrize(
    "source",
    [
        "open('a', 'rb')",
        "open('a', encoding='utf-8')",
        "path.open('xb')",
        "path.read_text(encoding='utf-8')",
        "subprocess.run(['a'], text=True, encoding='utf-8')",
        "os.replace(a, b)",
        "if sys.platform != 'win32':\n    import fcntl\n    os.kill(1, 9)",
        "try:\n    import fcntl\nexcept ImportError:\n    fcntl = None",
        "ProcessPoolExecutor(2, mp_context=multiprocessing.get_context('spawn'))",
    ],
)
def test_what_is_portable_passes(source: str) -> None:
    assert faults(source) == []
