"""What a person can do wrong to a session: each is a line with an exit code, and the state stays as it was."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from analysis.apps.makers.programs.motion_plan import demand_of
from analysis.apps.makers.writing import programs_of
from analysis.apps.session.session_plan import BY_HAND, FIXED, minutes_of, planned, programs_of_steps
from analysis.apps.session.session_state import Aim, Emulated, SessionDirectory, Try
from daq.store import durable
from rigs.errors import CellError
from rigs.load import load
from rigs.schema.vocabulary import MAKERS
from tests.support.command_line import ran
from tests.support.session_cell import begun, cell_file


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    return cell_file(tmp_path)


def one_line(text: str) -> str:
    """The error, which is one line."""
    lines = text.splitlines()
    assert len(lines) == 1 and lines[0].startswith("error: "), text
    return lines[0]


def test_status_shows_every_step_and_json_the_whole_state(cell: Path, tmp_path: Path) -> None:
    session = begun(cell, tmp_path / "own")
    shown = ran("session", cell, "-o", tmp_path / "own", "--status")
    assert shown.returncode == 0 and shown.stdout.count("to be driven") == len(session.steps)
    assert f"next: start program p01-yaw-acw; continue with: rig session {cell}" in shown.stdout
    assert f" -o {tmp_path / 'own'} --for {session.maker}" in shown.stdout
    fast = session.model_copy(update={"emulated": Emulated(fast=True)})
    assert SessionDirectory(tmp_path).command(cell, fast).endswith(f" --for {session.maker} --emulated --fast")
    plain = json.loads(ran("session", cell, "-o", tmp_path / "own", "--status", "--json").stdout)
    assert plain["steps"][0]["program"] == "p01-yaw-acw" and plain["rig"] == session.rig


def test_no_session_yet(cell: Path, tmp_path: Path) -> None:
    done = ran("session", cell, "-o", tmp_path / "none", "--status")
    assert done.returncode == 3 and "this directory has no session" in one_line(done.stderr)
    assert f"start a session: rig session {cell} -o {tmp_path / 'none'}" in done.stderr


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("minutes", "-1", "minutes"),
        ("minutes", "0", "minutes"),
        ("minutes", ".inf", "minutes"),
        ("minutes", "1.0e+9", "minutes"),
        ("began", "yesterday", "began"),
        ("rig", "''", "rig"),
        ("rig_sha256", "abc", "rig_sha256"),
        ("rig_sha256", "0" * 64, "rig_sha256: does not match the rig file"),
        ("driven_minutes", "-5", "driven_minutes"),
    ],
)
def test_a_value_that_no_session_has_is_refused_with_its_line(
    key: str, value: str, said: str, cell: Path, tmp_path: Path
) -> None:
    begun(cell, tmp_path / "own")
    file = tmp_path / "own" / "session.yaml"
    kept = [line for line in file.read_text().splitlines() if not line.startswith(f"{key}:")]
    file.write_text("\n".join([*kept[:2], f"{key}: {value}", *kept[2:]]) + "\n")
    done = ran("session", cell, "-o", tmp_path / "own", "--status")
    assert done.returncode == 3 and f"{file}, line 3, {said}" in one_line(done.stderr)


@pytest.mark.parametrize("name", ["nowhere", "../elsewhere", "/etc"])
def test_a_run_that_is_not_there_is_refused_with_its_line(name: str, cell: Path, tmp_path: Path) -> None:
    session = begun(cell, tmp_path / "own")
    place = SessionDirectory(tmp_path / "own")
    place.write(session.with_step(0, session.steps[0].model_copy(update={"tries": (Try(run="there"),)})))
    place.run("there").mkdir(parents=True)
    assert ran("session", cell, "-o", place.directory, "--status").returncode == 0
    place.file.write_text(place.file.read_text().replace("run: there", f"run: {name}"))
    done = ran("session", cell, "-o", place.directory, "--status")
    line = next(k for k, text in enumerate(place.file.read_text().splitlines(), 1) if f"run: {name}" in text)
    assert done.returncode == 3 and f"{place.file}, line {line}, " in one_line(done.stderr)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("aim: faults", "aim: all", "aim"),
        ("p01-yaw-acw", "../../etc", "program"),
        ("stage: yaw", "stage: moon", "moon"),
        ("version: 1", "version: 2", "version"),
        ("steps:", "steps: [", "YAML"),
        ("minutes:", "minutes: .nan\nminuten:", "minuten"),
    ],
)
def test_a_file_edited_by_hand_is_checked_with_its_line(
    old: str, new: str, said: str, cell: Path, tmp_path: Path
) -> None:
    begun(cell, tmp_path / "own")
    file = tmp_path / "own" / "session.yaml"
    edited = file.read_text().replace(old, new, 1)
    file.write_text(edited)
    done = ran("session", cell, "-o", tmp_path / "own", "--for", "kuka")
    assert done.returncode == 3 and said in done.stderr
    assert all(line.startswith("error: ") for line in done.stderr.splitlines())
    assert file.read_text() == edited


def test_another_rig_file_is_refused(cell: Path, tmp_path: Path) -> None:
    begun(cell, tmp_path / "own")
    cell.write_text(cell.read_text() + "# changed\n")
    done = ran("session", cell, "-o", tmp_path / "own", "--for", "kuka")
    assert done.returncode == 3 and "has changed or is" in one_line(done.stderr)


def test_an_emulated_session_does_not_go_on_in_a_real_cell(cell: Path, tmp_path: Path) -> None:
    begun(cell, tmp_path / "own")
    done = ran("session", cell, "-o", tmp_path / "own", "--for", "kuka", "--emulated")
    assert done.returncode == 2 and "this session uses a real cell" in one_line(done.stderr)


def test_two_sessions_in_one_directory(cell: Path, tmp_path: Path) -> None:
    begun(cell, tmp_path / "own")
    with SessionDirectory(tmp_path / "own"):
        done = ran("session", cell, "-o", tmp_path / "own", "--for", "kuka")
        assert done.returncode == 4 and "a different rig session" in one_line(done.stderr)
        assert ran("session", cell, "-o", tmp_path / "own", "--status").returncode == 0


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (("--for", "kuka", "--minutes", "3"), 2, "the shortest session of this cell takes"),
        (("--for", "kuka", "--effects", "x.yaml"), 2, "only with --emulated"),
        (("--for", "kuka", "--fast"), 2, "only with --emulated"),
        (("--for", "kuka", "--minutes", "60", "--entered"), 2, "does not have values to enter"),
    ],
)
def test_options_that_cannot_be(options: tuple[str, ...], code: int, said: str, cell: Path, tmp_path: Path) -> None:
    done = ran("session", cell, "-o", tmp_path / "own", *options)
    assert done.returncode == code and said in one_line(done.stderr)
    assert not (tmp_path / "own" / "session.yaml").exists()


def test_a_cell_that_names_no_maker_asks_for_it(cell: Path, tmp_path: Path) -> None:
    data = yaml.safe_load(cell.read_text())
    data["robot"]["name"] = "arm"
    cell.write_text(yaml.safe_dump(data, sort_keys=False))
    done = ran("session", cell, "-o", tmp_path / "own")
    assert done.returncode == 2 and "--for" in one_line(done.stderr)


def test_a_cell_whose_ports_are_not_there(cell: Path, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        tmp_path.chmod(0o700)
        done = ran("session", cell, "-o", tmp_path / "own", "--for", "kuka")
    assert done.returncode == 4 and "rigd: exited unexpectedly" in done.stderr
    assert done.stderr.count("error: ") == 1
    kept = SessionDirectory(tmp_path / "own").read()
    assert kept is not None and kept.steps[0].is_open


def test_a_full_disk_keeps_the_state_that_was_there(
    cell: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = begun(cell, tmp_path / "own")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(durable, "create", full)
    with (
        SessionDirectory(tmp_path / "own") as place,
        pytest.raises(CellError, match=r"No space left on device.*repeat the command"),
    ):
        place.write(session.model_copy(update={"minutes": 9.0}))
    assert SessionDirectory(tmp_path / "own").read() == session


@pytest.mark.parametrize(("aim", "minutes"), [("check", 20), ("faults", 50)])
def test_a_plan_fits_its_time_and_its_names_every_language(aim: Aim, minutes: int) -> None:
    rig, _ = load("ur10e")
    stages, steps = planned(rig, aim, minutes, BY_HAND, lambda _: None)
    assert minutes_of(stages, steps, BY_HAND) + BY_HAND.thinking_min <= minutes
    programs = programs_of_steps(rig, stages, steps)
    assert all(len(name + FIXED) <= 24 for name in programs)
    for maker in MAKERS:
        files = programs_of(maker, [(one.plan, demand_of(one.plan)) for one in programs.values()])
        assert all(any(name.replace("-", "_") in file.lower() for file in files) for name in programs)
