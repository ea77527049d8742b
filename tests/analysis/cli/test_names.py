import getpass
import socket

import pytest

import analysis
from analysis.apps.emulate.served_cell import locked_cell
from analysis.cli.options import operator_or_user
from daq.store import durable
from rigs.errors import FileError
from rigs.load import SHIPPED, find, names_a_cell
from rigs.makers import maker_named
from tests.support.command_line import errors_of, ran, succeeded
from tests.support.refusals import refused


@pytest.mark.parametrize(
    ("word", "maker"),
    [
        ("ur", "ur"),
        ("UR", "ur"),
        ("UR10e", "ur"),
        ("Universal Robots", "ur"),
        ("Kuka", "kuka"),
        ("ABB", "abb"),
        ("Motoman", "yaskawa"),
        ("siemens", None),
        ("", None),
    ],
)
def test_a_maker_is_understood_as_people_write_it(word, maker):
    assert maker_named(word) == maker


@pytest.mark.parametrize(
    ("name", "file"), [("UR10E cell", "ur10e-cell"), ("Paper Fanuc", "paper-fanuc"), ("UR10e", "ur10e")]
)
def test_a_shipped_rig_is_understood_as_people_write_it(name, file):
    assert find(name).stem == file


def test_ambiguous_name_is_refused_with_near_ones():
    with pytest.raises(FileError, match="ur10e"):
        find("UR")
    assert "ur10e" in errors_of("arms UR")
    assert ran("arms UR10E").stdout == ran("arms ur10e").stdout != ""


@pytest.mark.parametrize(
    "command", ["simulate ur10e --test yaw -o {}", "emulate UR10E -o {}", "program ur10e --for ur --test yaw -o {}"]
)
def test_command_that_needs_a_cell_names_the_one_with_this_arm(command, tmp_path):
    (line,) = errors_of(command.format(tmp_path / "out")).splitlines()
    assert "for the shipped cell with this arm, give ur10e-cell;" in line
    assert not (tmp_path / "out").exists()


def test_api_names_the_cell_too():
    with refused("rig_file.invalid", "needed for yaw, roll, radial, repeatability") as refusal:
        analysis.simulate("ur10e", "radial")
    assert "give ur10e-cell;" in refusal.value.remedy


@pytest.mark.parametrize("command", ["analyse", "diagnose", "calibrate", "report", "compare", "moved"])
@pytest.mark.parametrize("word", ["--arm paper-fanuc", "--arm=UR10e-cell"])
def test_shipped_cell_is_no_arm(command, word):
    (line,) = errors_of(f"{command} poses.csv {word}", exit_code=2).splitlines()
    name = word[6:]
    assert f"--arm: {name} is a shipped cell" in line and f"--rig {name} for the cell" in line


def test_own_file_may_have_the_name_of_a_shipped_cell(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert names_a_cell("ur10e-cell") and not names_a_cell("ur10e")
    (tmp_path / "ur10e-cell").write_bytes((SHIPPED / "ur10e-cell.yaml").read_bytes())
    assert not names_a_cell("ur10e-cell")


def test_earlier_spellings_of_options_work_and_are_hidden(tmp_path):
    radial = ("simulate", "UR10e cell", "--test", "radial")
    succeeded(*radial, "--runs", "2", "-o", tmp_path / "runs")
    succeeded(*radial, "--times=2", "-o", tmp_path / "same")
    assert len(list((tmp_path / "runs").iterdir())) == len(list((tmp_path / "same").iterdir())) == 2
    new, old = (ran(f"history ur10e {option} {tmp_path}/runs --json") for option in ("--runs", "--data"))
    assert new.returncode == old.returncode == 0 and new.stdout == old.stdout
    for command, word in (("correct", "--controller"), ("history", "--data"), ("simulate", "--runs ")):
        assert word not in ran(f"{command} --help", COLUMNS="200").stdout


@pytest.mark.parametrize("rig", ["ur10e-cell", "paper-fanuc"])
def test_the_doctor_touches_no_address_of_a_shipped_example(rig, monkeypatch):
    reached = []
    monkeypatch.setattr(socket.socket, "connect", lambda _, address: reached.append(address))
    done = ran(f"doctor {rig}")
    assert "init cell.yaml" in done.stdout
    assert not [address for address in reached if isinstance(address, tuple)]
    assert errors_of(f"doctor {rig} --scan", exit_code=2).startswith("error: --scan: ")


def test_second_cell_in_a_directory_is_refused(tmp_path):
    lock = locked_cell(tmp_path / "cell")
    with refused("output.exists", "different rig emulate or rig replay"):
        locked_cell(tmp_path / "cell")
    durable.close(lock)
    durable.close(locked_cell(tmp_path / "cell"))


@pytest.mark.parametrize("read", ["own", "ur10e-cell"])
def test_emulated_cell_replaces_no_foreign_rig_file(read, tmp_path):
    own = tmp_path / "rig.yaml"
    own.write_bytes((SHIPPED / "ur10e-cell.yaml").read_bytes())
    for command in (("emulate",), ("replay", own)):
        (line,) = errors_of(*command, own if read == "own" else read, "-o", tmp_path).splitlines()
        assert "rig.yaml: already exists" in line
    assert own.read_bytes() == (SHIPPED / "ur10e-cell.yaml").read_bytes()
    assert list(tmp_path.iterdir()) == [own]


@pytest.mark.parametrize("error", [KeyError("getpwuid(): 54321"), OSError("No username set")])
def test_a_user_without_a_name_is_no_operator(error, monkeypatch):
    """As in a container that runs under any user; Python 3.13 raises the latter."""

    def unknown() -> str:
        raise error

    monkeypatch.setattr(getpass, "getuser", unknown)
    assert operator_or_user("") == "" and operator_or_user("anna") == "anna"
