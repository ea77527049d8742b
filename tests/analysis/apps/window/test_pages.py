import asyncio
import io
import json
import math
import re
import shutil
import time
import zipfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pyarrow.parquet as pq
import pytest

from analysis import load_run
from analysis.apps.live.view import GaugeReading, LiveView, Update
from analysis.apps.report.texts import LANGUAGES
from analysis.apps.session.session_state import SessionDirectory, Try
from analysis.apps.window import frames
from analysis.apps.window.app import language_of
from analysis.apps.window.app import words_of as texts_of
from analysis.apps.window.control_posts import WindowControls
from analysis.apps.window.frames import summary
from analysis.apps.window.made import OutputStore
from analysis.apps.window.watcher import Board, Watcher
from daq.store.marks import load_marks
from rigs.load import find
from tests.support.nightly import cases
from tests.support.refusals import refused
from tests.support.session_cell import NAMED, begun
from tests.support.simulated_laps import lap_run, watched_lap
from tests.support.windows import PATIENCE_S, Served, no_daemon, served, told
from tests.support.written_files import contents

HOSTILE = (
    "<script>alert(1)</script>",
    "a'\"><img src=x>",
    "\x1b[31mred",
    "..",
    "%2e%2e%2fmanifest.json",
    "\u202eevil",
    "'; x",
    "{{7*7}}",
)
PLACES = (
    "/runs/{}",
    "/history/{}",
    "/made/{}/page.html",
    "/made/0/{}",
    "/static/{}",
    "/runs?q={}",
    "/report?run={}",
)
ROOT = Path(__file__).parents[4]
WINDOW = ROOT / "analysis" / "apps" / "window"
METRICS = ("daq/service/metrics.py", "analysis/apps/window/shelf.py")
TEMPLATES = ROOT / "analysis" / "templates" / "browser"


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    run = lap_run(folder / "made-elsewhere", seed=1)
    (folder / "runs").mkdir()
    for name in ("good", "<b>bold", "q'\"&x"):
        shutil.copytree(run, folder / "runs" / name)
    (folder / "runs" / "torn").mkdir()
    (folder / "runs" / "torn" / "manifest.json").write_text("{")
    (folder / "runs" / "link").symlink_to(run)
    with served(folder, control=True, session=folder / "session") as window:
        yield window


def test_runs_are_listed_filtered_evaluated_and_compared(one):
    page = one.until("/runs", lambda answer: "error band" in answer.text and "refresh" not in answer.text)
    assert "&lt;b&gt;bold" in page.text and "<b>bold" not in page.text and "link" not in page.text.split("<tbody>")[1]
    assert "damaged" in page.text and "pass" in page.text
    assert "good" in one.ask("/runs?q=yaw+good").text.split("<tbody>")[1]
    assert "<tbody>" not in one.ask("/runs?q=roll").text
    told = one.ask("/metrics").text
    assert "rig_up 0" in told
    figure = 'rig="ur10e",test="yaw",direction="acw",figure="band_deg"'
    assert f"rig_figure{{{figure}}} 0." in told and f'rig_figure_limit{{{figure},bound="fail"}} 0.205' in told
    assert f'rig_figure_standing{{{figure},standing="pass"}} 1' in told
    page = one.until("/compare?run=good&run=%3Cb%3Ebold", lambda answer: "<img" in answer.text)
    assert "+0.0" in page.text and "<b>bold" not in page.text
    assert one.ask("/compare?run=good").status == one.ask("/report").status == 400
    assert one.ask("/report?run=nothing").status == 404
    damaged = one.until("/report?run=torn", lambda answer: answer.status != 202)
    assert damaged.status == 409 and "torn" in damaged.text


def test_a_run_has_curves_and_figures(one):
    page = one.until("/runs/good", lambda answer: "<img" in answer.text and "refresh" not in answer.text)
    picture = page.text.split('<img src="')[1].split('"')[0]
    assert one.ask(picture).headers["content-type"] == "image/png"
    assert "error band" in page.text and "sine amplitude" in page.text
    assert "play_j" not in page.text and "± 0.0000 " not in page.text
    assert one.ask("/runs/good/table.exe").status == 404


