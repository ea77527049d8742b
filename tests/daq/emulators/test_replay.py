from dataclasses import replace
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import yaml

from analysis.apps.emulate.robot import EmulatedRobot
from daq import clock
from daq.emulators.played import StreamingPlayer
from daq.emulators.replay import Replay
from daq.protocol.conversation import ConversationStep
from daq.wire.capture import read_capture
from rigs.errors import FileError
from rigs.load import load_hidden, parse
from tests.support.bench import PATIENCE_S, rig_text
from tests.support.command_line import ran
from tests.support.simulated_bench import SimulatedBench

LATE_NS = 100_000_000
"""Some cycles of the robot."""


def _captured(folder: Path, gauges: str, laps: int) -> tuple[str, Path]:
    data = yaml.safe_load(rig_text(gauges, timeout_s=0.5))
    data["tests"]["circle"] |= {"speed_mm_s": 60, "laps": laps}
    text = yaml.safe_dump(data)
    hidden = load_hidden("ur10e").apply_to(parse(text, "quick"))  # where nothing errs, no figure tells of a time
    robot = EmulatedRobot.of_rig(hidden, seed=7)
    folder.mkdir()
    with SimulatedBench(folder, text, robot, capture=folder / "cell.log") as bench:
        bench.start().all_reading()
        run = bench.record("lap", "acw")
        bench.recorded(more_than=60)  # in the replay a recording is begun as long before the robot moves
        bench.drive(robot, "acw")
        bench.stop()
    return text, run


def _replayed(folder: Path, text: str, log: Path) -> tuple[Path, Replay]:
    folder.mkdir()
    capture, marks = read_capture(log), folder / "out-of-step.txt"
    replay = Replay(parse(text, "quick"), capture, marks, opening=lambda _, devices, **__: devices)
    played: Any = replay.cell  # what plays each stream, for the lines of a simulated cell
    marked = yaml.safe_dump(yaml.safe_load(text) | {"replay": str(marks)})
    with SimulatedBench(folder, marked, devices=played, paced=False) as bench:
        bench.start().all_reading()
        run = bench.record("lap", "acw")
        seconds = (capture.pieces[-1].at_ns - capture.pieces[0].at_ns) / 1e9
        until_s = clock.now_s() + seconds + PATIENCE_S
        while not replay.is_finished and clock.now_s() < until_s:
            clock.sleep(0.05)
        assert replay.is_finished, f"{replay.restarts} restarts"
        bench.stop()
    return run, replay


def _analysed(folder: Path, run: Path) -> CompletedProcess[str]:
    return ran("analyse", run, "--json", cwd=folder)


def _is_refused(done: CompletedProcess[str], stream: str) -> bool:
    told = done.stderr.partition("was made from a replay out of step (")[2]
    return done.returncode == FileError.exit_code and len(done.stderr.splitlines()) == 1 and f"{stream} for " in told


def test_run_from_a_replay_out_of_step_is_refused(tmp_path, monkeypatch):
    text, _ = _captured(tmp_path / "cell", "keyence", laps=1)
    # private _play: a replay is late only on a computer that is held up
    punctual = StreamingPlayer._play

    def late(self: StreamingPlayer, now_ns: int) -> ConversationStep:
        step = punctual(self, now_ns)
        return step if step.send or step.wake_ns is None else replace(step, wake_ns=step.wake_ns + LATE_NS)

    monkeypatch.setattr(StreamingPlayer, "_play", late)  # the robot; a Keyence answers
    run, replay = _replayed(tmp_path / "replayed", text, tmp_path / "cell" / "cell.log")
    assert replay.steps["robot"].seconds_out > 3
    assert _is_refused(_analysed(tmp_path, run), "robot")
