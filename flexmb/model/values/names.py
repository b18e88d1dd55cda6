"""What a name may look like, and how a reference to a marker is taken apart."""

from __future__ import annotations

import re
from typing import Any

GROUND = "ground"
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*\Z")


def bad_name(name: Any) -> str:
    """What is wrong with a name; empty if nothing."""
    if isinstance(name, str) and _NAME.match(name):
        return ""
    return f'"{name}" is no name: letters, digits, _ and - only, and a letter first'


def split_reference(reference: str) -> tuple[str, str]:
    """Body and marker of ``"body.marker"``; a bare ``"body"`` means its origin."""
    body, _, marker = reference.partition(".")
    return body, marker or "origin"
