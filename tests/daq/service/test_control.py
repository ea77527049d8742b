import json
import os
import socket

import pytest

import daq.service.client
from daq.recording.active_run import RunLabel
from daq.service.client import Client, find_socket
from daq.service.control import ControlServer, reply
from daq.service.trust import InstanceLock
from daq.store import RunWriter, load_manifest, new_manifest
from tests.support.refusals import refused


def test_other_file_in_place_of_the_socket_stays(tmp_path):
    file, folder = tmp_path / "notes.txt", tmp_path / "folder"
    file.write_text("precious")
    folder.mkdir()
    for path in (file, folder):
        with refused("daemon.socket"):
            ControlServer(path, lambda _: {}).start()
    assert file.read_text() == "precious"


def test_an_error_in_the_program_is_no_mistake_of_who_asked():
    def fails(_: object) -> dict[str, object]:
        raise ValueError("unforeseen")

    with pytest.raises(ValueError, match="unforeseen"):  # logged with its traceback
        reply(b"{}", fails)
    assert "not JSON" in reply(b"{", fails)["what"] and "a JSON object" in reply(b"[]", fails)["what"]


def test_a_socket_has_one_daemon(tmp_path):
    lock = InstanceLock.take("cell", tmp_path / "cell.sock")
    with refused("daemon.second"):
        InstanceLock.take("cell", tmp_path / "cell.sock")
    InstanceLock.take("cell", tmp_path / "other.sock").release()
    lock.release()
    InstanceLock.take("cell", tmp_path / "cell.sock").release()


def test_hanging_daemon_is_distinguished_from_none(tmp_path, monkeypatch):
    """The daemon accepts a few connections and answers none, until the system refuses more."""
    monkeypatch.setattr(daq.service.client, "socket_directory", lambda: tmp_path)
    monkeypatch.setattr(daq.service.client, "ANSWERS_S", 0.1)
    # private: the real limit is seconds
    monkeypatch.setattr(daq.service.client, "_CONNECT_S", 0.1)
    path = tmp_path / "hanging.sock"
    with socket.socket(socket.AF_UNIX) as hanging:
        hanging.bind(str(path))
        hanging.listen(0)
        with Client(path) as client:
            with refused("daemon.no_answer"):
                client.ask("status")
            assert find_socket("hanging") == path
            with refused("daemon.busy"), Client(path):
                pass


def test_an_operator_of_another_encoding_is_recorded(tmp_path):
    """As the command line of a Latin-1 terminal gives him."""
    operator = json.loads(json.dumps(os.fsdecode("Müller".encode("latin-1"))))
    label = RunLabel(name="lap", test="radial", operator=operator)
    who = {"rig_name": "r", "rig_text": "", "streams": {"g1": ("g1_mm",)}}
    writer = RunWriter.create(
        tmp_path, new_manifest(name="lap", test="radial", direction=None, operator=operator, **who)
    )
    writer.close("interrupted", f"{label.operator} started another", {})
    assert load_manifest(writer.path).operator == label.operator == r"M\udcfcller"
