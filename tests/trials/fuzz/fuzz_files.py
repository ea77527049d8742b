"""Mutated rig files, run directories and tables: readers may raise only RigError, within the time limit."""

from __future__ import annotations

import atexit
import contextlib
import csv
import io
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from random import Random

from analysis.intake.read import read_file
from daq.store import read_run, recover, verify
from daq.store.ledger import sha256
from rigs.errors import RigError
from rigs.load import SHIPPED, load, load_hidden
from tests.support.store_cases import crash, edit_chunk, finished, record
from tests.support.table_cases import TESTS, rig, rows_of
from tests.trials.fuzz.mutation import mutated

LONGEST_FILE = 20_000


Feed = Callable[[Random], int]
"""Function that feeds one input and returns 1; raises an exception on failure."""


@dataclass
class _Bench:
    """Where the files of this process go, and what was put there last, for a report."""

    said: list[bytes] = field(default_factory=list)

    @cached_property
    def folder(self) -> Path:
        made = tempfile.TemporaryDirectory(dir=_MEMORY if _MEMORY.is_dir() else None)
        atexit.register(made.cleanup)
        return Path(made.name)


_MEMORY = Path("/dev/shm")  # noqa: S108 - files there cost no disk
BENCH = _Bench()


def files() -> dict[str, list[Feed]]:
    """Reader of each kind of file."""
    return {
        "rig_files": [_rig_file],
        "runs": [partial(_one_run, crashed=crashed) for crashed in (False, True)],
        "tables": [_table],
    }


NASTY = [
    *("", "~", "[]", "{}", "-1", "0", "1e999", ".nan", "-.inf", "9" * 400, "0x7f", "1_0", "2026-11-20", "2026-99-99"),
    *(
        "!!python/object:os.system x",
        "!!binary x",
        "!!timestamp x",
        "!!set {a}",
        "&a [*a]",
        "*a",
        "<<: *a",
        "? a",
        "a: b: c",
    ),
    *('"\\ud800"', "'\\0'", "\t", "%YAML 9.9", "--- {", "...", "| x", "[" * 300, "{a: " * 300, "? " * 300, "- " * 300),
    *(
        '"a\\nb": 1',
        f"{'k' * 7000}: 1",
        '"\\e[31m": 1',
        "12:30:45",
        "yes",
        "=",
        "!!int x",
        "!!float x",
        "!!omap [a]",
        "{[a]: 1}",
        "{{a: 1}: 2}",
        "1: 2",
    ),
]
BOMB = "\n".join(["a0: &a0 [x]", *(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 9))])
MERGES = "\n".join(["b0: &b0 {x: 1}", *(f"b{k}: &b{k} {{<<: [{', '.join([f'*b{k - 1}'] * 9)}]}}" for k in range(1, 9))])


@contextlib.contextmanager
def _only_lines() -> Iterator[None]:
    """Check that errors are printed as complete lines of safe characters."""
    try:
        yield
    except RigError as error:
        for line in error.lines():
            assert line.isprintable(), f"not printable: {line!r}"
            assert len(line) < 5000, f"a line of {len(line)} characters"


_RIGS = [re.sub(rb"(?m)^\s*#.*\n|\s+#.*$", b"", path.read_bytes()) for path in sorted(SHIPPED.glob("*.yaml"))]
"""The shipped rigs without comments: a short file is read sooner."""


def _rig_file(dice: Random) -> int:
    text = _nasty(dice, dice.choice(_RIGS)) if dice.random() < 0.5 else mutated(dice, _RIGS, LONGEST_FILE)
    file = BENCH.folder / "rig.yaml"
    _put(file, text)
    with _only_lines():
        load(file)
    if dice.random() < 0.2:  # reads it as the other does
        with _only_lines():
            load_hidden(file)
    return 1


def _nasty(dice: Random, good: bytes) -> bytes:
    """A rig file with something in it that YAML takes in its own way."""
    lines = good.decode().splitlines()
    place = dice.randrange(len(lines))
    key, colon, _ = lines[place].partition(":")
    thing = dice.choice([*NASTY, *NASTY, BOMB, MERGES])
    lines[place] = dice.choice(
        (f"{key}{colon} {thing}", thing, f"{lines[place]}\n{thing}", f"{key}: &a\n{lines[place]}")
    )
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def _one_run(dice: Random, *, crashed: bool) -> int:
    """A run with one file spoilt, at times lost or with its checksum made to fit; read, verified and recovered."""
    run = BENCH.folder / "run"
    shutil.rmtree(run, ignore_errors=True)
    shutil.copytree(_template(crashed), run)
    corpus = [file.read_bytes() for file in sorted(run.iterdir())]
    file = dice.choice([file for file in sorted(run.iterdir()) if file.name != ".lock"])
    old = file.read_bytes()
    if dice.random() < 0.05:
        file.unlink()
    else:
        _put(file, mutated(dice, [old], LONGEST_FILE) if dice.random() < 0.9 else mutated(dice, corpus, LONGEST_FILE))
        if dice.random() < 0.3 and file.suffix == ".parquet":
            edit_chunk(run, file.name, {"sha256": sha256(file.read_bytes())})
    with _only_lines():
        read_run(run)
    assert all("\n" not in line for line in verify(run))
    with _only_lines():
        recover(run)
        assert recover(run).nothing_to_do, "recover, done again, found something to do"
    return 1


def _template(crashed: bool) -> Path:
    path = BENCH.folder / ("crashed" if crashed else "whole")
    if not path.exists():
        made = crash(record(BENCH.folder / "runs", 3, 8)) if crashed else finished(BENCH.folder / "runs", 3, 8)
        made.rename(path)
    return path


def _table(dice: Random) -> int:
    test = dice.choice(TESTS)
    file = BENCH.folder / "table.csv"
    _put(file, mutated(dice, _TABLES[test], LONGEST_FILE))
    with _only_lines():
        direction = dice.choice((None, "cw", "acw")) if test in ("yaw", "roll") else None
        table = read_file(file, test, rig(), direction).table
        assert table.num_rows and not any(column.null_count for column in table.columns)
    return 1


def _csv(test: str, rows: int) -> bytes:
    columns = rows_of(test)  # type: ignore[arg-type]
    text = io.StringIO(newline="")
    csv.writer(text).writerows([list(columns), *list(zip(*columns.values(), strict=True))[:rows]])
    return text.getvalue().encode()


_TABLES: dict[str, Sequence[bytes]] = {test: [_csv(test, 12), _csv(test, 200)] for test in TESTS}


def _put(file: Path, data: bytes) -> None:
    BENCH.said = [file.name.encode(), data]
    file.write_bytes(data)
