"""What is answered so far, kept beside the rig file until that is written, so that a second run goes on.

It is data that a person could have changed: read bounded and checked by the schema, as a rig file is.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from daq.store import durable
from rigs.errors import CellError, FileError
from rigs.files import read_bytes
from rigs.schema.declared_tests import Circle
from rigs.schema.feedback import Feedback
from rigs.schema.gauges import Gauge
from rigs.schema.part import Part
from rigs.schema.robot import Pose

_ENDING = ".init"
_MAX_BYTES = 100_000
_BEGIN_AGAIN = "remove it, and begin again"


class Answers(Part):
    """The answers; None where a question is open."""

    robot_address: str | None = Field(default=None, max_length=300)
    feedback: Feedback | None = None
    gauges: tuple[Gauge, ...] | None = Field(default=None, min_length=1, max_length=2)
    """Gauge 1 and, where there is one, gauge 2; their places on the baseline follow from `baseline_mm`."""
    baseline_mm: Annotated[float, Field(gt=0, le=10_000)] | None = None
    arm: str | None = Field(default=None, max_length=4096)
    tool: Pose | None = None
    tolerance_mm: Annotated[float, Field(ge=0, le=1000)] | None = None
    """Error that the work allows at the ball; 0 where there are to be no limits."""
    circle: Circle | None = None
    circle_later: bool = False

    @property
    def count(self) -> int:
        """How many questions are answered."""
        return len(self.model_fields_set)


def kept_in(rig_file: Path) -> Path:
    """Return where the answers for a rig file are kept."""
    return rig_file.with_name(rig_file.name + _ENDING)


def load_answers(rig_file: Path) -> Answers:
    """Return the answers kept so far; none where nothing is kept. Raises FileError."""
    path = kept_in(rig_file)
    try:
        owner = path.lstat().st_uid
        if owner != os.geteuid():
            raise FileError(str(path), f"belongs to another user (number {owner})", _BEGIN_AGAIN)
        return Answers.model_validate_json(read_bytes(path, _MAX_BYTES))
    except FileNotFoundError:
        return Answers()
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), _BEGIN_AGAIN) from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise FileError(str(path), f"is damaged: {where} {first['msg']}".strip(), _BEGIN_AGAIN) from None


def keep_answers(rig_file: Path, answers: Answers) -> None:
    """Keep the answers, whole or not at all, readable by their owner alone. Raises CellError."""
    path = kept_in(rig_file)
    try:
        durable.replace(path, answers.model_dump_json(exclude_unset=True, indent=1).encode(), 0o600)
    except OSError as error:
        raise CellError(
            str(path), f"cannot be written: {error.strerror or error}", "choose another directory"
        ) from None


def forget_answers(rig_file: Path) -> None:
    """Remove the kept answers."""
    kept_in(rig_file).unlink(missing_ok=True)
