"""Files that may come from elsewhere: read at first in a process with little time and memory.

Parsers of meshes may loop in a damaged file, or make room for as many nodes as 20 bytes state;
`check_reading` finds that out in a process of its own, once for each content.

HDF5 follows links and external storage into any file of the user, takes the sizes that a file
states on trust, and may loop in damaged data. So a file is opened in three steps:

1. The **seal**, a line in the first 512 bytes (the user block of HDF5), states the SHA-256 of all
   that follows. A file that does not match is refused. The tag behind it is an HMAC with a key in
   the cache folder: it tells that flexmb wrote the file here, for this user.
2. A file without such a tag is read once by a process of its own, which refuses links, external
   storage, filters and sizes beyond the length of the file.
3. The file is opened for reading, without lock.
"""

from __future__ import annotations

import hashlib
import hmac
import math
import os
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, NoReturn

from flexmb.errors import FlexmbError, printable
from flexmb.folders import cache_root, is_private

if TYPE_CHECKING:
    import h5py

USER_BLOCK: Final = 512  # bytes before the HDF5 data: room for the seal
_SEAL: Final = b"flexmb seal 1 "
_PIECE = 1 << 20
_SECONDS, _BYTES_A_SECOND = 8.0, 1e5  # time of the first reading; texts take most of it
_MEMORY, _MEMORY_A_BYTE = 700_000_000, 40  # bytes that reading may take, and for each of the file
_PATIENCE = 6  # wall time over that of the processor, for a busy machine
_MARK_SECONDS = 30 * 86400.0  # that a mesh was read well is forgotten after a month
_DEPTH = 8  # groups inside groups
_OBJECTS = 100_000  # groups and datasets
_HERE = "flexmb.untrusted"
_KIND = "<kind>"  # in a sentence: what the file should be
_REFUSED = 3  # exit code of the first reading
_WITH_OTHERS = "<others>"  # it is well, but names other files of its folder
_own: set[tuple[int, ...]] = set()  # files that this process is writing
_checked: set[tuple[int, ...]] = set()  # files that were checked


def seal(content: IO[bytes]) -> bytes:
    """The line that states the checksum of what follows the user block.

    Parameters
    ----------
    content : binary file
        The whole file, open for reading; it stays open.

    Returns
    -------
    bytes
        `USER_BLOCK` bytes, for the begin of the file.
    """
    content.seek(USER_BLOCK)
    digest = _digest(content)
    return (_SEAL + f"sha256={digest} tag={_tag(digest) or '-'}\n".encode()).ljust(
        USER_BLOCK, b"\0"
    )


def is_sealed(path: Path) -> bool:
    """Whether the file has the checksum of a whole file."""
    with path.open("rb") as file:
        return file.read(len(_SEAL)) == _SEAL


def begin_writing(path: Path) -> None:
    """Note that this process writes the file: until the end it is not checked here."""
    _own.add(_identity(path.stat()))


def end_writing(path: Path) -> None:
    """Note that the file is complete."""
    with suppress(OSError):  # removed meanwhile
        _own.discard(_identity(path.stat()))


def open_hdf5(path: Path, error: type[FlexmbError], kind: str) -> h5py.File:
    """Open a file for reading after the checks of this module.

    Parameters
    ----------
    path : Path
        The file.
    error : type
        What to raise.
    kind : str
        What it should be, for messages, such as ``"a result of flexmb"``.

    Raises
    ------
    FlexmbError
        Of the type `error`: no such file, no regular file, not HDF5, damaged or changed after it
        was written, links to other files, sizes beyond the file, or no end of reading.
    """
    problem = _problem(path)
    if problem is None:
        try:
            return open_of_others(path)
        except OSError as failure:
            if "locking flag" in str(failure):
                problem = (
                    "is held open in this program by other means than flexmb; close it there first"
                )
            else:
                problem = f"is a damaged HDF5 file, so not {_KIND}"
    raise error(f"{path}: {problem.replace(_KIND, kind)}")


