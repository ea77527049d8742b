"""Answers of a daemon, checked by the client before use, because the daemon may have a different version."""

from __future__ import annotations

import json
from typing import Any

from rigs.text import escape_values

LONGEST_ANSWER = 1 << 20
"""The status of a cell with three streams has 3 kB."""
_REFUSAL = {"where", "what", "remedy", "exit_code"}
_REQUIRED = {
    "status": {"rig", "baseline_mm", "streams", "automatic", "recording"},
    "samples": {"now_ns", "streams", "rig_lines"},
    "metrics": {"text"},
    "record_start": {"run"},
    "record_stop": {"run", "counters"},
}
"""Keys of the answer to each command."""


def read_answer(command: str, line: bytes) -> dict[str, Any]:
    """Decode an answer, including `ok`, and sanitise its texts. Raises ValueError if it does not fit the command."""
    try:
        answer = json.loads(line)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if not isinstance(answer, dict) or not isinstance(answer.get("ok"), bool):
        raise ValueError("not an answer")
    required = _REQUIRED.get(command, set()) if answer["ok"] else _REFUSAL
    if missing := sorted(required - answer.keys()):
        raise ValueError(f"{missing[0]} is missing")
    if command == "metrics" and answer["ok"]:
        return answer  # several lines, each sanitised when printed
    plain: dict[str, Any] = escape_values(answer)
    return plain
