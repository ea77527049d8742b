"""What a maker's reader offers: the targets of a program, and how a remark is written in its language."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.target import Parsed, Texts


@dataclass(frozen=True)
class Remark:
    """begins, ends: of each line of a remark, with {} for the line's number; width: how many characters stand between;
    before: what it stands before in a file of a suffix, in its last place there; it is the last line of other files."""

    begins: str
    ends: str = ""
    width: int = 100
    before: Mapping[str, re.Pattern[bytes]] = field(default_factory=dict)


@dataclass(frozen=True)
class ProgramReader:
    """parse: the targets of the texts of a program; null_tools, null_frames: the tool and the frame that are nothing,
    by their names; of_world: such a frame is the cell's, which is the robot's foot where the arm stands upright;
    beside: the suffixes of files in the directory whose routines and data a program can use."""

    parse: Callable[[Texts], Parsed]
    decimals: Decimals
    remark: Remark
    null_tools: tuple[str, ...] = ()
    null_frames: tuple[str, ...] = ()
    of_world: bool = False
    beside: tuple[str, ...] = ()
