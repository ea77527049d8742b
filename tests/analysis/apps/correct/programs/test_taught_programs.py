"""Points that a hand taught on arms with hidden errors, before and after changes of arm and controller."""

import datetime as dt
import json

import numpy as np
import pytest

from analysis.apps.correct.entered_values import values_in
from analysis.apps.correct.stated_points import Exceptions, StatedPoints, computed_points, points_of
from analysis.correction.point_origins import ChangedArm, ConvertedPoints, ReadingChange, UnchangedPoints
from rigs.effects import EffectProvenance, JointOffset, turned
from tests.analysis.apps.correct.programs.cells import left_names
from tests.analysis.apps.correct.programs.taught_cells import MAKERS, taught_cell
from tests.support.refusals import refused
from tests.worlds.languages import arms

ZEROS_DEG = np.array([0.0, -0.08, 0.15, 0.05, -0.1, 0.0])
ROUNDED_MM = {"fanuc": 0.004, "yaskawa": 0.008, "kuka": 0.001, "abb": 0.003, "ur": 0.001, "linuxcnc": 0.001}
"""Twice the rounding by the decimals of each language."""
for_every_maker = pytest.mark.parametrize("maker", MAKERS)


def stated(origin) -> StatedPoints:
    return StatedPoints(origin, computed_points(origin.then).origin, Exceptions("--computed"))


@for_every_maker
def test_taught_points_without_a_change_keep_their_bytes(maker, tmp_path, monkeypatch):
    cell = taught_cell(maker, monkeypatch)
    found = cell.corrected(tmp_path, stated(UnchangedPoints(cell.rig)))
    assert found.files == cell.given and found.is_right
    assert not found.names and not found.left and len(found.groups[0].names) >= 2


@for_every_maker
def test_taught_points_corrected_as_computed_miss_the_part(maker, tmp_path, monkeypatch):
    cell = taught_cell(maker, monkeypatch)
    found = cell.corrected(tmp_path, computed_points(_with_hidden(cell)))
    assert cell.off_mm(found.files).max() > 0.1
    assert cell.off_mm(cell.given).max() == 0


def _with_hidden(cell):
    """Rig of the cell with an error in the file, if the cell has none."""
    found = EffectProvenance(date=dt.date(2026, 11, 20), runs=("r",), sd={"offset_deg": 0.002})
    return cell.rig.model_copy(
        update={"effects": cell.rig.effects or (JointOffset(axis=3, offset_deg=0.05, found=found),)}
    )


@for_every_maker
def test_converted_points_keep_the_tool_at_its_taught_places(maker, tmp_path, monkeypatch):
    cell = taught_cell(maker, monkeypatch)
    if maker == "ur":  # the readings stay, and the controller computes with other offsets
        constants = tuple(turned(axis, deg) for axis, deg in enumerate(ZEROS_DEG.tolist(), start=1) if deg)
        change, shown_deg = ReadingChange("corrections.yaml", (0.0,) * 6, constants), 0.0
    else:
        change, shown_deg = ReadingChange("corrections.yaml", tuple(ZEROS_DEG.tolist())), ZEROS_DEG
    changed = {"offset": arms.cell(maker).offset + np.radians(ZEROS_DEG)} if maker == "ur" else {}
    found = cell.corrected(tmp_path, stated(ConvertedPoints(cell.rig, change)))
    unconverted = cell.off_mm(cell.given, shown_deg, **changed)
    assert not left_names(found)
    assert cell.off_mm(found.files, shown_deg, **changed).max() < ROUNDED_MM[maker]
    assert unconverted.max() > 0.3
    (group,) = found.groups
    assert group.moved_mm.max() == pytest.approx(unconverted.max(), rel=0.25)
    assert group.tool_mm.max() < ROUNDED_MM[maker]


MOVED_DEG = np.array([0.0, 0.06, 0.0, -0.09, 0.0, 0.0])


@for_every_maker
def test_points_taught_before_zeros_moved_return_to_their_places(maker, tmp_path, monkeypatch):
    cell = taught_cell(maker, monkeypatch)
    then = _with_hidden(cell)
    found = EffectProvenance(date=dt.date(2026, 11, 21), runs=("r",), sd={"offset_deg": 0.001})
    moved = [
        JointOffset(axis=axis, offset_deg=deg, found=found)
        for axis, deg in enumerate(MOVED_DEG.tolist(), start=1)
        if deg
    ]
    now = then.model_copy(update={"effects": (*then.effects, *moved)})
    program = cell.corrected(tmp_path, stated(ChangedArm(then, now, "then.yaml")))
    assert cell.off_mm(cell.given, moved_deg=MOVED_DEG).max() > 0.3
    off_mm = cell.off_mm(program.files, moved_deg=MOVED_DEG)
    assert not left_names(program)
    assert off_mm.max() < min(np.nanmax(program.u_mm), 0.01)
    (group,) = program.groups
    assert group.error.gains
    assert group.error.base.before_um > 2 * group.error.base.after_um


@for_every_maker
def test_zero_that_rig_moved_names_is_compensated_without_a_calibration(maker, tmp_path, monkeypatch):
    cell = taught_cell(maker, monkeypatch)
    bare = cell.rig.model_copy(update={"effects": ()})
    zero = {"what": "zero", "axis": 2, "size_deg": 0.06, "u": 0.002}
    (tmp_path / "moved.json").write_text(json.dumps({"causes": [zero], "named": zero}))
    change = values_in(bare, tmp_path / "moved.json")
    program = cell.corrected(tmp_path, stated(ConvertedPoints(bare, change)))
    moved_deg = np.array([0, 0.06, 0, 0, 0, 0])
    assert cell.off_mm(cell.given, moved_deg=moved_deg).max() > 0.3
    assert cell.off_mm(program.files, moved_deg=moved_deg).max() < ROUNDED_MM[maker]
    assert program.groups[0].u_mm.max() > 0.01
    (tmp_path / "moved.json").write_text(json.dumps({"causes": [], "named": zero | {"what": "tool"}}))
    with refused("controller.invalid", "names tool as moved"):
        values_in(bare, tmp_path / "moved.json")


def test_exceptions_by_name_leave_other_points_as_computed(tmp_path, monkeypatch):
    cell = taught_cell("yaskawa", monkeypatch)
    points = points_of(cell.rig, "computed", taught_names=["C0000?"])
    assert cell.corrected(tmp_path, points).is_right
    mixed = cell.corrected(tmp_path, points_of(cell.rig, "computed", taught_names=["C00001"]))
    assert [(group.origin.kind, group.names) for group in mixed.groups] == [
        ("taught", ("C00001",)), ("computed", ("C00002",))
    ]  # fmt: skip
    assert mixed.names == ("C00002",) and not len(mixed.beside_left_mm)
    taught, computed = cell.off_mm(mixed.files)
    assert taught == 0 and computed > 0.1
    with pytest.raises(Exception, match="C7"):
        points_of(cell.rig, "computed", taught_names=["C7"]).refuse_unmatched(mixed.points)
