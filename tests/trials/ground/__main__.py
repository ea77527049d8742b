"""The proving ground: tasks for any program that corrects the errors of robot arms, and their scorer.

Tasks are plain CSV; the truth lies in a directory of its own. docs/how-to/enter-the-proving-ground.md
describes the tasks and how to enter.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from tests.support.cpu_limit import cpu_s
from tests.trials.ground.score import Scores, scored
from tests.trials.ground.table import markdown
from tests.trials.ground.tasks import TINY, WHOLE, make

ROOT = Path(__file__).parents[3]
ENTRIES = {
    "rig": [sys.executable, str(ROOT / "tests" / "trials" / "ground" / "rig_entry.py")],
    "least squares": [str(ROOT / "scripts" / "dev"), "ground_peers", "least-squares"],
    "with gravity": [str(ROOT / "scripts" / "dev"), "ground_peers", "with-gravity"],
    "Gaussian process": [str(ROOT / "scripts" / "dev"), "ground_peers", "gaussian-process"],
    "pybotics": [str(ROOT / "scripts" / "dev"), "ground_peers", "pybotics"],
}
"""The commands of the entries that come along, which take the directory of tasks and that of answers."""


def arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/dev ground", description=(__doc__ or "").split("\n", 1)[0])
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="write DIRECTORY/tasks and DIRECTORY/truth")
    scoring = commands.add_parser("score", help="print the figures of a directory of answers")
    running = commands.add_parser("run", help="make, let the entries answer, print the table")
    for one in (making, scoring, running):
        one.add_argument("directory", type=Path, metavar="DIRECTORY", help="of tasks and truth")
    for one in (making, running):
        one.add_argument("--seed", type=int, required=True, help="of what is drawn; take one that nobody has seen")
        one.add_argument("--data", type=Path, help="directory of the measured series of others (none: left out)")
        one.add_argument("--tiny", action="store_true", help="two tasks of one simulated arm, to try an entry")
    scoring.add_argument("answers", type=Path, metavar="ANSWERS", help="a file NAME.csv for each task")
    scoring.add_argument("--json", action="store_true", help="print the figures as JSON")
    running.add_argument("--entries", default=",".join(ENTRIES), help=f"some of {', '.join(ENTRIES)} (all)")
    given = parser.parse_args(words)
    if given.command == "run" and (unknown := set(given.entries.split(",")) - set(ENTRIES)):
        parser.error(f"no such entry: {', '.join(sorted(unknown))}; known are {', '.join(ENTRIES)}")
    if given.command == "make" and given.directory.exists():
        parser.error(f"{given.directory} exists; nothing is overwritten: name another directory")
    if given.command == "score":
        for place, what in ((given.directory / "truth" / "tasks.csv", "truth"), (given.answers, "answers")):
            if not place.exists():
                parser.error(f"{place} is not there: give the directory that make wrote, and one with {what}")
    return given


def main(words: Sequence[str] | None = None) -> int:
    """Run the selected command."""
    given = arguments(words)
    match given.command:
        case "make":
            made(given.directory, given)
        case "score":
            try:
                found = {given.answers.name: scored(given.directory, given.answers)}
            except csv.Error as error:
                raise SystemExit(f"error: {given.answers}: a file is no CSV table: {error}; write it again") from error
            print(as_json(found) if given.json else markdown(found))
        case "run":
            run(given)
    return 0


def made(directory: Path, given: argparse.Namespace) -> None:
    """Write the tasks and report omitted ones."""
    for line in make(directory, given.seed, TINY if given.tiny else WHOLE, given.data):
        print(f"left out: {line}", flush=True)
    print(f"wrote {directory / 'tasks'} for entrants, and {directory / 'truth'} for the scorer", flush=True)


def run(given: argparse.Namespace) -> None:
    """Make the tasks, or use those that are there, let each entry answer those it has not, and print the table."""
    directory = given.directory
    if not (directory / "truth" / "made.json").exists():
        made(directory, given)
    seed = json.loads((directory / "truth" / "made.json").read_text(encoding="utf-8"))["seed"]
    if seed != given.seed:
        raise SystemExit(f"error: {directory} was made with --seed {seed}; give that, or another directory")
    found: dict[str, Scores] = {}
    seconds = {}
    for entry in given.entries.split(","):
        answers = directory / "answers" / entry.replace(" ", "-").lower()
        if not (answers / "done").exists():
            answers.mkdir(parents=True, exist_ok=True)
            begin_s = cpu_s()
            command = [*ENTRIES[entry], str(directory / "tasks"), str(answers)]
            ended = subprocess.run(command, check=False, env=os.environ | {"PATH": path_outside()})
            if ended.returncode:
                raise SystemExit(f"error: {entry} ended with {ended.returncode}; the same command goes on")
            (answers / "done").write_text(f"{cpu_s() - begin_s:.0f}\n", encoding="utf-8")
        seconds[entry] = int((answers / "done").read_text(encoding="utf-8"))
        found[entry] = scored(directory, answers)
    (directory / "scores.json").write_text(as_json(found) + "\n", encoding="utf-8")
    took = ", ".join(f"{entry} {own} s" for entry, own in seconds.items())
    print(f"\nSeed {seed}, {datetime.now(UTC):%Y-%m-%d}; processor time: {took}.\n")
    print(markdown(found))


def path_outside() -> str:
    """Path without this environment: an entry makes its own by the python that has pip."""
    own = str(Path(sys.executable).parent)
    return os.pathsep.join(place for place in os.environ["PATH"].split(os.pathsep) if place != own)


def as_json(found: dict[str, Scores]) -> str:
    """Figures in plain types, by entry, row and figure."""
    plain = {
        entry: {row: {name: figure.to_dict() for name, figure in own.items()} for row, own in scores.items()}
        for entry, scores in found.items()
    }
    return json.dumps(plain, indent=1)


if __name__ == "__main__":
    sys.exit(main())
