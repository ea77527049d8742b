"""What prints next lines and remedies: commands in directories that are made for them, and the golden cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.support.command_line import ran
from tests.support.recorded_lap import recorded
from tests.trials.golden import golden
from tests.trials.next_lines.next_lines import Followed, Place, follow, matching


@dataclass(frozen=True)
class HintCase:
    """Commands, each a line after `rig`, called one after the other in a directory that `make` has filled; it returns
    whether it could. quick: one of those that each commit follows."""

    name: str
    make: Callable[[Path], bool]
    commands: tuple[str, ...]
    place: str = "runs/*"
    quick: bool = False


def _cell(directory: Path) -> bool:
    """Radial runs, a yaw lap under the wrong label, a rig file with a hand-typed effect, a table, and a letter."""
    for words in (
        ("simulate", "ur10e-cell", "--test", "radial", "--times", "2", "-o", "runs"),
        ("example", "."),
    ):
        assert ran(*words, cwd=directory).returncode == 0
    text = (directory / "ur10e-cell.yaml").read_text()
    effects = "effects: [{effect: joint_offset, axis: 3, offset_deg: 0.05}]"
    (directory / "cell.yaml").write_text(f"{text}\n{effects}\n")
    (directory / "letter.txt").write_text("Dear all,\n")
    (directory / "one.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,-80,100,-20,80,0\n")
    recorded(directory / "laps", label="cw", part=0.35, stands_s=3.0).rename(directory / "laps" / "lap")
    return True


_WRONG_WAYS = (
    "correct ur10e -o out",
    "correct cell.yaml -o out",
    "correct cell.yaml --path one.csv -o out-2",
    "correct cell.yaml -o out",
    "correct cell.yaml --for cuca -o out-3",
    "correct nowhere.yaml -o out-4",
    "program ur10e-cell --for ur --test radial -o programs --targets",
    "program ur10e-cell --for ur --test radial -o programs",
    "program ur10e-cell --for ur --test yaw --dwell-s 3 -o other",
    "check cell.yaml",
    "check letter.txt",
    "arms ur",
    "arms gofa",
    "arms nothing-like-it",
    "history nobody",
    "history ur10e --runs nowhere",
    "runs nowhere",
    "runs .",
    "verify runs/* nowhere",
    "recover runs/*",
    "keep nowhere",
    "relabel runs/*",
    "relabel runs/* --direction cw",
    "analyse laps/lap",
    "analyse nowhere",
    "analyse laps/lap --lines",
    "report runs/* -o letter.txt",
    "export runs/* --to csv -o letter.txt",
    "export-urdf cell.yaml -o arm.urdf",
    "export-urdf cell.yaml --hash x",
    "circle fit laps/lap",
    "import one.csv --rig ur10e-cell --test radial -o imported",
    "import letter.txt --rig ur10e-cell --test pose -o imported",
    "import one.csv --rig ur10e-cell --test pose -o imported",
    "simulate nobody --test yaw -o out-5",
    "simulate ur10e-cell --test radial --direction cw -o out-6",
    "init cell.yaml",
    "doctor ur10e-cell",
    "fleet nowhere",
    "plan ur10e-cell --poses 5",
    "plan ur10e-cell --for ur",
    "session ur10e-cell --effects paper-fanuc",
    "emulate ur10e-cell --for ur",
    "nothing",
)


def cases(data: Path) -> Iterator[HintCase]:
    """Yield every case; data: the folder of measured data, of which cases are left out where it is not."""
    yield HintCase("wrong-ways", _cell, _WRONG_WAYS, quick=True)
    yield HintCase(
        "explain-it",
        lambda directory: next(case for case in golden.CASES if case.name == "yaw-lap").make(directory, data),
        (
            "calibrate runs/* --fit backlash:1,joint_offset -o fitted.yaml",
            "correct fitted.yaml -o corrections",
            "program fitted.yaml --for ur --test yaw --targets -o programs",
            "correct fitted.yaml --path programs/yaw-path.csv -o corrected --for ur",
        ),
    )
    for case in golden.CASES:
        commands = (*case.commands, *_FINDS * any(line.startswith("diagnose") for line in case.commands))
        yield HintCase(case.name, lambda directory, made=case: made.make(directory, data), commands)


_FINDS = ("diagnose runs/* -o found", "report runs/* -o page.html")


def followed(case: HintCase, work: Path) -> Followed:
    """Follow every hint that the commands of a case print, in directories below `work`."""
    directory, counted = work / "place", Followed()
    directory.mkdir(parents=True)
    if not case.make(directory):
        return counted
    for number, line in enumerate(case.commands):
        words = [given for word in line.split() for given in matching(directory, word)]
        done = ran(*words, cwd=directory, COLUMNS="2000")
        runs = "laps/lap" if "laps/lap" in line else "runs/*"
        counted += follow(f"{done.stdout}\n{done.stderr}", Place(directory, runs), work / f"{number}")
    return counted
