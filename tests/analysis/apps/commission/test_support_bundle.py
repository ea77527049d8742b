"""The bundle of a cell for an issue: complete, readable by rig, and without names of people and computers."""

import json
import zipfile

import numpy as np
import pytest

from analysis.apps.commission import support_bundle
from daq.protocol.conversation import Fault, FaultKind, Sample
from daq.store import RunWriter, judge, new_manifest, read_run, relabel
from rigs.load import SHIPPED, load
from tests.support.command_line import ran

PERSONAL = ("Anna Beispiel", "anna", "shopfloor7", "10.20.30.40", "/home/anna")


@pytest.fixture
def cell(tmp_path, monkeypatch):
    """A rig file and a recorded run of a person on a computer, both with their names in several places."""
    monkeypatch.setattr(support_bundle.getpass, "getuser", lambda: "anna")
    monkeypatch.setattr(support_bundle.socket, "gethostname", lambda: "shopfloor7")
    text = (SHIPPED / "paper-fanuc.yaml").read_text().replace("192.168.1.10", "10.20.30.40")
    text = f"# copied by anna from /home/anna/cells on shopfloor7\n{text}"
    (tmp_path / "anna-cell.yaml").write_text(text)
    manifest = new_manifest(
        name="lap",
        test="yaw",
        direction="acw",
        rig_name="paper-fanuc",
        rig_text=text,
        operator="Anna Beispiel",
        streams={"g1": ("g1_mm",)},
    )
    writer = RunWriter.create(tmp_path / "runs", manifest.updated(host="shopfloor7"))
    for k in range(50):
        writer.append("g1", [Sample((0.001 * k,), k * 1000, k * 1000 + 1, k * 1000 + 1, k)])
    writer.append_faults("g1", [Fault(FaultKind.SILENT, 60_000, "/home/anna/ttyUSB0: no answer", 1)])
    writer.write()
    writer.close("complete", "stopped by anna", {"g1": {"samples": 50}})
    return tmp_path


def test_bundle_is_a_readable_cell_without_names(cell):
    (run,) = (cell / "runs").iterdir()
    relabel(run, operator="Anna B.")
    done = ran("doctor", "anna-cell.yaml", "--runs", "runs", "--bundle", "cell.zip", cwd=cell)
    assert done.returncode == 1 and "packed: " in done.stdout and "left out: " in done.stdout
    with zipfile.ZipFile(cell / "cell.zip") as archive:
        everything = b"".join(archive.read(name) for name in archive.namelist()).decode("utf-8", "replace")
        names = "\n".join(archive.namelist())
        archive.extractall(cell / "received")
        versions = json.loads(archive.read("versions.json"))
    assert not [name for name in (*PERSONAL, "Anna B.") if name in everything + names]
    assert versions["packages"]["numpy"] == np.__version__
    (copy,) = (cell / "received/runs").iterdir()
    assert judge(copy).is_sealed and not judge(copy).lines
    original, received = read_run(run), read_run(copy)
    np.testing.assert_array_equal(received.streams["g1"]["g1_mm"], original.streams["g1"]["g1_mm"])
    assert [fault["detail"] for fault in received.faults] == ["~/ttyUSB0: no answer"]
    assert load(cell / "received/user-cell.yaml")[0].robot == load(cell / "anna-cell.yaml")[0].robot


def test_bundle_of_a_cell_without_runs_says_so(cell, tmp_path):
    made = support_bundle.make_bundle(str(cell / "anna-cell.yaml"), None, tmp_path / "none", [])
    assert any("a run" in line for line in made.left_out)
    assert not [name for name in made.files if name.startswith("runs/")]


def test_long_run_is_left_out(cell, monkeypatch):
    (run,) = (cell / "runs").iterdir()
    monkeypatch.setattr(support_bundle, "MOST_RUN_BYTES", 10)
    assert support_bundle.newest_run(cell / "runs") is None
    made = support_bundle.make_bundle(str(cell / "anna-cell.yaml"), run, cell / "runs", [])
    assert any(run.name in line for line in made.left_out)


def test_names_that_are_words_of_a_rig_file_stay(monkeypatch):
    monkeypatch.setattr(support_bundle.getpass, "getuser", lambda: "robot")
    monkeypatch.setattr(support_bundle.socket, "gethostname", lambda: "cell")
    hide = support_bundle.NameReplacement.of_this_computer(["rig simulate"])
    assert hide("robot: cell, rig simulate, tcp://127.0.0.1:3") == "robot: cell, rig simulate, tcp://127.0.0.1:3"
    assert hide("udp://kuka.plant:1 tcp://10.0.0.2:2 udp://kuka.plant:4") == (
        "udp://address-1:1 tcp://address-2:2 udp://address-1:4"
    )


def test_run_without_bundle_is_refused(cell):
    assert ran("doctor", "anna-cell.yaml", "--run", "runs", cwd=cell).returncode == 2
