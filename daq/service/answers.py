"""What a daemon answers, as far as a client uses it: held against these shapes before anything of it is shown.

Anybody may have bound the socket, and a daemon of another version may know more or less: what is missing or of another
kind is one line instead of a traceback, what is more is passed on. Every text in an answer is plain (`rigs.text`).
"""

from __future__ import annotations

import json
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from rigs.text import plain_values

LONGEST_ANSWER = 1 << 20
"""Bytes of a line; the status of a cell with three streams has 3 kB."""
Number = Annotated[float, Field(strict=True)]


class _Answer(BaseModel):
    model_config = ConfigDict(extra="allow", defer_build=True)


class Refusal(_Answer):
    """An error of the daemon in its parts."""

    where: str
    what: str
    remedy: str
    exit_code: Annotated[int, Field(ge=1, le=125)]


class Started(_Answer):
    """A recording has begun."""

    run: str


class Stopped(_Answer):
    """A recording has ended. seal: SHA-256 of its ledger; empty of an older daemon."""

    run: str
    counters: dict[str, dict[str, int]]
    seal: str = ""


class Metrics(_Answer):
    """The text for Prometheus."""

    text: str


class StreamStatus(_Answer):
    """A stream of samples now. last: of each column the last good value; age_s: the time since then."""

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


class AutomaticStatus(_Answer):
    """What the automat waits for, and why it did not start."""

    waits_for: list[str]
    why_not: str


class StreamSamples(_Answer):
    """The latest samples of a stream. rows: stamp in ns, then a value for each column, None where there is none."""

    newest: int
    columns: list[str]
    rows: list[list[Number | None]]

    @model_validator(mode="after")
    def _of_one_width(self) -> StreamSamples:
        if any(len(row) != 1 + len(self.columns) or row[0] is None for row in self.rows):
            raise ValueError("a row has another number of values than there are columns, or no stamp")
        return self


class Samples(_Answer):
    """The latest samples of all streams."""

    now_ns: Number
    streams: dict[str, StreamSamples]
    rig_lines: list[str]


class NotRecording(_Answer):
    """Nothing is recorded. missed: samples of each stream since a recording waits for the disk."""

    recording: None
    last_end: str | None
    missed: dict[str, int] = {}


class Recording(_Answer):
    """What is recorded."""

    recording: str
    test: str
    direction: str | None
    seconds: Number


class Status(_Answer):
    """Everything that the daemon reads now."""

    rig: str
    baseline_mm: Number | None
    streams: dict[str, StreamStatus]
    automatic: AutomaticStatus | None


_OF_COMMAND: dict[str, type[_Answer]] = {
    "status": Status,
    "samples": Samples,
    "metrics": Metrics,
    "record_start": Started,
    "record_stop": Stopped,
}


def read_answer(command: str, line: bytes) -> dict[str, Any]:
    """Return an answer, `ok` and all, with plain texts. Raises ValueError where it is not one of this command."""
    try:
        answer = json.loads(line)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if not isinstance(answer, dict) or not isinstance(answer.get("ok"), bool):
        raise ValueError("not an answer")
    shapes: list[type[_Answer]] = [_OF_COMMAND.get(command, _Answer) if answer["ok"] else Refusal]
    if command == "status" and answer["ok"]:
        shapes.append(NotRecording if answer.get("recording") is None else Recording)
    try:
        for shape in shapes:
            shape.model_validate(answer)
    except ValidationError as error:
        detail = error.errors(include_url=False, include_input=False, include_context=False)[0]
        raise ValueError(f"{'.'.join(map(str, detail['loc']))}: {detail['msg']}") from None
    if command == "metrics" and answer["ok"]:
        return answer  # of several lines, each of which is plain where it is printed
    plain: dict[str, Any] = plain_values(answer)
    return plain
