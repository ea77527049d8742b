"""Browser actions in a window started with --control. The robot is never commanded."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from pathlib import Path

from analysis.apps.session.child_processes import Child
from analysis.apps.session.session_state import SessionDirectory
from analysis.apps.window.recording_form import RecordingLabel, StartRecording, zeros_at
from analysis.apps.window.watcher import Watcher
from analysis.apps.window.window_check import WindowCheck
from rigs.errors import CellError
from rigs.makers import MAKERS
from rigs.schema.vocabulary import MakerName
from rigs.text import escape_text

_TAIL_BYTES = 4096


class WindowControls:
    def __init__(
        self, watcher: Watcher, place: SessionDirectory | None, rig_file: str, runs: Path = Path("runs")
    ) -> None:
        """place, rig_file: of the session; None and empty if there is no session."""
        self._watcher, self._place, self._rig_file = watcher, place, rig_file
        self.moved = WindowCheck(watcher, runs)
        self._session: Child | None = None
        self._lock = threading.Lock()

    def do(self, action: str, form: Mapping[str, str]) -> str | None:
        """Execute the action of a form. Gives a message; None for an unknown action."""
        watcher = self._watcher
        match action:
            case "start":
                typed = " ".join(form.get(key, "") for key in ("name", "test", "direction"))
                label = RecordingLabel.typed(typed)
                watcher.board.post("label", label.fields())
                return str(watcher.ask("record_start", **StartRecording(label, watcher.zero_mm).request())["run"])
            case "stop":
                return str(watcher.ask("record_stop")["run"])
            case "zero":
                watcher.zero_mm = zeros_at(watcher.view.readings)
            case "unzero":
                watcher.zero_mm = (0.0, 0.0)
            case "restart":
                watcher.view = watcher.view.restarted()
            case "session":
                maker = next((known for known in MAKERS if known == form.get("maker")), None)
                return self._go_on(maker, entered=bool(form.get("entered")))
            case _:
                kind, _, step = action.partition("-")
                return self.moved.do(step, form) if kind == "moved" else None
        return ""

    def session_lines(self) -> list[str]:
        log = self._log
        if log is None or not log.is_file():
            return []
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - _TAIL_BYTES))
            lines = file.read().decode("utf-8", "replace").splitlines()
        return [escape_text(line) for line in lines[-30:]]

    def close(self) -> None:
        with self._lock:
            if self._session is not None:
                self._session.stop()

    @property
    def _log(self) -> Path | None:
        return self._place.directory / "window.log" if self._place else None

    def _go_on(self, maker: MakerName | None, *, entered: bool) -> str:
        if self._place is None or self._log is None:
            remedy = "start rig window CELL --control"
            raise CellError("rig window", "was started without a cell", remedy, code="rig_file.invalid")
        with self._lock:
            if self._session is not None and self._session.runs:
                problem, remedy = "this session is already running", "see the messages of the session"
                raise CellError(str(self._place.directory), problem, remedy, code="session.in_use")
            kept = self._place.read()
            words = ["session", self._rig_file, "-o", str(self._place.directory)]
            chosen = kept.maker if kept else maker
            words += ["--for", chosen] if chosen else []
            words += ["--emulated"] if kept and kept.emulated else []
            words += ["--entered"] if entered else []
            self._session = Child.start("analysis.cli", "rig", words, self._log)
        return f"rig {' '.join(words)}"
