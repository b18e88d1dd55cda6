"""Mutations of texts, bytes, tables and HDF5 files, for inputs that nobody would write."""

from __future__ import annotations

import copy
import datetime as dt
import re
from contextlib import suppress
from io import BytesIO
from random import Random
from typing import Any

import h5py
import numpy as np

NUMBERS = (
    "0", "-0.0", "-1", "1", "2", "3", "1e-300", "5e-324", "1e308", "-1e308", "1e400", "nan", "inf",
    "-inf", "1e9", "-1e9", "200000000", "2147483647", "2147483648", "4294967295",
    "9223372036854775807", "18446744073709551616", "1e-12", "0.1", "3.7", "1_000", "0x10", "1e",
    "9" * 400, "٣", "½",
)  # fmt: skip
WORDS = (
    "", " ", "\0", "\x1b]0;owned\x07", "\x1b[31m", "\x9b2J", "\u202e", "\u2028", "\ufeff", "\r",
    "x" * 300, "../../../etc/passwd", "/etc/passwd", "/dev/zero", "C:\\", "a.b.c", "placed", "none",
    "ground", "t", "pi", "e", "__import__('os').system('touch owned')", "().__class__", "{}", "[[",
    "'''", '"', "=", "#", "\n", "%s%n", "{0}", "$(touch owned)", "nan", "true", "\U0001f600", "é",
    "&x;", "<!DOCTYPE x [<!ENTITY x SYSTEM 'file:///etc/passwd'>]>",
)  # fmt: skip
_NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_]\w+")


