"""The manual as a site of HTML pages that MkDocs builds; it needs no server and no network.

MkDocs' own search loads its index through a web worker, which browsers refuse for files; here the
index stands in the script that searches it, ``search.js``.
"""

from __future__ import annotations

import json
import logging
import shutil
import tempfile
from pathlib import Path
from typing import Any

from flexmb.errors import OutputError
from flexmb.manual.pages import FOLDER, PAGES, page, pages

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
    with tempfile.TemporaryDirectory() as name:
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