@pytest.mark.parametrize("page", cases(("/runs/a", "/compare?run=a&run=b"), ("/runs/a",)))
def test_page_read_just_before_its_figures_were_ready_refreshes_itself(page, tmp_path, monkeypatch):
    run = lap_run(tmp_path / "elsewhere", seed=1)
    for name in "ab" if "run=b" in page else "a":
        shutil.copytree(run, tmp_path / "runs" / name)
    get = OutputStore.get

    def wait_for_output(store: OutputStore, words: Sequence[str], runs: Iterable[Path]) -> Path | None:
        """Every output becomes ready between the reading of the run and the page."""
        runs = list(runs)
        while (made := get(store, words, runs)) is None:
            time.sleep(0.05)
        return made

    monkeypatch.setattr(OutputStore, "get", wait_for_output)
    with served(tmp_path) as window:
        assert "refresh" in window.ask(page).text
        complete = window.ask(page).text
        assert "refresh" not in complete and "error band" in complete


ROWS = {
    "csv": lambda data: data.count(b"\n") - 1,
    "parquet": lambda data: pq.read_table(io.BytesIO(data)).num_rows,
    "xlsx": lambda data: zipfile.ZipFile(io.BytesIO(data)).read("xl/worksheets/sheet1.xml").count(b"<row ") - 1,
}
"""Functions that count the rows of a table, by format."""


@pytest.mark.parametrize("kind", cases(ROWS, ("csv",)))
def test_run_saved_as_a_table_is_not_marked_as_exported(one, kind):
    answer = one.until(f"/runs/good/table.{kind}", lambda answer: answer.status != 202)
    assert answer.status == 200 and f"good.{kind}" in answer.headers["content-disposition"]
    assert ROWS[kind](answer.data) == len(load_run(one.window.shelf.directory / "good").table.t_s)
    marks = load_marks(one.window.shelf.directory / "good")
    assert not marks.exports  # what a browser saved may be lost, and rigd may delete what is exported


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_lead_nowhere_and_are_text(one, name):
    for path in PLACES:
        answer = one.ask(path.format(quote(name, safe="")))
        assert answer.status in (200, 404), (path, answer.status)
        body = answer.text.replace('<script src="/static/window.js" defer></script>', "")
        assert "<script" not in body and "<img" not in body and "\x1b" not in body and "\u202e" not in body
        assert "49" not in body.split("<h1>")[-1]


def test_session_is_shown_and_a_damaged_file_reported(tmp_path):
    session = begun(find("paper-fanuc"), tmp_path, 11).with_try(0, Try(run="r1"))
    session = session.model_copy(update={"answer": NAMED})
    shown = summary(session)
    following, words = session.steps[1].program, session.stages[0].words
    count = len(session.steps)
    assert shown["next"] == {"key": "drive", "program": following, "number": 2, "of": count, "stage": words}
    assert [one["state"] for one in shown["steps"]] == ["driven", *["open"] * (count - 1)]
    assert shown["parts"][0]["fault"]
    place = SessionDirectory(tmp_path)
    place.write(session)
    with served(tmp_path, session=tmp_path) as window:
        read = _heard(window, "session")
        assert read["next"]["number"] == 2
        place.file.write_text("version: [")
        assert _heard(window, "session", lambda one: one["next"]["key"] == "damaged")["next"]["why"]
        place.file.unlink()
        nothing = _heard(window, "session", lambda one: one["next"]["key"] == "none")["next"]
        assert nothing["command"] == f"rig session cell.yaml -o {tmp_path}"


def _heard(window: Served, kind: str, is_so: Callable[[Any], object] = bool) -> Any:
    with window.raw(b"GET /events HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n") as sock:
        data = ""
        while True:
            for text in told(data, kind):
                if is_so(found := json.loads(text)):
                    return found
            received = sock.recv(65536)
            assert received
            data += received.decode()


def test_frames_contain_the_values_of_the_view(tmp_path):
    view = watched_lap(lap_run(tmp_path))
    now = frames.now(view, (0.0, 0.0), 1)
    assert now["gauges"]["g1"]["mm"] == view.readings["g1"].mm and now["lap"]["place"] in ("lap", "lead_out")
    curves = frames.curves(view)
    phi, error = curves["acw"]["pieces"][0]
    assert len(phi) == len(error) > 300 and max(error) - min(error) == pytest.approx(
        curves["acw"]["band"] * 1e5, rel=0.05
    )
    assert {axis for axis, _, _ in curves["circle"]["turned"]} == {1, 2, 3, 4, 5, 6}
    trace = frames.trace(view)
    assert len(trace["t"]) == len(trace["g"][0]) <= 240 and trace["t"][-1] <= 0 and trace["t"][0] >= -3000
    less = frames.now(view, (1.0, 0.0), 2)
    assert less["zero_mm"] == [1.0, 0.0] and less["angle_deg"] != now["angle_deg"]


