"""The latest samples of every stream, for a live view: one bounded answer, whatever the rates.

A view asks some ten times a second and names the last sample that it has of each stream. It gets at most `MOST` newer
ones, evenly thinned, since encoding takes processor time from the readers: an answer of three streams takes 0.35 ms on
a busy computer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, ValidationError

from daq import clock
from daq.acquisition.stream_buffer import StreamBuffer
from rigs.errors import CellError
from rigs.schema.part import Part

MOST = 20
"""Samples of a stream in an answer; at ten answers a second more than a screen can show."""
_DIGITS = 7
"""Decimals: 0.1 nm and a ten millionth of a degree."""
_LONGEST_RIG = 500_000
"""Characters of a rig file that are passed on, so that an answer stays below its limit; shipped ones have 4000."""


class _Request(Part):
    """after: stream → number of the last sample that the client has; rig: whether it needs the rig file."""

    command: str
    after: dict[str, Annotated[int, Field(ge=0)]] = Field(default={}, max_length=64)
    rig: bool = False


def recent_samples(request: Mapping[str, Any], buffers: Mapping[str, StreamBuffer], rig_text: str) -> dict[str, Any]:
    """Return the answer to a `samples` request. Raises CellError for a request that is not valid."""
    try:
        asked = _Request.model_validate(request)
    except ValidationError as error:
        problem = f"a samples request is not valid: {error.errors(include_url=False)[0]['msg']}"
        raise CellError("control socket", problem, 'send {"command": "samples", "after": {"g1": 0}}') from None
    streams = {name: _stream(buffer, asked.after.get(name, 0)) for name, buffer in buffers.items()}
    text = rig_text if asked.rig and len(rig_text) <= _LONGEST_RIG else ""
    return {"now_ns": clock.now_ns(), "streams": streams, "rig_lines": text.splitlines()}


def _stream(buffer: StreamBuffer, after: int) -> dict[str, Any]:
    """Number of the newest sample, the columns, and of the samples after `after` [first_byte_ns, value, …] each."""
    newest, samples = buffer.recent(after)
    step = max(1, math.ceil(len(samples) / MOST))
    thinned = samples[::-1][::step][::-1]  # the newest is always among them
    return {
        "newest": newest,
        "columns": list(buffer.columns),
        "rows": [
            [
                sample.first_byte_ns,
                *(round(value, _DIGITS) if math.isfinite(value) else None for value in sample.values),
            ]
            for sample in thinned
        ],
    }
