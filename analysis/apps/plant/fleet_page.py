"""Page of a plant with a row per robot, linked to the history page of each."""

from __future__ import annotations

import hashlib
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from analysis.apps.plant.collect import Progress, Workers
from analysis.apps.plant.fleet_screen import answer_of
from analysis.apps.plant.gather import Fleet, collected_in
from analysis.apps.plant.history import history_of
from analysis.apps.plant.robot_state import FleetRobot
from analysis.apps.plant.store import Damaged, Key, made_by
from analysis.apps.report.html_page import answer_page, write_html
from analysis.runs.batch import FailedItem, each

_HEAD_BYTES = 2000
"""Start of a page, with the digest of its inputs."""


@dataclass(frozen=True)
class _Page:
    """A page of a robot to be written: catalogue and key, digest of its inputs, and the page of the plant."""

    path: Path
    catalogue: Path
    key: Key
    made_of: str
    overview: str


def write_pages(fleet: Fleet, path: Path, workers: Workers, progress: Progress) -> list[str]:
    """Write the page of the plant, and the outdated history pages of the robots.

    Returns a line for each page of a robot that could not be written.
    """
    folder = path.with_name(f"{path.stem}-robots")
    pages = [_page(fleet, state, folder, path) for state in fleet.robots if state.runs]
    fresh = [page for page in pages if not _is_current(page)]
    failed: list[str] = []
    for done, outcome in enumerate(each(_write, fresh, jobs=workers.jobs), 1):
        if isinstance(outcome, FailedItem):
            if isinstance(outcome.error, Damaged):
                raise outcome.error
            failed.append(f"{outcome.item.path}: {outcome.error.what}")
        progress("drawing the pages of robots", done, len(fresh))
    links = {page.key: quote(f"{folder.name}/{page.path.name}") for page in pages if page.path.exists()}
    title = f"{fleet.directory.resolve().name or fleet.directory}: robots"
    html = answer_page(title, answer_of(fleet, links, failed))
    write_html(html, path)
    return failed


def _page(fleet: Fleet, state: FleetRobot, folder: Path, overview: Path) -> _Page:
    key = (state.folder, state.robot)
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", state.robot).lstrip(".")[:60]
    # Names may differ only in unusual characters.
    digest = hashlib.sha256(repr(key).encode("utf-8", "surrogatepass")).hexdigest()[:8]
    made_of = f"{made_by()} {fleet.digests[key]}"
    return _Page(folder / f"{plain}-{digest}.html", fleet.catalogue, key, made_of, quote(f"../{overview.name}"))


def _is_current(page: _Page) -> bool:
    with suppress(OSError), page.path.open("rb") as file:
        return f'name="made-of" content="{page.made_of}"'.encode() in file.read(_HEAD_BYTES)
    return False


def _write(page: _Page) -> None:
    from analysis.apps.plant.history_page import write_page  # noqa: PLC0415 - matplotlib, which no current page needs

    history = history_of(collected_in(page.catalogue, page.key))
    write_page(history, page.path, made_of=page.made_of, overview=page.overview)
