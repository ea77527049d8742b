"""The page in a real browser: no request, no error, hover and rotation work, and it prints whole."""

import base64
import time
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from analysis import evaluate_runs, load_run
from analysis.apps.report.page.write_page import gather, write_page
from analysis.diagnosis.judge.staircase import ModelResidual, Staircase, StaircaseStep
from rigs.load import load, load_hidden
from tests.support.browser import CHROMIUM, Browser, browser
from tests.support.handmade_diagnosis import diagnosis
from tests.support.written_runs import write_simulated

pytestmark = [
    pytest.mark.skipif(not CHROMIUM, reason="there is no chromium here"),
]
PATIENCE_S = 120.0
DRAWN = (
    "document.readyState === 'complete' && document.querySelectorAll('.live').length > 0"
    " && document.querySelectorAll('.live .main-svg').length >= document.querySelectorAll('.live').length"
)
"""True once the page is loaded and every picture is drawn."""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    rig, text = load("ur10e-cell")
    folder = tmp_path_factory.mktemp("page")
    hidden = load_hidden("ur10e-cell").apply_to(rig)
    runs = [*write_simulated(hidden, text, "yaw", ("acw", "cw"), [1], folder)]
    runs += write_simulated(hidden, text, "radial", (None,), [1], folder)
    measured = [load_run(run) for run in runs]
    return write_page(
        gather(evaluate_runs(measured), diagnosed=False, progress=lambda doing: None), folder / "page.html"
    )


@pytest.fixture(scope="module")
def stepped(page, tmp_path_factory):
    """The same runs with a diagnosis made by hand, whose gap shrinks in two steps."""
    found = diagnosis("named")
    curves = tuple(np.stack([one.before_um, (one.before_um + one.after_um) / 2, one.after_um]) for one in found.curves)
    maps = tuple(np.stack([one.before_um, (one.before_um + one.after_um) / 2, one.after_um]) for one in found.maps)
    steps = [((), 6.1), ((0,), 3.0), ((1, 2), 1.9)]
    staircase = Staircase(tuple(StaircaseStep(parts, ModelResidual(um, 0.2)) for parts, um in steps), curves, maps)
    measured = [load_run(path.parent) for path in sorted(page.parent.glob("yaw*/manifest.json"))]
    report = gather(evaluate_runs(measured), diagnosis=replace(found, staircase=staircase), progress=lambda doing: None)
    return write_page(report, tmp_path_factory.mktemp("stepped") / "page.html")


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile")) as one:
        yield one


@pytest.fixture
def opened(started, page):
    """The page as it is drawn first: at the size of a desk, and light."""
    shown(started, page)
    started.until(DRAWN)
    return started


def shown(one: Browser, page: Path) -> None:
    one.send("Emulation.setEmulatedMedia", media="")
    one.sized(1100, 900)
    one.events.clear()
    one.send("Page.navigate", url=page.as_uri())
    one.until(f"location.href === {page.as_uri()!r} && document.readyState === 'complete'")


def test_no_request_leaves_the_file_and_no_error_is_said(opened, page):
    asked = [event["request"]["url"] for event in opened.named("Network.requestWillBeSent")]
    assert {url.partition(":")[0] for url in asked} <= {"file", "data", "blob"}
    assert [url for url in asked if url.startswith("file:")] == [page.as_uri()]
    assert opened.named("Runtime.exceptionThrown") == []
    said = [event for event in opened.named("Runtime.consoleAPICalled") if event["type"] == "error"]
    said += [event for event in opened.named("Log.entryAdded") if event["entry"]["level"] == "error"]
    assert said == []


@pytest.mark.parametrize(("width", "height"), [(390, 844), (1280, 800)])
def test_the_tiles_are_above_the_fold(started, stepped, width, height):
    shown(started, stepped)
    started.sized(width, height, is_mobile=width < 500)
    ends = started.value("[...document.querySelectorAll('.tile')].map(one => one.getBoundingClientRect().bottom)")
    assert len(ends) == 3 and max(ends) <= height
    assert started.value("document.documentElement.scrollWidth") <= width
    assert started.value("document.querySelector('details').open") is False


def _middle(opened: Browser, kind: str) -> tuple[float, float]:
    """The middle of the first picture of a kind, scrolled into the window."""
    picture = f"document.querySelector('figure.{kind} .live')"
    opened.value(f"{picture}.scrollIntoView({{block: 'center'}})")
    x, y, width, height = opened.value(
        f"(() => {{ const box = {picture}.getBoundingClientRect(); return [box.x, box.y, box.width, box.height]; }})()"
    )
    return x + width / 2, y + height / 2


def test_the_mouse_over_a_curve_shows_both_directions(opened):
    shown, end = "", time.monotonic() + PATIENCE_S
    for step in count():  # a busy computer draws what is above only after the mouse came
        x, y = _middle(opened, "straight")
        opened.mouse("mouseMoved", x - step % 40, y)
        shown = opened.value("document.querySelector('figure.straight .hoverlayer').textContent")
        if shown or time.monotonic() > end:
            break
    assert "acw" in shown and "cw" in shown and "°" in shown


