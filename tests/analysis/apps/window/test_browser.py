"""The window in a real browser: a lap, pages of all sizes, and no requests to other hosts."""

import json
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

import pytest
import yaml

from analysis.apps.window.app import Window
from tests.support.bench import Bench, rig_text
from tests.support.browser import CHROMIUM, Browser, browser
from tests.support.simulated_laps import lap_run
from tests.support.windows import PATIENCE_S, Playing, served

pytestmark = [
    pytest.mark.skipif(not CHROMIUM, reason="there is no chromium here"),
]
TEXT = "(document.getElementById('{}')?.textContent ?? '…')"
WHOLE = f"!/[…–]/.test({TEXT.format('acw-band')})"
MAKES = "Boolean(document.querySelector('meta[http-equiv=refresh]'))"
SIZES = {"telephone": (390, 844), "tablet": (820, 1180), "desk": (1440, 900)}
HOSTILE = "a<img src=x onerror=alert(1)>"
_MOST_LAPS = 6
TOKEN = "a-token-of-some-letters"  # noqa: S105 - of the test


def opened(one: Browser, address: str) -> None:
    loaded(one, lambda: one.send("Page.navigate", url=address))
    while one.value(MAKES):
        loaded(one, lambda: None)


def loaded(one: Browser, leads: Callable[[], object]) -> None:
    before, end_s = len(one.named("Page.loadEventFired")), time.monotonic() + PATIENCE_S
    leads()
    while len(one.named("Page.loadEventFired")) == before:
        assert time.monotonic() < end_s
        with suppress(AssertionError):  # between two pages it is refused, which takes in what was said all the same
            one.send("Page.getNavigationHistory")
        time.sleep(0.05)


def sent(one: Browser, field: str, value: str) -> None:
    element = f"document.getElementById({field!r})"
    one.value(f"{element}.value = {value!r}; setTimeout(() => {element}.form.submit(), 50); true")


def violations(one: Browser) -> list[Any]:
    """Violations of accessibility rules (WCAG 2.1 A and AA, and best practice) found by axe."""
    if not one.value("typeof axe !== 'undefined'"):
        one.value((resources.files("axe_core_python") / "axe.min.js").read_text() + "; true")
    found = json.loads(one.value("axe.run().then(found => JSON.stringify(found.violations))"))
    return [(rule["id"], [node["html"][:120] for node in rule["nodes"][:3]]) for rule in found]


def shows_what_is_read(one: Browser, window: Window) -> None:
    """Check that the page shows the reading of a moving gauge. The page is some frames later than the watcher."""
    end_s = time.monotonic() + PATIENCE_S
    while float(one.value(TEXT.format("g1"))) != pytest.approx(window.watcher.view.readings["g1"].mm, abs=1e-3):
        assert time.monotonic() < end_s, window.watcher.view.readings


def hold_quiet(one: Browser, port: int, known: tuple[str, ...] = ()) -> None:
    """No error was said, and nobody else was asked for anything. known: parts of errors that a test has caused."""
    said = [event["args"] for event in one.named("Runtime.consoleAPICalled") if event["type"] in ("error", "warning")]
    said += [event["entry"] for event in one.named("Log.entryAdded") if event["entry"]["level"] == "error"]
    assert [entry for entry in said if not any(part in str(entry) for part in known)] == []
    assert one.named("Runtime.exceptionThrown") == []
    asked = {urlsplit(event["request"]["url"]) for event in one.named("Network.requestWillBeSent")}
    assert {url.netloc for url in asked if url.scheme not in ("data", "blob", "about")} == {f"127.0.0.1:{port}"}


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile")) as one:
        yield one


@pytest.fixture
def chromium(started):
    """A fresh browser without output or cookies."""
    started.send("Page.navigate", url="about:blank")
    started.send("Network.clearBrowserCookies")
    started.sized(*SIZES["desk"])
    started.events.clear()
    return started


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("window")
    for seed, direction in ((1, "acw"), (2, "cw"), (3, "acw")):
        lap_run(folder / "runs" / f"{seed}", direction=direction, seed=seed)
    for seed, run in enumerate(sorted((folder / "runs").glob("*/*")), start=1):
        run.rename(folder / "runs" / f"run-{seed}")
        run.parent.rmdir()
    return folder