def test_unknown_values_are_null_and_never_nan():
    readings = {"g1": GaugeReading(math.nan, 0.0), "g2": GaugeReading(np.inf, 1.0)}
    board, view = Board(), LiveView().after(Update(readings=readings))
    board.post("now", frames.now(view, (0.0, 0.0), 1))
    board.post("trace", frames.trace(view))

    async def second() -> bytes:
        stream = board.follow()
        await anext(stream)
        return await anext(stream)

    news = asyncio.run(second())
    assert b"event: now" in news and b"event: trace" in news and b'"mm":null' in news
    assert b"NaN" not in news and b"Infinity" not in news


def test_each_language_has_each_text():
    english = texts_of("en")
    files = [file for file in (*TEMPLATES.iterdir(), *WINDOW.glob("*.py")) if file.suffix != ".yaml"]
    used = "".join(file.read_text() for file in files)
    for language in LANGUAGES:
        own = texts_of(language)
        assert own.keys() == english.keys(), language
        for key, text in own.items():
            places = {part.split("}")[0] for part in text.split("{")[1:]}
            assert places == {part.split("}")[0] for part in english[key].split("{")[1:]}, (language, key)
    dynamic = ("js_lap_", "js_next_", "js_step_", "js_where_", "status_", "moved_unit_")
    for key in english:
        name = key.removeprefix("js_")
        assert key.startswith(dynamic) or f"t.{name}" in used or f'"{name}"' in used or f"t.{key}" in used, key
    assert [language_of("", text) for text in ("de-AT,en", "fr", "ko", "", "en;q=0.1, de")] == [
        "de",
        "en",
        "ko",
        "en",
        "en",
    ]
    assert language_of("ko", "de") == "ko"


def test_recording_needs_a_valid_label(one):
    secret = one.window.gate.secret
    for form in (
        "name=a&test=pose",
        "name=&test=yaw",
        "name=a&test=yaw",
        "name=a b&test=radial",
        "test=yaw&direction=acw",
    ):
        answer = one.post("/control/start", f"secret={secret}&{form}")
        assert (answer.status, json.loads(answer.text)["code"]) == (409, "usage"), form
    assert one.post("/control/stop", f"secret={secret}").status == 409
    assert one.post("/control/explode", f"secret={secret}").status == 404
    assert one.post("/control/zero", f"secret={secret}").status == 200


def test_a_full_queue_asks_to_retry(one, monkeypatch):
    monkeypatch.setattr("analysis.apps.window.made.MOST_WAITING", -1)
    assert one.ask("/report?run=good&diagnosis=1").status == 409


def test_dashboard_queries_existing_metrics(one):
    dashboard = contents(ROOT / "docs" / "grafana-dashboard.json")
    one.until("/runs", lambda answer: "error band" in answer.text)
    sources = "".join((ROOT / name).read_text() for name in METRICS)
    queries = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    named = {name for query in queries for name in re.findall(r"rig_[a-z_]+", query)}
    assert len(queries) > 8 and all(f'"{name}"' in sources for name in named), named


def test_session_continues_by_its_own_command_and_shows_its_lines(tmp_path):
    place = SessionDirectory(tmp_path / "session")
    controls = WindowControls(Watcher(no_daemon, place), place, str(tmp_path / "none.yaml"))
    try:
        said = controls.do("session", {"maker": "kuka", "entered": "1"})
        assert said == f"rig session {tmp_path}/none.yaml -o {place.directory} --for kuka --entered"
        end_s = time.monotonic() + PATIENCE_S
        while not controls.session_lines():
            assert time.monotonic() < end_s
            time.sleep(0.1)
        assert "none.yaml" in controls.session_lines()[-1]
    finally:
        controls.close()
    with refused("rig_file.invalid", "was started without a cell"):
        WindowControls(Watcher(no_daemon, None), None, "").do("session", {})
