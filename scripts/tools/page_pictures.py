"""Create pictures of the pages for the documents: of the report, a fleet and a history.

The report is shown annotated, dark, printed, with its steps, on the sphere and on the arm.

`scripts/dev page_pictures` simulates the runs described in `docs/reading-the-report.md`, and a plant of a year, creates
their pages, and takes screenshots with a headless Chromium, stored in docs/images.
"""

from __future__ import annotations

import argparse
import base64
import io
import re
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from PIL import Image

from tests.support.browser import Browser, browser
from tests.support.command_line import ran
from tests.support.plant_runs import robot_of, write_visits

_HIDDEN = "effects: [{effect: backlash, axis: 1, width_deg: 0.008}]\neccentricity_mm: [0.3, -0.2, 0.1]\n"
_RUNS = (("yaw", 2, 0), ("repeatability", 1, 20), ("radial", 1, 30))
"""Test, number of runs (in each direction), and noise seed."""
_README_HIDDEN = "effects: [{effect: joint_offset, axis: 3, offset_deg: 0.2}]\neccentricity_mm: [0.6, -0.4, 0.1]\n"
_README_RUNS = (("yaw", 3, 0), ("roll", 3, 10), ("radial", 1, 20))
_VERDICTS = {"phone": (390, 844), "desktop": (1280, 520)}
"""Width and height in pixels of the verdict pictures of the README."""
_NUMBERED = (
    (1, r'(<p class="lead headline">)()'),
    (2, r"(<h3>)(Error now)"),
    (3, r"(<h3>)(Main causes)"),
    (4, r"(<h3>)(Do next)"),
    (5, r'(<h2 id="budget">)()'),
    (6, r'(<th scope="col" class="word">)(size)'),
    (7, r'(<h2 id="steps">)()'),
)
"""Numbered elements in the documents: number, and pattern of the element."""
_BADGE = (
    '<b style="display:inline-block;width:1.35em;height:1.35em;line-height:1.35em;border-radius:50%;margin-right:.35em;'
    'background:#1f5aa6;color:#fff;font:bold 14px/1.45em sans-serif;text-align:center">{}</b>'
)
_WIDE = 1100
_ROBOTS, _GROWN, _YEAR_DAYS, _VISITS = 4, "robot-003", 365.0, 20
"""Robots of the plant, the one whose history is shown, and number of visits in the year."""
_STEPS, _SPHERE = "document.querySelector('#steps')", "document.querySelector('figure.sphere')"
_HEADINGS = "[...document.querySelectorAll('h2')]"
_YAW = f"{_HEADINGS}.find(one => one.innerText.startsWith('Yaw'))"
_STEPPER = "document.querySelector('.stepper')"


