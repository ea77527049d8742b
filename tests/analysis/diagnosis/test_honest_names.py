from dataclasses import replace

from analysis.diagnosis.judge.result import Gap
from analysis.diagnosis.judge.verdict import (
    Gaps,
    _missed_elsewhere_um,  # private: the rest of the remainder needs a search
)
from tests.support.diagnosis_cells import healthy


def test_errors_at_other_places_are_unexplained_if_repeats_state_the_noise():
    gap = Gap(("a",), before_um=200.0, after_um=90.0, noise_floor_um=50.0, calibrated_um=50.0)
    (block, *_) = healthy().blocks
    repeated, once = [replace(block, measured=True)], [replace(block, measured=False)]
    missed = Gaps(gap, None, None, unexplained_um=30.0, beyond_um=45.0)
    assert _missed_elsewhere_um(missed, repeated) == 45.0
    assert _missed_elsewhere_um(missed, once) == 0.0  # it may be scatter
    assert _missed_elsewhere_um(replace(missed, beyond_um=40.0), repeated) == 0.0  # sound cells have as much
    assert _missed_elsewhere_um(replace(missed, unexplained_um=60.0), once) == 60.0