@pytest.mark.cpu_limit(150)
def test_lap_is_shown_on_every_screen_and_a_lost_window_reported(chromium, runs):
    with served(runs, source=Playing(runs / "runs" / "run-1", 12.0)) as one:
        port = one.port
        chromium.sized(*SIZES["desk"])
        opened(chromium, one.address)
        chromium.until(f"{TEXT.format('acw-band')}.includes('…')")
        chromium.until(f"known.now.tick >= {chromium.value('known.now.tick') + 10}")
        loaded(chromium, lambda: chromium.send("Page.reload"))
        chromium.until(WHOLE)
        assert any(word in chromium.value(TEXT.format("lap")) for word in ("cw", "stands"))
        assert chromium.value("document.getElementById('acw-path').getAttribute('d').length") > 2000
        assert chromium.value("document.querySelectorAll('#turns text').length") > 5
        assert len(chromium.value(TEXT.format("joints"))) > 60
        shows_what_is_read(chromium, one.window)
        for name, size in SIZES.items():
            for scheme in ("light", "dark") if name == "desk" else ("light",):  # contrast is the same at every size
                chromium.sized(*size, prefers_color_scheme=scheme)
                assert chromium.value("document.documentElement.scrollWidth") <= size[0], name
                assert violations(chromium) == [], (name, scheme)
        hold_quiet(chromium, port)
    chromium.until("document.getElementById('state').classList.contains('stale')")
    assert chromium.value("document.getElementById('live').classList.contains('stale-all')")
    assert violations(chromium) == []  # old figures are read too
    with served(runs, source=Playing(runs / "runs" / "run-1", 12.0), port=port):
        chromium.until("!document.getElementById('state').classList.contains('stale')")
    chromium.sized(*SIZES["desk"])


@pytest.mark.cpu_limit(150)
def test_every_page_is_accessible_and_hostile_names_do_nothing(chromium, runs, tmp_path):
    with served(runs, session=tmp_path, control=True) as one:
        opened(chromium, f"{one.address}/runs?q={HOSTILE}")
        assert chromium.value("document.querySelector('[name=q]').value") == HOSTILE
        for path in (
            "/runs",
            "/runs/run-1",
            "/compare?run=run-1&run=run-3",
            "/session",
            "/runs/nothing",
            "/",
        ):
            opened(chromium, one.address + path)
            for size in SIZES.values():
                chromium.sized(*size)
                assert chromium.value("document.documentElement.scrollWidth") <= size[0], path
            assert violations(chromium) == [], path
        opened(chromium, f"{one.address}/runs/run-1")
        assert chromium.value("[...document.querySelectorAll('img')].every(one => one.naturalWidth > 300)")
        assert chromium.value("document.querySelectorAll('img').length") == 2
        chromium.send("Page.navigate", url=f"{one.address}/report?run=run-1&run=run-2")
        chromium.until("document.querySelectorAll('.live .main-svg').length > 3")
        assert (
            chromium.value("(() => { try { return document.cookie + 'seen'; } catch { return 'nothing'; } })()")
            == "nothing"
        )
        hold_quiet(chromium, one.port, ("404",))


@pytest.mark.cpu_limit(150)
def test_lap_is_recorded_from_the_page_and_survives_the_daemon(chromium, tmp_path):
    data = yaml.safe_load(rig_text())
    data["tests"]["circle"] |= {"laps": 1, "speed_mm_s": 60}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(data))
    with Bench(tmp_path, yaml.safe_dump(data)) as bench, bench.emulating("own.yaml") as keyboard:
        bench.rig = tmp_path / "cell" / "rig.yaml"
        bench.start().all_reading()
        with served(tmp_path, find=lambda: bench.socket, control=True) as one:
            chromium.sized(*SIZES["desk"])
            opened(chromium, one.address)
            chromium.until("!document.getElementById('g1').textContent.includes('–')")
            chromium.value("document.getElementById('label-name').value = 'lap'; document.forms[1].requestSubmit()")
            chromium.until(f"{TEXT.format('recording')}.includes('lap yaw acw')")
            chromium.until(f"{TEXT.format('said')}.includes('/runs/')")
            # On a busy computer rigd answers late, and the page may miss a lap. Then the person drives again.
            for _ in range(_MOST_LAPS):
                said = keyboard("acw")
                time.sleep(float(said.rpartition(", ")[2].removesuffix(" s")))  # the robot moves in real time
                if chromium.value(TEXT.format("acw-band")) != "–":
                    break
            chromium.value("document.querySelector('form[action=\"/control/stop\"]').requestSubmit()")
            chromium.until(f"{TEXT.format('recording')}.includes('not recording')")
            answered = "!document.querySelector('form[action=\"/control/stop\"] button').disabled"
            chromium.until(answered)
            assert [path.name.split("_")[1] for path in (tmp_path / "runs").iterdir() if path.is_dir()] == ["lap"]
            bench.signalled(signal.SIGKILL)
            chromium.until("document.getElementById('state').classList.contains('stale')")
            band = chromium.value(TEXT.format("acw-band"))
            assert band != "–"
            assert "rigd" in chromium.value(TEXT.format("state"))
            bench.start().all_reading()
            chromium.until("!document.getElementById('state').classList.contains('stale')")
            assert chromium.value(TEXT.format("acw-band")) == band
            hold_quiet(chromium, one.port)
