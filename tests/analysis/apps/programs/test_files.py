import re
from pathlib import Path

import pytest
import yaml

from analysis.apps.makers.motion_plan import demand_of
from analysis.apps.makers.program_text import fixed, identifier, wrapped
from analysis.apps.makers.writing import programs_of
from analysis.apps.programs.planned import plans_of
from rigs.errors import FileError
from rigs.load import SHIPPED
from tests.support.changed_rigs import rig_with, shipped
from tests.support.command_line import errors_of, ran, succeeded
from tests.support.every import for_every_maker

LONG = "a-cell-with-a-name-of-sixty-three-characters-which-is-the-most-"
LONGEST = {"ur": 60, "fanuc": 36, "kuka": 24, "abb": 32, "yaskawa": 32}
"""Letters of a program's name that a controller takes, of the makers whose manual states it."""


@pytest.fixture(scope="module")
def planned():
    return [(plan, demand_of(plan)) for plan in plans_of(rig_with(name=LONG[:63]), "yaw", 3.0)]


@pytest.mark.parametrize("dialect", LONGEST)
def test_names_fit_the_controller_and_differ_between_directions(dialect, planned):
    files = programs_of(dialect, planned)
    names = {name.rpartition(".")[0] for name in files}
    assert len(names) == 2
    assert all(re.fullmatch(r"[A-Za-z]\w*", name) and len(name) <= LONGEST[dialect] for name in names)


@for_every_maker
def test_the_first_comment_is_the_override_and_the_clearance(dialect, planned):
    text = next(iter(programs_of(dialect, planned).values()))
    comments = re.findall(r"^\s*(?:\d+:)?\s*(?:[#;'!] ?)(.*?)(?: ;)?$", text, re.M)
    first = " ".join(comments[:8])
    assert first.startswith("CHECK: override 10 %")
    assert "mm (base frame) clear" in first and text.isascii()


@pytest.mark.parametrize(
    ("value", "text"), [(-1e-9, "0.000"), (0.0, "0.000"), (-0.0005001, "-0.001"), (1e6, "1000000.000")]
)
def test_a_number_has_no_exponent_and_no_negative_zero(value, text):
    assert fixed(value, 3) == text


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_number_that_is_none_is_never_written(value):
    with pytest.raises(FileError):
        fixed(value, 3)


def test_identifiers_and_comments():
    assert identifier("circle acw ur-10.e--x", 20) == "circle_acw_ur_10_e_x"
    assert identifier("circle acw ur", 11) == "circle_acw"
    assert wrapped("5° of Größe … and more", 12) == ["5 deg of", "Gr??e to and", "more"]


def test_the_command_writes_both_directions_and_nothing_twice(tmp_path):
    order = ("program", "ur10e-cell", "--for", "kuka", "--test", "yaw", "-o", tmp_path / "out")
    done = ran(*order)
    names = ["yaw_acw_ur10e.dat", "yaw_acw_ur10e.src", "yaw_cw_ur10e.dat", "yaw_cw_ur10e.src"]
    assert done.returncode == 0 and sorted(Path(line).name for line in done.stdout.split()) == names
    assert "axis 6 (wrist 3) turns" in done.stderr and "yourself" in done.stderr
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert sorted(before) == names
    del before[names[0]]
    (tmp_path / "out" / names[0]).unlink()
    assert "exists already" in errors_of(*order)
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


def _commands() -> list[str]:
    page = (SHIPPED.parent / "docs" / "robot-programs.md").read_text()
    return [line.split("#")[0] for line in re.findall(r"^rig program .*$", page, re.M)]


@pytest.mark.parametrize("line", _commands())
def test_the_commands_of_the_page_run(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rig = shipped()
    fields = ["t_ms", *(f"q{axis}_deg" for axis in range(1, 7)), "signal"]
    rig["feedback"] = {"interface": "line_feed", "port": "tcp://192.168.1.10:59002", "fields": fields}
    directions = enumerate(("acw", "cw"), start=1)
    rules = [{"when": {"signal": number}, "test": "roll", "direction": one} for number, one in directions]
    rig["tests"]["iso9283"] = {}
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(rig | {"automatic": {"rules": rules}}))
    succeeded(*line.split()[1:])
    assert list((tmp_path / "programs").iterdir())


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        ("--for kuka --test circle", 2, "'circle'"),
        ("--for comau --test yaw", 2, "--for"),
        ("--for ur --test yaw --outputs a", 2, "list of"),
        ("--for ur --test yaw --outputs 1,1", 2, "different outputs"),
        ("--for ur --test radial --dwell-s 0", 2, "--dwell-s"),
    ],
)
def test_wrong_use_is_one_line(words, code, says, tmp_path):
    (line,) = errors_of(f"program ur10e-cell {words} -o {tmp_path}/out", exit_code=code).splitlines()
    assert says in line
    assert not (tmp_path / "out").exists()


def test_a_directory_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "file").touch()
    for output in (tmp_path / "file", tmp_path / "file" / "below"):
        (line,) = errors_of(f"program ur10e-cell --for ur --test repeatability -o {output}").splitlines()
        assert line.startswith(f"error: {output}") and line.endswith("; choose a different --output")


def test_missing_or_unreachable_test_writes_nothing(tmp_path):
    rig = shipped()
    far = rig | {"tests": {"circle": rig["tests"]["circle"] | {"centre_mm": [-1500, -200, 250]}}}
    (tmp_path / "far.yaml").write_text(yaml.safe_dump(far))
    for test, says in (("yaw", "reach"), ("radial", "no tests.hemisphere")):
        (line,) = errors_of(f"program {tmp_path}/far.yaml --for abb --test {test} -o {tmp_path}/out").splitlines()
        assert says in line
    assert not (tmp_path / "out").exists()
