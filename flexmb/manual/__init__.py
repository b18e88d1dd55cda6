"""The manual: pages of Markdown beside this file, shown and searched by ``flexmb help``.

In: the name of a page, or words to search for. Out: pages with their tables filled in, sections
that hold the words, or a site of HTML pages.
"""

from __future__ import annotations

from flexmb.manual.pages import PAGES, Page, Section, page, pages, search, write_site

__all__ = ["PAGES", "Page", "Section", "page", "pages", "search", "write_site"]
