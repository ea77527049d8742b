"""Wrong use of a session: each mistake has its code, and the stored state is unchanged."""

import json
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from analysis.apps.makers.motion_plan import demand_of
from analysis.apps.makers.writing import programs_of
from analysis.apps.session.session_plan import BY_HAND, FIXED, minutes_of, planned, programs_of_steps
from analysis.apps.session.session_state import Emulated, SessionDirectory, Try
from analysis.cli import app
from daq.store import durable
from rigs.errors import CellError, RigError
from rigs.load import load
from rigs.schema.vocabulary import MAKERS
from tests.support.command_line import ran
from tests.support.session_cell import begun, cell_file


@pytest.fixture
def cell(tmp_path):
    return cell_file(tmp_path)


def one_line(text: str) -> str:
    """The error, which is one line."""
    lines = text.splitlines()
    assert len(lines) == 1 and lines[0].startswith("error: "), text
    return lines[0]


def refused(*words: str | Path) -> str:
    """Run `rig session` and return the code of its failure."""
    error = CliRunner().invoke(app, ["session", *map(str, words)]).exception
    assert isinstance(error, RigError), error
    return error.code


def test_status_shows_every_step_and_json_the_whole_state(cell, tmp_path):
    session = begun(cell, tmp_path / "own")
    shown = ran("session", cell, "-o", tmp_path / "own", "--status")
    assert shown.returncode == 0 and all(step.program in shown.stdout for step in session.steps)
    assert f"rig session {cell}" in shown.stdout
    assert f" -o {tmp_path / 'own'} --for {session.maker}" in shown.stdout
    fast = session.model_copy(update={"emulated": Emulated(fast=True)})
    assert SessionDirectory(tmp_path).command(cell, fast).endswith(f" --for {session.maker} --emulated --fast")
    plain = json.loads(ran("session", cell, "-o", tmp_path / "own", "--status", "--json").stdout)
    assert plain["steps"][0]["program"] == "p01-yaw-acw" and plain["rig"] == session.rig


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
        ("driven_minutes", "-5", "driven_minutes"),
    ],
)
def test_impossible_value_is_refused_with_its_line(key, value, said, cell, tmp_path):
    begun(cell, tmp_path / "own")
    file = tmp_path / "own" / "session.yaml"
    kept = [line for line in file.read_text().splitlines() if not line.startswith(f"{key}:")]
    file.write_text("\n".join([*kept[:2], f"{key}: {value}", *kept[2:]]) + "\n")
    done = ran("session", cell, "-o", tmp_path / "own", "--status")
    assert done.returncode == 3 and f"{file}, line 3, {said}" in one_line(done.stderr)


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
def test_edited_file_is_checked_with_its_line(old, new, said, cell, tmp_path):
    begun(cell, tmp_path / "own")
    file = tmp_path / "own" / "session.yaml"
    edited = file.read_text().replace(old, new, 1)
    file.write_text(edited)
    done = ran("session", cell, "-o", tmp_path / "own", "--for", "kuka")
    assert done.returncode == 3 and said in done.stderr
    assert all(line.startswith("error: ") for line in done.stderr.splitlines())
    assert file.read_text() == edited


def test_other_rig_file_is_refused(cell, tmp_path):
    begun(cell, tmp_path / "own")
    cell.write_text(cell.read_text() + "# changed\n")
    for option in (("--for", "kuka"), ("--status",)):
        assert refused(cell, "-o", tmp_path / "own", *option) == "session.other_rig_file"


def test_session_with_a_missing_run_is_refused(cell, tmp_path):
    session, place = begun(cell, tmp_path / "own"), SessionDirectory(tmp_path / "own")
    place.write(session.with_try(0, Try(run="there")))
    for option in (("--for", session.maker), ("--status",)):
        assert refused(cell, "-o", place.directory, *option) == "session.run_missing"
    place.run("there").mkdir(parents=True)
    assert ran("session", cell, "-o", place.directory, "--status").returncode == 0


def test_session_of_a_real_cell_is_not_continued_in_an_emulated_one(cell, tmp_path):
    begun(cell, tmp_path / "own")
    assert refused(cell, "-o", tmp_path / "own", "--for", "kuka", "--emulated") == "session.other_cell"


def test_second_session_in_a_directory_is_refused(cell, tmp_path):
    begun(cell, tmp_path / "own")
    with SessionDirectory(tmp_path / "own"):
        assert refused(cell, "-o", tmp_path / "own", "--for", "kuka") == "session.in_use"
        assert ran("session", cell, "-o", tmp_path / "own", "--status").returncode == 0


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (("--status",), "session.none"),
        (("--for", "kuka", "--minutes", "3"), "session.minutes"),
        (("--for", "kuka", "--effects", "x.yaml"), "session.option_unused"),
        (("--for", "kuka", "--fast"), "session.option_unused"),
        (("--for", "kuka", "--minutes", "60", "--entered"), "session.no_entries"),
    ],
)
def test_impossible_option_is_refused(options, code, cell, tmp_path):
    assert refused(cell, "-o", tmp_path / "own", *options) == code
    assert not (tmp_path / "own" / "session.yaml").exists()


def test_unknown_maker_is_asked_for(cell, tmp_path):
    data = yaml.safe_load(cell.read_text())
    data["robot"]["name"] = "arm"
    cell.write_text(yaml.safe_dump(data, sort_keys=False))
    assert refused(cell, "-o", tmp_path / "own") == "session.maker"


def test_missing_ports_end_the_session_and_keep_its_state(cell, tmp_path):
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        tmp_path.chmod(0o700)
        assert refused(cell, "-o", tmp_path / "own", "--for", "kuka") == "process.ended"
    kept = SessionDirectory(tmp_path / "own").read()
    assert kept.steps[0].is_open


def test_full_disk_keeps_the_stored_state(cell, tmp_path, monkeypatch):
    session = begun(cell, tmp_path / "own")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "full")

    monkeypatch.setattr(durable, "create", full)
    with SessionDirectory(tmp_path / "own") as place, pytest.raises(CellError) as error:
        place.write(session.model_copy(update={"minutes": 9.0}))
    assert error.value.code == "disk.write"
    assert SessionDirectory(tmp_path / "own").read() == session


@pytest.mark.parametrize(("aim", "minutes"), [("check", 20), ("faults", 50)])
def test_plan_fits_its_time_and_its_names_every_language(aim, minutes):
    rig, _ = load("ur10e")
    stages, steps = planned(rig, aim, minutes, BY_HAND, lambda _: None)
    assert minutes_of(steps, BY_HAND) + BY_HAND.thinking_min <= minutes
    programs = programs_of_steps(rig, stages, steps)
    assert all(len(name + FIXED) <= 24 for name in programs)
    for maker in MAKERS:
        files = programs_of(maker, [(one.plan, demand_of(one.plan)) for one in programs.values()])
        assert all(any(name.replace("-", "_") in file.lower() for file in files) for name in programs)
