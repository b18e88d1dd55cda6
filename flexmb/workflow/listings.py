"""What a listing consists of: tables of text under a title.

In: specifications of the model. Out: :class:`Table` of what their fields hold, and their defaults.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

__all__ = ["Listing", "Table", "fields_tables"]


class Table(NamedTuple):
    """Rows of text under headings."""

    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


class Listing(NamedTuple):
    """What there is of one topic: tables with a line of text above each."""

    title: str
    tables: tuple[tuple[str, Table], ...]


def fields_tables(kinds: Mapping[str, Any]) -> tuple[tuple[str, Table], ...]:
    """One table for each specification: what its fields hold, and their defaults."""
    from flexmb.model.scenes.description import described, fields_of, words

    tables = []
    for spec in dict.fromkeys(kinds.values()):
        names = [name for name, kind in kinds.items() if kind is spec]
        rows = [
            (field.name, words(field.form), "required" if field.required else _told(field.default))
            for field in fields_of(spec)
            if field.name != "type" or field.form.get("enum", [None])[0] not in kinds
        ]
        about = f"{', '.join(names)}: {described(spec)}"
        tables.append((about, Table(("field", "holds", "default"), rows)))
    return tuple(tables)


def _told(default: Any) -> str:
    """A default as a scene writes it; nothing where leaving it out means leaving it out."""
    if default is None or default == {} or default == ():
        return ""
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, Iterable) and not isinstance(default, str):
        return f"[{', '.join(_told(value) for value in default)}]"
    return f"{default:g}" if isinstance(default, int | float) else str(default)
