"""Answers of a daemon, validated by the client before use.

A different program may have bound the socket, and the daemon may have a different version. A missing or invalid value
is an error of one line; additional values are passed on. All texts are sanitised (`rigs.text`).
"""

from __future__ import annotations

import json
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from rigs.text import plain_values

LONGEST_ANSWER = 1 << 20
"""The status of a cell with three streams has 3 kB."""
Number = Annotated[float, Field(strict=True)]


class _DaemonAnswer(BaseModel):
    model_config = ConfigDict(extra="allow", defer_build=True)


class Refusal(_DaemonAnswer):
    """Error of the daemon. code: empty from an older daemon."""

    where: str
    what: str
    remedy: str
    exit_code: Annotated[int, Field(ge=1, le=125)]
    code: str = ""


class Started(_DaemonAnswer):
    run: str


class RecordingEnded(_DaemonAnswer):
    """seal: SHA-256 of the ledger, empty from an older daemon."""

    run: str
    counters: dict[str, dict[str, int]]
    seal: str = ""


class Metrics(_DaemonAnswer):
    text: str


class StreamStatus(_DaemonAnswer):
    """State of a sample stream: last valid value and its age by column."""

    connected: bool
    rate_hz: Number
    counters: dict[str, int]
    last: dict[str, Number]
    age_s: dict[str, Number]
    last_fault: str

    @model_validator(mode="after")
    def _of_one_age(self) -> StreamStatus:
        if self.last.keys() != self.age_s.keys():
            raise ValueError("last and age_s have different columns")
        return self


class AutomaticStatus(_DaemonAnswer):
    waits_for: list[str]
    why_not: str


class StreamSamples(_DaemonAnswer):
    """Latest samples of a stream. rows: timestamp in ns, followed by a value per column or None."""

    newest: int
    columns: list[str]
    rows: list[list[Number | None]]

    @model_validator(mode="after")
    def _of_one_width(self) -> StreamSamples:
        if any(len(row) != 1 + len(self.columns) or row[0] is None for row in self.rows):
            raise ValueError("a row has a different number of values than there are columns, or no stamp")
        return self


class LatestSamples(_DaemonAnswer):
    now_ns: Number
    streams: dict[str, StreamSamples]
    rig_lines: list[str]


class NotRecording(_DaemonAnswer):
    """missed: samples per stream missed while a recording waits for the disk."""

    recording: None
    last_end: str | None
    missed: dict[str, int] = {}


class Recording(_DaemonAnswer):
    recording: str
    test: str
    direction: str | None
    seconds: Number


class Status(_DaemonAnswer):
    rig: str
    baseline_mm: Number | None
    streams: dict[str, StreamStatus]
    automatic: AutomaticStatus | None


_OF_COMMAND: dict[str, type[_DaemonAnswer]] = {
    "status": Status,
    "samples": LatestSamples,
    "metrics": Metrics,
    "record_start": Started,
    "record_stop": RecordingEnded,
}


def read_answer(command: str, line: bytes) -> dict[str, Any]:
    """Decode an answer, including `ok`, and sanitise its texts. Raises ValueError if it does not fit the command."""
    try:
        answer = json.loads(line)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if not isinstance(answer, dict) or not isinstance(answer.get("ok"), bool):
        raise ValueError("not an answer")
    shapes: list[type[_DaemonAnswer]] = [_OF_COMMAND.get(command, _DaemonAnswer) if answer["ok"] else Refusal]
    if command == "status" and answer["ok"]:
        shapes.append(NotRecording if answer.get("recording") is None else Recording)
    try:
        for shape in shapes:
            shape.model_validate(answer)
    except ValidationError as error:
        detail = error.errors(include_url=False, include_input=False, include_context=False)[0]
        raise ValueError(f"{'.'.join(map(str, detail['loc']))}: {detail['msg']}") from None
    if command == "metrics" and answer["ok"]:
        return answer  # several lines, each sanitised when printed
    plain: dict[str, Any] = plain_values(answer)
    return plain
