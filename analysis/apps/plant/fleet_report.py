"""Robots of a plant on a terminal, as JSON, as a page with a row per robot, and all figures as a Parquet file."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC
from pathlib import Path
from typing import Any
from urllib.parse import quote

from analysis.apps.plant.collect import Collected, Progress, Workers
from analysis.apps.plant.fleet import ORDER, Attention, Fleet, collected_in
from analysis.apps.plant.history import history_of
from analysis.apps.plant.history_report import write_page
from analysis.apps.plant.history_sentences import simulated_runs, without_figures
from analysis.apps.plant.store import Key, made_by
from analysis.apps.report.blocks import Block, Cell, Sentence, Table, Tone, paragraphs
from analysis.apps.report.html_page import answer_page, write_html
from analysis.runs.batch import FailedItem, each
from analysis.runs.tabular import pick_fields
from daq.store import durable
from daq.store.chunk import storable
from rigs.errors import FileError
from rigs.text import counted, escape_text

WORDS: dict[Attention, str] = {
    "beyond": "beyond a limit",
    "watch": "watch",
    "unreadable": "no figures",
    "changed": "has changed",
    "within": "within limits",
    "unlimited": "no limits",
}
_TONES: dict[Attention, Tone] = {"beyond": "fail", "within": "pass", "unlimited": "plain"}
_ORDER = (
    "Robots that need attention come first: beyond a limit, not proven to be within a limit, no figures, a figure "
    "increased by more than the scatter between runs, then the others. A robot is identified by the name of its rig "
    "file and the directory of its runs."
)


def fleet_answer(fleet: Fleet, links: Mapping[Key, str] | None = None, failed: Sequence[str] = ()) -> list[Block]:
    """links: pages of robots. failed: pages that could not be written."""
    robots = fleet.robots
    counts = Counter(state.attention for state in robots)
    states = ", ".join(f"{counts[reason]} {WORDS[reason]}" for reason in ORDER if counts[reason])
    times, rows = Counter(state.robot for state in robots), []
    for state in robots:
        some = "" if state.simulated == state.runs else f"{state.simulated} of {state.runs} "
        simulated = f"{some}simulated" if state.simulated else ""
        name = escape_text(state.robot if times[state.robot] == 1 else f"{state.robot} in {state.folder}")
        robot = Cell(name, (simulated,), link=(links or {}).get((state.folder, state.robot), ""))
        worst = Cell(state.worst, (", ".join(state.tests), escape_text(", ".join(state.doubts))))
        standing = Cell(WORDS[state.attention], tone=_TONES.get(state.attention, "watch"))
        rows.append((robot, standing, worst, state.trend, state.last[:10], f"{state.runs}"))
    heads = ("robot", "state", "figure closest to its limit", "what changed", "last run", "runs")
    # The omitted runs of unknown robots come first.
    left_out = [*fleet.strays]
    left_out += [(str(Path(state.folder, run)), why) for state in robots for run, why in state.without_figures]
    origin = simulated_runs(sum(state.simulated for state in robots), sum(state.runs for state in robots))
    gone = f", {fleet.gone} gone" if fleet.gone else ""
    read = f"{fleet.runs} runs, {fleet.examined} of them read (new, changed, or unreadable the last time){gone}"
    return [
        Sentence(f"{counted(len(robots), 'robot')}: {states or 'none found'}.", "strong"),
        *paragraphs((origin, *fleet.notes, *without_figures(left_out), *failed), "doubt"),
        Table(heads, rows, {5}, key="stack"),
        Sentence(f"{_ORDER} {read}", "note"),
    ]


def as_object(fleet: Fleet) -> dict[str, Any]:
    return {
        "directory": fleet.directory,
        "catalogue": fleet.catalogue,
        "robots": [
            vars(state) | {"attention": state.attention, "without_figures": dict(state.without_figures)}
            for state in fleet.robots
        ],
        "without_robot": dict(fleet.strays),
        "notes": fleet.notes,
        "runs": fleet.runs,
        "runs_read": fleet.examined,
        "runs_gone": fleet.gone,
    }


def write_figures(fleet: Fleet, path: Path) -> None:
    """A row per figure, with one robot in memory at a time; a run without figures has a row with the `problem`."""
    import pyarrow as pa  # noqa: PLC0415 - slow to import, needed for Parquet only
    import pyarrow.parquet as pq  # noqa: PLC0415

    words = pa.dictionary(pa.int32(), pa.string())
    columns = dict.fromkeys(("robot", "folder"), words) | {"run": pa.string(), "started_utc": pa.timestamp("ms")}
    columns |= dict.fromkeys(("test", "direction", "placement", "program", "corrected", "figure"), words)
    columns |= {"value": pa.float64(), "u": pa.float64(), "unit": words, "samples": pa.int64(), "noise": words}
    columns |= {"watch": pa.float64(), "fail": pa.float64(), "standing": words, "problem": pa.string()}
    schema = pa.schema(columns)
    temporary = path.with_name(path.name + durable.TEMPORARY)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with pq.ParquetWriter(temporary, schema, compression="zstd") as file:
            for key in sorted(fleet.digests):
                rows = list(_rows(key, collected_in(fleet.catalogue, key)))
                file.write_table(pa.Table.from_pylist(rows, schema))
            strays = [_label("", "", run) | {"problem": why} for run, why in fleet.strays]
            file.write_table(pa.Table.from_pylist(strays, schema))
        durable.rename(temporary, path)
    except OSError as error:
        raise FileError.of_os(path, error, "choose a different --parquet", code="output.not_writable") from None
    finally:
        with suppress(OSError):
            temporary.unlink()


def _rows(key: Key, collected: Collected) -> Iterator[dict[str, Any]]:
    folder, robot = key
    for record in (*collected.broken, *collected.runs):
        label, started = _label(robot, folder, record.name), None
        with suppress(ValueError):
            started = record.when.astimezone(UTC).replace(tzinfo=None)  # DuckDB needs pytz for times with a zone.
        label |= {"started_utc": started}
        label |= pick_fields(record, "test", "direction", "placement", "program", "corrected")
        if record.problem:
            yield label | {"problem": record.problem}
        for name, quantity in record.figures.items():
            row = label | {"figure": name} | asdict(quantity)
            if limit := collected.limits.of(record.test, name):
                standing = limit.standing(quantity.value, quantity.u)
                row |= {"watch": limit.watch, "fail": limit.fail, "standing": standing}
            yield row


def _label(robot: str, folder: str, run: str) -> dict[str, Any]:
    return {"robot": robot, "folder": storable(folder), "run": storable(run)}


_HEAD_BYTES = 2000


@dataclass(frozen=True)
class _Page:
    path: Path
    catalogue: Path
    key: Key
    made_of: str
    overview: str


def write_pages(fleet: Fleet, path: Path, workers: Workers, progress: Progress) -> list[str]:
    """Write the page of the plant and the outdated pages of robots; a line for each that could not be written."""
    folder = path.with_name(f"{path.stem}-robots")
    pages, fresh = [], []
    for state in (state for state in fleet.robots if state.runs):
        key = (state.folder, state.robot)
        name = re.sub(r"[^A-Za-z0-9_.-]", "_", state.robot).lstrip(".")[:60]
        # Names may differ only in unusual characters.
        digest = hashlib.sha256(repr(key).encode("utf-8", "surrogatepass")).hexdigest()[:8]
        made_of = f"{made_by()} {fleet.digests[key]}"
        page = _Page(folder / f"{name}-{digest}.html", fleet.catalogue, key, made_of, quote(f"../{path.name}"))
        pages.append(page)
        head = b""
        with suppress(OSError), page.path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        fresh += [] if f'name="made-of" content="{made_of}"'.encode() in head else [page]
    failed: list[str] = []
    for done, outcome in enumerate(each(_write, fresh, jobs=workers.jobs), 1):
        if isinstance(outcome, FailedItem):
            failed.append(f"{outcome.item.path}: {outcome.error.what}")
        progress("drawing the pages of robots", done, len(fresh))
    links = {page.key: quote(f"{folder.name}/{page.path.name}") for page in pages if page.path.exists()}
    title = f"{fleet.directory.resolve().name or fleet.directory}: robots"
    write_html(answer_page(title, fleet_answer(fleet, links, failed)), path)
    return failed


def _write(page: _Page) -> None:
    history = history_of(collected_in(page.catalogue, page.key))
    write_page(history, page.path, made_of=page.made_of, overview=page.overview)
