"""The messages that the page on errors explains are those of the package."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

from flexmb import manual


@cache
def _texts(project: Path) -> str:
    """All texts of the package in one, values in them as ``…``."""
    texts = []
    for path in sorted((project / "flexmb").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                texts.append("".join(_text(part) for part in node.values))
            elif isinstance(node, ast.Constant):
                texts.append(_text(node))
    return "\n".join(texts)


def _text(node: ast.AST) -> str:
    return str(node.value) if isinstance(node, ast.Constant) else "…"


def _messages() -> list[str]:
    lines = manual.page("errors").text.splitlines()
    rows = [line.strip("| ").split(" | ") for line in lines if line.startswith("| ")]
    return [row[0] for row in rows if len(row) == 3 and row[0] != "message"]


@pytest.mark.parametrize("message", _messages())
def test_a_message_of_the_page_is_one_of_the_package(message: str, project: Path) -> None:
    known = _texts(project)
    for part in message.split(" … "):
        assert part in known
