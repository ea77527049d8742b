"""Layout of charts whose names are long."""

import warnings

import numpy as np
import pytest

from analysis.apps.report.chart import Chart, ChartLine, Frame, still

ROLES = ("acw", "cw", "measured", "model", "after", "quiet")


def _chart(frame: Frame, letters: int) -> Chart:
    x = np.linspace(0.0, 350.0, 36)
    lines = [ChartLine(f"{axis} {letters * 'm'}\x1b\n", role, x, np.sin(x)) for axis, role in enumerate(ROLES, 1)]
    return Chart("title", "caption", frame, "x", "y", "mm", tuple(lines))


@pytest.mark.parametrize("frame", ["straight", "polar"])
def test_long_names_are_shortened_and_leave_room_for_the_curves(frame):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        svg = still(_chart(frame, 200))
    assert all(f">{axis} mmm" in svg for axis in range(1, 7)) and "m…<" in svg and 200 * "m" not in svg


def test_short_names_are_complete():
    svg = still(_chart("straight", 30))
    assert svg.count(f"{30 * 'm'}\\x1b\\n<") == len(ROLES)
