"""Pages of the manual: read, fill in, search.

The tables of fields, units, allowed values and defaults are not typed in the pages. A line
``<!-- list: forces bushing, beam -->`` stands for what ``flexmb list forces`` shows of these kinds,
``<!-- list: forces -->`` for all of it, ``overview`` for the table of the kinds themselves. Other
comments tell the tests how to run a block. A picture is a file of the folder ``pictures``.

The site of HTML pages is built by MkDocs; it needs no server and no network. MkDocs' own search
loads its index through a web worker, which browsers refuse for files; here the index stands in the
script that searches it, ``search.js``.
"""

from __future__ import annotations

import json
import logging
import re
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from flexmb.errors import FlexmbError, OutputError, Problem, nearest
from flexmb.folders import scratch_folder

FOLDER = Path(__file__).parent
PAGES = (
    "first-machine",
    "scenes",
    "units",
    "joints",
    "drivers",
    "forces",
    "contact",
    "sensors-and-control",
    "flexible-bodies",
    "elements",
    "reduction",
    "parts",
    "accuracy",
    "studies",
    "budget",
    "sweeps",
    "cluster",
    "hard-cases",
    "statics",
    "linearization",
    "textbook",
    "cases",
    "effects",
    "audit",
    "results",
    "pictures",
    "errors",
    "design",
    "adding-a-kind",
    "benchmarks",
    "adams",
    "changes",
)
_LIST = re.compile(r"^<!-- list: ([\w-]+)(?: (.+?))? -->$", re.MULTILINE)
_COMMENT = re.compile(r"^<!--.*?-->\n?", re.DOTALL | re.MULTILINE)
_HEADING = re.compile(r"^#{1,4} (.+)$")
_WORD = re.compile(r"[\w.-]*\w")


class Page(NamedTuple):
    """A page: its name, title, one sentence on what it holds, and its Markdown."""

    name: str
    title: str
    summary: str
    text: str


class Section(NamedTuple):
    """A part of a page below one heading, and the line that a search matched."""

    page: str
    heading: str
    line: str


def pages() -> tuple[Page, ...]:
    """All pages in the order in which they are best read; tables are not filled in."""
    return tuple(_read(name) for name in PAGES)


def page(name: str) -> Page:
    """A page with its tables filled in.

    Raises
    ------
    FlexmbError
        No page of that name; lists the names, nearest first.
    """
    if name not in PAGES:
        what = f'the manual has no page "{name}"'
        raise FlexmbError.from_problems([Problem("", what, PAGES, nearest(name, PAGES))])
    raw = _read(name)
    text = _LIST.sub(lambda match: _tables(match[1], match[2]), raw.text)
    return Page(raw.name, raw.title, raw.summary, _COMMENT.sub("", text))


def _read(name: str) -> Page:
    text = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    title, summary = (" ".join(part.split()) for part in text.split("\n\n", 2)[:2])
    return Page(name, title.removeprefix("# "), summary, text)


def _tables(topic: str, kinds: str | None) -> str:
    """Markdown of what ``flexmb list`` shows of a topic, or of some of its kinds."""
    from flexmb.workflow import listings

    names = kinds.split(", ") if kinds else []
    parts = []
    for about, table in listings.listing(topic).tables:
        described, colon, text = about.partition(": ")
        described = described if colon else "overview"
        shared = [name for name in described.split(", ") if name in names]
        if shared:
            names = [name for name in names if name not in shared]
        elif kinds:
            continue
        lead = f"**{_escape(described)}**: {_escape(text)}" if colon else _escape(about)
        parts += [lead, _markdown_table(table.columns, table.rows)]
    if names:
        raise FlexmbError(f'the manual lists {", ".join(names)}, which "{topic}" does not have')
    return "\n\n".join(part for part in parts if part)


