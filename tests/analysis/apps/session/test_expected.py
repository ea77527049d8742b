"""Expected result of a correction in a session: with u where the runs of the model state it, otherwise none."""

import math

import numpy as np
import pytest

from analysis.apps.report.blocks import Table
from analysis.apps.report.page.accuracy import BeforeAfter, now_sentence, path_blocks
from analysis.apps.report.texts import keys_of, texts_of
from analysis.apps.session.correction_step import expected_left
from analysis.correction.deviation import Deviation, Side, Work
from analysis.correction.pose_uncertainty import pose_uncertainty
from analysis.runs.tables import PoseTable
from rigs.load import load
from tests.support.handmade_calibration import calibrated_model
from tests.worlds.arms.seven_axes import run_of


@pytest.mark.parametrize(("most_deg", "is_known"), [(29.0, True), (40.0, False)])
def test_u_is_known_only_in_the_region_of_the_runs(most_deg, is_known):
    rig = load("paper-fanuc")[0].with_calibration(None, calibrated_model())
    q = np.radians(np.random.default_rng(1).uniform(-20, 20, (40, 6)))
    q[-1, 3] = math.radians(most_deg)
    run = run_of(rig, PoseTable(q, np.zeros((40, 3)), None))
    expected = expected_left(rig, pose_uncertainty(rig, ()), [run], 12.34)
    assert expected.um == 12.3
    assert (expected.u_um is not None and 0 < expected.u_um < math.inf) == is_known
    before = Deviation(um=50, largest_um=90, u_um=1, runs=2)
    after = BeforeAfter("Load them.", "programs", (Side("same", before, before, expected),))
    table = next(block for block in path_blocks(after, texts_of("en")) if isinstance(block, Table))
    assert keys_of(table.rows[0][3]) == (("rms_and_u_of" if is_known else "rms_without_u"),)


@pytest.mark.parametrize(("unknown", "key"), [(0.0, None), (0.82, "work_unknown"), (1.0, "work_unknown_all")])
def test_error_over_the_work_states_the_unmeasured_share(unknown, key):
    side = Deviation(um=50, largest_um=90, u_um=1, runs=2)
    work = Work(before_um=312, after_um=133, u_um=46, unknown=unknown)
    after = BeforeAfter("Load them.", "programs", (Side("same", side, side, None),), work)
    sentence = now_sentence(after, texts_of("en"))
    assert keys_of(sentence) == ("is_now_programs", "over_the_work", *filter(None, [key]))
    assert "312 µm to 133 µm" in sentence and ("82 %" in sentence) == (unknown == 0.82)