def mutate_bytes(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    """One to four changes; `others` are spliced in."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        data = rng.choice(_CHANGES)(data, rng, others)
    return data


def _flip(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 3, 20)) if data else 0):
        changed[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(changed)


def _cut(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _drop(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    start = rng.randrange(len(data) + 1)
    return data[:start] + data[start + rng.choice((1, 2, 8, 40, 400)) :]


def _insert(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    start = rng.randrange(len(data) + 1)
    return data[:start] + rng.choice(NUMBERS + WORDS).encode() + data[start:]


def _number(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    return _replace(_NUMBER, NUMBERS, data, rng)


def _word(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    return _replace(_WORD, WORDS, data, rng)


def _replace(pattern: re.Pattern[bytes], texts: tuple[str, ...], data: bytes, rng: Random) -> bytes:
    places = list(pattern.finditer(data))
    if not places:
        return data
    place = rng.choice(places)
    return data[: place.start()] + rng.choice(texts).encode() + data[place.end() :]


def _exchange(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    """Two words of the file change places, or one takes the other's."""
    places = sorted(rng.sample(found, 2), key=lambda m: m.start()) if len(
        found := list(_WORD.finditer(data)) or list(_NUMBER.finditer(data))
    ) > 1 else []  # fmt: skip
    if not places:
        return data
    a, b = places
    parts = data[: a.start()], b[0], data[a.end() : b.start()], rng.choice((a[0], b[0]))
    return b"".join(parts) + data[b.end() :]


def _lines(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    """A line is dropped, doubled, repeated many times or moved."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    what = rng.randrange(4)
    line = lines.pop(i)
    if what == 1:
        lines[i:i] = [line, line]
    elif what == 2:
        lines[i:i] = [line] * rng.choice((10, 1000))
    elif what == 3:
        lines.insert(j, line)
    return b"".join(lines)


def _splice(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    other = rng.choice(others)
    start = rng.randrange(len(other) + 1)
    piece = other[start : start + rng.choice((10, 100, 1000))]
    place = rng.randrange(len(data) + 1)
    return data[:place] + piece + data[place + rng.choice((0, len(piece))) :]


def _header(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    """A number of the first lines: counts, sizes, versions."""
    end = rng.choice((60, 200, 600))
    return _number(data[:end], rng, others) + data[end:]


def _integer(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    """A binary number is another one."""
    width, order = rng.choice((2, 4, 8)), rng.choice(("little", "big"))
    value = rng.choice((0, 1, -1, 2**15, 2**31 - 1, 2**31, 2**40, 2**62, -(2**31), 1000))
    raw = (value % 2 ** (8 * width)).to_bytes(width, order)
    place = rng.randrange(min(len(data), rng.choice((64, 400, len(data) + 1))) + 1)
    return data[:place] + raw + data[place + width :]


_CHANGES = (_flip, _cut, _drop, _insert, _number, _number, _word, _exchange, _lines, _splice,
            _header, _integer)  # fmt: skip

VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 3.7, 1e-12, 5e-324, 1e9, 10**9, 1e308, float("inf"), float("nan"),
    10**400, [], {}, [1], [1, 2, 3], ["z", {}, []], [[1, 2, 3]] * 3, [1e200] * 3, [[0, 0], [1, 1]],
    [[0, 0], [1, 1], [2, 0]], "sin(t)", "1/0", "t", "9 deg", "1 mm", "3 rad/s", "1e308 km", "2 t",
    {"type": "box"}, {"axis": "z", "angle": "9 deg"}, {"a": {"node": 3}}, {"": {}}, "1e-2..1e-6",
    "1..1e300", "1e-3..1e-5:1000", {"euler": "xyz", "angles": [1, 2, 3]}, [1e-300, 0, 0],
    {"origin": {"velocity": [1, 2, 3]}}, "x.y", "sensors.a.x", list(range(40)), [{}] * 5,
    dt.date(2026, 1, 1), dt.datetime(1, 1, 1, tzinfo=dt.UTC), dt.time(9, 30), -0.0, 2**63, [None],
    "normal(0.15, 1e-4)", "uniform(1, 0)", "triangular(0, 0, 0)", "log-uniform(-1, 1)", "1..2:1e9",
    "log-uniform(1e-320, 1e308)", {"x": 1, "X": 2}, ["\u0000"], {"a.b": 1, 'a"b': 2, "a\nb": 3},
)  # fmt: skip


def places(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The path of every entry of nested tables and lists."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    paths = []
    for key, value in items:
        paths.append((*path, key))
        if isinstance(value, dict | list):
            paths += places(value, (*path, key))
    return paths


def at(data: Any, path: tuple[Any, ...]) -> Any:
    """The entry there."""
    for key in path:
        data = data[key]
    return data


def mutate_table(scene: dict[str, Any], rng: Random, other: dict[str, Any]) -> dict[str, Any]:
    """Entries replaced, dropped, renamed, scaled, or taken from another scene."""
    scene = copy.deepcopy(scene)
    for _ in range(rng.choice((1, 1, 2, 3))):
        paths = places(scene)
        if not paths:
            break
        *path, key = rng.choice(paths)
        table, what = at(scene, tuple(path)), rng.randrange(8)
        if what < 3:
            table[key] = copy.deepcopy(rng.choice(VALUES + WORDS))
        elif what == 3:
            del table[key]
        elif what == 4 and isinstance(table, dict):
            table[rng.choice((*WORDS, *table))] = table.pop(key)
        elif what == 5 and isinstance(table[key], int | float):
            with suppress(OverflowError):  # a number of many digits
                table[key] = table[key] * rng.choice((-1, 1e-12, 1e-3, 1e3, 1e12))
        else:
            source = rng.choice([p for p in places(other)] or [()])
            table[key if rng.random() < 0.5 or isinstance(table, list) else source[-1]] = (
                copy.deepcopy(at(other, source))
            )
    return scene


def mutate_hdf5(data: bytes, rng: Random) -> bytes:
    """One to three datasets or attributes replaced, dropped or of another type or shape."""
    content = BytesIO(data)
    with h5py.File(content, "r+") as file:
        items: list[str] = []
        file.visit(items.append)
        for _ in range(rng.choice((1, 1, 2, 3))):
            path = rng.choice(items)
            if path in file:
                _change_item(file, path, rng, items)
    return content.getvalue()


def _change_item(file: h5py.File, path: str, rng: Random, items: list[str]) -> None:
    item, what = file[path], rng.randrange(9)
    if what == 0:
        del file[path]
        return
    if what == 1:
        owner = rng.choice((file, item))
        name = rng.choice([*owner.attrs, "x"])
        owner.attrs[name] = rng.choice((
            1, -1, 2.5, np.nan, "x" * 70, "\x1b[2J", b"\xff", [1, 2], h5py.Empty("f8"), "",
            np.void(b"a"), np.zeros((2, 2)), "9" * 5000, file.ref, np.zeros(1, "i4,f8"), [b"a"],
            h5py.Empty("S4"), ["\u202e"], np.uint8(1), np.bool_(False), np.complex128(1j), 2**62,
        ))  # fmt: skip
        return
    if isinstance(item, h5py.Group):
        return
    value = item.asstr(errors="replace")[()] if h5py.check_string_dtype(item.dtype) else item[()]
    del file[path]
    if what == 2 and (source := rng.choice(items)) in file:
        file.copy(source, file, path)
        return
    new = _changed_value(np.asarray(value), rng, what)
    try:
        file.create_dataset(path, data=new)
    except (TypeError, ValueError):  # arrays of no HDF5 type
        file.create_dataset(path, data=str(new))


def _changed_value(value: Any, rng: Random, what: int) -> Any:
    if value.dtype.kind in "OSU":
        if what < 6:
            text = str(value.flat[rng.randrange(value.size)]) if value.size else ""
            new = value.astype(object)
            if value.size:
                wrong = mutate_bytes(text.encode()[:100_000], rng, [b"{}"])
                new[np.unravel_index(rng.randrange(value.size), value.shape)] = wrong.decode(
                    "utf-8", "replace"
                ).replace("\0", "")
            return new if new.shape else str(new[()])
        return rng.choice((0.0, np.zeros(3), "text", [b"a\xff", b"b"], np.int64(-1)))
    if what == 3:
        return value.astype(rng.choice(("f4", "i1", "u8", "c16", "?")), casting="unsafe")
    if what == 4 and value.size:
        return np.resize(value, rng.choice(((0,), (1,), (3, 3), (value.size + 1,), ())))
    if what == 5:
        return value.T
    if what == 6:
        return rng.choice(("text", ["a", "b"], np.zeros(3, "i4,f8"), np.void(b"\0" * 8),
                           np.zeros((2, 0)), np.array([], "f8"), h5py.Empty("f8")))  # fmt: skip
    new = np.array(value)
    if new.size:
        place = np.unravel_index(rng.randrange(new.size), new.shape)
        wrong = rng.choice((0, -1, 1, 10**9, -(2**31), 2**62, 1e308, 1e-300, np.nan, np.inf, -1e5))
        with np.errstate(all="ignore"):
            new[place] = np.array(wrong).astype(new.dtype)
    return new


def mutate_parquet(data: bytes, rng: Random, others: list[bytes]) -> bytes:
    """Bytes changed, or a column dropped, renamed, doubled, of another type, or ever so long."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if rng.random() < 0.5:
        return mutate_bytes(data, rng, others)
    table = pq.read_table(BytesIO(data))
    for _ in range(rng.choice((1, 1, 2))):
        place = rng.randrange(table.num_columns)
        name, what = table.column_names[place], rng.randrange(6)
        values = pa.array([rng.choice((None, *NUMBERS, *WORDS[5:], "{}", "[[1]]", "[" * 9999))
                           for _ in range(table.num_rows)], pa.string())  # fmt: skip
        if what == 0 and table.num_columns > 1:
            table = table.remove_column(place)
        elif what == 1:
            table = table.append_column(rng.choice((name, *WORDS, "key", "reason")), values)
        elif what == 2:
            table = table.set_column(place, name, values)
        elif what == 3:
            other = rng.choice((0, 1.5, -(2**62), True, [1.0], ["a"], b"\xff", {"a": 1}, [],
                                float("nan"), None, dt.date(2026, 1, 1), [[1.0]]))  # fmt: skip
            table = table.set_column(place, name, pa.array([other] * table.num_rows))
        elif what == 4:
            about = rng.choice((b"", b"{}", b"3", b"[" * 9999, b'{"scene": 3}', b"\xff"))
            table = table.replace_schema_metadata({b"flexmb": about})
        else:
            rows = table.slice(0, 1).to_pylist() * rng.choice((0, 2, 200_000))
            table = pa.Table.from_pylist(rows, table.schema)
    target = BytesIO()
    pq.write_table(table, target, compression=rng.choice(("snappy", "zstd", "gzip", "none")))
    return target.getvalue()
