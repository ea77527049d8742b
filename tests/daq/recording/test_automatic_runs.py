import math
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from daq.acquisition.stream_buffer import StreamBuffer
from daq.acquisition.streams import streams_of
from daq.protocol.conversation import NO_TIME, Sample
from daq.recording.active_run import RunLabel
from daq.recording.automatic import Arbiter
from daq.recording.recorder import Recorder
from daq.store import Manifest, durable, load_manifest, read_run, verify
from rigs.load import parse
from tests.support.bench import Bench, rig_text
from tests.support.recorders import recorder_of
from tests.support.refusals import refused

RULES = [
    {"when": {"signal": 1}, "test": "yaw", "direction": "cw"},
    {"when": {"signal": 2}, "test": "yaw", "direction": "acw"},
]


def _text(interface: str, still_s: float = 0.5) -> str:
    data = yaml.safe_load(rig_text("keyence"))
    data["automatic"] = {"rules": [rule | {"still_s": still_s} for rule in RULES]}
    data["retention"] = {"days": 30}
    if interface == "ur_rtde":
        data["feedback"]["signal"] = {"outputs": [0, 5]}
    else:
        fields = ["t_ms", *(f"q{axis}_deg" for axis in range(1, 7)), "signal"]
        data["feedback"] = {"interface": "line_feed", "port": "tcp://127.0.0.1:1", "fields": fields}
    return str(yaml.safe_dump(data))


def _ended(bench: Bench) -> list[tuple[Path, Manifest]]:
    found = [(path, load_manifest(path)) for path in sorted((bench.folder / "runs").glob("[!.]*"))]
    return [(path, manifest) for path, manifest in found if manifest.exit_status != "recording"]


def _active(direction: str) -> Any:
    return lambda state: (
        state["recording"]
        and state["direction"] == direction
        and state["seconds"] > 2.2
        and state["automatic"]["recording"] == state["recording"]
    )


@pytest.fixture
def printing(tmp_path):
    with Bench(tmp_path, _text("line_feed")) as bench:
        yield bench


def test_a_program_after_the_other_is_a_run_each(printing):
    cell = printing.start()
    cell.all_reading()
    said = cell.until(lambda state: state["automatic"]["signal"] == 0)
    assert said["automatic"]["waits_for"] == ["signal 1: yaw cw", "signal 2: yaw acw"] and said["recording"] is None
    for program, direction in ((1, "cw"), (2, "acw")):
        cell.motion.program = program
        cell.until(_active(direction))
    cell.motion.program = 0
    cell.until(lambda state: state["recording"] is None and not state["closing"])
    assert 'rig_automatic_started_total{rig="bench"} 2' in cell.run("rig", "metrics").stdout.splitlines()
    (first, one), (second, other) = _ended(cell)
    assert [one.direction, other.direction] == ["cw", "acw"] and {one.operator, other.operator} == {"automatic"}
    assert [one.reason.split()[-1], other.reason.split()[-1]] == ["began", "still"]
    assert [one.exit_status, other.exit_status] == ["complete", "complete"]
    assert one.name == first.name and one.name.endswith("Z-yaw-cw") and other.name.endswith("Z-yaw-acw")
    for path, program in ((first, 1), (second, 2)):
        assert verify(path) == []
        robot = read_run(path).streams["robot"]
        began = int(np.argmax(robot["signal"] == program))
        assert began > 0 and robot["signal"][began - 1] == program - 1  # what was before it belongs to the run
        since_ns = robot["last_byte_ns"][began] - 1_000_000_000
        assert robot["first_byte_ns"][0] >= since_ns
    # the run before has the same second, with whatever gaps a busy computer left in it
    before = read_run(first).streams["robot"]["first_byte_ns"]
    assert robot["first_byte_ns"][0] == before[before >= since_ns][0]
    gauge = read_run(second).streams["g1_g2"]["first_byte_ns"]
    assert gauge[0] < robot["last_byte_ns"][began]


def _by_hand(tmp_path: Path) -> tuple[Recorder, Arbiter, dict[str, StreamBuffer]]:
    """The arbiter and the recorder without their threads."""
    text = _text("ur_rtde", still_s=0.2)
    rig = parse(text, "bench")
    buffers = {stream.name: StreamBuffer(stream.name, stream.columns) for stream in streams_of(rig)}
    recorder = recorder_of(tmp_path, buffers, text)
    return recorder, Arbiter(recorder, rig.automatic), buffers


