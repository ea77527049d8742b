"""Run the marked examples of the documents, and compare the output on the pages with the printed one, or renew it.

A page marks a block of commands with the line `<!-- runs -->` above it. The next `text` block has parts of their
output; a line `…` stands for omitted lines. All marked blocks of a page run in one directory, in order.
`<!-- runs after tutorial.md -->` continues in a copy of the directory in which the examples of that page have run.
"""

from __future__ import annotations

import argparse
import difflib
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
OMITTED = "…"
LIKE = 0.03
"""Allowed relative difference of figures: other processors and libraries round differently."""
LAST_DIGITS = 2
"""Allowed difference in units of the last printed digit."""
LEAST_LIKENESS = 0.6
"""Mean likeness of lines above which they replace those of a page; below it, the lines are no longer printed."""
VERDICT = 1
"""Exit code of a command that ran and has a negative answer, for example a rejected feature."""
_NUMBER = r"\d+(?:\.\d+)?"
_BLOCK = re.compile(
    r"(?:^<!-- runs(?: after (?P<after>\S+))? -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$", re.S | re.M
)


@dataclass(frozen=True)
class Example:
    """Commands of a page, and the place of the text block with their output, if there is one."""

    after: str | None
    commands: str
    output: tuple[int, int] | None


def examples_of(page: str) -> list[Example]:
    """Find the marked blocks in the text of a page, each with the text block that follows before other commands."""
    found: list[Example] = []
    is_waiting = False
    for block in _BLOCK.finditer(page):
        if block["language"] == "sh":
            is_waiting = block[0].startswith("<!--")
            if is_waiting:
                found.append(Example(block["after"], block["text"], None))
        elif block["language"] == "text" and is_waiting:
            found[-1] = Example(found[-1].after, found[-1].commands, block.span("text"))
            is_waiting = False
    return found


def marked_pages(docs: Path = DOCS) -> dict[str, list[str]]:
    """List the pages with examples by the page in whose directory they start, that page first."""
    groups: dict[str, list[str]] = {}
    for path in sorted(docs.glob("*.md")):
        if found := examples_of(path.read_text(encoding="utf-8")):
            groups.setdefault(found[0].after or path.name, []).append(path.name)
    return {first: sorted(pages, key=lambda name: (name != first, name)) for first, pages in groups.items()}


def run_pages(pages: Sequence[str], docs: Path = DOCS) -> Iterator[tuple[str, list[str]]]:
    """Run the examples of pages that start in the same directory. Yield each page with the outputs of its examples."""
    with tempfile.TemporaryDirectory() as scratch:
        first = Path(scratch, "first")
        first.mkdir()
        for number, name in enumerate(pages):
            folder = first if number == 0 else Path(shutil.copytree(first, Path(scratch, name)))
            yield name, [printed_by(one.commands, folder) for one in examples_of((docs / name).read_text("utf-8"))]


def printed_by(commands: str, folder: Path) -> str:
    """Run commands in a shell as on a terminal of 100 columns. Raises RuntimeError if one fails."""
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "COLUMNS": "100"}
    done = subprocess.run(
        ["bash", "-ec", commands], cwd=folder, env=environment, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    if done.returncode not in (0, VERDICT) or "Traceback (most recent call last)" in done.stdout:
        raise RuntimeError(f"{commands}\nexit code {done.returncode}\n{done.stdout}")
    return done.stdout


def parts_of(text: str) -> list[str]:
    """Split a text block at its omitted lines."""
    return [part.strip("\n") for part in re.split(rf"^{OMITTED}$", text, flags=re.M) if part.strip()]


def is_printed(part: str, printed: str) -> bool:
    """True if the output has the words of a part, with figures that agree within the rounding of other computers."""
    pattern = f"({_NUMBER})".join(map(re.escape, re.split(_NUMBER, _words(part))))
    stated = re.findall(_NUMBER, part)
    return any(all(map(_agree, stated, found.groups())) for found in re.finditer(pattern, _words(printed)))


def drifted(page: str, outputs: Sequence[str]) -> list[str]:
    """Parts of the output shown on a page that its commands do not print: empty if the page is up to date.

    outputs: printed text of each example, as from `run_pages`.
    """
    return [
        part
        for one, printed in zip(examples_of(page), outputs, strict=True)
        if one.output
        for part in parts_of(page[slice(*one.output)])
        if not is_printed(part, printed)
    ]


def renewed(page: str, outputs: Sequence[str]) -> str:
    """Replace the output on a page by the printed one. Raises ValueError if a part is no longer printed at all."""
    for one, printed in reversed([*zip(examples_of(page), outputs, strict=True)]):
        if one.output:
            start, end = one.output
            page = page[:start] + _renewed_block(page[start:end], printed) + page[end:]
    return page


def _renewed_block(text: str, printed: str) -> str:
    lines = [line.rstrip() for line in printed.splitlines() if line.strip()]
    for part in parts_of(text):
        if is_printed(part, printed):
            continue
        old = [line for line in part.splitlines() if line.strip()]
        windows = [lines[at : at + len(old)] for at in range(len(lines) - len(old) + 1)]
        best = max(windows, key=lambda new: _likeness(old, new), default=[])
        if not best or _likeness(old, best) < LEAST_LIKENESS:
            raise ValueError(f"is no longer printed; edit the page:\n{part}")
        text = text.replace(part, "\n".join(best), 1)
    return text


def _likeness(old: Sequence[str], new: Sequence[str]) -> float:
    """Mean likeness of lines, from 0 to 1, regardless of their figures."""
    pairs = zip(old, new, strict=True)
    return sum(difflib.SequenceMatcher(None, _masked(a), _masked(b)).ratio() for a, b in pairs) / len(old)


def _masked(line: str) -> str:
    return re.sub(r"\d", "0", " ".join(line.split()))


def _words(text: str) -> str:
    return " ".join(text.split())


def _agree(stated: str, printed: str) -> bool:
    unit = 10.0 ** -len(stated.partition(".")[2])
    return math.isclose(float(stated), float(printed), rel_tol=LIKE, abs_tol=LAST_DIGITS * unit * (1 + 1e-9))


def main() -> None:
    """Compare or renew the pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", metavar="PAGE", help="such as moved.md; default: every page with examples")
    parser.add_argument("--write", action="store_true", help="write the printed output into the pages")
    given = parser.parse_args()
    problems = []
    for group in marked_pages().values():
        if given.pages and not set(group) & set(given.pages):
            continue
        for name, outputs in run_pages(group):
            page = (DOCS / name).read_text(encoding="utf-8")
            parts = drifted(page, outputs)
            print(f"docs/{name}: {len(outputs)} examples, {len(parts)} parts of their output differ", flush=True)
            if parts and given.write:
                (DOCS / name).write_text(renewed(page, outputs), encoding="utf-8")
            elif parts:
                problems += [f"docs/{name}: is not printed any more:\n{part}" for part in parts]
    sys.exit("\n".join(problems) or 0)


if __name__ == "__main__":
    main()
