"""Routes of the window, in the languages of the report."""

from __future__ import annotations

import asyncio
import io
import logging
import mimetypes
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, quote

import numpy as np
import yaml
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    RedirectResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route

from analysis.apps.commission.cell_references import references_of
from analysis.apps.commission.movement_report import movement_answer
from analysis.apps.plant.history import label_of
from analysis.apps.report.html_page import environment
from analysis.apps.report.texts import LANGUAGES, Language
from analysis.apps.report.texts import texts_of as report_texts
from analysis.apps.session.session_state import SessionDirectory
from analysis.apps.window.control_posts import WindowControls
from analysis.apps.window.guard import COOKIE, Gate, is_equal
from analysis.apps.window.made import OutputStore
from analysis.apps.window.shelf import MOST_SHOWN, Shelf, ShelfRun, metrics_of
from analysis.apps.window.watcher import Watcher
from analysis.apps.window.window_check import touchable
from analysis.procedures.shared.quantity import Quantity
from analysis.runs.loading import load_measured
from analysis.runs.written_files import write_csv, write_parquet, write_xlsx
from rigs.distribution import version
from rigs.errors import RigError
from rigs.makers import MAKERS

NAMES: dict[Language, str] = {"en": "English", "de": "Deutsch", "ko": "한국어"}


@cache
def words_of(language: Language) -> dict[str, str]:
    file = resources.files("analysis") / "templates" / "browser" / f"texts.{language}.yaml"
    words: dict[str, str] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return words


def language_of(chosen: str, accepted: str) -> Language:
    """The chosen language, or the first supported one accepted by the browser (RFC 9110, 12.5.4), or English."""
    for tag in (chosen, *(part.partition(";")[0].strip() for part in accepted[:200].split(","))):
        for language in LANGUAGES:
            if tag.lower().partition("-")[0] == language:
                return language
    return "en"


