"""The frame of every trial: options, cases in turn or in processes, a line for each, the table and the exit code."""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import sys
import time
from argparse import ArgumentParser, Namespace
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

CASES_OF_A_PROCESS = 40
Options = Mapping[str, tuple[Any, ...]]
"""Default, help and choices of each option by its name; a name in capitals is an argument without a name."""


@dataclass(frozen=True)
class Trial:
    """A question that is asked of many cases.

    `draw` makes the cases from the options, and `judge` the result of a case, in a process of its own with `--jobs`.
    `line` is printed for each result and `report` for all. `failed` decides about the exit code 1.
    """

    draw: Callable[[Namespace], Iterable[Any]]
    judge: Callable[[Any], Any]
    report: Callable[[Sequence[Any]], str] = lambda results: ""
    line: Callable[[Any], str] = lambda result: " | ".join(result) if isinstance(result, list) else str(result)
    failed: Callable[[Sequence[Any]], bool] = lambda results: False
    count: int = 0
    """Default number of cases of each kind; 0 if the cases are fixed."""
    seed: int = 0
    options: Options = field(default_factory=dict)
    keeps: bool = False
    """Results are plain objects, which `--json FILE` appends to a file and reads again."""


def seeds(given: Namespace) -> range:
    """Seeds of the drawn cases."""
    return range(given.seed, given.seed + given.count)


def parser_of(trial: Trial, name: str) -> ArgumentParser:
    """Parser of the common options and those of the trial."""
    about = sys.modules[trial.draw.__module__].__doc__
    form = argparse.RawDescriptionHelpFormatter
    parser = ArgumentParser(prog=f"scripts/dev {name}", description=about, formatter_class=form)
    for option, (default, about, *choices) in trial.options.items():
        _add(parser, option, default, about, choices[0] if choices else None)
    if trial.count:
        parser.add_argument("count", type=int, nargs="?", help=f"cases of each kind ({trial.count})")
        parser.add_argument("--cases", "--count", type=int, dest="cases", help="the same")
        parser.add_argument("--seed", "--first", type=int, default=trial.seed, help=f"first seed ({trial.seed})")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no further case after this time")
    if trial.keeps:
        parser.add_argument("--json", type=Path, help="append each result to this file; results in it are used again")
    return parser


def _add(parser: ArgumentParser, option: str, default: Any, about: str, choices: Any) -> None:
    """Add an option. default: its default value, or its type if it has no default."""
    kind = default if isinstance(default, type) else type(default)
    given: dict[str, Any] = {"help": about, "default": None if isinstance(default, type) else default}
    if kind is bool:
        given["action"] = "store_true"
    else:
        if kind in (tuple, list):
            given |= {"nargs": "*", "type": type(default[0]) if default else str}
        else:
            given["type"] = kind
        given["choices"] = choices
    if option.isupper():
        given.setdefault("nargs", "?" if given["default"] is not None else None)
        parser.add_argument(option.lower(), **given)
    else:
        parser.add_argument(f"--{option.replace('_', '-')}", **given)


def results_of(trial: Trial, given: Namespace) -> Iterator[Any]:
    """Judge the cases in their order, and stop after the given minutes."""
    file = given.json if trial.keeps else None
    known = {}
    if file and file.exists():
        known = {one.pop("case"): one for one in map(json.loads, file.read_text(encoding="utf-8").splitlines())}
    end = time.monotonic() + 60 * given.minutes
    for case, result in _judged(trial, given, known, end):
        if file and str(case) not in known:
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps({"case": str(case)} | result) + "\n")
        yield result


def _judged(trial: Trial, given: Namespace, known: Mapping[str, Any], end: float) -> Iterator[tuple[Any, Any]]:
    cases = iter(trial.draw(given))
    if given.jobs == 1:
        for case in itertools.takewhile(lambda _: time.monotonic() < end, cases):
            yield case, known[str(case)] if str(case) in known else trial.judge(case)
        return
    begun: deque[tuple[Any, Any]] = deque()
    with _pool(given.jobs) as pool:
        while True:
            while len(begun) < 2 * given.jobs and time.monotonic() < end and (case := next(cases, None)) is not None:
                begun.append((case, known.get(str(case)) or pool.submit(trial.judge, case)))
            if not begun:
                return
            case, result = begun.popleft()
            try:
                yield case, result.result() if isinstance(result, Future) else result
            except BrokenProcessPool:
                raise SystemExit(f"error: a process died in one of {case} and the next {len(begun)}") from None


def _pool(jobs: int) -> ProcessPoolExecutor:
    """Processes that make way for new ones, so that what libraries hold does not add up."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(jobs, mp_context=context, max_tasks_per_child=CASES_OF_A_PROCESS)


def main(trial: Trial, words: Sequence[str] | None = None) -> int:
    """Run a trial with the words of a command line; the exit code is 1 if it failed."""
    program = Path(sys.argv[0])
    name = program.parent.name if program.stem == "__main__" else program.stem
    given = parser_of(trial, name).parse_args(words)
    if trial.count:
        given.count = next(count for count in (given.count, given.cases, trial.count) if count is not None)
    results = []
    try:
        for result in results_of(trial, given):
            results.append(result)
            if line := trial.line(result):
                print(line, flush=True)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        if not results:
            return 1
    if table := trial.report(results):
        print(table)
    return int(trial.failed(results))


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)
