"""The doors of the package: what type checkers see is what there is at run time."""

from __future__ import annotations

import ast
from pathlib import Path

import flexmb


def test_type_checkers_see_every_public_name_where_it_is() -> None:
    tree = ast.parse(Path(flexmb.__file__).read_text(encoding="utf-8"))
    seen = {
        alias.name: node.module
        for block in tree.body
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    homes = {name: f"flexmb.{home}" for home, names in flexmb._HOMES.items() for name in names}
    assert seen == homes
    assert sorted(flexmb.__all__) == sorted(seen)


def test_the_package_says_that_it_is_typed() -> None:
    assert Path(flexmb.__file__).with_name("py.typed").is_file()