def _problem(path: Path) -> str | None:
    """What speaks against opening the file; `_KIND` in it stands for what it should be."""
    try:
        state = path.stat()
    except OSError as failure:
        missing = isinstance(failure, FileNotFoundError | NotADirectoryError)
        return "there is no such file" if missing else f"cannot be read ({failure.strerror})"
    if not stat.S_ISREG(state.st_mode):
        return f"is {'a folder' if path.is_dir() else 'no regular file'}, so not {_KIND}"
    unsealed = (*_identity(state), state.st_size)  # a run may be writing it now
    written = (*unsealed, state.st_mtime_ns)
    try:
        with path.open("rb") as file:
            if _identity(state) in _own or {written, unsealed} & _checked:
                return None
            head = file.read(USER_BLOCK)
            content = file.read(8)
            if b"\x89HDF\r\n\x1a\n" not in (head[:8], content):
                return f"is not an HDF5 file, so not {_KIND}"
            matches = _check_seal(file, head)
    except OSError as failure:
        return f"cannot be read ({failure.strerror})"
    if matches is False:
        return (
            "does not match its checksum: it was damaged, or changed after it was written; take a "
            "copy that is whole, or make it again"
        )
    problem = None if matches else _first_reading(path, _HERE)
    if problem is None:
        _checked.add(written if head.startswith(_SEAL) else unsealed)
    return problem


def _check_seal(file: IO[bytes], head: bytes) -> bool | None:
    """False: the checksum differs; True: written here for this user; None: from elsewhere."""
    if not head.startswith(_SEAL):
        return None  # of a run that was killed, or of another program
    words = dict(
        word.partition("=")[::2]
        for word in head[len(_SEAL) :].rstrip(b"\0\n").decode("ascii", "replace").split(" ")
    )
    file.seek(USER_BLOCK)
    digest = _digest(file)
    if digest != words.get("sha256"):
        return False
    tag = _tag(digest)
    return True if tag and hmac.compare_digest(tag, words.get("tag", "")) else None


def _digest(file: IO[bytes]) -> str:
    digest = hashlib.sha256()
    while piece := file.read(_PIECE):
        digest.update(piece)
    return digest.hexdigest()


def _tag(digest: str) -> str | None:
    """HMAC of a checksum with the key of this user; None where no key can be kept."""
    path = cache_root() / "seal.key"
    with suppress(OSError):
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with suppress(FileExistsError):  # another process was faster
                handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
                with os.fdopen(handle, "wb") as file:
                    file.write(os.urandom(32))
        key = path.read_bytes()
        if len(key) == 32 and is_private(
            path
        ):  # else another process is writing it, or another user made it
            return hmac.new(key, digest.encode(), hashlib.sha256).hexdigest()
    return None


def _identity(state: os.stat_result) -> tuple[int, ...]:
    return state.st_dev, state.st_ino


def check_reading(path: Path, module: str = _HERE) -> str | None:
    """Let `module` read a file in a process of its own, unless it has read that content before.

    Parameters
    ----------
    path : Path
        The file.
    module : str
        A module that calls `serve_reading` when it is run; this one reads HDF5 and Parquet.

    Returns
    -------
    str or None
        What is wrong with the file; None if it can be read.
    """
    mark = _mark(path, module)
    if mark.exists() and is_private(mark.parent):
        return None
    problem = _first_reading(path, module)
    if problem == _WITH_OTHERS:
        return None  # whose contents the mark does not tell
    if problem is None:
        note_reading(path, module)
    return problem


def note_reading(path: Path, module: str = _HERE) -> None:
    """Note that a content was read well by `module`, or written by it."""
    with suppress(OSError):  # then it is read apart the next time as well
        mark = _mark(path, module)
        mark.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        for old in mark.parent.iterdir():
            if old.stat().st_mtime < time.time() - _MARK_SECONDS:
                old.unlink()
        mark.touch()


