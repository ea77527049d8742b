"""The recorder and the store on a real disk, driven at random: each reading is in one run, or counted, once.

The two threads of the disk are driven by hand, so that every order of what they do and of what people do can come.
"""

import errno
import shutil
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pytest
from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule, run_state_machine_as_test

import daq.recording.io_worker
from daq.acquisition.stream_buffer import StreamBuffer
from daq.protocol.conversation import Sample
from daq.recording.active_run import RunLabel
from daq.recording.machine import Beginning, RecordingRequest, Waiting
from daq.store import load_manifest, read_run, recover, verify
from rigs.errors import CellError
from tests.support.failing_disk import COLUMNS, failing
from tests.support.nightly import cases
from tests.support.recorders import recorder_of

MINE = RecordingRequest(RunLabel(name="mine", test="yaw", direction="cw"))
THEIRS = RecordingRequest(RunLabel(name="theirs", test="yaw", direction="acw"), "robot")


class ByHand:
    """An executor whose work is done when a test says so, a piece at a time and in order."""

    def __init__(self) -> None:
        self._work: deque[tuple[Future[Any], Callable[[], Any]]] = deque()

    def submit(self, work: Callable[[], Any]) -> Future[Any]:
        future: Future[Any] = Future()
        self._work.append((future, work))
        return future

    @property
    def has_work(self) -> bool:
        return bool(self._work)

    def go_on(self) -> bool:
        if not self._work:
            return False
        future, work = self._work.popleft()
        try:
            future.set_result(work())
        except OSError as error:  # of a sync; an error in the program is not caught
            future.set_exception(error)
        return True


class Recordings(RuleBasedStateMachine):
    """Readings come, people and the robot start and stop, and the disk works, fails and is back."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="rig-recorder-"))
        self.buffers = {name: StreamBuffer(name, columns) for name, columns in COLUMNS.items()}
        self.recorder = recorder_of(self.folder, self.buffers, chunk_rows=20)
        # private _io, _thread, _creator, _round: the test takes the place of the recorder's threads
        self.recorder._io.shut_down()
        self.disk, self.creator = ByHand(), ByHand()
        self.recorder._io._thread, self.recorder._io._creator = self.disk, self.creator
        self.failing = ExitStack()
        self.fails = False
        self.delivered = self.waiting = self.taken = 0
        """Readings of each stream: delivered in total, not yet drained, and drained during a recording."""
        self.deliver()
        self._start(MINE)

    def _drained(self) -> None:
        self.taken += self.waiting if self.recorder.recording else 0
        self.waiting = 0

    @rule()
    def deliver(self) -> None:
        now = time.monotonic_ns()
        for buffer in self.buffers.values():
            buffer.deliver([Sample((float(self.delivered + i),), now, now, now, 8) for i in range(10)])
        self.delivered += 10
        self.waiting += 10

    @rule(works=st.sampled_from((True, True, False)))
    def go_round(self, works: bool) -> None:
        """Readings and a round, in which a pause is over; then the disk does all that it was asked, or nothing."""
        self.deliver()
        self._drained()
        # private _state, _runs: the machine's own state decides what may be done next
        state = self.recorder._state
        if isinstance(state.phase, Waiting):
            self.recorder._state = replace(state, phase=replace(state.phase, due_s=0.0))
        self.recorder._round()
        while works and (self.creator.has_work or self.disk.has_work):
            self.the_disk_makes_a_run()
            self.the_disk_goes_on()

    @rule()
    def the_disk_goes_on(self) -> None:
        self.disk.go_on()

    @rule()
    def the_disk_makes_a_run(self) -> None:
        self.creator.go_on()

    @rule(recording=st.sampled_from((MINE, THEIRS)), stops=st.sampled_from((False, False, True)))
    def ask(self, recording: RecordingRequest, stops: bool) -> None:
        if stops:
            self._stop(recording.by)
        else:
            self._start(recording)

    def _start(self, recording: RecordingRequest) -> None:
        before = self.recorder._state
        with suppress(CellError):
            self.recorder.start_run(recording)
            assert before.recording is None or (recording is MINE and before.recording is THEIRS) or self._lost(before)
            self.taken += self.waiting if before.recording else 0
            self.waiting = 0

    def _lost(self, before: Any) -> bool:
        return isinstance(before.phase, Waiting) or before.phase.pause_s > 0

    def _stop(self, by: Literal["person", "robot"]) -> None:
        self._drained()
        before = self.recorder._state
        with suppress(CellError):
            self.recorder.stop_run(by=by)
        assert by == "person" or before.recording is not MINE or self.recorder.recording is MINE  # people come first

    @precondition(lambda self: not self.fails)
    @rule()
    def the_disk_fails(self) -> None:
        self.fails = True
        self.failing.enter_context(failing(errno.EIO, "pwrite", "fsync", "mkdir"))

    @precondition(lambda self: self.fails)
    @rule()
    def the_disk_is_back(self) -> None:
        self.fails = False
        self.failing.close()

    @precondition(lambda self: not self.fails)
    @rule()
    def a_recording_chunk_vanishes(self) -> None:
        # private _writers: the files that are written, one of which vanishes
        writers = [run.writer._writers["g1"] for run in self.recorder._runs.values() if run.writer]
        for chunk in [chunk for writer in writers for chunk in writer.unclosed()][-1:]:
            chunk.path.unlink(missing_ok=True)

    def teardown(self) -> None:
        self.failing.close()
        self.fails = False
        try:
            self._end()
        finally:
            shutil.rmtree(self.folder)

    def _end(self) -> None:
        """The disk is well: what waits goes on, all is stopped, and every reading is accounted for."""
        for _ in range(4):
            self.go_round(works=True)
        assert not isinstance(self.recorder._state.phase, Waiting | Beginning)  # it goes on when the disk is back
        self._stop("person")
        while self.disk.go_on():
            pass
        self.go_round(works=True)
        assert not self.recorder._runs and self.recorder.recording is None  # nothing is left open
        self._account()

    def _account(self) -> None:
        held: dict[str, Counter[int]] = {stream: Counter() for stream in COLUMNS}
        dropped: Counter[str] = Counter()
        for path in self.folder.iterdir():
            recover(path)  # as the next start does, where the disk failed at the end
            assert verify(path) == [] and load_manifest(path).is_sealed
            for stream, (column,) in COLUMNS.items():
                held[stream].update(read_run(path).streams[stream][column].astype(int).tolist())
                dropped[stream] += load_manifest(path).counters.get(stream, {}).get("dropped", 0)
        for stream, found in held.items():
            assert max(found.values(), default=1) == 1  # no reading is in two runs
            lost = self.recorder.losses.counts
            count = found.total() + dropped[stream] + lost[stream]
            assert count == self.taken, (stream, count, self.taken, found.total(), dict(dropped), lost)


@pytest.mark.parametrize("examples", cases((20, 300), {20}))
def test_each_reading_is_in_one_run_or_counted(monkeypatch, examples):
    # private: a sync at every round
    monkeypatch.setattr(daq.recording.io_worker, "_SYNC_S", 0.0)
    tried = (Phase.explicit, Phase.reuse, Phase.generate)  # to shrink a failure takes minutes, its steps are printed
    few = settings(max_examples=examples, stateful_step_count=40, phases=tried)
    run_state_machine_as_test(Recordings, settings=few)
