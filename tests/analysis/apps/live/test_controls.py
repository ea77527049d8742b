import pytest

from analysis.apps.live.controls import Action, LiveControls, RecordingLabel, StartRecording
from analysis.apps.live.view import GaugeReading, LiveView
from tests.support.refusals import refused

READINGS = {"g1": GaugeReading(0.5, 0.0), "g2": GaugeReading(-0.25, 0.0)}


def typed(text: str, controls: LiveControls | None = None) -> tuple[LiveControls, list[Action]]:
    controls, actions = controls or LiveControls(), []
    for key in text:
        controls, action = controls.pressed(key, READINGS)
        actions += [action] if action else []
    return controls, actions


def test_only_the_first_start_asks_for_a_label():
    label = RecordingLabel("lap", "yaw", "acw")
    controls, actions = typed("slap yaw acw\r")
    assert actions == [StartRecording(label)] and controls.prompt is None
    assert typed("s", controls)[1] == [StartRecording(label)]
    assert typed("l\x7f\x7f\x7fcw\r", controls)[0].label == RecordingLabel("lap", "yaw", "cw")


def test_a_label_alone_starts_nothing():
    controls, actions = typed("llap radial\r")
    assert not actions and controls.label == RecordingLabel("lap", "radial", None)
    assert controls.label.fields() == {"name": "lap", "test": "radial", "direction": None}


@pytest.mark.parametrize(
    "text", ["", "lap", "lap tap", "lap yaw", "lap yaw up", "lap radial cw", "lap radial up", "lap yaw acw now"]
)
def test_a_wrong_label_stays_with_a_message(text):
    with refused("live.label"):
        RecordingLabel.typed(text)
    controls, actions = typed(f"s{text}\r")
    assert controls.prompt == text and controls.message and not actions


def test_escape_leaves_the_prompt_and_keys_are_text_within_it():
    controls, actions = typed("squez\x1b")
    assert controls.prompt is None and not actions and controls.zero_mm == (0.0, 0.0)
    assert typed("l\x01\x02" + "a" * 999)[0].prompt == "a" * 200


def test_zero_is_an_offset_of_the_view_and_reversible():
    controls, actions = typed("z")
    assert controls.zero_mm == (0.5, -0.25) and controls.message and not actions
    assert typed("Z", controls)[0].zero_mm == (0.0, 0.0)


def test_a_run_that_is_started_with_a_zero_notes_it():
    label = RecordingLabel("lap", "radial", None)
    assert typed("zslap radial\r")[1] == [StartRecording(label, (0.5, -0.25))]
    assert StartRecording(label, (0.5, -0.25)).request() == {**label.fields(), "view_zero_mm": (0.5, -0.25)}
    assert typed("zZslap radial\r")[1] == [StartRecording(label)] and StartRecording(label).request() == label.fields()


def test_units_go_round():
    assert [typed("u" * k)[0].units.name for k in range(4)] == ["mm", "µm", "inch", "mm"]


def test_every_other_key_is_an_action_or_nothing():
    assert typed("er +-q?x")[1] == ["stop", "restart", "pause", "faster", "slower", "quit"]
    assert typed("?")[0].shows_help and not typed("??")[0].shows_help and not typed("?x")[0].shows_help


@pytest.mark.parametrize(
    ("before", "view"),
    [
        (LiveView(), LiveView(name="lap")),
        (LiveView(name="lap"), LiveView()),
        (LiveView(), LiveView(lost="gone")),
        (LiveView(lost="gone"), LiveView()),
    ],
)
def test_a_message_does_not_outlive_the_state_it_speaks_of(before, view):
    controls = LiveControls().with_notice("started", before, before)
    assert controls.with_notice("", before, before).message == "started"
    assert not controls.with_notice("", before, view).message
    assert controls.with_notice("refused", before, view).message == "refused"
