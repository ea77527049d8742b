from itertools import pairwise

import numpy as np
import pytest

from analysis.apps.live.lap import LapProgress
from analysis.robot.kinematics.arm import Array

START, LEAD = np.radians(30.0), np.radians(12.0)


def driven(*stops_deg: float, state: LapProgress | None = None, noise_deg: float = 0.0) -> tuple[LapProgress, Array]:
    """The progress along a way from stop to stop in steps of half a degree, and the share at each."""
    pieces = [np.linspace(a, b, 1 + int(abs(b - a) * 2)) for a, b in pairwise(stops_deg)]
    phi_deg = np.concatenate(pieces) + np.random.default_rng(1).normal(0, noise_deg, sum(map(len, pieces)))
    found, _, shares = (state or LapProgress()).after(np.radians(phi_deg % 360), START, LEAD)
    return found, shares


@pytest.mark.parametrize("sense", [1, -1])
def test_a_lap_begins_after_the_lead_in(sense):
    found, shares = driven(30 - 12 * sense, 30 + 180 * sense)
    assert found.sense == sense
    assert found.share(START, LEAD) == pytest.approx(0.5, abs=1e-6)
    assert np.nanmin(shares) == pytest.approx(-10 / 360, abs=0.01)


@pytest.mark.parametrize(
    ("stops", "acw", "cw"),
    [
        ((18, 402, 18, 402, 18), 2, 0),  # two laps, with the way back after each
        ((42, -342, 42, -342), 0, 2),
        ((18, 402 + 360, 18, 402 + 360), 4, 0),  # a wrist with two turns to give
        ((18, 402, 18, -366), 1, 1),  # on over the start: a lap the other way round
        ((12, 18, 14, 402, 18), 1, 0),  # it finds its start first
    ],
)
def test_way_back_is_no_lap_of_the_other_direction(stops, acw, cw):
    found, _ = driven(*stops)
    assert (found.ended().acw, found.ended().cw) == (acw, cw)


def test_way_back_has_no_share_of_a_lap():
    back, _ = driven(18, 402, 200)
    assert back.goes_back and back.sense == -1 and back.share(START, LEAD) is None
    for end, share in ((210, 0.5), (-60, 0.25)):
        again, _ = driven(200, 18, end, state=back)
        assert not again.goes_back and again.share(START, LEAD) == pytest.approx(share, abs=1e-6)
    off, _ = driven(18, 402)
    elsewhere, _ = driven(42, -100, state=off.ended())
    assert not elsewhere.goes_back and elsewhere.share(START, LEAD) is not None


@pytest.mark.parametrize(
    ("begin", "end", "laps_deg"),
    [(30, 120, 90), *((at, at + 30, at) for at in (40, 100, 250, 340)), (18, 402 + 360, 732)],
    ids=["from the very start", *["joined late"] * 4, "two laps in one way"],
)
def test_a_lap_counts_from_its_start(begin, end, laps_deg):
    assert driven(begin, end)[0].share(START, LEAD) == pytest.approx(laps_deg / 360, abs=1e-6)


def test_the_noise_of_a_robot_that_stands_is_no_motion():
    found, _ = driven(100, 100.5, 100, 100.5, 100, noise_deg=0.2)
    assert found.sense == 0 and found.share(START, LEAD) is None
    turned, _ = driven(18, 200, 199, 200, 199, 200, noise_deg=0.05)
    assert turned.sense == 1 and turned.cw == 0


def test_off_the_circle_there_is_no_lap():
    found, _ = driven(18, 402)
    off, _, shares = found.after(np.array([np.nan]), START, LEAD)
    assert off.sense == 0 and np.isnan(shares).all() and off.acw == 1
    again, _ = driven(200, 250, state=off)
    assert again.sense == 1 and again.acw == 1