def main() -> None:
    """Create the report and its pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/images"), help="where the pictures go")
    parser.add_argument("--page", type=Path, help="a page that is there already (made anew)")
    parser.add_argument("--plant", action="store_true", help="only the pages of a fleet and of a history")
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch, browser(Path(scratch) / "plant-profile") as chromium:
        _plant(chromium, Path(scratch), given.output)
    if given.plant:
        return
    with tempfile.TemporaryDirectory() as scratch:
        page = given.page or made_page(Path(scratch))
        numbered = Path(scratch) / "numbered.html"
        numbered.write_text(with_numbers(page.read_text(encoding="utf-8")), encoding="utf-8")
        with browser(Path(scratch) / "profile") as chromium:
            _annotated(chromium, numbered, given.output / "report-annotated.png")
            _part(chromium, page, _STEPS, 1000, given.output / "report-steps.png")
            _part(chromium, page, _YAW, 1000, given.output / "report-dark.png", dark=True)
            _part(chromium, page, _SPHERE, 560, given.output / "report-sphere.png")
            readme_page = given.page or made_page(
                Path(scratch), "paper-fanuc", _README_HIDDEN, _README_RUNS, "yaw-cw-002"
            )
            for name, (width, height) in _VERDICTS.items():
                with _opened(chromium, readme_page, width):
                    _shot(chromium, given.output / f"verdict-{name}.png", 0, 0, width, height)
            _printed(chromium, page, given.output / "report-printed.png")


def made_page(
    directory: Path,
    rig: str = "ur10e-cell",
    hidden: str = _HIDDEN,
    runs: Sequence[tuple[str, int, int]] = _RUNS,
    hold_out: str = "",
) -> Path:
    """Simulate an arm with hidden backlash and create the report of its runs; `hold_out` only validates the model."""
    directory = directory / rig
    directory.mkdir()
    (directory / "hidden.yaml").write_text(hidden)
    for test, times, seed in runs:
        _rig(directory, "simulate", rig, "--test", test, "--times", str(times), "--seed", str(seed),
             "--effects", "hidden.yaml", "-o", "runs")  # fmt: skip
    command = ("diagnose", "--hold-out", f"runs/{hold_out}") if hold_out else ("report",)
    made = sorted(f"runs/{path.name}" for path in (directory / "runs").iterdir())
    _rig(directory, *command, "-o", "page.html", *made)
    return directory / "page.html"


def _plant(chromium: Browser, directory: Path, output: Path) -> None:
    """Pictures of the fleet and history pages of a plant in which the backlash of one robot grew."""
    days = [_YEAR_DAYS * visit / _VISITS for visit in range(_VISITS)]
    for number in range(1, _ROBOTS + 1):
        robot = robot_of(number, 0, _YEAR_DAYS)
        list(write_visits(directory / "plant" / robot.name, robot, days))
    _rig(directory, "fleet", "plant", "-o", "plant.html")
    history = next((directory / "plant-robots").glob(f"*{_GROWN}*.html"))
    pages = {"fleet": directory / "plant.html", "history": history}
    for name, page in pages.items():
        with _opened(chromium, page, 1000):
            height = min(chromium.value("document.body.scrollHeight"), 1050)
            _shot(chromium, output / f"{name}-page.png", 0, 0, 1000, height)


def with_numbers(page: str) -> str:
    """Return a page with the numbers of the documents. Raises SystemExit if a numbered element is missing."""
    for number, place in _NUMBERED:
        page, count = re.subn(place, rf"\1{_BADGE.format(number)}\2", page, count=1)
        if not count:
            raise SystemExit(f"the page has no place for number {number}: {place}")
    return page


def _rig(directory: Path, *words: str) -> None:
    done = ran(*words, cwd=directory)
    if done.returncode:
        raise SystemExit(f"rig {' '.join(words)} ended with {done.returncode}: {done.stderr}")


@contextmanager
def _opened(chromium: Browser, page: Path, width: int, *, dark: bool = False) -> Iterator[None]:
    """Open a page in a window of a given width and wait until its charts are drawn."""
    chromium.send("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
    scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
    chromium.send("Emulation.setEmulatedMedia", media="screen", features=scheme)
    chromium.send("Page.navigate", url=page.as_uri())
    chromium.until(f"location.href === {page.as_uri()!r} && document.readyState === 'complete'")
    yield


def _place_of(chromium: Browser, element: str) -> dict[str, float]:
    """Return position and size of an element on the page, in pixels."""
    corner = "x: box.x + scrollX, y: box.y + scrollY, width: box.width, height: box.height"
    found: dict[str, float] = chromium.value(f"(box => ({{{corner}}}))({element}.getBoundingClientRect())")
    return found


def _shot(chromium: Browser, file: Path, x: float, y: float, width: float, height: float) -> None:
    clip = {"x": x, "y": y, "width": width, "height": height, "scale": 1}
    png = chromium.send("Page.captureScreenshot", format="png", clip=clip, captureBeyondViewport=True)["data"]
    picture = Image.open(io.BytesIO(base64.b64decode(png))).convert("P", palette=Image.Palette.ADAPTIVE, colors=128)
    picture.save(file, optimize=True)


def _annotated(chromium: Browser, page: Path, file: Path) -> None:
    """Take a picture of the first screen with its numbers, down to the steps."""
    with _opened(chromium, page, _WIDE):
        last = _place_of(chromium, _STEPPER)
        _shot(chromium, file, 0, 0, _WIDE, last["y"] + last["height"] + 10)


def _part(chromium: Browser, page: Path, element: str, height: float, file: Path, *, dark: bool = False) -> None:
    """Take a picture of a part of the page starting at an element, once its charts are drawn."""
    with _opened(chromium, page, _WIDE, dark=dark):
        chromium.value(f"{element}.scrollIntoView()")
        chromium.until("document.querySelectorAll('.live .main-svg').length > 0")
        chromium.value("new Promise(done => setTimeout(done, 1500))")
        place = _place_of(chromium, element)
        _shot(chromium, file, place["x"] - 20, place["y"] - 10, _WIDE - place["x"], height)


def _printed(chromium: Browser, page: Path, file: Path) -> None:
    """Take a picture of the first two printed A4 sheets side by side."""
    with _opened(chromium, page, _WIDE):
        chromium.send("Emulation.setEmulatedMedia", media="print", features=[])
        data = chromium.send("Page.printToPDF", paperWidth=8.27, paperHeight=11.69, preferCSSPageSize=True)["data"]
    with tempfile.TemporaryDirectory() as scratch:
        pdf = Path(scratch) / "page.pdf"
        pdf.write_bytes(base64.b64decode(data))
        sheets = _sheets_of(pdf, Path(scratch))
    width, height = sheets[0].size
    both = Image.new("RGB", (2 * width + 10, height), (160, 160, 160))
    for k, sheet in enumerate(sheets[:2]):
        both.paste(sheet, (k * (width + 10), 0))
    both.convert("P", palette=Image.Palette.ADAPTIVE, colors=128).save(file, optimize=True)


def _sheets_of(pdf: Path, scratch: Path) -> list[Image.Image]:
    subprocess.run(["pdftoppm", "-r", "70", "-png", "-l", "2", pdf, scratch / "sheet"], check=True)
    return [Image.open(path).convert("RGB") for path in sorted(scratch.glob("sheet*.png"))]


if __name__ == "__main__":
    main()
