"""The interface of the reader of a maker: the targets of a program, and the format of remarks."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.target import Parsed, ProgramTexts


@dataclass(frozen=True)
class Remark:
    """The format of a remark.

    begins, ends: of each line, with {} for the line number. width: maximum characters between them. before: pattern, by
    file suffix, of the last text that the remark precedes; in other files the remark is the last line.
    """

    begins: str
    ends: str = ""
    width: int = 100
    before: Mapping[str, re.Pattern[bytes]] = field(default_factory=dict)


@dataclass(frozen=True)
class ProgramReader:
    """The reader of a maker.

    parse: returns the targets of the texts of a program. null_tools, null_frames: names of the tool and frame that are
    the identity. of_world: the null frame is the world frame of the cell, which equals the robot's foot if the arm is
    upright. beside: suffixes of files in the directory whose routines and data a program can use. backup: pattern of
    the name, in upper case, of the directory of a controller's backup that contains all files that a program can use.
    is_together: the programs of a directory are one program, because they share points and routines. is_of_maker:
    whether a file, by its path in the backup, is delivered by the maker and is not corrected. empty: text of a file
    with an empty routine, {0} for the name; no text if the language has no such files.
    """

    parse: Callable[[ProgramTexts], Parsed]
    decimals: Decimals
    remark: Remark
    null_tools: tuple[str, ...] = ()
    null_frames: tuple[str, ...] = ()
    of_world: bool = False
    beside: tuple[str, ...] = ()
    backup: str = "(?!)"
    is_together: bool = False
    is_of_maker: Callable[[str], bool] = lambda _: False
    empty: str = ""
