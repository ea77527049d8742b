"""The label of a recording: its name, its test, and who measures."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from daq.store.manifest import DrivenWith, Operator, Placement, ViewZero
from rigs.schema.part import Part
from rigs.schema.vocabulary import Direction, TestName

NAME_RULE = "use up to 64 letters, digits, . _ and -, a letter or digit first"


class Label(Part):
    """What a person enters about a recording when it starts."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
    test: TestName
    direction: Direction | None = None
    operator: Operator = ""
    placement: Placement = ""
    corrected: DrivenWith = ""
    view_zero_mm: ViewZero | None = None
