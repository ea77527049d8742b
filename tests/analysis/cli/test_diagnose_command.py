import json
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from analysis.diagnosis.judge.result import Diagnosis
from analysis.runs.loading import Measured
from rigs.load import load
from tests.support.command_line import failure_of, ran, succeeded
from tests.support.handmade_diagnosis import diagnosis
from tests.support.written_files import contents

# Without limits: figures that nobody looks at would take a quarter of each diagnosis.
CELL = re.sub(r"(?ms)^limits:.*?(?=^\S|\Z)", "", load("paper-fanuc")[1]).replace("speed_mm_s: 25", "speed_mm_s: 50")
CENTRE = "centre_mm: [930.766, -87.820, 273.2]"
HIDDEN = "eccentricity_mm: [0.6, -0.4, 0.1]\neffects:\n  - {effect: backlash, axis: 1, width_deg: 0.06}\n"


@dataclass(frozen=True)
class Cell:
    """Simulated runs of a robot with a hidden backlash, and rig files that do not know it."""

    directory: Path
    rig: Path
    runs: tuple[Path, ...]
    left_out: tuple[Path, ...]
    elsewhere: tuple[Path, ...]

    @property
    def judges(self) -> list[Any]:
        held = [word for path in self.left_out for word in ("--hold-out", path)]
        return [*held, *(word for path in self.elsewhere for word in ("--unseen", path))]


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    directory = tmp_path_factory.mktemp("cell")
    rig, other, hidden = (directory / name for name in ("cell.yaml", "elsewhere.yaml", "hidden.yaml"))
    rig.write_text(CELL)
    other.write_text(CELL.replace(CENTRE, "centre_mm: [870, 30, 250]"))
    hidden.write_text(HIDDEN)

    def runs(file: Path, test: str, count: int, seed: int) -> tuple[Path, ...]:
        words = ("--test", test, "--runs", str(count), "--seed", str(seed), "--effects", hidden)
        done = succeeded("simulate", file, *words, "-o", directory / "runs")
        return tuple(map(Path, done.stdout.split()))

    return Cell(directory, rig, runs(rig, "yaw", 2, 1), runs(rig, "yaw", 1, 20), runs(other, "yaw", 1, 30))


@pytest.fixture(scope="module")
def found(cell):
    output = cell.directory / "found"
    done = succeeded("diagnose", *cell.runs, *cell.judges, "--json", "-o", output)
    return json.loads(done.stdout), done.stderr, output


def test_the_hidden_backlash_is_named_with_its_size(found):
    answer, _, _ = found
    assert answer["condition"] == "named"
    (effect,) = answer["effects"]
    assert (effect["effect"], effect["axis"]) == ("backlash", 1) and effect["posterior"] > 0.9
    assert effect["parameters"]["width_deg"]["value"] == pytest.approx(0.06, rel=0.05)
    assert answer["where"] and answer["repeats_measured"]
    part = answer["budget"][0]
    assert (part["kind"], part["name"], part["class"]) == ("effect", "backlash 1", "unusual")
    assert part["share"] > 0.95 and part["u_um"] < part["um"]


def test_the_files_are_written_and_named(cell, found):
    answer, told, output = found
    assert contents(output / "diagnosis.json") == answer
    assert (output / "diagnosis.png").read_bytes().startswith(b"\x89PNG")
    extended = output / "paper-fanuc.yaml"
    (again,) = re.findall(r"next: rig diagnose (.*) --rig (.*)  # verify", told)
    # The runs by their directory, of which each has a use, not one by one
    assert again == (" ".join(map(str, [cell.runs[0].parent, *cell.judges])), str(extended))
    assert cell.rig.read_text() == CELL
    (effect,) = load(extended)[0].effects
    assert effect.found and len(effect.found.runs) == len(cell.runs) and effect.found.gap_um


@pytest.mark.parametrize("case", ["missing", "none used", "directory", "robot", "rig file"])
def test_wrong_input_is_one_line(case, cell, tmp_path):
    run = cell.runs[0]
    other = tmp_path / "other.yaml"
    other.write_text(CELL.replace("a_mm: 695.0", "a_mm: 700.0"))
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "mine").touch()
    words, told = {
        "missing": ([tmp_path / "no-run"], "no-run"),
        "none used": ([run, "--hold-out", run], "every run"),
        "directory": ([run, "-o", tmp_path / "used"], "not empty"),
        "robot": ([*cell.runs, "--rig", other], "a different robot"),
        "rig file": ([run, "--rig", tmp_path / "no.yaml"], "no such"),
    }[case]
    done = ran("diagnose", *words)
    (line,) = done.stderr.splitlines()
    assert told in line and not done.stdout
    assert [path.name for path in (tmp_path / "used").iterdir()] == ["mine"]


def test_one_damaged_run_names_itself(cell, tmp_path, monkeypatch):
    def judged(rig: object, runs: Sequence[Measured], *_: object) -> Diagnosis:
        return diagnosis("named", runs=tuple(run.run.manifest.name for run in runs))

    monkeypatch.setattr("analysis.diagnosis.diagnose.diagnose", judged)
    copy = tmp_path / "run"
    shutil.copytree(cell.runs[0], copy)
    (copy / "manifest.json").write_text("{")
    done = ran("diagnose", copy, *cell.runs[1:], "--json")
    assert done.returncode == 3
    (error,) = (line for line in done.stderr.splitlines() if '"error"' in line)
    assert str(copy) in error and len(json.loads(done.stdout)["runs"]) == len(cell.runs) - 1  # the others are diagnosed


def test_a_copy_is_no_repeat_and_judges_nothing(cell, tmp_path):
    copy = shutil.copytree(cell.runs[0], tmp_path / "copy")
    for words in ((cell.runs[0], copy), (cell.runs[0], cell.runs[1], "--hold-out", copy)):
        assert failure_of("diagnose", *words) == (3, "run.copied")