def _signal_on(arbiter: Arbiter, buffers: dict[str, StreamBuffer], on: range) -> None:
    """Two seconds of the robot, one of its outputs on in some of the 200 samples; the gauges read."""
    now_ns = time.monotonic_ns()
    buffers["g1_g2"].deliver([Sample((1.0, 2.0), NO_TIME, now_ns, now_ns, 60)])
    stamps = [now_ns - 2_000_000_000 + 10_000_000 * number for number in range(200)]
    condition = (math.nan,) * (len(buffers["robot"].columns) - 7)
    samples = [Sample((0.0,) * 6 + (float(n in on), *condition), NO_TIME, at, at, 60) for n, at in enumerate(stamps)]
    buffers["robot"].deliver(samples)
    arbiter.feed(samples)


def test_a_recording_that_cannot_be_ends_none(tmp_path):
    recorder, arbiter, buffers = _by_hand(tmp_path)
    _signal_on(arbiter, buffers, range(50, 200))
    arbiter.after_round()
    # private _io, _creator: the test waits for the thread that makes runs
    recorder._io._creator.submit(lambda: None).result()
    name = recorder.state()["recording"]
    # private: a gauge that fell silent long ago
    buffers["g1_g2"]._last["g2_mm"] = (2.0, 0)
    with refused("gauge.silent"):
        arbiter.start(RunLabel(name="mine", test="yaw", direction="cw"))
    assert name and recorder.state()["recording"] == name
    arbiter.start(RunLabel(name="mine", test="radial"))
    assert recorder.state()["recording"] == "mine"
    arbiter.stop()
    recorder._io.shut_down()


def test_a_run_of_a_blink_is_kept_and_marked(tmp_path):
    recorder, arbiter, buffers = _by_hand(tmp_path)
    _signal_on(arbiter, buffers, range(50, 80))
    arbiter.after_round()
    recorder._io.shut_down()
    (path,) = tmp_path.iterdir()
    manifest = read_run(path).manifest
    assert manifest.exit_status == "interrupted" and manifest.reason.endswith("only 0.50 s long")
    assert manifest.counters["robot"]["samples"] == 150 + 50  # all from 0.5 s on, where the recorder began, to now


def test_a_disk_that_refuses_is_why_nothing_started(tmp_path, monkeypatch):
    recorder, arbiter, buffers = _by_hand(tmp_path)
    _signal_on(arbiter, buffers, range(50, 200))
    monkeypatch.setattr(durable, "free_bytes", lambda _: 0)
    arbiter.after_round()
    recorder._io._creator.submit(lambda: None).result()
    arbiter.after_round()
    state = arbiter.state()
    assert (state["refused"], state["started"], state["recording"]) == (1, 0, None)
    assert "yaw cw" in str(state["why_not"]) and "nearly full" in str(state["why_not"])
    assert recorder.state()["waiting"] is None and list(tmp_path.iterdir()) == []
    recorder._io.shut_down()


def test_person_has_priority_while_the_automatic_run_is_created(tmp_path, making):
    recorder, arbiter, buffers = _by_hand(tmp_path)
    _signal_on(arbiter, buffers, range(50, 200))
    arbiter.after_round()
    assert making.reached.wait(60)
    mine: list[Path] = []
    person = threading.Thread(target=lambda: mine.append(arbiter.start(RunLabel(name="mine", test="radial"))))
    person.start()
    while recorder.state()["beginning"] != "mine":
        person.join(0.01)
    making.open()
    person.join(60)
    arbiter.after_round()
    state = arbiter.state()
    assert recorder.state()["recording"] == "mine"
    assert (state["started"], state["refused"], state["recording"]) == (1, 0, None)
    arbiter.stop()
    recorder._io.shut_down()
    (theirs,) = [path for path in tmp_path.iterdir() if path not in mine]
    manifest = load_manifest(theirs)
    assert manifest.exit_status == "interrupted" and manifest.reason.endswith("started mine")
    assert manifest.counters["robot"] == {"samples": 200}  # from a second before the signal


def test_lap_begun_before_the_previous_is_on_disk_is_kept(tmp_path, making):
    recorder, arbiter, buffers = _by_hand(tmp_path)
    _signal_on(arbiter, buffers, range(50, 80))
    arbiter.after_round()
    assert making.reached.wait(60)
    _signal_on(arbiter, buffers, range(50, 200))
    arbiter.after_round()
    making.open()
    recorder._io._creator.submit(lambda: None).result()
    arbiter.after_round()
    state = arbiter.state()
    assert (state["started"], state["refused"]) == (2, 0)
    assert recorder.state()["recording"] == state["recording"]
    arbiter.stop()
    recorder._io.shut_down()
    assert len(list(tmp_path.iterdir())) == 2 and all(verify(path) == [] for path in tmp_path.iterdir())
