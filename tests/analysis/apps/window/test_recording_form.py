import pytest

from analysis.apps.live.view import GaugeReading
from analysis.apps.window.recording_form import RecordingLabel, StartRecording, zeros_at
from tests.support.refusals import refused


def test_label_is_read_from_one_line():
    assert RecordingLabel.typed("lap yaw cw") == RecordingLabel("lap", "yaw", "cw")
    assert RecordingLabel.typed("lap radial").fields() == {"name": "lap", "test": "radial", "direction": None}


@pytest.mark.parametrize(
    "text", ["", "lap", "lap tap", "lap yaw", "lap yaw up", "lap radial cw", "lap radial up", "lap yaw acw now"]
)
def test_wrong_label_is_refused(text):
    with refused("usage"):
        RecordingLabel.typed(text)


def test_a_run_that_is_started_with_a_zero_notes_it():
    label, zeros = RecordingLabel("lap", "radial", None), zeros_at({"g1": GaugeReading(0.5, 0.0)})
    assert zeros == (0.5, 0.0)
    assert StartRecording(label, zeros).request() == {**label.fields(), "view_zero_mm": zeros}
    assert StartRecording(label).request() == label.fields()
