import re

import pytest

from analysis.apps.interchange.bags import MCAP_MAGIC as MAGIC
from analysis.intake.read import parse_csv, read_file
from analysis.intake.table_files import MOST_BYTES
from rigs.errors import FileError
from rigs.schema.vocabulary import Direction, TestName
from tests.support.refusals import refused
from tests.support.table_cases import RIG_FILE, circle_values, csv_text, plain, rig, rows_of, texts
from tests.support.written_runs import import_table


def refusal(text: str, test: TestName, direction: Direction | None = None) -> list[str]:
    with pytest.raises(FileError) as caught:
        parse_csv(text.encode(), "t.csv", test, rig(), direction)
    assert all("\n" not in line for line in caught.value.lines())
    assert "\n" not in str(caught.value)
    return caught.value.lines()


def with_cell(test: TestName, column: str, row: int, cell: str) -> str:
    rows = {name: list(cells) for name, cells in plain(test).items()}
    rows[column][row] = cell
    return csv_text(rows)


CELLS = """\
yaw|g1_mm||is empty; fill in the value or remove the row
roll|q3_deg|12,5|'12,5' is written with a decimal comma; write 12.5
radial|polar_deg|nan|'nan' is not a finite number
pose|x_mm|-Inf|'-Inf' is not a finite number
pose|x_mm|NaN(ind)|'NaN(ind)' is not a finite number
pose|rx_deg|1_000|'1_000' is not a number
pose|rx_deg|٣|'٣' is not a number
pose|rx_deg|12 mm|'12 mm' is not a number
pose|rx_deg|ERR0|'ERR0' is not a number
pose|x_mm|1e300|'1e300' is too large for a measured value; check the unit
pose|x_mm|1e999|'1e999' is too large for a measured value; check the unit
radial|target|0|'0' is not a positive integer: 1, 2, 3, …
radial|orientation|-1|'-1' is not a positive integer: 1, 2, 3, …
repeatability|round|1.5|'1.5' is not a positive integer: 1, 2, 3, …
repeatability|target|99999999999999999999|'99999999999999999999' is not a positive integer: 1, 2, 3, …
repeatability|approach|outside|'outside' is not none, out or in; did you mean out?
repeatability|approach|x|'x' is not none, out or in
yaw|direction|ccw|'ccw' is not acw or cw; did you mean acw?
yaw|direction|CW|'CW' is not acw or cw; did you mean cw?"""


@pytest.mark.parametrize(("test", "column", "cell", "reason"), [row.split("|") for row in CELLS.splitlines()])
def test_a_bad_cell_is_named(test, column, cell, reason):
    assert refusal(with_cell(test, column, 4, cell), test) == [f"t.csv, line 6, {column}: {reason}; correct the file"]


def test_a_table_of_an_arm_with_another_joint_is_refused():
    rows = plain("pose")
    rows["q7_deg"] = ["0"] * len(rows["x_mm"])
    (line, *_) = refusal(csv_text(rows), "pose")
    assert line.startswith("t.csv, line 1, q7_deg: ") and "7 joints" in line


def test_same_mistake_in_many_rows_is_reported_once():
    rows = {name: list(cells) for name, cells in plain("pose").items()}
    rows["y_mm"], rows["x_mm"][3] = ["?"] * len(rows["y_mm"]), "?"
    told = refusal(csv_text(rows), "pose")
    assert (
        told[0].startswith("t.csv, line 2, y_mm: '?'")
        and f"3, 4, 5, 6, 7, 8 and {len(rows['y_mm']) - 7} more" in told[0]
    )
    assert told[1].startswith("t.csv, line 5, x_mm: '?' ")


def test_lines_are_those_an_editor_shows():
    rows = rows_of("pose")  # its extra columns hold line ends
    rows["x_mm"] = [*rows["x_mm"][:-1], "?"]
    text = csv_text(rows)
    assert refusal(text, "pose")[0].startswith(f"t.csv, line {_line_of(text)}, x_mm: '?' ")


def _line_of(text: str) -> int:
    """Line of the row with the question mark, whose cells contain no line ends."""
    before = text[: text.index('"?"')].replace("\r", "\n")
    return before.count("\n") + 1


def test_time_must_grow():
    (line,) = refusal(with_cell("roll", "t_s", 5, "0.4"), "roll")
    assert line.startswith("t.csv, line 7, t_s: ") and "0.4 after 0.4" in line
    assert "0 after 5.1" in refusal(with_cell("repeatability", "t_s", 4, "0"), "repeatability")[0]


def test_one_file_holds_one_direction():
    (line,) = refusal(with_cell("yaw", "direction", 9, "cw"), "yaw")
    assert line.startswith("t.csv, line 11, direction: cw after")


def test_the_direction_of_the_command():
    text = csv_text(plain("yaw", "cw"))
    assert "leave --direction" in refusal(text, "yaw", "acw")[0]
    assert parse_csv(text.encode(), "t.csv", "yaw", rig(), "cw").num_rows
    (line,) = refusal(csv_text(plain("radial")), "radial", "cw")
    assert line.startswith("t.csv: ") and "--direction" in line
    rows = plain("yaw")
    del rows["direction"]
    line = refusal(csv_text(rows), "yaw")[0]
    assert line.startswith("t.csv, line 1, direction: ") and "--direction" in line


