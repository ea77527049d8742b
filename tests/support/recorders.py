"""Recorders without their threads, and calls that wait until a test lets them go on."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from daq.acquisition.stream_buffer import StreamBuffer
from daq.recording.active_run import RunLabel
from daq.recording.recorder import Recorder
from daq.store import RunWriter, new_manifest


def recorder_of(runs: Path, buffers: Mapping[str, StreamBuffer], rig_text: str = "", **options: int) -> Recorder:
    """A recorder of these streams. options: of each run writer."""
    columns = {name: buffer.columns for name, buffer in buffers.items()}

    def create(label: RunLabel, follows: str) -> RunWriter:
        about = {"rig_name": "r", "rig_text": rig_text, "streams": columns, "follows": follows}
        return RunWriter.create(runs, new_manifest(**label.model_dump(), **about), **options)

    return Recorder(dict(buffers), create, lambda: None)


class Gate:
    """A call that waits until a test opens the gate."""

    def __init__(self) -> None:
        self.reached, self._open = threading.Event(), threading.Event()

    def before(self, call: Callable[..., Any] = lambda *_: None) -> Callable[..., Any]:
        """The call, which first reports that it is reached and then waits."""

        def held(*arguments: Any) -> Any:
            self.reached.set()
            assert self._open.wait(60)
            return call(*arguments)

        return held

    def open(self) -> None:
        self._open.set()
