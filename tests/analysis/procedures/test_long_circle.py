from __future__ import annotations

from pathlib import Path

import pytest

from analysis.procedures import long_circle
from analysis.procedures.results import Result, evaluate_path
from rigs.errors import DirectionError
from tests.support.streamed_circle import Trouble, streamed_circle

ROWS = 40_000
SHIFTED = 0.03
"""Share of its u by which a figure may change: of the twenty rows at a node here the one at the end of a lap may fall
on its other side. Of a million rows it is a ten-thousandth."""
DRAWS = 0.03
"""Share of u by which u may change: 400 draws, of which those of the noise's size follow each bit of the readings."""
TROUBLES = {
    "wild readings": Trouble(wild_every=700),
    "stamps and restarts near the ends of parts": Trouble(wrong=(0.13, 0.249, 0.6), restarts=(0.377, 0.7)),
    "a cable pulled between the laps": Trouble(pulled=(0.385, 0.615)),
    "a computer that is held up": Trouble(held_up=(0.12, 0.374, 0.5)),
}


@pytest.fixture(autouse=True)
def _short_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    # private _ROWS, _MARGIN_NS, _SHOWN: parts of a run that a test can afford
    monkeypatch.setattr(long_circle, "_ROWS", 3000)
    monkeypatch.setattr(long_circle, "_MARGIN_NS", 1e9)
    monkeypatch.setattr(long_circle, "_SHOWN", 15_000)


def _both(path: Path) -> tuple[Result, Result]:
    assert long_circle.long_circle(path, path) is not None  # read as a whole
    return evaluate_path(path, with_rows=False), evaluate_path(path)


@pytest.mark.parametrize("trouble", TROUBLES.values(), ids=TROUBLES.keys())
def test_a_circle_in_parts_is_that_of_the_whole(tmp_path: Path, trouble: Trouble) -> None:
    parts, whole = _both(streamed_circle(tmp_path, ROWS, trouble))
    assert parts.doubts == whole.doubts
    assert parts.found.samples == whole.found.samples
    for name, figure in whole.figures.items():
        assert abs(parts.figures[name].value - figure.value) < SHIFTED * figure.u, name
        assert parts.figures[name].u == pytest.approx(figure.u, rel=DRAWS), name


def test_a_wrong_direction_is_named_as_of_the_whole(tmp_path: Path) -> None:
    run = streamed_circle(tmp_path, ROWS, driven="acw", label="cw")
    for with_rows in (False, True):
        with pytest.raises(DirectionError) as error:
            evaluate_path(run, with_rows=with_rows)
        assert error.value.drove == "acw"


def test_poses_that_show_an_unknown_controller_are_read_as_a_whole(tmp_path: Path) -> None:
    run = streamed_circle(tmp_path, 8_000, with_poses=True)
    assert long_circle.long_circle(run, run) is None
    assert evaluate_path(run, with_rows=False).measured.rig.controller == "data_sheet"
