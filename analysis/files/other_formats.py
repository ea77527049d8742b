"""Files that are no table, and what to do with each: a person gives what a controller or a recorder has written."""

from __future__ import annotations

from analysis.arms.ur_calibration import ROS_KINEMATICS
from analysis.traces.table_layout import LAYOUTS
from rigs.errors import FileError
from rigs.schema.part import TestName
from rigs.text import as_argument

_BEGINNINGS = (
    (b"\xff\xfe", "is UTF-16", "save it as UTF-8"),
    (b"\xfe\xff", "is UTF-16", "save it as UTF-8"),
    (b"PAR1", "is a Parquet file", "give the table as CSV"),
    (b"#ROSBAG", "is a bag of ROS 1", "convert it to MCAP: rosbags-convert --src {file} --dst BAG --dst-storage mcap"),
    (b"\x28\xb5\x2f\xfd", "is compressed (zstd)", "unpack it first: zstd -d {file}"),
    (b"\x1f\x8b", "is compressed (gzip)", "unpack it first: gunzip -k {file}"),
    (b"\x04\x22\x4d\x18", "is compressed (lz4)", "unpack it first: lz4 -d {file}"),
    (b"PK\x03\x04", "is a workbook or a zip file", "save the table as CSV, or unpack the file first"),
    (b"\xd0\xcf\x11\xe0", "is a workbook of an old Excel", "save the table as CSV"),
    (b"%PDF", "is a PDF", "give the table as CSV"),
)
"""What a file begins with that is no text, what it is, and what to do."""


def refuse_other_formats(where: str, data: bytes) -> None:
    """Raise FileError for the bytes of a file that is known to be no table."""
    for magic, what, remedy in _BEGINNINGS:
        if data.startswith(magic):
            raise FileError(where, what, remedy.format(file=as_argument(where)))
    if data.lstrip().startswith(ROS_KINEMATICS.encode()):
        what = "is the kinematics of an arm, as ur_calibration of ROS writes it, and no table of measurements"
        raise FileError(where, what, "for the arm, give calibration.conf of the controller: rig arms ARM --calibration")


def refuse_comments(where: str, data: bytes, test: TestName) -> None:
    """Raise FileError for a table that begins with lines of comment; its header may be the last of them."""
    lines = data.decode("utf-8-sig").splitlines()
    count = next((number for number, line in enumerate(lines) if not line.startswith("#")), len(lines))
    names = {name.strip() for name in lines[count - 1].lstrip("# ").split(",")}
    file = as_argument(where)
    if len(names & set(LAYOUTS[test].required)) > 1:
        before = f"1,{count - 1}d; " if count > 1 else ""
        what = f"has its header in line {count} behind a #, which makes it a comment"
        raise FileError(where, what, f"take it off: sed '{before}s/^# *//' {file} > TABLE.csv")
    comment = "a line" if count == 1 else f"{count} lines"
    raise FileError(where, f"begins with {comment} of comment (#)", f"leave them out: sed '/^#/d' {file} > TABLE.csv")