log = logging.getLogger("uvicorn.error")
LANGUAGE = "rig_window_lang"
_STATIC = {
    "window.css": "browser/window.css",
    "window.js": "browser/window.js",
    "icon.svg": "browser/icon.svg",
    "report.css": "report.css",
}
_WRITERS = {"csv": write_csv, "parquet": write_parquet, "xlsx": write_xlsx}
_A_YEAR_S = 31_536_000
_MOST_RUNS = 60
"""Maximum number of runs in an address: addresses are limited to 8 kB."""
_MOST_ROBOTS = 3
"""Maximum number of robots evaluated for a list of runs."""
_PAGE = "page.html"
_SCRAPE_S, _POLL_S = 8.0, 0.2
"""Time that a metrics request waits for evaluations (Prometheus has a limit of 10 s), and polling interval."""
_SCRIPTED = "sandbox allow-scripts allow-downloads; frame-ancestors 'none'"
"""Policy for pages of `rig report`: their scripts are allowed by hash, isolated from the window."""
_PLAIN = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""Policy for all other generated files: scripts are forbidden."""


@dataclass(frozen=True)
class Window:
    watcher: Watcher
    shelf: Shelf
    place: SessionDirectory | None
    made: OutputStore
    gate: Gate
    controls: WindowControls | None
    """None if the window is read-only."""


def app_of(window: Window) -> Starlette:
    pages = _Pages(window)
    routes = [
        Route("/", pages.live),
        Route("/events", pages.events),
        Route("/session", pages.session),
        Route("/session/report", pages.session_report),
        Route("/runs", pages.runs),
        Route("/runs/{name}", pages.run),
        Route("/runs/{name}/table.{kind}", pages.table),
        Route("/report", pages.report),
        Route("/compare", pages.compare),
        Route("/moved", pages.moved),
        Route("/moved/runs", pages.moved_runs),
        Route("/history/{robot}", pages.history),
        Route("/fleet", pages.fleet),
        Route("/metrics", pages.metrics),
        Route("/made/{key}/{file:path}", pages.requested_output),
        Route("/login", pages.login, methods=["GET", "POST"]),
        Route("/language", pages.language, methods=["POST"]),
        Route("/control/{what}", pages.control, methods=["POST"]),
        Route("/static/{file}", pages.static),
    ]

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        def log_failure(watching: asyncio.Task[None]) -> None:
            if not watching.cancelled() and (error := watching.exception()) is not None:
                log.error("the cell is no longer monitored", exc_info=error)  # the pages report missing updates

        watching = asyncio.create_task(window.watcher.run())
        watching.add_done_callback(log_failure)
        try:
            yield
        finally:
            watching.cancel()
            with suppress(asyncio.CancelledError):
                await watching
            window.made.close()

    handlers: dict[Any, Any] = {HTTPException: pages.refused, RigError: pages.failed}
    middleware = window.gate.middleware()
    return Starlette(routes=routes, lifespan=lifespan, exception_handlers=handlers, middleware=middleware)


class _Pages:
    def __init__(self, window: Window) -> None:
        self._window = window
        self._templates = environment()
        self._templates.filters["written"] = _written
        self._templates.filters["address"] = lambda name: quote(name, safe="")
        self._asset = version()

    async def live(self, request: Request) -> Response:
        return self._page(request, "live.html", session=self._window.place is not None)

    async def events(self, request: Request) -> Response:
        news = self._window.watcher.board.follow()
        return StreamingResponse(news, media_type="text/event-stream", headers={"x-accel-buffering": "no"})

    async def session(self, request: Request) -> Response:
        session_lines: list[str] = []
        if self._window.controls is not None:
            session_lines = await run_in_threadpool(self._window.controls.session_lines)
        place = self._window.place
        is_new = place is not None and not place.file.exists()
        directories = {self._window.shelf.directory, Path("runs")} if is_new else ()
        references = await run_in_threadpool(references_of, directories)
        return self._page(
            request, "session.html", has_session=place is not None, said=session_lines,
            makers=MAKERS if is_new else (), reference=references[0] if references else None,
        )  # fmt: skip

    def session_report(self, request: Request) -> Response:
        place = self._window.place
        session = place.read() if place else None
        if place is None or session is None or not session.report:
            raise HTTPException(404)
        file = place.directory / Path(session.report).name
        if not file.is_file():
            raise HTTPException(404)
        return FileResponse(file, media_type="text/html", headers={"content-security-policy": _SCRIPTED})

    def runs(self, request: Request) -> Response:
        words = request.query_params.get("q", "")[:200]
        shown, count = self._window.shelf.runs(words)
        robots = sorted({str(run.about["rig"]) for run in shown if run.about["rig"]})
        unshown = max(0, count - MOST_SHOWN)
        waits = self._evaluates(shown)
        return self._page(
            request, "runs.html", runs=shown, count=count, more=unshown, words=words, robots=robots, waits=waits
        )

    def run(self, request: Request) -> Response:
        shown = self._window.shelf.run(request.path_params["name"])
        pictures, why = self._pictures([shown]) if _is_readable(shown) else ([], "")
        waits = self._evaluates([shown]) or pictures is None
        return self._page(
            request, "run.html", run=shown, pictures=pictures or [], why=why, waits=waits, kinds=list(_WRITERS)
        )

    def table(self, request: Request) -> Response:
        """A run as a file, not marked as exported: a download may be lost, and rigd may delete exported runs."""
        kind = request.path_params["kind"]
        if kind not in _WRITERS:
            raise HTTPException(404)
        shown = self._window.shelf.run(request.path_params["name"])
        file = io.BytesIO()
        _WRITERS[kind](load_measured(shown.path).to_table(), file)
        attachment = f"attachment; filename*=utf-8''{quote(f'{shown.name}.{kind}', safe='')}"
        return Response(file.getvalue(), headers={"content-disposition": attachment})

    def report(self, request: Request) -> Response:
        shown = self._chosen(request)
        diagnosis = "--diagnosis" if request.query_params.get("diagnosis") else "--no-diagnosis"
        words = ("report", *_paths(shown), "--lang", self._language(request), diagnosis)
        return self._made_page(request, words, shown)

    def compare(self, request: Request) -> Response:
        shown = self._chosen(request)
        if len(shown) != 2:
            raise HTTPException(400, "choose_two")
        pictures, why = self._pictures(shown)
        waits = self._evaluates(shown) or pictures is None
        first, second = ({figure.name: figure.value for figure in run.figures} for run in shown)
        rows = []
        for name in (name for name in first if name in second):
            u = (first[name].u ** 2 + second[name].u ** 2) ** 0.5
            difference = second[name].value - first[name].value
            rows.append((name, first[name], second[name], difference, difference / u if u > 0 else None))
        return self._page(request, "compare.html", runs=shown, rows=rows, pictures=pictures or [], why=why, waits=waits)

    def moved(self, request: Request) -> Response:
        controls, texts = self._window.controls, report_texts(self._language(request))
        check = controls.moved.check if controls else None
        if check is None:
            return self._page(request, "moved.html", check=None, references=touchable(self._window.shelf.directory))
        result, next_posture = check.result, check.result.next_posture
        return self._page(
            request, "moved.html", check=check, answer=movement_answer(result, texts),
            targets=[] if next_posture is None else np.degrees(next_posture.angles).round(2).tolist(),
        )  # fmt: skip

    def moved_runs(self, request: Request) -> Response:
        shown = sorted(self._chosen(request), key=lambda run: -run.about["age_s"])
        if len(shown) < 2:
            raise HTTPException(400, "choose_moved")
        *before, after = _paths(shown)
        words = ("moved", *before, "--new", after, "--lang", self._language(request))
        return self._made_page(request, words, shown)

    def history(self, request: Request) -> Response:
        robot = request.path_params["robot"]
        if robot not in self._window.shelf.robots():
            raise HTTPException(404)
        return self._redirect(request, self._history(robot))

    def fleet(self, request: Request) -> Response:
        shown, _ = self._window.shelf.runs()
        words = ("fleet", str(self._window.shelf.directory.resolve()), "--jobs", "1")
        return self._made_page(request, words, shown[:_MOST_RUNS])

    def metrics(self, request: Request) -> Response:
        daemon = ""
        with suppress(RigError):  # not available until the daemon starts
            daemon = str(self._window.watcher.ask("metrics")["text"])
        end_s = time.monotonic() + _SCRAPE_S
        while self._evaluates(self._window.shelf.runs()[0]) and time.monotonic() < end_s:
            time.sleep(_POLL_S)  # runs in a thread of the pool; new runs are not evaluated yet
        text = daemon + metrics_of(self._window.shelf.runs()[0], daemon_is_up=bool(daemon))
        return Response(text, media_type="text/plain; version=0.0.4; charset=utf-8")

    async def requested_output(self, request: Request) -> Response:
        file = self._window.made.file(request.path_params["key"], request.path_params["file"])
        if file is None or file.suffix not in (".html", ".png"):
            raise HTTPException(404)
        policy = _SCRIPTED if request.query_params.get("scripts") else _PLAIN
        kind = mimetypes.types_map[file.suffix]
        return FileResponse(file, media_type=kind, headers={"content-security-policy": policy})

    async def login(self, request: Request) -> Response:
        gate = self._window.gate
        if gate.token is None:
            return RedirectResponse("/", 303)
        if request.method == "GET":
            return self._page(request, "login.html", wrong=False)
        if not is_equal((await _form(request)).get("token", ""), gate.token):
            return self._page(request, "login.html", 403, wrong=True)
        answer = RedirectResponse("/", 303)
        is_encrypted = request.url.scheme == "https"
        answer.set_cookie(COOKIE, gate.secret, httponly=True, samesite="strict", secure=is_encrypted)
        return answer

    async def language(self, request: Request) -> Response:
        form = await _form(request)
        answer = RedirectResponse("/" + form.get("back", "").lstrip("/\\"), 303)  # never to another site
        if form.get("to") in LANGUAGES:
            answer.set_cookie(LANGUAGE, form["to"], max_age=_A_YEAR_S, httponly=True, samesite="strict")
        return answer

    async def control(self, request: Request) -> Response:
        controls, form = self._window.controls, await _form(request)
        if controls is None or not self._window.gate.is_own(form.get("secret", "")):
            raise HTTPException(403)
        try:
            answer = await run_in_threadpool(controls.do, request.path_params["what"], form)
        except RigError as error:
            return JSONResponse({"ok": False, "said": str(error), "code": error.code}, 409)
        if answer is None:
            raise HTTPException(404)
        return JSONResponse({"ok": True, "said": answer})

    def static(self, request: Request) -> Response:
        name = request.path_params["file"]
        if name not in _STATIC:
            raise HTTPException(404)
        text = (resources.files("analysis") / "templates" / _STATIC[name]).read_text(encoding="utf-8")
        return Response(text, media_type=mimetypes.guess_type(name)[0], headers={"cache-control": "no-cache"})

    async def refused(self, request: Request, error: HTTPException) -> Response:
        texts = words_of(self._language(request))
        key = error.detail if error.detail in texts else f"status_{error.status_code}"
        return self._page(request, "message.html", error.status_code, message=texts.get(key, error.detail))

    async def failed(self, request: Request, error: RigError) -> Response:
        status = 404 if error.code == "run.missing" else 409
        return self._page(request, "message.html", status, message=str(error))

    def _page(self, request: Request, template: str, status: int = 200, **values: Any) -> Response:
        language = self._language(request)
        window, texts = self._window, words_of(language)
        html = self._templates.get_template(f"browser/{template}").render(
            t=texts, lang=language, languages=NAMES, label=partial(_label, language), asset=self._asset,
            here=request.url.path + (f"?{request.url.query}" if request.url.query else ""),
            control=window.controls is not None, secret=window.gate.secret if window.controls is not None else "",
            let_in=window.gate.is_open_to(request),
            script_texts={key.removeprefix("js_"): text for key, text in texts.items() if key.startswith("js_")},
            **values,
        )  # fmt: skip
        return HTMLResponse(html, status, {"content-language": language})

    def _language(self, request: Request) -> Language:
        return language_of(request.cookies.get(LANGUAGE, ""), request.headers.get("accept-language", ""))

    def _chosen(self, request: Request) -> list[ShelfRun]:
        names = list(dict.fromkeys(request.query_params.getlist("run")))
        if not names or len(names) > _MOST_RUNS:
            raise HTTPException(400, "choose_runs")
        return [self._window.shelf.run(name) for name in names]

    def _evaluates(self, shown: Sequence[ShelfRun]) -> bool:
        """Start the evaluation of runs not yet evaluated, as in `rig history`.

        True while it is in progress, and if it ended after the runs were read: then the page is out of date.
        """
        new = [run for run in shown if run.record is None and _is_readable(run)]
        made = list[Path | None]()
        for robot in sorted({str(run.about["rig"]) for run in new})[:_MOST_ROBOTS]:
            with suppress(RigError):  # the next attempt reports the details
                made.append(self._history(robot))
        return None in made or (bool(new) and self._window.shelf.has_record_of(new))

    def _history(self, robot: str) -> Path | None:
        shelf = self._window.shelf
        runs = [run.path for run in shelf.runs()[0] if run.about["rig"] == robot]
        words = ("history", robot, "--runs", str(shelf.directory.resolve()), "-o", f"{{out}}/{_PAGE}", "--jobs", "1")
        return self._window.made.get(words, runs)

    def _pictures(self, shown: Sequence[ShelfRun]) -> tuple[list[str] | None, str]:
        words = ("analyse", *_paths(shown), "--json", "--plot", "{out}")
        try:
            made = self._window.made.get(words, [run.path for run in shown])
        except RigError as error:
            return [], error.what
        if made is None:
            return None, ""
        return [f"/made/{made.name}/{picture.name}" for picture in sorted(made.glob("*.png"))], ""

    def _made_page(self, request: Request, words: tuple[str, ...], shown: Sequence[ShelfRun]) -> Response:
        made = self._window.made.get((*words, "-o", f"{{out}}/{_PAGE}"), [run.path for run in shown])
        return self._redirect(request, made, "?scripts=1" if words[0] == "report" else "")

    def _redirect(self, request: Request, made: Path | None, query: str = "") -> Response:
        if made is None:
            return self._page(request, "wait.html", 202)
        return RedirectResponse(f"/made/{made.name}/{_PAGE}{query}", 303)


def _label(language: Language, name: str) -> str:
    """Name of a figure. Figures of single axes are in English."""
    label = report_texts(language).label(name)
    return label_of(name) if label == name else label


def _written(value: Quantity) -> str:
    return str(value) if value.u > 0 else f"{value.rounded(value.value)} {value.sign}".rstrip()


async def _form(request: Request) -> dict[str, str]:
    return dict(parse_qsl((await request.body()).decode("utf-8", "replace"), keep_blank_values=True))


def _is_readable(shown: ShelfRun) -> bool:
    return shown.about["status"] not in ("recording", "crashed", "damaged")


def _paths(shown: Sequence[ShelfRun]) -> list[str]:
    return [str(run.path.resolve()) for run in shown]
