"""Pages in a browser: they load without a message or a request, and the machine moves.

Needs playwright, and a Chromium of its own or of the system (CHROMIUM names another one).
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import slidercrank

import flexmb
from flexmb.view.html_page import Html, tag
from flexmb.workflow import result_page

sync_api = pytest.importorskip("playwright.sync_api")
pytest.importorskip("plotly")
pytestmark = [pytest.mark.browser, pytest.mark.slow]

_SOFTWARE = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
             "--ignore-gpu-blocklist"]  # fmt: skip
_PATIENCE = 120_000  # ms, for a machine without graphics that does other things as well


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as tools:
        own = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chrome")
        try:
            opened = tools.chromium.launch(executable_path=own, args=_SOFTWARE)
        except sync_api.Error as error:
            pytest.skip(f"no Chromium: {error}")
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    run = flexmb.load_result(slidercrank.make(folder))
    run.model["title"] = "<b>Crank</b> <img src=x onerror=alert(1)>"

    def picture(*_: object) -> Html:
        return tag("figure")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(result_page, "picture_of", picture)
        return flexmb.report(run, output=folder / "report.html")


@pytest.fixture
def opened(browser: Any, page_file: Path) -> Iterator[tuple[Any, list[str], list[str]]]:
    page = browser.new_page(viewport={"width": 1100, "height": 800})
    page.set_default_timeout(_PATIENCE)
    messages, requests = list[str](), list[str]()
    page.on("console", lambda one: messages.append(one.text) if one.type == "error" else None)
    page.on("pageerror", lambda error: messages.append(str(error)))
    page.on("request", lambda one: requests.append(one.url))
    page.goto(page_file.as_uri())
    page.wait_for_selector("#stage[data-ready=yes]")
    yield page, messages, requests
    page.close()


def test_it_loads_without_messages_requests_or_foreign_markup(opened: Any) -> None:
    page, messages, requests = opened
    assert messages == []
    assert [url for url in requests if not url.startswith(("file:", "data:", "blob:"))] == []
    assert page.locator("h1").inner_text().startswith("<b>Crank</b> <img src=x")
    assert page.locator("h1 img").count() == 0
    assert page.locator(".chart .main-svg").count() >= 3
    assert page.locator(".stage canvas").count() >= 1


def test_the_play_button_moves_the_parts(opened: Any) -> None:
    page, messages, _ = opened
    places = (
        """() => document.getElementById("stage").data.map(t => Array.from(t.x).slice(0, 50))"""
    )
    frame = page.get_attribute("#stage", "data-frame")
    before = page.evaluate(places)
    page.evaluate("document.getElementById('play').click()")
    page.wait_for_function(f"document.getElementById('stage').dataset.frame !== '{frame}'")
    page.wait_for_function(
        f"""JSON.stringify(({places})()) !== JSON.stringify({before})""".replace("None", "null")
    )
    assert "Pause" in page.inner_text("#play")
    page.evaluate("document.getElementById('play').click()")
    assert "Play" in page.inner_text("#play") and messages == []


def test_the_slider_and_the_factor_of_deformation_move_them_too(opened: Any) -> None:
    page, messages, _ = opened
    heights = """() => Array.from(document.getElementById("stage").data.find(t => t.intensity).y)"""
    page.evaluate("""() => { const s = document.getElementById("frame"); s.value = 30;
                     s.dispatchEvent(new Event("input")); }""")
    page.wait_for_function("document.getElementById('stage').dataset.frame === '30'")
    assert "t = 0.0267 s" in page.inner_text("#clock")
    page.wait_for_timeout(2000)
    before = page.evaluate(heights)
    page.select_option("#factor", "0")
    page.wait_for_function(f"({heights})().some((y, k) => Math.abs(y - {before}[k]) > 1e-4)")
    assert messages == []


def test_it_is_legible_on_a_telephone_and_on_paper(opened: Any, tmp_path) -> None:
    page, messages, _ = opened
    page.set_viewport_size({"width": 390, "height": 800})
    page.wait_for_timeout(500)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    smallest = """() => Math.min(...[...document.querySelectorAll("p, td, th, span, label, text")]
                  .filter(e => e.textContent.trim() && e.getClientRects().length)
                  .map(e => parseFloat(getComputedStyle(e).fontSize)))"""
    assert page.evaluate(smallest) >= 11
    page.emulate_media(media="print")
    assert not page.locator(".controls").is_visible()
    page.pdf(path=str(tmp_path / "r.pdf"), format="A4")
    assert (tmp_path / "r.pdf").stat().st_size > 20_000 and messages == []
