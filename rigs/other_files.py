"""Recognition of files that are not rig files: tables, programs, and the other files that rig writes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigs.errors import FileError
from rigs.text import as_argument

_SEPARATORS = (",", ";", "\t")
_LOOKED_AT = 3
_ARCHIVE = b"PK\x03\x04"
"""First bytes of zip files, and so of workbooks (PKWARE APPNOTE, 4.3.7)."""
_PROGRAMS = (".script", ".urscript", ".ls", ".src", ".mod", ".modx", ".prg", ".jbi", ".ngc", ".nc")
_CALIBRATION = "is a calibration that rig diagnose wrote", "give the rig file next to it, which names the calibration"
_BY_KEYS = (
    (
        {"condition", "accuracy"},
        "is the JSON of a diagnosis",
        "give the rig file that the diagnosis wrote next to it, or the original one",
    ),
    ({"rig_text", "rig_name"}, "is the manifest of a run", "give the directory of the run, or the rig file"),
    ({"format", "terms"}, *_CALIBRATION),
    ({"kinematics"}, "is the kinematics of a controller", "give the rig file, and this file as --calibration {file}"),
    ({"files", "joints"}, "is the column map of a table", "give the rig file, and this file to rig import as --map"),
)
"""Keys that identify a file, its description, and the remedy."""
_EFFECTS = {"effects", "eccentricity_mm", "axes"}
_IS_EFFECTS = (
    "is a file of hidden effects",
    "give the rig file; rig simulate and rig emulate read these effects as --effects {file}",
)


def _error(where: str, fact: str, remedy: str) -> FileError:
    problem = f"{fact}, not a rig file"
    return FileError(where, problem, remedy.format(file=as_argument(where)), code="rig_file.invalid")


def refuse_head(where: str, head: bytes) -> None:
    """Refuse a file by its first bytes, before it is read."""
    if head.startswith(_ARCHIVE):
        raise _error(where, "is a workbook or an archive", "give the rig file; rig import reads tables")
    if head.startswith(b"{") and b'"format"' in head and b'"rig"' in head:
        raise _error(where, *_CALIBRATION)


def refuse_other_texts(text: str, where: str) -> None:
    """Refuse an empty file, XML, a robot program or a table."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("#", "---"))]
    if not lines:
        raise _error(where, "is empty", "create a rig file with rig init cell.yaml")
    begin = lines[0].lstrip().lower()
    if begin.startswith(("<!doctype html", "<html")):
        raise _error(where, "is a page for a browser", "give the rig file")
    if begin.startswith("<"):
        raise _error(where, "is XML", "convert a URDF: rig import-urdf {file} -o arm.yaml")
    if Path(where).suffix.lower() in _PROGRAMS:
        raise _error(where, "is a robot program", "give the rig file, and this file to rig correct as --program {file}")
    for separator in _SEPARATORS:
        columns = lines[0].count(separator)
        is_even = all(line.count(separator) == columns for line in lines[:_LOOKED_AT])
        if columns and is_even and len(lines) > 1 and ":" not in lines[0]:
            names = [name.strip() for name in lines[0].split(separator)]
            shown = ", ".join(names) if columns < 3 else f"{', '.join(names[:3])} …"
            fact = f"is a table of {columns + 1} columns ({shown})"
            raise FileError(
                where,
                f"{fact}, not a rig file",
                f"import the table as a run: rig import {as_argument(where)} --rig RIG --test TEST -o RUN",
                code="rig_file.invalid",
            )


def refuse_other_data(data: Any, where: str) -> None:
    """Refuse the content of a YAML or JSON file that rig writes or reads for another purpose."""
    if not isinstance(data, Mapping) or "robot" in data:
        return
    for keys, fact, remedy in _BY_KEYS:
        if keys <= data.keys():
            raise _error(where, fact, remedy)
    if data and data.keys() <= _EFFECTS:
        raise _error(where, *_IS_EFFECTS)
