import datetime as dt

import pytest

from rigs.edit import extended
from rigs.effects import Backlash, EffectProvenance, LinkGeometry
from rigs.load import SHIPPED, parse

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
        ((SHIPPED / "ur10.yaml").read_text(), 0),
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
