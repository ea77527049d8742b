"""The history page shows what changed first, and fits on a telephone."""

import re

import pytest

from analysis.apps.plant.history import history_of
from analysis.apps.plant.history_report import write_page
from tests.support.browser import CHROMIUM, browser
from tests.support.figure_histories import GREW, STILL, collected

WIDE = """(() => {
    const HIDDEN = one => (one.closest("thead")?.getBoundingClientRect().width ?? 2) <= 1;  // of a table as cards
    document.querySelectorAll("details").forEach(one => one.open = true);
    return [...document.querySelectorAll("body *")]
        .filter(one => one.getBoundingClientRect().right > innerWidth + 1 && !HIDDEN(one))
        .map(one => one.outerHTML.slice(0, 80));
})()"""


def _page(folder, runs):
    history = history_of(collected(runs))
    write_page(history, folder / "history.html")
    return history, (folder / "history.html").read_text()


def test_changes_are_a_table_with_u_and_a_picture_each_before_the_rest(tmp_path):
    history, html = _page(tmp_path, GREW)
    changed = [series for series in history.series if series.trend.changes]
    first, _, behind = html.partition("<details>")
    assert changed and len(changed) < len(history.series)
    assert first.count("<svg") == len(changed) and behind.count("<svg") == len(history.series) - len(changed)
    table = first[first.index("What changed") :]
    rows = re.findall(r"<tr>.*?</tr>", table[: table.index("</table>")], re.DOTALL)[1:]
    assert len(rows) == len(history.changed) and all("±" in row for row in rows)


def test_unchanged_robot_has_no_table_of_changes_and_no_open_picture(tmp_path):
    history, html = _page(tmp_path, STILL)
    first, _, behind = html.partition("<details>")
    assert "What changed" not in html and "<svg" not in first
    assert behind.count("<svg") == len(history.series)


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.parametrize("width", [390, 1400])
def test_no_element_is_wider_than_the_screen(tmp_path, width):
    _page(tmp_path, GREW)
    with browser(tmp_path / "profile") as opened:
        page = (tmp_path / "history.html").as_uri()
        opened.sized(width, 844, is_mobile=width < 500)
        opened.send("Page.navigate", url=page)
        opened.until(f"location.href === {page!r} && document.readyState === 'complete'")
        assert opened.value(WIDE) == []
