"""Every hint works: the commands that rig's own output names, next lines and remedies, followed to an end.

A *hint* is a command in what a command printed. It is called as it stands, in a copy of the directory in which it was
printed; where it ends with an error, the hints of that error are followed in turn. An end is a command that succeeds. A
command that needs a cell, a terminal, a file of the user or a person at the robot is checked only for valid options.
"""

from __future__ import annotations

import itertools
import re
import shlex
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import typer
from typer.exceptions import TyperException

from daq.service.rigd import app as rigd_app
from rigs.arms import arm_names
from rigs.load import shipped
from tests.support.command_line import all_imported, ran

_DEEPEST = 3
"""Errors one after the other: who has followed three remedies in vain gives up."""
_NEED_A_CELL = ("rigd", "record", "live", "doctor", "init", "status", "logs", "metrics", "emulate", "replay", "window",
                "session", "automatic", "paper")  # fmt: skip
_STANDS_FOR = {"RUN": "{runs}", "RUN…": "{runs}", "RUNS": "{runs}", "RIG": "{rig}", "CELL": "{rig}", "FILE": "{rig}",
               "DIR": "new", "FILE.html": "new.html"}  # fmt: skip
"""Values of the words in capitals in hints."""
_FILES_OF_THE_USER = ("TRACKER.csv", "--program FILE")
"""Files that rig cannot know: those of an instrument, and programs of the robot. Such a hint is not called."""
_USE = 2
_TOKENS = re.compile(r"""(?:'[^']*'|[^\s'])+[^\s']*|'""")
_ENDS_A_COMMAND = ",;:.)]…'`’"


@dataclass(frozen=True)
class Hint:
    """A command that a line of output names, as the words of a command line."""

    words: tuple[str, ...]
    line: str

    def __str__(self) -> str:
        return " ".join(self.words)


@dataclass
class Followed:
    """Hints by result. dead: hints with the line that named them and the resulting error."""

    lines: int = 0
    ends: int = 0
    need_a_cell: int = 0
    dead: list[tuple[Hint, str]] = field(default_factory=list)

    def __iadd__(self, other: Followed) -> Followed:
        self.lines += other.lines
        self.ends += other.ends
        self.need_a_cell += other.need_a_cell
        self.dead += other.dead
        return self

    def __str__(self) -> str:
        return f"{self.lines} lines: {self.ends} ends, {self.need_a_cell} at a cell, {len(self.dead)} dead"


_RIG = all_imported()
_RIGD = typer.main.get_command(rigd_app)


def hints_of(text: str, place: Path) -> list[Hint]:
    """Commands that a text names, each once; files that it names lie in `place`."""
    found: dict[tuple[str, ...], Hint] = {}
    for line in text.splitlines():
        tokens = _TOKENS.findall(line)
        for at, token in enumerate(tokens):
            if token.lstrip("(`'") in ("rig", "rigd") and tokens[at - 1 : at] != ["error:"]:
                words = tuple(_command_at(tokens[at:], place))
                if len(words) > 1:
                    found.setdefault(words, Hint(words, line.strip()))
    return list(found.values())


def _command_at(tokens: Sequence[str], place: Path) -> Iterator[str]:
    """Words of the command with which tokens begin, up to the sentence that goes on after it."""
    program = tokens[0].lstrip("(`'")
    yield program
    command: Any = _RIG if program == "rig" else _RIGD
    takes_value = False
    for token in tokens[1:]:
        after = _ENDS_A_COMMAND.replace("'", "") if token.startswith("'") else _ENDS_A_COMMAND
        bare = token.rstrip(after) if token not in _STANDS_FOR else token
        within: dict[str, Any] = getattr(command, "commands", {})
        if within and bare in within:
            command = within[bare]
        elif within and tokens[2:3] and tokens[2].startswith("--"):
            yield bare  # a command that there is not, and no word of a sentence
            return
        elif within or not (takes_value or _is_argument(bare, place)):
            return
        yield bare
        options = {name: one for one in command.params for name in (*one.opts, *one.secondary_opts)}
        is_option = bare.startswith("-")
        takes_value = is_option and bare in options and not options[bare].is_flag
        if bare != token:
            return


