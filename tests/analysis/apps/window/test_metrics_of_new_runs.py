from tests.support.simulated_laps import lap_run
from tests.support.windows import served


def test_the_first_scrape_has_every_figure_of_the_newest_runs(tmp_path):
    lap_run(tmp_path / "runs", seed=1)
    with served(tmp_path) as window:
        told = window.until("/metrics", lambda answer: "rig_figure{" in answer.text).text
    assert "rig_up 0" in told
    assert 'rig_figure{rig="ur10e",test="yaw",direction="acw",figure="band_deg"} 0.' in told
