"""The interface of the reader of a maker: the targets of a program, and the format of remarks."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.target import Parsed, ProgramTexts
from rigs.schema.robot import Robot


@dataclass(frozen=True)
class Remark:
    begins: str
    """Begin of each line, with {} for the line number."""
    ends: str = ""
    width: int = 100
    before: Mapping[str, re.Pattern[bytes]] = field(default_factory=dict)
    """By file suffix, pattern of the last text that the remark precedes; in other files the remark is the last line."""


@dataclass(frozen=True)
class ProgramReader:
    parse: Callable[[ProgramTexts], Parsed]
    decimals: Decimals
    remark: Remark
    null_tools: tuple[str, ...] = ()
    null_frames: tuple[str, ...] = ()
    shifts_only: bool = False
    """True if the controller adds the angles of a frame to those of a pose, so that rig knows only shifted frames."""
    of_world: bool = False
    """True if the null frame is the world of the cell, which equals the robot's foot if the arm is upright."""
    beside: tuple[str, ...] = ()
    """Suffixes of files in the directory whose routines and data a program can use."""
    backup: str = "(?!)"
    """Pattern of the name, in upper case, of a directory of a backup with all files that a program can use."""
    tables: tuple[str, ...] = ()
    """Names, in lower case, of the files of a backup with the tools and frames of the controller."""
    other_arm: Callable[[ProgramTexts, Robot], str] = lambda _, __: ""
    """Explains why the files belong to another arm than a robot; empty if they fit or state no arm."""
    is_together: bool = False
    """True if the programs of a directory are one program, because they share points and routines."""
    is_of_maker: Callable[[str], bool] = lambda _: False
    """True for a file, by its path in the backup, that the maker delivers: it is not corrected."""
    empty: str = ""
    """Text of a file with an empty routine {0}; none if the language has no such files."""
