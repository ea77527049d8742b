"""The history page shows what changed first, and fits on a telephone."""

import re
from dataclasses import replace

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


@pytest.fixture(scope="module")
def grown(tmp_path_factory):
    """History of a robot whose play grew, and the file of its page."""
    history, file = history_of(collected(GREW)), tmp_path_factory.mktemp("grown") / "history.html"
    write_page(history, file)
    return history, file


def test_changes_are_a_table_with_u_and_a_picture_each_before_the_rest(grown):
    history, html = grown[0], grown[1].read_text()
    changed = [series for series in history.series if series.trend.changes]
    first, _, behind = html.partition("<details>")
    assert changed and len(changed) < len(history.series)
    assert first.count("<svg") == len(changed) and behind.count("<svg") == len(history.series) - len(changed)
    table = first[first.index("What changed") :]
    rows = re.findall(r"<tr>.*?</tr>", table[: table.index("</table>")], re.DOTALL)[1:]
    assert len(rows) == len(history.changed) and all("±" in row for row in rows)


def test_unchanged_robot_has_no_table_of_changes_and_no_open_picture(tmp_path):
    history, file = history_of(collected(STILL)), tmp_path / "history.html"
    history = replace(history, series=history.series[:3])
    write_page(history, file)
    first, _, behind = file.read_text().partition("<details>")
    assert "What changed" not in first + behind and "<svg" not in first
    assert behind.count("<svg") == len(history.series)


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_no_element_is_wider_than_the_screen(grown, tmp_path):
    page = grown[1].as_uri()
    with browser(tmp_path / "profile") as opened:
        for width in (390, 1400):
            opened.sized(width, 844, is_mobile=width < 500)
            opened.send("Page.navigate", url=page)
            opened.until(f"location.href === {page!r} && document.readyState === 'complete'")
            assert opened.value(WIDE) == [], width