def _is_argument(token: str, place: Path) -> bool:
    names = (*arm_names(), *shipped())
    return bool(token) and (
        token.startswith(("-", "'"))
        or token in names
        or token in _STANDS_FOR
        or any(char in token for char in "/*")
        or (place / token.strip("'\"")).exists()
        or token.endswith((".yaml", ".csv", ".json", ".html"))
    )


@dataclass(frozen=True)
class Place:
    """Directory in which hints are executed, with the values of RUN and RIG."""

    directory: Path
    runs: str = "runs"
    rig: str = "ur10e-cell"


def follow(text: str, place: Place, scratch: Path) -> Followed:
    """Follow every hint of a text, each in a copy of its place below `scratch`."""
    counted = Followed()
    numbers = itertools.count(1)
    seen: set[tuple[str, ...]] = set()
    for hint in hints_of(text, place.directory):
        counted.lines += 1
        if (why := _wrong_use(hint)) is not None:
            counted.dead.append((hint, why))
        elif _needs_a_cell(hint):
            counted.need_a_cell += 1
        elif why := _followed(hint, place, scratch, numbers, seen):
            counted.dead.append((hint, why))
        else:
            counted.ends += 1
    return counted


def _needs_a_cell(hint: Hint) -> bool:
    names_file = any(file in str(hint) for file in _FILES_OF_THE_USER)
    return names_file or hint.words[0] == "rigd" or hint.words[1] in _NEED_A_CELL


def _followed(
    hint: Hint, place: Place, scratch: Path, numbers: itertools.count[int], seen: set[tuple[str, ...]], depth: int = 0
) -> str:
    """Error in which a hint ends, empty where it, or a remedy of its error, comes to an end."""
    if hint.words in seen:
        return f"names itself again: {hint}" if depth else ""
    seen.add(hint.words)
    copy = scratch / f"{next(numbers)}"
    shutil.copytree(place.directory, copy, symlinks=True)
    words = _filled(hint.words[1:], place, copy)
    done = ran(*words, cwd=copy, COLUMNS="2000")
    is_named_alone = len(words) == 1 and done.returncode == _USE and "Missing argument" in done.stderr
    if done.returncode == 0 or (is_named_alone and ran(*words, "--help", cwd=copy).returncode == 0):
        return ""
    said = done.stderr.strip() or done.stdout.strip()
    if depth < _DEEPEST:
        for other in hints_of(said, copy):
            if _wrong_use(other) is None and not _followed(other, place, scratch, numbers, seen, depth + 1):
                return ""
    return said or f"exit code {done.returncode}"


def _filled(words: Sequence[str], place: Place, copy: Path) -> list[str]:
    """Arguments after expansion of placeholders and file patterns."""
    filled: list[str] = []
    for word in shlex.split(" ".join(words)):
        meant = _STANDS_FOR.get(word, word).format(runs=place.runs, rig=place.rig)
        filled += matching(copy, meant)
    return filled


def matching(directory: Path, word: str) -> list[str]:
    """Files of a directory that match a pattern, as a shell gives them; any other word as it is."""
    there = directory.glob(word) if "*" in word and not word.startswith("/") else ()
    return sorted(str(file.relative_to(directory)) for file in there) or [word]


def _wrong_use(hint: Hint) -> str | None:
    """Reason why a command rejects these arguments; None if it accepts them."""
    program, *words = shlex.split(" ".join(hint.words))
    command: Any = _RIG if program == "rig" else _RIGD
    context: Any = None
    try:
        while (within := getattr(command, "commands", None)) is not None:
            if not words or words[0] not in within:
                return f"{program} has no command {' '.join(words[:1])}"
            command, words = within[words[0]], words[1:]
        if not words or words == ["--help"]:  # it is only named: its help says what it takes
            return None
        context = command.make_context(command.name, list(words), resilient_parsing=False)
    except TyperException as error:
        return str(error.format_message())
    finally:
        if context is not None:
            context.close()
    return None


def table(found: dict[str, Followed]) -> str:
    """The counts by case, and each dead end with the line that names it."""
    total, lines = Followed(), []
    for name, one in found.items():
        lines.append(f"{name}: {one}")
        total += one
    lines.append(f"all: {total}")
    words = Counter((str(hint), hint.line, why) for hint, why in total.dead)
    return "\n".join([*lines, *(f"dead: {hint}\n  named by: {line}\n  {why}" for hint, line, why in words)])
