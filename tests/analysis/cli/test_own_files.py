from __future__ import annotations

import getpass
import subprocess

import pytest

from analysis.cli.options import operator_or_user
from rigs.load import SHIPPED, load
from tests.support.bench import BIN
from tests.support.command_line import ran


@pytest.mark.parametrize("read", ["own", "ur10e"])
def test_emulated_cell_replaces_no_foreign_rig_file(read, tmp_path):
    own = tmp_path / "rig.yaml"
    own.write_bytes((SHIPPED / "ur10e.yaml").read_bytes())
    for command in (("emulate",), ("replay", own)):
        done = ran(*command, own if read == "own" else read, "-o", tmp_path)
        (line,) = done.stderr.splitlines()
        assert done.returncode == 3 and "rig.yaml: already exists" in line
    assert own.read_bytes() == (SHIPPED / "ur10e.yaml").read_bytes()
    assert list(tmp_path.iterdir()) == [own]


def test_an_emulated_cell_replaces_the_rig_file_of_an_earlier_one(tmp_path):
    for _ in range(2):
        done = subprocess.run(
            [BIN / "rig", "emulate", "ur10e", "-o", tmp_path],
            input="quit\n",
            capture_output=True,
            text=True,
            check=True,
        )
        assert "ready; next: rigd" in done.stdout
    rig = load(tmp_path / "rig.yaml")[0]
    assert rig.emulated and rig.limits == load("ur10e")[0].limits  # its runs are called emulated, and have a verdict


@pytest.mark.parametrize("error", [KeyError("getpwuid(): 54321"), OSError("No username set")])
def test_a_user_without_a_name_is_no_operator(error, monkeypatch):
    """As in a container that runs under any user; Python 3.13 raises the latter."""

    def unknown() -> str:
        raise error

    monkeypatch.setattr(getpass, "getuser", unknown)
    assert operator_or_user("") == "" and operator_or_user("anna") == "anna"
