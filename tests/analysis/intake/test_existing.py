from pathlib import Path

import pytest

from tests.support.command_line import ran

KEPT = [
    "simulate ur10e-cell --test radial -o {}/runs",
    "example {}",
    "arms ur10e -o {}/arm.yaml",
    "export {run} --to csv -o {}/table.csv",
    "export-urdf ur10e-cell -o {}/arm.urdf",
    "program ur10e-cell --for ur --test radial -o {}",
    "correct {corrected} -o {}",
    "import {table} --rig ur10e-cell --test radial -o {}/run",
]
SHOWN = ["report {run} -o {}/page.html", "analyse {run} --plot {}", "history ur10e --runs {runs} -o {}/page.html"]


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    work = tmp_path_factory.mktemp("work")
    assert ran(f"simulate ur10e-cell --test radial -o {work}/runs").returncode == 0
    (run,) = (work / "runs").iterdir()
    table, corrected = work / "table.csv", work / "cell.yaml"
    assert ran(f"export {run} --to csv -o {table}").returncode == 0
    assert ran("example", work / "shipped").returncode == 0
    text = (work / "shipped" / "ur10e-cell.yaml").read_text()
    corrected.write_text(f"{text}\neffects: [{{effect: joint_offset, axis: 3, offset_deg: 0.05}}]\n")
    return {"run": run, "runs": work / "runs", "table": table, "corrected": corrected}


def _twice(command: str, names: dict[str, Path], place: Path) -> tuple[dict[Path, bytes], tuple[str | Path, ...]]:
    words = tuple(word.format(place, **names) for word in command.split())
    done = ran(*words)
    assert done.returncode == 0 and "replacing" not in done.stderr, done.stderr
    return {file: file.read_bytes() for file in place.rglob("*") if file.is_file()}, words


@pytest.mark.parametrize("command", KEPT)
def test_measurements_are_never_replaced(tmp_path, names, command):
    made, words = _twice(command, names, tmp_path / "out")
    again = ran(*words)
    assert again.returncode == 3 and "exists" in again.stderr
    assert made and all(file.read_bytes() == data for file, data in made.items())


@pytest.mark.parametrize("command", SHOWN)
def test_own_pages_are_replaced_and_nothing_else(tmp_path, names, command):
    made, words = _twice(command, names, tmp_path / "out")
    done = ran(*words)
    assert done.returncode == 0
    for file in made:
        assert f"wrote {file}, replacing " in done.stderr
        assert file.stat().st_size
        for other in (b"Dear all,", b"<!doctype html><p>mine", b"\x89PNG\r\n\x1a\nmine"):
            file.write_bytes(other)
            again = ran(*words)
            assert again.returncode == 3 and f"{file}: already exists" in again.stderr
            assert file.read_bytes() == other
        file.write_bytes(b"")  # of a disk that was full
        assert ran(*words).returncode == 0 and file.stat().st_size
