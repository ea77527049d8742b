"""When a verdict is believed: what is certain and large stands beside what is usual, twins are one name, and a remedy
is given only for a cause that was shown."""

from __future__ import annotations

import pytest

from rigs.effects import Backlash, Compliance, Effect, JointOffset, LinkGeometry, TransmissionError
from rigs.schema.effect import name_of
from tests.support.diagnosis_cells import circles, found_in
from tests.support.nightly import cases

USUAL: tuple[Effect, ...] = (
    *(JointOffset(axis=axis, offset_deg=size) for axis, size in ((2, 0.012), (3, -0.016), (5, 0.01))),
    *(
        TransmissionError(axis=axis, order=order, amplitude_deg=0.004, phase_deg=40 * axis)
        for axis, order in ((1, 60), (2, 2), (3, 3), (4, 1), (5, 2))
    ),
    *(Backlash(axis=axis, width_deg=0.008, transit=0.3) for axis in (2, 3, 4)),
    Compliance(axis=2, deg_per_Nm=4e-5, payload_kg=3.0),
    LinkGeometry(axis=2, field="a", delta=0.15),
    LinkGeometry(axis=4, field="d", delta=-0.2),
)


def test_many_usual_errors_are_no_fault() -> None:
    found = found_in(circles(USUAL, seed=56))
    assert found.condition in ("nothing_unusual", "undecided") and found.standing == ()
    assert found.train.calibrated_um < 0.2 * found.train.before_um


@pytest.mark.parametrize(
    ("fault", "seed", "least_um"),
    cases(
        [
            (Backlash(axis=1, width_deg=0.06, transit=0.2), 55, 200),
            (Compliance(axis=3, deg_per_Nm=29 * 5e-5, payload_kg=5.0), 51, 100),
        ],
        lambda case: case[1] == 51,
    ),
    ids=["play", "compliance"],
)
def test_a_fault_beside_usual_errors_stands(fault: Effect, seed: int, least_um: float) -> None:
    """Both were dismissed once: a play within what healthy arms show, and a size not known to half of itself."""
    found = found_in(circles((fault, *USUAL), seed=seed))
    assert found.condition == "named" and [name_of(one.effect) for one in found.standing] == [name_of(fault)]
    (one,) = found.standing
    assert one.contribution_um > least_um and one.u_um < 0.1 * one.contribution_um
    assert one.times_usual > 5 and one.probability > 0.95


def test_exact_twins_are_one_name() -> None:
    """d2 and d3 move the arm along axes that are parallel: only what they make together is known."""
    truth = LinkGeometry(axis=2, field="d", delta=3.0)
    found = found_in(circles((truth,), seed=52, count=1, tests=("yaw", "roll"), ways=("cw",)))
    assert found.condition == "uncalibrated"  # twins are no rivals, and a difference from the data sheet is no fault
    (one,) = found.effects
    assert {name_of(one.effect), *map(name_of, one.twins)} == {"link_geometry 2.d", "link_geometry 3.d"}
    assert one.rivals == () and getattr(one.effect, "delta", 0.0) == pytest.approx(3.0, abs=0.03)


@pytest.mark.parametrize(
    ("axis", "order", "seed", "is_gear"), cases([(3, 6, 54, False), (4, 2, 14, True)], [(3, 6, 54, False)])
)
def test_a_remedy_names_a_gear_only_where_two_waves_were_driven(
    axis: int, order: float, seed: int, is_gear: bool
) -> None:
    """Axis 3 turns 82°, 1.4 waves of six a turn; axis 4 turns a whole turn."""
    truth = TransmissionError(axis=axis, order=order, amplitude_deg=0.05, phase_deg=40)
    (one,) = found_in(circles((truth,), seed=seed)).standing
    assert name_of(one.effect) == f"transmission_error {axis}"
    assert ("gear" in one.remedy) == is_gear
    assert ("use the calibrated model" in one.remedy) != is_gear