def test_joints_that_jump():
    q4 = plain("yaw")["q4_deg"]
    told = refusal(with_cell("yaw", "q4_deg", 50, repr(float(q4[50]) - 60)), "yaw")
    assert len(told) == 1  # the good row after a bad one is not blamed
    assert re.search(r"line 52, q4_deg: jumps by -\d+\.?\d*° in 0\.1 s;", told[0])
    rows = plain("yaw")
    rows["q4_deg"] = [repr(float(cell) - 360 * (k >= 60)) for k, cell in enumerate(q4)]
    (line,) = refusal(csv_text(rows), "yaw")
    assert re.search(r"line 62, q4_deg: jumps by -3\d\d\.?\d*° in 0\.1 s: a full turn", line)
    slow = rows | {"t_s": texts(circle_values("yaw", "acw")[0] * 100)}
    assert "line 62, q4_deg" in refusal(csv_text(slow), "yaw")[0]


def test_columns_missing_or_misnamed():
    def told(test: TestName, change: dict[str, str | None]) -> list[str]:
        rows = {change.get(name, name): cells for name, cells in plain(test).items()}
        return refusal(csv_text({name: cells for name, cells in rows.items() if name is not None}), test)

    scaled, named = told("yaw", {"g1_mm": "g1_um", "g2_mm": "G2 [inch]"})
    assert scaled.startswith("t.csv, line 1, g1_mm: ") and "'g1_um'" in scaled and "by 0.001" in scaled
    assert named.startswith("t.csv, line 1, g2_mm: ") and "'G2 [inch]'" in named and "g1_mm,g2_mm;" in named
    absent, misspelt = told("yaw", {"q3_deg": "q3_dge", "g2_mm": None})
    assert absent.startswith("t.csv, line 1, g2_mm: ") and "two gauges" in absent
    assert misspelt.startswith("t.csv, line 1, q3_deg: ") and "'q3_dge'" in misspelt
    assert "is 'q1_rad' meant? Then rename" in told("pose", {"q1_deg": "q1_rad"})[0]
    assert "round: this" in told("repeatability", {"round": None})[0]
    assert "rx_deg and rz_deg" in told("pose", {"ry_deg": None})[0]


def test_another_separator():
    text = csv_text(plain("pose")).replace('"', "")
    other = text.replace(",", ";").replace(".", ",")
    (line,) = refusal(other, "pose")
    assert "semicolons" in line and line.endswith("sed 'y/,;/.,/' t.csv > TABLE.csv")
    converted = other.translate(str.maketrans(",;", ".,")).encode()
    assert parse_csv(converted, "t.csv", "pose", rig()).num_rows  # the remedy works
    assert "by tabs" in refusal(text.replace(",", "\t"), "pose")[0]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "is empty"),
        (b"\n\n", "is empty"),
        (csv_text(plain("pose")).encode("utf-16"), "is UTF-16"),
        (csv_text(plain("pose")).encode() + "\nµ".encode("latin-1"), "line 27 is not UTF-8"),
        (b"PAR1....PAR1", "Parquet"),
        (b"SQLite format 3\0....", "is a bag"),
        (MAGIC, "is a bag"),
        (csv_text(plain("pose")).encode().replace(b"deg", b"\0eg"), "zero bytes"),
        (csv_text({name: [] for name in plain("pose")}).encode(), "no rows"),
        (b"\n".join(csv_text(plain("pose")).encode().replace(b'"', b"").splitlines()[1:]), "lacks a header line"),
        (csv_text(plain("pose")).encode()[:-2], "cannot be split into fields: .*; check the quotes"),
        (csv_text(plain("pose")).encode().replace(b'"', b"")[:-20], "the header 12; is the line cut off"),
    ],
)
def test_a_file_that_is_no_table(tmp_path, data, reason):
    (tmp_path / "t.csv").write_bytes(data)
    with pytest.raises(FileError, match=reason):
        read_file(tmp_path / "t.csv", "pose", rig())


def test_a_file_that_is_not_there(tmp_path):
    for path in (tmp_path / "none.csv", tmp_path / "a\0b"):
        with refused("file.unreadable"):
            read_file(path, "pose", rig())
    with refused("file.invalid", "is a directory"):
        read_file(tmp_path, "pose", rig())


def test_oversized_bag_names_the_topics_to_keep(tmp_path):
    with (tmp_path / "large.mcap").open("wb") as file:
        file.write(MAGIC)
        file.truncate(MOST_BYTES + 1)
    with refused("file.too_large", "is a bag of more than"):
        read_file(tmp_path / "large.mcap", "yaw", rig())


@pytest.mark.parametrize("test", ["yaw", "radial", "repeatability"])
def test_constant_gauge_is_reported_at_import(tmp_path, test):
    rows = plain(test)
    (tmp_path / "t.csv").write_text(csv_text(rows | {"g1_mm": ["0"] * len(rows["g1_mm"])}))
    doubts = import_table(tmp_path / "t.csv", tmp_path / "r", rig_file=RIG_FILE, test=test, direction=None, operator="")
    assert any("g1_mm reads 0 mm" in doubt for doubt in doubts), doubts