def test_dragging_rotates_the_sphere(opened):
    eye = "JSON.stringify(document.querySelector('figure.sphere .live')._fullLayout.scene._scene.getCamera().eye)"
    before, end = opened.until(eye), time.monotonic() + PATIENCE_S
    while opened.value(eye) == before and time.monotonic() < end:  # a busy computer may still move the picture
        x, y = _middle(opened, "sphere")
        opened.mouse("mouseMoved", x, y)
        opened.mouse("mousePressed", x, y, button="left", clickCount=1)
        for step in range(1, 6):
            opened.mouse("mouseMoved", x + 12 * step, y, button="left", buttons=1)
        opened.mouse("mouseReleased", x + 60, y, button="left", clickCount=1)
    assert opened.value(eye) != before


def test_on_paper_every_picture_is_there_and_no_table_is_wider(opened):
    opened.sized(688, 1009)  # A4 less the margins, at 96 px an inch
    opened.send("Emulation.setEmulatedMedia", media="print")
    assert opened.value("[...document.querySelectorAll('.live')].every(one => !one.offsetParent)")
    assert opened.value("[...document.querySelectorAll('.still')].every(one => one.naturalWidth && one.offsetParent)")
    assert opened.value("[...document.querySelectorAll('table')].filter(one => one.offsetWidth > 690).length") == 0
    printed = opened.send("Page.printToPDF", preferCSSPageSize=True)["data"]
    assert base64.b64decode(printed).startswith(b"%PDF")


def test_a_telephone_scrolls_in_its_tables_and_not_the_page(opened):
    """The window is narrowed after the page was drawn wide, as when a screen is turned."""
    opened.sized(390, 844)
    assert opened.value("document.documentElement.scrollWidth") <= 390
    opened.until("[...document.querySelectorAll('.live .main-svg')].every(svg => svg.clientWidth <= 390)")
    assert opened.value("[...document.querySelectorAll('table')].every(table => table.closest('.wide'))")


def test_the_arrow_keys_go_through_the_steps_and_the_curves_follow(started, stepped):
    picture = "document.querySelector('#steps ~ .pictures .live')"
    curve = f"Array.from({picture}._fullData[1].y)"
    shown(started, stepped)
    started.until(DRAWN)
    started.sized(390, 844)
    assert started.value("[...document.querySelectorAll('.wide')].every(one => one.scrollWidth <= one.clientWidth)")
    started.until(f"{picture}._fullData?.length > 1")
    last = started.value(curve)
    started.value("document.querySelector('.stepper input').focus()")
    for kind in ("rawKeyDown", "keyUp") * 2:
        started.send("Input.dispatchKeyEvent", type=kind, key="ArrowLeft", code="ArrowLeft", windowsVirtualKeyCode=37)
    started.until(f"{curve}.every(y => y === 0)")  # the model begun with says nothing more
    assert "0" in started.value("document.querySelector('.stepper output').textContent")
    assert started.value("document.querySelector('table.steps tr.now').textContent").count("6.1") == 1
    started.value("document.querySelectorAll('.stepper button')[1].click()")
    halfway = started.until(f"{curve}.some(y => y !== 0) && {curve}")
    assert np.allclose(2 * np.array(halfway), last, rtol=1e-4, atol=1e-4)


def test_dark_paper_has_light_ink(opened):
    line = "getComputedStyle(document.querySelector('figure.straight .lines path')).stroke"
    light = opened.value(line)
    opened.sized(1100, 900, prefers_color_scheme="dark")
    assert opened.until(f"{line} !== {light!r}")
    assert opened.value("getComputedStyle(document.body).backgroundColor") == "rgb(22, 24, 27)"


_LAID_OUT = """
(() => {
  const box = (node) => node.getBoundingClientRect(), problems = [];
  for (const live of document.querySelectorAll('.live')) {
    const frame = box(live), legend = live.querySelector('.legend'), title = live.querySelector('.xtitle');
    if (legend && title) {
      const [a, b] = [box(legend), box(title)];
      const beside = a.left > b.right || b.left > a.right;
      if (a.top < b.bottom && b.top < a.bottom && !beside) problems.push('legend on title');
      if (a.bottom > frame.bottom + 1) problems.push('legend cut');
    }
    const marks = [...live.querySelectorAll('.annotation-text-g')].map(box).sort((a, b) => a.left - b.left);
    marks.forEach((mark, k) => {
      if (mark.right > frame.right + 1) problems.push('mark cut');
      if (k && mark.left - marks[k - 1].left < 12) problems.push('marks overlap');
    });
  }
  return problems.join(', ');
})()
"""


@pytest.mark.parametrize("width", [390, 1280])
def test_no_label_is_cut_and_no_legend_covers_a_title(started, page, width):
    started.sized(width, 900, is_mobile=width < 500)
    started.send("Page.navigate", url=page.as_uri())
    started.until(DRAWN)
    assert started.value(_LAID_OUT) == ""
