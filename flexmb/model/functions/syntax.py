"""The syntax tree of an expression, and mistakes in it with a caret under the character."""

from __future__ import annotations

import ast
import re
import warnings

from flexmb.errors import Problem, SceneError, nearest

__all__ = ["mistake", "syntax_tree", "unknown_channel"]

_WINDOW = 60  # characters of a long text shown on either side of the mistake
_LONGEST = 2000  # characters; beyond it the text is no formula, and Python's parser may give up


def syntax_tree(text: str) -> ast.expr:
    flat = text.replace("\n", " ").replace("\r", " ").replace("\t", " ")
    body = flat.lstrip()
    lead = len(flat) - len(body)
    if not body:
        raise mistake(text, 0, "the expression is empty")
    if len(body) > _LONGEST:
        raise mistake(text, 0, f"the expression is longer than {_LONGEST} characters")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(body, mode="eval").body
    except SyntaxError as error:
        column = max((error.offset or 1) - 1, 0) + lead
        raise mistake(text, column, f"syntax error: {_reason(error)}") from None
    except (ValueError, RecursionError, MemoryError):
        raise mistake(text, lead, "no expression that can be read") from None


def unknown_channel(text: str, name: str, known: tuple[str, ...]) -> Problem:
    """The problem of a name in an expression that is neither a parameter nor a channel."""
    found = re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.])", text)
    column = found.start() if found else 0
    return mistake(text, column, f'unknown name "{name}"', known, name).problems[0]


def _reason(error: SyntaxError) -> str:
    """The parser's word in the terms of a formula."""
    message = (error.msg or "").removesuffix(" (<unknown>, line 1)")
    if "Perhaps you forgot a comma" in message or message.startswith("invalid decimal literal"):
        return "two values with no operator between them"
    if message in ("invalid syntax", "unexpected EOF while parsing", ""):
        return "a value or an operator is missing or out of place here"
    return message


def mistake(
    text: str, column: int, what: str, names: tuple[str, ...] = (), name: str = ""
) -> SceneError:
    flat = text.replace("\n", " ").replace("\r", " ").replace("\t", " ")
    column = min(column, len(flat))
    begin = max(0, column - _WINDOW)
    shown = flat[begin : column + _WINDOW]
    caret = " " * (column - begin)
    where = f"{what} at character {column + 1}\n    {shown}\n    {caret}^"
    near = nearest(name, names) if name else ()
    return SceneError.from_problems([Problem("", where, names, near)])
