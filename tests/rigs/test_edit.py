import datetime as dt
import re
from typing import Any

import pytest
import yaml

from rigs.edit import block_of, extended, with_test, with_values
from rigs.effects import Backlash, EffectProvenance, LinkGeometry
from rigs.errors import FileError
from rigs.load import SHIPPED, parse
from rigs.problems import RigFileError
from rigs.rig import Rig
from rigs.yaml_text import flow, read_yaml

UR10E = (SHIPPED / "ur10e-cell.yaml").read_text(encoding="utf-8")
FANUC = (SHIPPED / "paper-fanuc.yaml").read_text(encoding="utf-8")
VALUES = {
    "centre_mm": [-600.125, -210.5, 240.0],
    "normal": [0.1, 0.05, 0.993],
    "zero": [0.0, 1.0, 0.0],
    "radius_mm": 65.123,
    "posture_deg": [1.5, -80.0, 100.0, 50.0, 80.0, 100.0],
}


def circle_in(text: str) -> dict:
    return yaml.safe_load(text)["tests"]["circle"]


def without_tests(text: str) -> str:
    return text.partition("\ntests:\n")[0] + "\n"


def test_an_edit_reads_a_file_as_the_loader_does():
    """YAML 1.1 has `on` for true."""
    text = re.sub("^name: .*$", "name: on", UR10E, flags=re.M)
    assert parse(with_test(text, "circle", VALUES, "cell.yaml"), "cell.yaml").name == "on"


@pytest.mark.parametrize("text", [UR10E, FANUC, UR10E.replace("\n", "\r\n"), UR10E.rstrip("\n")])
def test_only_the_values_change(text):
    edited = with_test(text, "circle", VALUES, "cell.yaml")
    before, after = yaml.safe_load(text), yaml.safe_load(edited)
    assert {key: after["tests"]["circle"][key] for key in VALUES} == VALUES
    before["tests"]["circle"] |= VALUES
    assert after == before
    assert [line for line in text.splitlines() if "#" in line and "centre_mm" not in line] == [
        line for line in edited.splitlines() if "#" in line and "centre_mm" not in line
    ]


def test_the_comment_behind_a_changed_value_stays():
    (line,) = [line for line in FANUC.splitlines() if "934.9 mm from" in line]
    edited = with_test(FANUC, "circle", VALUES, "cell.yaml")
    assert f"centre_mm: [-600.125, -210.5, 240] {line[line.index('#') :]}" in edited


@pytest.mark.parametrize(
    "tests",
    [
        "",
        "tests: {}\n",
        "tests: {repeatability: {targets: [1]}}\n",
        "tests:\n  repeatability:\n    targets: [1] # the pole\n# the end\n",
        "tests:\n  circle:\n  repeatability: {targets: [1]}\n",
        "tests: {circle: null}\n",
        "tests: {circle: {centre_mm: [1, 2, 3], posture_deg: [1, 2, 3, 4, 5, 6]}}\n",
        "tests:\n  circle:\n    centre_mm:\n    - 1\n    - 2 # y\n    - 3\n    posture_deg: [1, 2, 3, 4, 5, 6]\n",
    ],
)
def test_any_style_of_the_block_takes_the_values(tests):
    text = without_tests(UR10E) + tests
    edited = with_test(text, "circle", VALUES, "cell.yaml")
    assert {key: circle_in(edited)[key] for key in VALUES} == VALUES
    old, new = (parse(one, "cell.yaml") for one in (text, edited))
    assert new.tests.repeatability == old.tests.repeatability and new.robot == old.robot
    assert edited.startswith(without_tests(UR10E))
    assert re.findall("#.*", edited) == re.findall("#.*", text)


def test_a_value_that_another_place_shares_is_refused():
    text = UR10E.replace("    centre_mm: [-650, -200, 250]", "    centre_mm: &here [-650, -200, 250]")
    text = text.replace("    centre_mm: [-800, -200, 0]", "    centre_mm: *here")
    assert text.count("*here") == 1
    with pytest.raises(FileError, match="anchor"):
        with_test(text, "circle", VALUES, "cell.yaml")


def test_a_value_beyond_its_bounds_is_refused():
    with pytest.raises(RigFileError, match="radius_mm"):
        with_test(UR10E, "circle", VALUES | {"radius_mm": 5000.0}, "cell.yaml")


def test_written_block_is_valid_in_a_rig_file():
    text = without_tests(UR10E) + "tests:\n" + block_of("circle", VALUES, 2)
    assert circle_in(text) == VALUES


def _wanted(text: str, **circle: Any) -> Rig:
    rig = parse(text, "cell")
    tests = rig.tests.model_copy(update={"circle": rig.tests.circle.model_copy(update=circle)})
    return rig.model_copy(update={"tests": tests})