def _mark(path: Path, module: str) -> Path:
    with path.open("rb") as file:
        form = printable(path.suffix).replace("/", "")[:20]  # it chooses the parser
        return cache_root() / "files" / f"{module}-{_digest(file)}{form}"


def serve_reading(read: Callable[[Path], object]) -> NoReturn:
    """Read the file that the command line names, with limits; the exit code tells how that went.

    Parameters
    ----------
    read : callable
        Reads the file; a ValueError from it is the sentence on what is wrong.
    """
    import psutil

    path = Path(sys.argv[1])
    others = SiblingFiles(path)
    sys.addaudithook(others.check_open)
    if hasattr(psutil, "RLIMIT_AS"):  # Linux
        process = psutil.Process()
        limit = process.memory_info().vms + _MEMORY + _MEMORY_A_BYTE * path.stat().st_size
        process.rlimit(psutil.RLIMIT_AS, (limit, limit))
        process.rlimit(psutil.RLIMIT_CPU, (int(sys.argv[2]), int(sys.argv[2])))
    problem = ""
    try:
        read(path)
    except ValueError as error:
        problem = str(error)
    problem = others.problem or problem or (_WITH_OTHERS if others.opened else "")
    sys.stdout.write(problem)
    sys.exit(_REFUSED if problem else 0)


class SiblingFiles:
    """The files that a file names, which parsers open: in its folder or below, and nowhere else."""

    def __init__(self, path: Path) -> None:
        self.problem, self.opened = "", set[Path]()
        self._path = path.resolve()
        parts = (sys.prefix, sys.base_prefix, *filter(None, sys.path))  # of Python, of the system
        system = map(Path, (os.devnull, "/proc", "/sys"))
        self._free = (*(Path(part).resolve() for part in parts), *system)

    def check_open(self, event: str, words: tuple[Any, ...]) -> None:
        """An audit hook: refuse to open what is not beside the file."""
        if event == "open" and isinstance(words[0], str | bytes | os.PathLike):
            self.check(words[0])

    def check(self, name: str | bytes | os.PathLike[Any]) -> None:
        """Raise PermissionError if a file is not beside the one that is read."""
        place = Path(os.path.realpath(os.fsdecode(name)))
        if place.is_relative_to(self._path.parent):
            self.opened |= {place} - {self._path}
        elif not any(place.is_relative_to(part) for part in self._free):
            self.problem = f"names {printable(str(place))}: flexmb reads a mesh from its own folder"
            raise PermissionError(self.problem)


