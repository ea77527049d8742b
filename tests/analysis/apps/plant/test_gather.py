import hashlib
import os
import shutil
from pathlib import Path

import pytest

from analysis.apps.plant.collect import REASONS, Collected, Progress, Workers
from analysis.apps.plant.fleet import Fleet, gather, state_of
from analysis.apps.plant.history import history_of
from analysis.apps.plant.records import RunRecord
from analysis.procedures.shared.quantity import Quantity
from daq.store import mark_kept
from rigs.schema.limits import Limits
from tests.support.plant_runs import known_robot, write_visits

VISITS = 12


def write(plant: Path, number: int, grown_deg: float, days: range = range(VISITS)) -> list[Path]:
    one = known_robot(number, VISITS, grown_deg)
    return list(write_visits(plant / one.name / "runs", one, list(days)))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Three robots: healthy, with a play that grew beyond the limit, with one that grew a little."""
    plant = tmp_path_factory.mktemp("written") / "plant"
    for number, grown_deg in enumerate((0.0, 0.03, 0.004), start=1):
        write(plant, number, grown_deg)
    return plant


@pytest.fixture
def plant(written, tmp_path):
    return shutil.copytree(written, tmp_path / "plant")


@pytest.fixture
def file(tmp_path):
    return tmp_path / "catalogue.sqlite"


def silent(doing: str, done: int, total: int) -> None:
    pass


def gathered(plant: Path, file: Path, jobs: int = 1, progress: Progress = silent) -> Fleet:
    return gather(plant, file, Workers(jobs), progress)


def runs_of(plant: Path, number: int) -> list[Path]:
    return sorted((plant / f"robot-{number:03d}" / "runs").iterdir())


def content(plant: Path) -> str:
    found = hashlib.sha256()
    for path in sorted(plant.rglob("*")):
        status = path.stat()
        found.update(f"{path} {status.st_mtime_ns}".encode() + (path.read_bytes() if path.is_file() else b""))
    return found.hexdigest()


def test_urgent_robots_come_first(plant, file):
    before = content(plant)
    found = gathered(plant, file)
    assert [(one.robot, one.attention) for one in found.robots] == [
        ("robot-002", "beyond"),
        ("robot-003", "changed"),
        ("robot-001", "within"),
    ]
    worst, changed, healthy = found.robots
    assert worst.folder == str(Path("robot-002/runs")) and worst.runs == VISITS
    assert "beyond 0.26 since 2025-12-0" in worst.worst and worst.worst_ratio > 1
    assert " and 7 Dec 2025" in worst.trend and worst.changed == changed.changed == "2025-12-07"
    assert healthy.trend == "" and healthy.last == "2025-12-12T06:00:00+00:00" and healthy.tests == ("repeatability",)
    assert content(plant) == before


def test_only_changed_runs_are_read_again(written, plant, file):
    first = gathered(plant, file)
    assert (first.runs, first.examined) == (3 * VISITS, 3 * VISITS)
    again = gathered(plant, file)
    assert (again.examined, again.robots) == (0, first.robots)
    mark_kept(runs_of(plant, 1)[0], True)
    chunk = next(runs_of(plant, 2)[0].glob("*.parquet"))
    status = chunk.stat()
    chunk.write_bytes(bytes(status.st_size))
    os.utime(chunk, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert gathered(plant, file).examined == 0  # sizes and times alone are looked at
    os.utime(chunk)
    assert gathered(plant, file).robots != first.robots
    shutil.copy2(next(written.glob(f"robot-002/runs/{chunk.parent.name}/*.parquet")), chunk)
    write(plant, 1, 0.0, range(VISITS, VISITS + 1))
    shutil.rmtree(runs_of(plant, 3)[0])
    third = gathered(plant, file)
    assert (third.runs, third.examined, third.gone) == (3 * VISITS, 2, 1)
    assert {one.robot: one.runs for one in third.robots} == {"robot-001": 13, "robot-002": 12, "robot-003": 11}
    file.unlink()
    assert gathered(plant, file).robots == third.robots


def test_a_bad_run_costs_its_own_row(plant, file):
    cut, unreadable, unsealed = runs_of(plant, 1)[:3]
    chunk = next(cut.glob("*.parquet"))
    chunk.write_bytes(chunk.read_bytes()[:-100])
    (unreadable / "manifest.json").write_text("{")
    ledger = unsealed / "ledger.jsonl"
    ledger.write_bytes(b"".join(ledger.read_bytes().splitlines(keepends=True)[:-1]))
    found = gathered(plant, file)
    healthy = next(one for one in found.robots if one.robot == "robot-001")
    assert healthy.runs == VISITS - 3
    assert [name for name, _ in healthy.without_figures] == [cut.name, unsealed.name]
    assert healthy.without_figures[1][1] == REASONS["crashed"]
    assert found.strays == ((str(unreadable.relative_to(plant)), REASONS["damaged"]),)
    assert gathered(plant, file).robots == found.robots
    (unreadable / "manifest.json").unlink()
    assert gathered(plant, file).strays == found.strays
    shutil.copytree(runs_of(plant, 1)[5], unsealed, dirs_exist_ok=True)
    mended = next(one for one in gathered(plant, file).robots if one.robot == "robot-001")
    assert [name for name, _ in mended.without_figures] == [cut.name] and mended.copies == 1


def test_a_robot_without_figures_is_listed(plant, file):
    for run in runs_of(plant, 1):
        next(run.glob("*.parquet")).unlink()
    found = next(one for one in gathered(plant, file).robots if one.robot == "robot-001")
    assert (found.attention, found.runs, found.last) == ("unreadable", 0, "")
    assert found.doubts == [f"{VISITS} without figures"]


def test_a_name_in_two_directories_is_two_robots(plant, file):
    shutil.move(plant / "robot-002" / "runs", plant / "other")
    for run in runs_of(plant, 1)[:3]:
        shutil.move(run, plant / "other" / run.name)
    found = {(one.folder, one.robot): one.runs for one in gathered(plant, file).robots}
    assert found[("other", "robot-001")] == 3 and found[(str(Path("robot-001/runs")), "robot-001")] == 9
    assert found[("other", "robot-002")] == VISITS


def test_runs_read_before_an_interruption_are_kept(plant, file):
    def ended(doing: str, done: int, total: int) -> None:
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        gathered(plant, file, progress=ended)
    assert gathered(plant, file).examined == 3 * VISITS - 5


def test_a_corrected_program_mends_no_arm():
    def run(day: int, band_deg: float, corrected: str = "") -> RunRecord:
        figures = {"band_deg": Quantity(band_deg + 1e-4 * (day % 3), 1e-4, "deg", 720, "measured")}
        when = f"2025-12-{day:02d}T06:00:00+00:00"
        name = f"{day:02d}{corrected}"
        return RunRecord(name, name, "cell", when, "yaw", "acw", "", "", "", figures, name, False, corrected)

    as_it_is = [run(day, 0.08) for day in range(1, 11)]
    limits = Limits.model_validate({"yaw": {"band_deg": {"fail": 0.05}}})
    for corrected in ("targets", "entries"):
        after = [run(day, 0.01, corrected) for day in range(11, 21)]
        found = state_of("runs", Collected("cell", (*as_it_is, *after), (), (), limits))
        assert (found.standing, found.trend, found.corrected) == ("fail", "", 10)
        assert "10 driven" in " ".join(found.doubts)
        titles = [series.title for series in history_of(Collected("cell", (*as_it_is, *after), (), (), limits)).series]
        assert len(titles) == 2 and titles[0] == "yaw acw" and titles[1] != titles[0]
    mended = [run(day, 0.01) for day in range(11, 21)]
    assert state_of("runs", Collected("cell", (*as_it_is, *mended), (), (), limits)).standing == "pass"