def test_only_the_lines_of_the_values_change():
    text = with_values(FANUC, {("tests", "circle", "radius_mm"): 140.0}, _wanted(FANUC, radius_mm=140.0), "cell")
    lines = list(zip(FANUC.splitlines(), text.splitlines(), strict=True))
    assert [after.strip() for before, after in lines if before != after] == ["radius_mm: 140"]


@pytest.mark.parametrize("flow", [False, True])
def test_missing_key_is_added(flow):
    bare = FANUC.replace("    speed_mm_s: 25\n", "")
    if flow:
        begin, end = bare.index("  circle:\n"), bare.index("  hemisphere:\n")
        rows = [line.strip() for line in bare[begin:end].splitlines()[1:]]
        bare = bare[:begin] + "  circle: {" + ", ".join(rows) + "}\n" + bare[end:]
        bare = re.sub(" # 934.9 mm from [^,}]*, above[^,}]*", "", bare)
    text = with_values(bare, {("tests", "circle", "speed_mm_s"): 100.0}, _wanted(bare, speed_mm_s=100.0), "cell")
    assert text.count("speed_mm_s: 100") == 1


def test_missing_branch_is_added():
    bare = re.sub(r"  tool: \{xyz_mm: .*\n", "", FANUC)
    rig = parse(bare, "cell")
    tool = rig.robot.tool.model_copy(update={"xyz_mm": (40.0, 0.0, 0.0)})
    wanted = rig.model_copy(update={"robot": rig.robot.model_copy(update={"tool": tool})})
    text = with_values(bare, {("robot", "tool", "xyz_mm"): [40.0, 0.0, 0.0]}, wanted, "cell")
    assert "  tool:\n    xyz_mm: [40, 0, 0]\n  name: FANUC-like" in text


def test_a_value_that_others_share_by_an_alias_is_refused():
    shared = FANUC.replace("    radius_mm: 70", "    radius_mm: &r 70").replace(
        "    radius_mm: 400", "    radius_mm: *r"
    )
    with pytest.raises(FileError, match="anchor"):
        with_values(shared, {("tests", "hemisphere", "radius_mm"): 300.0}, parse(shared, "cell"), "cell")


def test_numbers_keep_all_their_digits_and_words_their_quotes():
    rig = parse(FANUC, "cell")
    wanted = _wanted(FANUC, normal=(1e-5, 1 / 3, 1.0)).model_copy(update={"name": "true"})
    values = {("name",): "true", ("tests", "circle", "normal"): [1e-5, 1 / 3, 1.0]}
    assert rig != wanted == parse(with_values(FANUC, values, wanted, "cell"), "cell")


@pytest.mark.parametrize("value", [0.1, 1e-5, -0.0, 70.0, 1e300, 1 / 3, "true", "a: b", "...", "Ä", [1.0, 1e-7], []])
def test_a_value_in_one_line_is_read_back(value):
    text = flow(value)
    assert "\n" not in text
    assert read_yaml(f"key: {text}\n", "cell")[1] == {"key": value}
    assert read_yaml(f"{flow({'key': {'in': value}})}\n", "cell")[1] == {"key": {"in": value}}


NEW = (
    Backlash(
        axis=2,
        width_deg=0.031,
        found=EffectProvenance(date=dt.date(2026, 5, 1), runs=("a", "b"), sd={"width_deg": 0.001}),
    ),
    LinkGeometry(axis=3, field="a", delta=-1.2),
)
WITHOUT = (SHIPPED / "paper-fanuc.yaml").read_text()
TEXT = (SHIPPED / "paper-errors.yaml").read_text()


@pytest.mark.parametrize(
    ("text", "before"),
    [
        (TEXT, 7),
        (WITHOUT, 0),
        (WITHOUT + "effects: []\n", 0),
        (WITHOUT + "effects: [{effect: backlash, axis: 1, width_deg: 0.02}]\n", 1),
        (WITHOUT + "effects:\n- effect: backlash\n  axis: 1\n  width_deg: 0.02\n# the end\n", 1),
        ((SHIPPED / "ur10-cell.yaml").read_text(), 0),
    ],
)
def test_effects_are_added_behind_those_there_are(text, before):
    grown = extended(text, NEW, "cell.yaml")
    effects = parse(grown, "cell.yaml").effects
    assert len(effects) == before + 2
    assert effects[-2:] == NEW
    assert effects[:before] == parse(text, "cell.yaml").effects


def test_comments_stay():
    grown = extended(TEXT, NEW, "cell.yaml")
    assert [line for line in TEXT.splitlines() if "#" in line] == [line for line in grown.splitlines() if "#" in line]


def test_extending_twice_is_extending_by_both():
    once = extended(extended(TEXT, NEW[:1], "a"), NEW[1:], "a")
    assert parse(once, "a").effects == parse(extended(TEXT, NEW, "a"), "a").effects