def _first_reading(path: Path, module: str) -> str | None:
    """Read the file in a process of its own; None if that ended well, else what it met."""
    seconds = math.ceil(max(_SECONDS, path.stat().st_size / _BYTES_A_SECOND))  # of the processor
    command = [sys.executable, "-P", "-m", module, str(path.absolute()), str(seconds)]
    words = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    words["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))  # also where a script changed it
    try:
        child = subprocess.run(
            command,
            capture_output=True,
            timeout=_PATIENCE * seconds,
            check=False,
            env=os.environ | words,
        )
    except subprocess.TimeoutExpired:
        return f"is damaged: it cannot be read to its end within {_PATIENCE * seconds:.0f} s"
    if child.returncode == 0:
        return None
    if child.returncode == _REFUSED:
        return child.stdout.decode(errors="replace").strip()
    return "is damaged: reading it ends the process, or takes too much time or memory"


def _objects(group: h5py.Group, depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Every group and dataset below `group`; raises ValueError at a link that is not a hard one."""
    import h5py

    if depth > _DEPTH:
        raise ValueError(f"has groups inside each other, more than {_DEPTH} deep")
    for name in group:
        link = group.get(name, getlink=True)
        path = f"{group.name.rstrip('/')}/{name}"
        if not isinstance(link, h5py.HardLink):
            raise ValueError(f"has a link to another place at {path}: flexmb follows no links")
        item = group[name]
        yield path, item
        if isinstance(item, h5py.Group):
            yield from _objects(item, depth + 1)


def check_objects(file: h5py.File, size: int, *, packed: bool = False) -> None:
    """Raise ValueError at what a file of flexmb never has; read all that is in it.

    `packed` datasets are those of other programs, which compress.
    """
    import h5py

    for number, (path, item) in enumerate(_objects(file)):
        if number > _OBJECTS:
            raise ValueError(f"has more than {_OBJECTS} groups and datasets")
        if isinstance(item, h5py.Dataset):
            properties = item.id.get_create_plist()
            if properties.get_external_count() or properties.get_layout() == h5py.h5d.VIRTUAL:
                raise ValueError(f"stores {path} in other files: flexmb reads none of them")
            if properties.get_nfilters():
                if packed:
                    continue  # memory is limited while it is read
                raise ValueError(f"stores {path} through a filter, which flexmb never does")
            if item.size is None or item.size * item.dtype.itemsize > size:
                raise ValueError(f"states more values at {path} than the file has room for")
        for key in item.attrs:
            item.attrs[key]
        if isinstance(item, h5py.Dataset):
            for start in range(0, len(item), 4096) if item.shape else ():
                item[start : start + 4096]
            if not item.shape:
                item[()]


@contextmanager
def hdf5_beside() -> Iterator[None]:
    """Within a ``with`` block parsers open HDF5 files beside the mesh alone, without links.

    Raises
    ------
    ValueError
        At the end, where a file had such links.
    """
    import h5py

    problems: list[ValueError] = []

    class CheckedFile(h5py.File):  # type: ignore[misc]
        def __init__(self, name: Any, *words: Any, **options: Any) -> None:
            sys.audit("open", name, "r", 0)  # HDF5 opens it by itself
            super().__init__(name, *words, **options)
            try:
                check_objects(self, os.path.getsize(name), packed=True)
            except ValueError as problem:
                problems.append(problem)
                raise
            except (RuntimeError, LookupError, OSError) as problem:  # of the library
                problems.append(ValueError(f"is damaged ({problem})"))
                raise

    h5py.File = CheckedFile
    yield
    if problems:
        raise problems[0]


def open_of_others(path: Path) -> h5py.File:
    """Open an HDF5 file of another program, which `check_reading` has read well, or reads now."""
    import h5py

    return h5py.File(path, "r", locking=False)


def _read_hdf5(path: Path) -> None:
    """What the process of the first reading does."""
    try:
        with open_of_others(path) as file:
            check_objects(file, path.stat().st_size)
    except (OSError, RuntimeError, KeyError, TypeError, MemoryError) as problem:
        text = " ".join(str(problem).split())
        raise ValueError(f"is a damaged HDF5 file ({text})") from None


def column_kind(kind: Any) -> str:
    """What a column of a Parquet file holds; empty for a type that flexmb never writes."""
    import pyarrow as pa

    if pa.types.is_string(kind):
        return "texts"
    if pa.types.is_list(kind):
        return "lists" if kind.value_type in (pa.null(), pa.float64()) else ""
    return "numbers" if kind in (pa.null(), pa.bool_(), pa.int64(), pa.float64()) else ""


def _read_parquet(path: Path) -> None:
    """The same for a table of runs: all that will be done with its rows."""
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # others reserve more than they use
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, pre_buffer=False) as file:
            names = file.schema_arrow.names
            plain = all(column_kind(field.type) for field in file.schema_arrow)
            if "key" not in names or len({*names}) < len(names) or not plain:
                raise LookupError("it has other columns")
            file.read(use_threads=False).to_pylist()
    except (OSError, MemoryError, LookupError, ValueError, pa.ArrowException) as error:
        text = " ".join(str(error).split())[:200]
        raise ValueError(f"is no table of runs of flexmb ({text})") from None


def _read_apart(path: Path) -> None:
    (_read_parquet if path.suffix == ".parquet" else _read_hdf5)(path)


if __name__ == "__main__":
    serve_reading(_read_apart)
