"""Captured cells, through the drivers at the times they were captured, and through the real daemon on real wires."""

import json
import re
import signal
import time
from contextlib import ExitStack
from typing import Any

import pytest

from daq.emulators.replay import Replay
from daq.wire.capture import Capture, read_capture
from rigs.load import parse
from tests.support.bench import PATIENCE_S, Bench
from tests.support.captures import CORPUS, heard
from tests.support.refusals import refused

NAMES = sorted(folder.name for folder in CORPUS.iterdir() if (folder / "cell.log").exists())
ON_WIRES = ("heidenhain-egm", "keyence-rtde", "mahr-rsi", "sylvac-lines")


def _case(name: str) -> tuple[str, Capture, dict[str, Any]]:
    folder = CORPUS / name
    expected = json.loads((folder / "heard.json").read_text())
    return (folder / "rig.yaml").read_text(), read_capture(folder / "cell.log"), expected


@pytest.mark.parametrize("name", NAMES)
def test_drivers_receive_the_captured_bytes(name):
    text, capture, expected = _case(name)
    assert not capture.cut
    assert heard(parse(text, name), capture) == expected


def test_the_daemon_hears_the_same_over_ptys_and_sockets(tmp_path):
    with ExitStack() as stack:
        played = {}
        for name in ON_WIRES:
            text, capture, expected = _case(name)
            replay = Replay(parse(text, name), capture)
            (tmp_path / name).mkdir()
            bench = stack.enter_context(Bench(tmp_path / name, text, cell=replay.cell)).start()
            played[name] = bench, replay, expected
        for name, (bench, replay, expected) in played.items():
            seconds = max(piece.at_ns for piece in _case(name)[1].pieces) / 1e9
            deadline = time.monotonic() + seconds + PATIENCE_S
            while not replay.is_finished and time.monotonic() < deadline:
                time.sleep(0.05)
            assert replay.is_finished, (name, replay.restarts)
            assert replay.otherwise == 0, name
            for stream, one in expected.items():
                steps = replay.steps[stream]  # on a busy computer the host asks too late for some answers
                least = 1 if steps.skipped else one["samples"]
                told = bench.until(lambda state, s=stream, n=least: _counted(state, s)["samples"] >= n)
                counted = _counted(told, stream)
                assert counted["samples"] <= one["samples"] + steps.repeated, (name, stream)
                if not steps.skipped:
                    assert {kind: counted.get(kind, 0) for kind in one["faults"]} == one["faults"], (name, stream)


def _counted(state: dict[str, Any], stream: str) -> dict[str, int]:
    counters: dict[str, int] = state["streams"][stream]["counters"]
    return {"samples": 0} | counters


def test_a_rig_of_which_the_capture_knows_nothing_is_refused():
    text, capture, _ = _case(NAMES[0])
    other = Capture(tuple(piece for piece in capture.pieces if piece.stream != "robot"), cut=False)
    with refused("readings.unsuitable"):
        Replay(parse(text, "x"), other)


def test_command_serves_a_capture_to_its_end(tmp_path):
    name = "sylvac-lines"
    with Bench(tmp_path) as bench, bench.replaying(CORPUS / name / "cell.log", CORPUS / name / "rig.yaml") as said:
        bench.rig = tmp_path / "replayed" / "rig.yaml"
        bench.start().until(lambda state: state["streams"]["robot"]["counters"].get("samples", 0) > 50)
        end = said()
    assert "0 pieces from" in end
    bad = bench.fails("rig", "replay", CORPUS / name / "rig.yaml", CORPUS / name / "rig.yaml", code=3)
    assert "not a capture" in bad


def test_early_disconnection_restarts_the_replay_and_is_reported(tmp_path):
    name = "sylvac-lines"
    with Bench(tmp_path) as bench, bench.replaying(CORPUS / name / "cell.log", CORPUS / name / "rig.yaml") as said:
        bench.rig = tmp_path / "replayed" / "rig.yaml"
        bench.start().until(lambda state: state["streams"]["robot"]["counters"].get("samples", 0) > 50)
        assert bench.signalled(signal.SIGTERM)[0] == 0
        bench.start()
        end = said()
    assert re.search(r"^restarts .*: [1-9]", end, re.MULTILINE), end