def _markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    if not columns:
        return ""
    lines = [columns, ["---"] * len(columns), *(map(_escape, row) for row in rows)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _escape(text: str) -> str:
    """Text without the marks of Markdown, except for code between backticks."""
    parts = text.split("`")
    parts[::2] = [re.sub(r"([*_<>|\\])", r"\\\1", part) for part in parts[::2]]
    return "`".join(parts)


def search(words: Sequence[str]) -> list[Section]:
    """The sections that hold all words, best first, each with its best line.

    A word matches where it begins a word of the text, in capital letters or not. Words in the
    title of a page and in headings count most.

    Raises
    ------
    FlexmbError
        No section holds them; names words of the manual that resemble them.
    """
    wanted = [word.lower() for word in words]
    scored = []
    vocabulary: set[str] = set(PAGES)
    for name in PAGES:
        filled = page(name)
        for heading, lines in _sections(filled.text):
            vocabulary.update(_WORD.findall(" ".join(lines).lower()))
            score = _score(wanted, filled.title, heading, lines)
            if score:
                best = max(lines, key=lambda line: sum(_counts(wanted, line)), default="")
                scored.append((score, Section(name, heading, _plain(best))))
    if not scored:
        alike = [word for w in wanted for word in nearest(w, sorted(vocabulary))]
        what = f'no section of the manual holds "{" ".join(words)}"'
        raise FlexmbError.from_problems([Problem("", what, (), tuple(alike))])
    return [section for _, section in sorted(scored, key=lambda pair: -pair[0])]


def _sections(text: str) -> Iterator[tuple[str, list[str]]]:
    """The headings of a page with the lines below each; a heading in a code block is none."""
    heading, lines, code = "", list[str](), False
    for line in text.splitlines():
        code ^= line.startswith("```")
        match = None if code else _HEADING.match(line)
        if match:
            if heading:
                yield heading, lines
            heading, lines = match[1], []
        elif line.strip():
            lines.append(line)
    yield heading, lines


def _score(wanted: list[str], title: str, heading: str, lines: list[str]) -> int:
    """How well a section matches; 0 where a word is missing."""
    parts = zip(*(_counts(wanted, text) for text in (title, heading, " ".join(lines))), strict=True)
    counts = [(30 * t, 20 * h, min(n, 10)) for t, h, n in parts]
    if not all(h or n for _, h, n in counts):
        return 0
    return sum(map(sum, counts))


def _counts(wanted: list[str], text: str) -> list[int]:
    lower = text.lower()
    return [len(re.findall(rf"(?<!\w){re.escape(word)}", lower)) for word in wanted]


def _plain(line: str) -> str:
    """A line of Markdown as a reader sees it, cut to one line of the screen."""
    text = re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", line)
    text = re.sub(r"[*`\\]|^[#\s|-]+|[\s|]+$", "", text).replace(" | ", "  ")
    return text if len(text) <= 96 else f"{text[:93]}..."


_MARK = "flexmb-manual.txt"  # this file says that a folder holds a manual that may be replaced
_STYLE = """
.wy-nav-content { max-width: 1000px }
.rst-content .section td, .wy-table-responsive table td, .wy-table-responsive table th {
  white-space: normal }
.rst-content pre code, .rst-content code { font-size: 13px }
"""


def write_site(folder: Path) -> Path:
    """Write the manual as HTML pages into a folder; returns the first page.

    Raises
    ------
    OutputError
        MkDocs is not installed, or the folder holds files that are not those of a manual.
    """
    try:
        from mkdocs.commands.build import build
        from mkdocs.config import load_config
    except ImportError:
        raise OutputError(
            'MkDocs, which writes the HTML pages, is not installed: pip install "flexmb[manual]"'
        ) from None
    others = folder.is_file() or (folder.is_dir() and any(folder.iterdir()))
    if others and not (folder / _MARK).is_file():
        raise OutputError(f"{folder}: holds other files; give a new or empty folder")
    with scratch_folder() as name:
        work = Path(name)
        _write_sources(work / "pages")
        (work / "mkdocs.yml").write_text("site_name: flexmb\n", encoding="utf-8")
        logging.getLogger("mkdocs").setLevel(logging.ERROR)
        build(load_config(str(work / "mkdocs.yml"), **_settings(work)))
        _write_search(work / "site" / "search")
        try:
            shutil.copytree(work / "site", folder, dirs_exist_ok=True)
            (folder / _MARK).write_text("written by flexmb help --html\n", encoding="utf-8")
        except OSError as error:
            raise OutputError(f"{folder}: cannot be written ({error.strerror})") from None
    return folder / "index.html"


def _settings(work: Path) -> dict[str, Any]:
    theme = {"name": "readthedocs", "highlightjs": False, "navigation_depth": 3}
    navigation = [{"flexmb": "index.md"}, *({p.title: f"{p.name}.md"} for p in pages())]
    return {
        "docs_dir": str(work / "pages"),
        "site_dir": str(work / "site"),
        "site_name": "flexmb",
        "use_directory_urls": False,
        "theme": theme,
        "nav": navigation,
        "extra_css": ["style.css"],
        "markdown_extensions": [
            "tables",
            "fenced_code",
            "sane_lists",
            {"codehilite": {"guess_lang": False, "noclasses": True}},
        ],
    }


def _write_sources(folder: Path) -> None:
    shutil.copytree(FOLDER / "pictures", folder / "pictures")
    for name in PAGES:
        (folder / f"{name}.md").write_text(page(name).text, encoding="utf-8")
    rows = [f"| [{p.title}]({p.name}.md) | {p.summary} |" for p in pages()]
    lines = ["# flexmb", "", "Flexible multibody dynamics in Python.", "", "| page | what |"]
    index = "\n".join([*lines, "|---|---|", *rows, ""])
    (folder / "index.md").write_text(index, encoding="utf-8")
    (folder / "style.css").write_text(_STYLE, encoding="utf-8")


def _write_search(folder: Path) -> None:
    """Replace the script that searches the pages by one that holds the index itself."""
    index = json.loads((folder / "search_index.json").read_text(encoding="utf-8"))["docs"]
    titles = {entry["location"]: entry["title"] for entry in index}
    sections = []
    for entry in index:
        page_title = titles[entry["location"].partition("#")[0]]
        if "#" in entry["location"]:
            same = entry["title"] == page_title
            title = page_title if same else f"{page_title}: {entry['title']}"
            sections.append({**entry, "title": title})
    script = (FOLDER / "search.js").read_text(encoding="utf-8")
    text = f"var sections = {json.dumps(sections)};\n{script}"
    (folder / "main.js").write_text(text, encoding="utf-8")
