"""Wrong use of a session: each mistake has its code, and the stored state is unchanged."""

import pytest
import yaml

from analysis.apps.makers.motion_plan import demand_of
from analysis.apps.makers.writing import programs_of
from analysis.apps.session.session_plan import BY_HAND, FIXED, minutes_of, planned, programs_of_steps
from analysis.apps.session.session_state import Emulated, SessionDirectory, Try
from daq.store import durable
from rigs.load import load
from rigs.makers import MAKERS
from tests.support.command_line import errors_of, failure_of, json_of, succeeded
from tests.support.refusals import refused
from tests.support.session_cell import begun, cell_file
from tests.support.written_files import contents


@pytest.fixture
def cell(tmp_path):
    return cell_file(tmp_path)


@pytest.fixture
def own(cell, tmp_path):
    """The directory of a session that has begun."""
    begun(cell, tmp_path / "own")
    return tmp_path / "own"


def test_status_shows_every_step_and_json_the_whole_state(cell, tmp_path):
    session = begun(cell, tmp_path / "own")
    shown = succeeded(f"session {cell} -o {tmp_path}/own --status")
    assert all(step.program in shown.stdout for step in session.steps)
    assert f"rig session {cell}" in shown.stdout
    assert f" -o {tmp_path / 'own'} --for {session.maker}" in shown.stdout
    fast = session.model_copy(update={"emulated": Emulated(fast=True)})
    assert SessionDirectory(tmp_path).command(cell, fast).endswith(f" --for {session.maker} --emulated --fast")
    plain = json_of(f"session {cell} -o {tmp_path}/own --status")
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
def test_impossible_value_is_refused_with_its_line(key, value, said, cell, own):
    file = own / "session.yaml"
    kept = [line for line in file.read_text().splitlines() if not line.startswith(f"{key}:")]
    file.write_text("\n".join([*kept[:2], f"{key}: {value}", *kept[2:]]) + "\n")
    (line,) = errors_of(f"session {cell} -o {own} --status").splitlines()
    assert line.startswith("error: ") and f"{file}, line 3, {said}" in line


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
def test_edited_file_is_checked_with_its_line(old, new, said, cell, own):
    file = own / "session.yaml"
    edited = file.read_text().replace(old, new, 1)
    file.write_text(edited)
    errors = errors_of(f"session {cell} -o {own} --for kuka")
    assert said in errors and all(line.startswith("error: ") for line in errors.splitlines())
    assert file.read_text() == edited


def test_other_rig_file_is_refused(cell, own):
    cell.write_text(cell.read_text() + "# changed\n")
    for option in (("--for", "kuka"), ("--status",)):
        assert failure_of("session", cell, "-o", own, *option)[1] == "session.invalid"


def test_session_with_a_missing_run_is_refused(cell, tmp_path):
    session, place = begun(cell, tmp_path / "own"), SessionDirectory(tmp_path / "own")
    place.write(session.with_try(0, Try(run="there")))
    for option in (("--for", session.maker), ("--status",)):
        assert failure_of("session", cell, "-o", place.directory, *option)[1] == "run.missing"
    place.run("there").mkdir(parents=True)
    succeeded(f"session {cell} -o {place.directory} --status")


def test_session_of_a_real_cell_is_not_continued_in_an_emulated_one(cell, own):
    assert failure_of(f"session {cell} -o {own} --for kuka --emulated")[1] == "session.invalid"


def test_second_session_in_a_directory_is_refused(cell, own):
    with SessionDirectory(own):
        assert failure_of(f"session {cell} -o {own} --for kuka")[1] == "session.in_use"
        succeeded(f"session {cell} -o {own} --status")


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ("--status", "session.missing"),
        ("--for kuka --minutes 3", "usage"),
        ("--for kuka --effects x.yaml", "usage"),
        ("--for kuka --fast", "usage"),
        ("--for kuka --minutes 60 --entered", "controller.invalid"),
    ],
)
def test_impossible_option_is_refused(options, code, cell, tmp_path):
    assert failure_of(f"session {cell} -o {tmp_path}/own {options}")[1] == code
    assert not (tmp_path / "own" / "session.yaml").exists()


def test_unknown_maker_is_asked_for(cell, tmp_path):
    data = contents(cell)
    data["robot"]["name"] = "arm"
    cell.write_text(yaml.safe_dump(data, sort_keys=False))
    assert failure_of(f"session {cell} -o {tmp_path}/own")[1] == "maker.unknown"


def test_full_disk_keeps_the_stored_state(cell, tmp_path, monkeypatch):
    session = begun(cell, tmp_path / "own")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "full")

    monkeypatch.setattr(durable, "create", full)
    with SessionDirectory(tmp_path / "own") as place, refused("output.not_writable", "cannot be written"):
        place.write(session.model_copy(update={"minutes": 9.0}))
    assert SessionDirectory(tmp_path / "own").read() == session


@pytest.mark.parametrize(("aim", "minutes"), [("check", 20), ("faults", 50)])
def test_plan_fits_its_time_and_its_names_every_language(aim, minutes):
    rig, _ = load("ur10e-cell")
    stages, steps = planned(rig, aim, minutes, BY_HAND, lambda _: None)
    assert minutes_of(steps, BY_HAND) + BY_HAND.thinking_min <= minutes
    programs = programs_of_steps(rig, stages, steps)
    assert all(len(name + FIXED) <= 24 for name in programs)
    for maker in MAKERS:
        files = programs_of(maker, [(one.plan, demand_of(one.plan)) for one in programs.values()])
        assert all(any(name.replace("-", "_") in file.lower() for file in files) for name in programs)
