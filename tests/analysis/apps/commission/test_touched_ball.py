from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from analysis import Measured, simulate
from analysis.apps.commission.touched_ball import touched_ball
from daq.store import Run
from rigs.errors import FileError
from rigs.load import load
from tests.support.changed_rigs import with_tests
from tests.support.stood_about import CENTRE, recorded_stands


def of_simulation(seed: int | None) -> Measured:
    return simulate("ur10e-cell", "radial", seed=seed)


def test_radial_run_shows_the_ball():
    rig = load("ur10e-cell")[0]
    found = touched_ball([of_simulation(3).run], rig)
    error = found.centre - np.array(rig.tests.hemisphere.centre_mm)
    assert np.abs(error).max() < 0.02
    assert found.radius_mm == pytest.approx(400, abs=0.02)
    assert list(found.values) == ["centre_mm"]


@pytest.mark.parametrize("gauge", [True, False])
def test_recorded_run_shows_the_ball_with_and_without_a_gauge(gauge, tmp_path):
    run, rig = recorded_stands(tmp_path, gauge=gauge)
    found = touched_ball([run], rig)
    # Without the gauge nothing shows that the ball is elsewhere than in the middle of where the robot stood.
    truth = CENTRE if gauge else np.array(rig.tests.hemisphere.centre_mm)
    assert np.abs(found.centre - truth).max() < 0.05
    assert (np.abs(found.centre - truth) < 4 * found.u_centre_mm).all()
    assert any("g1" in doubt for doubt in found.doubts) != gauge


def test_rig_file_without_a_hemisphere_gets_radius_and_posture(tmp_path):
    run, rig = recorded_stands(tmp_path, gauge=True)
    bare = with_tests(rig, hemisphere=None, repeatability=None)
    assert set(touched_ball([run], bare).values) == {"centre_mm", "radius_mm", "posture_deg"}


def refused(run: Run) -> str:
    with pytest.raises(FileError) as raised:
        touched_ball([run], load("ur10e-cell")[0])
    return raised.value.code


def test_home_position_is_not_used():
    run = of_simulation(3).run
    q1 = run.table["q1_deg"].to_numpy().copy()
    q1[[0, -1]] += 12.0
    place = run.table.column_names.index("q1_deg")
    found = touched_ball(
        [replace(run, table=run.table.set_column(place, "q1_deg", pa.array(q1)))], load("ur10e-cell")[0]
    )
    assert np.abs(found.centre - [-800, -200, 0]).max() < 0.02
    assert any("2 stops" in doubt for doubt in found.doubts)


def rows_of(run: Run, rows: list[int]) -> Run:
    return replace(run, table=run.table.take(rows))


def test_stops_that_determine_no_ball_are_refused():
    run = of_simulation(None).run
    assert refused(rows_of(run, [0, 10, 20])) == "readings.too_few"
    ring = np.flatnonzero(np.isclose(run.table["polar_deg"].to_numpy(), 90.0))
    assert refused(rows_of(run, ring[::3].tolist())) in ("readings.unsuitable", "readings.unsuitable")
    assert refused(simulate("ur10e-cell", "yaw", "acw", seed=None).run) == "readings.unsuitable"
