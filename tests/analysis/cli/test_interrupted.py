import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from analysis import save_run, simulate
from analysis.apps.report import diagnosis_report
from analysis.apps.report.html_page import write_html
from analysis.correction.model_files import write_extended
from daq.store import read_run
from rigs.effects import play_of_joint
from rigs.load import SHIPPED
from tests.support.command_line import ran, succeeded
from tests.support.handmade_diagnosis import diagnosis

_CHANGES = {"os.mkdir", "os.rename", "os.link", "os.remove", "os.rmdir"}


class _Interrupt:
    """An audit hook, of which a process is never rid: it counts what changes files below a directory."""

    def __init__(self) -> None:
        self.below, self.at, self.count = "", 0, 0

    def __call__(self, event: str, arguments: tuple[object, ...]) -> None:
        if not self.below or (event not in _CHANGES and event != "open"):
            return
        if event == "open":
            flags = arguments[2]
            if not (isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)):
                return
        if str(arguments[0]).startswith(self.below):
            self.count += 1
            if self.count == self.at:
                raise KeyboardInterrupt


_HOOK = _Interrupt()
sys.addaudithook(_HOOK)


@contextmanager
def interrupted_at(number: int, below: Path) -> Iterator[_Interrupt]:
    """Ctrl-C at the change of this number, from 1, of a file below a directory; 0 for none."""
    _HOOK.below, _HOOK.at, _HOOK.count = str(below), number, 0
    try:
        yield _HOOK
    finally:
        _HOOK.below = ""


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    directory = tmp_path_factory.mktemp("given")
    for direction in ("acw", "cw"):
        save_run(simulate("ur10e-cell", "yaw", direction, seed=1, effects="ur10e-cell"), directory / direction)
    succeeded(f"export {directory}/acw --to csv -o {directory}/lap.csv")
    return directory


Write = Callable[[Path, Path], object]
RIG = SHIPPED / "ur10e-cell.yaml"
_IMPORT = ("--rig", RIG, "--test", "yaw")
_EFFECTS = [play_of_joint(1, 0.02)]
_DIAGNOSED = diagnosis(curves=(), maps=())  # a picture of everything takes a second
CASES = {
    "import": lambda given, out: ran("import", given / "lap.csv", *_IMPORT, "-o", out / "run"),
    "simulate": lambda _, out: ran(f"simulate {RIG} --test radial --runs 2 -o {out}"),
    "simulate --csv": lambda _, out: ran(f"simulate {RIG} --test radial --csv -o {out}"),
    "export": lambda given, out: ran(f"export {given}/acw {given}/cw --to parquet -o {out}"),
    "export mcap": lambda given, out: ran(f"export {given}/acw --to mcap -o {out}/lap.mcap"),
    "program": lambda _, out: ran(f"program {RIG} --for ur --test yaw --targets -o {out}/programs"),
    "analyse --plot": lambda given, out: ran(f"analyse {given}/acw --plot {out}/pictures"),
    "diagnose -o": lambda _, out: diagnosis_report.write(_DIAGNOSED, RIG.read_text(), out / "found"),
    "calibrate -o": lambda _, out: write_extended(RIG.read_text(), _EFFECTS, out / "cell.yaml"),
    "report": lambda _, out: write_html("<p>a page</p>", out / "page.html"),
    "example": lambda _, out: ran(f"example {out}/example"),
}


def _files(directory: Path) -> dict[str, int]:
    """Sizes of the files below a directory by their paths in it; a lock is left by whoever looks."""
    found = (path for path in directory.rglob("*") if path.is_file() and path.name != ".lock")
    return {str(path.relative_to(directory)): path.stat().st_size for path in found}


@pytest.mark.parametrize("name", CASES)
def test_interrupted_output_is_complete_or_absent(name, given, tmp_path):
    write = CASES[name]
    with interrupted_at(0, tmp_path) as hook:
        write(given, tmp_path / "whole")
    changes, whole = hook.count, _files(tmp_path / "whole")
    assert whole and changes > 1
    for number in range(1, changes + 1):
        out = tmp_path / f"out-{number}"
        with interrupted_at(number, tmp_path), suppress(KeyboardInterrupt):
            write(given, out)
        left = _files(out)
        assert not list(out.rglob("*.tmp")), f"{name}: change {number}"
        for unit in {path.partition("/")[0] for path in whole}:
            here, there = ({path for path in one if path.partition("/")[0] == unit} for one in (left, whole))
            assert here in (set(), there), f"{name}: change {number} leaves a half {unit}"
        for run in {(out / path).parent for path in left if path.endswith("manifest.json")}:
            assert read_run(run).manifest.exit_status == "complete"
        assert all(left[path] > 0 for path in left)


def test_existing_directory_gets_all_new_files_or_none(tmp_path):
    def write(out: Path) -> None:
        diagnosis_report.write(_DIAGNOSED, RIG.read_text(), out)

    whole = tmp_path / "whole"
    whole.mkdir()
    with interrupted_at(0, tmp_path) as hook:
        write(whole)
    for number in range(1, hook.count + 1):
        out = tmp_path / f"out-{number}"
        out.mkdir()
        (out / "mine.txt").write_text("mine")
        with interrupted_at(number, tmp_path), pytest.raises(KeyboardInterrupt):
            write(out)
        left = {path.name for path in out.iterdir()}
        assert left in ({"mine.txt"}, {"mine.txt", *_files(whole)}), number
