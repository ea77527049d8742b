import contextlib
import datetime as dt
import os
import re
import zipfile

import pytest
import yaml

from daq.acquisition.streams import streams_of
from rigs.arms import load_arm, rig_text_of
from rigs.errors import FileError
from rigs.load import SHIPPED, find, load, load_hidden, parse, shipped, shipped_effects
from rigs.makers import MAKERS
from rigs.problems import RigFileError
from rigs.schema.probe import Certificate
from tests.support.command_line import ran
from tests.support.refusals import refused

TEXT = (
    (SHIPPED / "paper-fanuc.yaml").read_text()
    + """
effects:
  - {effect: backlash, axis: 1, width_deg: 0.02}
  - {effect: backlash, axis: 5, width_deg: 0.015}
"""
)
FEEDBACK = TEXT[TEXT.index("interface: line_feed") : TEXT.index("\n\n", TEXT.index("interface: line_feed"))]
RSI = "interface: kuka_rsi\n  port: udp://192.168.1.5:49152"
JOINTS = (
    "interface: modbus_joints\n  port: tcp://robot:502\n  address: 0\n  count: 12\n  joints: ["
    + ", ".join(f"{{address: {2 * axis}, type: int32}}" for axis in range(6))
    + "]"
)


@pytest.mark.parametrize(("name", "path"), shipped().items())
def test_shipped_rigs_are_good_and_found_by_name(name, path):
    rig, text = load(name)
    assert rig.name == name.removesuffix("-cell")
    assert text == path.read_text()


def test_shipped_rigs_have_no_faults_and_hidden_effects_are_separate():
    """paper-errors is no template: its effects are what it is for."""
    for name in shipped().keys() - {"paper-errors"}:
        rig, _ = load(name)
        assert rig.effects == () and rig.tests.circle and rig.tests.circle.eccentricity_mm == (0, 0, 0), name
    assert list(shipped_effects()) == ["paper-fanuc", "ur10e-cell"]
    for name in shipped_effects():
        grown = load_hidden(name).apply_to(load(name)[0])
        assert grown.effects and grown.tests.circle and any(grown.tests.circle.eccentricity_mm), name
        assert grown.robot == load(name)[0].robot


def test_hidden_effects_replace_those_of_the_rig_file(tmp_path):
    file = tmp_path / "hidden.yaml"
    file.write_text("effects: [{effect: time_lag, lag_s: 0.01}]")
    rig = load("paper-errors")[0]
    grown = load_hidden(file).apply_to(rig)
    assert [effect.effect for effect in grown.effects] == ["time_lag"] and grown.tests == rig.tests
    file.write_text("eccentricity_mm: [1, 2, 3]")
    grown = load_hidden(file).apply_to(rig)
    assert grown.effects == () and grown.tests.circle and grown.tests.circle.eccentricity_mm == (1, 2, 3)
    assert load_hidden(SHIPPED / "paper-errors.yaml").effects == rig.effects
    with refused("file.missing", "no such file of effects"):
        load_hidden("ur10-cell")


def test_check_reports_initial_effects_with_their_provenance(tmp_path):
    file = tmp_path / "cell.yaml"
    found = "found: {date: 2026-05-01, runs: [mon, tue]}"
    file.write_text(TEXT + f"  - {{effect: joint_offset, axis: 2, offset_deg: 0.01, {found}}}\n")
    told = ran("check", file).stdout
    said = ("3 effects", "play of axis 1, play of axis 5", "2026-05-01 in mon, tue: zero of axis 2")
    assert all(told.count(part) == 1 for part in said)
    assert "begins with" not in ran("check", "paper-fanuc").stdout


def _problems(text: str) -> dict[str, tuple[int, str]]:
    with pytest.raises(RigFileError) as caught:
        parse(text, "cell.yaml")
    assert "\n" not in str(caught.value)
    return {problem.place: (problem.line, problem.message) for problem in caught.value.problems}


def _line(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1


def test_a_misspelt_interface_hides_no_other_mistake_of_its_gauge():
    text = (
        TEXT.replace("interface: sylvac_opto_rs", "interface: sylvac_optors", 1)
        .replace("mode: continuous", "mode: continous", 1)
        .replace("accuracy_mm: 0.0005", "acuracy_mm: 0.0005", 1)
        .replace("offset_mm: 25", "offset_mm: left")
        .replace("interface: line_feed", "interface: lines_feed")
        .replace("q6_deg]", "q5_deg]")
        .replace("effect: backlash, axis: 1", "effect: backlsh, axis: 9")
        .replace("radius_mm: 70", "radius_mn: 70")
    )
    assert {place: message.split()[-1] for place, (_, message) in _problems(text).items()} == {
        "gauges.g1": "sylvac_opto_rs?",
        "gauges.g1.mode": "continuous?",
        "gauges.g1.acuracy_mm": "accuracy_mm?",
        "gauges.g1.offset_mm": "'left'",
        "feedback": "line_feed?",
        "feedback.fields": "_rad",
        "effects[1]": "backlash?",
        "effects[1].axis": "9",
        "tests.circle.radius_mn": "radius_mm?",
    }


@pytest.mark.parametrize(
    ("old", "new", "place", "told"),
    [
        ("interface: line_feed\n", "timeout_s: 2\n", "feedback", "the key `interface`; add it; rig interfaces"),
        ("effect: backlash, ", "", "effects[1]", "the key `effect`; add it"),
    ],
)
def test_a_section_without_its_tag_names_the_key_of_this_section(old, new, place, told):
    assert told in _problems(TEXT.replace(old, new, 1))[place][1]


def test_a_workbook_is_no_rig_file(tmp_path):
    with zipfile.ZipFile(tmp_path / "poses.xlsx", "w") as book:
        book.writestr("xl/workbook.xml", "")
    with refused("rig_file.invalid", "a workbook or an archive, not"):
        load(tmp_path / "poses.xlsx")


@pytest.mark.parametrize("tag", ["nothing_of_ours", "[1]", "{a: 1}", "1", "null"])
def test_unknown_tag_is_refused(tag):
    assert "gauges.g1" in _problems(TEXT.replace("interface: sylvac_opto_rs", f"interface: {tag}", 1))


@pytest.mark.parametrize(
    "key", ["? [1, 2]\n: 3", "? {a: 1}\n: 3", "1: 2", "2026-01-01: 3", "null: 3", "[]: 1", "1.5: x"]
)
def test_invalid_keys_are_refused(key):
    _problems(f"{TEXT}\n{key}\n")


def test_a_rate_too_slow_to_record_with_is_refused():
    text = (SHIPPED / "ur10e-cell.yaml").read_text().replace("count: 13", "count: 13\n    rate_hz: 0.2")
    assert {message.split("least ")[1] for _, message in _problems(text).values()} == {"0.5, not 0.2"}


def test_decimal_comma_is_named():
    """In braces, the part after the comma is a key of its own."""
    ((_, message),) = _problems(rig_text_of("ur10e").replace("d_mm: 180.7", "d_mm: 180,7")).values()
    assert message == "is not the name of a key; write decimals with a point: 12.5, not 7"


@pytest.mark.cpu_limit(20)  # read as numbers, the two of a megabyte of sexagesimal digits take half a minute
def test_huge_number_is_refused_in_short():
    sexagesimal = "1" + ":0" * 480_000
    tagged = (("!!int ", sexagesimal), ("!!float ", f"-{sexagesimal}.5"))
    for tag, digits in (("", "0x" + "f" * 10_000), ("", "9" * 10_000), *tagged, ("", "1" + "_0" * 50)):
        with pytest.raises(RigFileError, match=rf"line \d+: a number of {len(digits)} characters") as raised:
            parse(TEXT.replace("radius_mm: 70", f"radius_mm: {tag}{digits}"), "rig.yaml")
        assert len(str(raised.value)) < 200


@pytest.mark.parametrize("digits", ["1e-400", "-0.02e-399", "0.5e-350"])
def test_number_too_small_to_represent_is_not_zero(digits):
    with pytest.raises(RigFileError, match="is too small for a number; write 0 if that is meant"):
        parse(TEXT.replace("radius_mm: 70", f"radius_mm: {digits}"), "rig.yaml")


def test_special_or_endless_file_is_not_read(tmp_path):
    large = tmp_path / "large.yaml"
    large.write_bytes(b"#" * 1_000_001)
    with refused("file.too_large", "MB, the limit for such files"):
        load(large)
    os.mkfifo(tmp_path / "fifo")
    for path in ("/dev/zero", tmp_path / "fifo"):
        with refused("file.invalid", "is not a regular file"):
            load(path)


def test_too_long_name_is_refused():
    with pytest.raises(FileError, match="too long"):
        load("a" * 5000)


def test_a_number_with_a_zero_before_it_is_decimal():
    circle = parse(TEXT.replace("radius_mm: 70", "radius_mm: 070"), "rig.yaml").tests.circle
    assert circle.radius_mm == 70


@pytest.mark.parametrize("written", ["yes", "on", "1:10", "1:10.5"])
def test_numbers_of_yaml_1_1_are_refused(written):
    (message,) = (words for _, words in _problems(TEXT.replace("radius_mm: 70", f"radius_mm: {written}")).values())
    assert message.endswith(f"not '{written}'")


def test_a_key_given_twice_is_refused():
    assert "twice" in _problems(TEXT + "\nname: other\n")["name"][1]


IMPOSSIBLE = r"""
- ['limits_deg: [-150, 150]', 'limits_deg: [150, -150]', 'swap them']
- ['/dev/serial/by-id/usb-FTDI_gauge_1-if00-port0', 'COM3', 'not a port']
- ['tcp://192.168.1.10:59002', 'tcp://192.168.1.10:99999', 'not a port']
- ['zero: [1, 0, 0]', 'zero: [-0.281, 0.240, 1]', 'parallel']
- ['normal: [-0.281, 0.240, 1]', 'normal: [0, 0, 0]', 'above zero']
- ['q6_deg]', 'q5_deg]', 'occur once']
- ['usb-FTDI_gauge_2', 'usb-FTDI_gauge_1', 'give g2 a separate port']
- ['radius_mm: 70', 'radius_mm: 0', 'at least 1']
- ['radius_mm: 70', 'radius_mm: .nan', 'finite']
- ['radius_mm: 70', 'radius_mm: 1.0e+9', 'at most 2000']
- ['speed_mm_s: 25', 'speed_mm_s: 0.00001', 'at least 0.5']
- ['speed_mm_s: 25', 'speed_mm_s: 0', 'at least 0.5, not 0']
- ['targets: [1, 5, 14, 20]', 'targets: []', '0 entries']
- ["radius_mm: 70\n    speed_mm_s: 25", "radius_mm: 900\n    speed_mm_s: 1", 'a lap takes 94 min']
- ['radius_mm: 400', 'step_deg: 0.001', 'at least 5']
- ['radius_mm: 400', 'orientations: 1000000', 'at most 15']
- ['radius_mm: 400', 'zero: [0, 0, 5]', 'parallel']
- ['targets: [1, 5, 14, 20]', 'rounds: 10000000', 'at most 1000']
- ['targets: [1, 5, 14, 20]', 'targets: [0]', 'at least 1']
- ['limits_deg: [-150, 150]', 'limits_deg: [-1.0e+9, 150]', 'at least -1440']
- ['[0, 1, 0, 0, 0, 0]', '[1, 0, 0, 0, 0, 0]', 'is singular']
- ['offset_mm: -25', 'offset_mm: 25', 'same position']
- ['offset_mm: -25', 'offset_mm: 75', 'of offset_mm']
- ['accuracy_mm: 0.0005', 'timeout_s: 1.0e-300', 'at least 0.01']
- ['line: 4800 7E2', 'line: {baud: 0, bits: 9, parity: X, stop: 3}', 'at least 50']
- ['line: 4800 7E2', 'line: 4800', '''9600 8N1''']
- ['name: paper-fanuc', 'name: ../paper', 'a–z']
- ['tcp://192.168.1.10:59002', 'udp://192.168.1.10:59002', 'add listens: true']
- ['tcp://192.168.1.10:59002', 'udp://192.168.1.10:0', 'not a UDP port']
- ['tcp://192.168.1.10:59002', "/dev/ttyUSB2\n  listens: true", 'serial port']
- ['$FEEDBACK', "interface: abb_egm\n  port: tcp://192.168.1.5:6510", 'not a UDP port']
- ['$FEEDBACK', "interface: abb_egm\n  port: udp://192.168.1.5:0", 'not a UDP port']
- ['$FEEDBACK', "interface: kuka_rsi\n  port: udp://192.168.1.5:49152\n  cycle_ms: 8", 'available: 12, 4']
- ['$FEEDBACK', "interface: kuka_rsi\n  port: udp://192.168.1.5:49152\n  sentype: '<x>'", 'form']
- ['$FEEDBACK', "$RSI\n  condition: {speed: Override}", 'unknown part ''speed''; known: program_state']
- ['$FEEDBACK', "$RSI\n  condition: {speed_percent: 'a b'}", 'write Element or Element.Attribute']
"""
"""What of a rig file is replaced by what, and what is told."""
IN_JOINTS = [
    (FEEDBACK, JOINTS.replace("count: 12", "count: 11"), "joints[5] at 10 "),
    (FEEDBACK, JOINTS.replace("tcp://robot:502", "/dev/ttyUSB0"), "not a TCP port"),
    (FEEDBACK, JOINTS.replace("{address: 10, type: int32}", ""), "missing"),
]


@pytest.mark.parametrize(("old", "new", "told"), [*yaml.safe_load(IMPOSSIBLE), *IN_JOINTS])
def test_impossible_values_are_refused(old, new, told):
    old, new = old.replace("$FEEDBACK", FEEDBACK), new.replace("$RSI", RSI)
    assert old in TEXT
    messages = " ".join(message for _, message in _problems(TEXT.replace(old, new)).values())
    assert told in messages


def test_a_block_that_misses_its_own_registers_is_refused():
    text = (SHIPPED / "ur10e-cell.yaml").read_text().replace("count: 13", "count: 3")
    assert "value at 202 " in " ".join(message for _, message in _problems(text).values())


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ({"line": "9600 8N1"}, "not `line` (57600 8E1 and 9600 8N1)"),
        ({"framing": "ascii"}, "not `framing`"),
    ],
)
def test_different_settings_of_one_line_are_named(setting, told):
    data = yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text())
    gauges = data["gauges"]
    gauges["g2"] |= {"port": gauges["g1"]["port"], "unit": 2, **setting}
    messages = " ".join(message for _, message in _problems(yaml.safe_dump(data)).values())
    assert told in messages


def test_missing_file_names_shipped_rigs():
    with pytest.raises(FileError, match="paper-fanuc"):
        find("no-such-rig")


BOMB = "\n".join(["a0: &a0 [x]", *(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 9))])
MERGES = "\n".join(["b0: &b0 {x: 1}", *(f"b{k}: &b{k} {{<<: [{', '.join([f'*b{k - 1}'] * 9)}]}}" for k in range(1, 9))])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (f"{TEXT}\n{BOMB}", "values out"),
        (f"{TEXT}\n{MERGES}", "values out"),
        (f"{TEXT}\nx: &x [*x]", "values out"),
        ("a: " + "[" * 1000, "too deeply"),
        ("name: !!timestamp x", "YAML"),
        ("name: !!int x", "YAML"),
        ("name: 2026-99-99", "YAML"),
        ("name: !!python/object:os.system x", "constructor"),
        (f'{TEXT}\n"a\\nb": 1', r"'a\nb'…: unknown key"),
        (f"{TEXT}\n? {'k' * 700_000}\n: 1", "kkk'…: unknown key"),
        (TEXT + "".join(f"\nkey{k}: 1" for k in range(1000)), "and 900 more mistakes"),
    ],
    ids=["bomb", "merges", "within itself", "deep", "stamp", "int", "date", "object", "newline", "long", "many"],
)
def test_hostile_yaml_is_refused_soon_in_short_lines(tmp_path, text, told):
    file = tmp_path / "rig.yaml"
    file.write_text(text)
    with pytest.raises(FileError) as caught:
        load(file)
    lines = caught.value.lines()
    assert told in lines[-1] and all(line.isprintable() and len(line) < 1000 for line in lines)
    with contextlib.suppress(FileError):
        load_hidden(file)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "efects: [{effect: backlash, axis: 1, width_deg: 0.02}]",
            "effects.yaml: ",
        ),
        ("", "effects.yaml: "),
        (
            "effects:\n  - {effect: backlsh, axis: 1}",
            "line 2, effects[1]: 'backlsh' ",
        ),
        ("effects:\n  - {effect: backlash, axis: 1, width: 1}", "line 2, effects[1].width: "),
        ("effects: []\neccentrity_mm: [1, 0, 0]", "line 2, eccentrity_mm: "),
        ("eccentricity_mm: [1, 0]", "line 1, eccentricity_mm[3]: missing"),
        ("- {effect: backlash, axis: 9, width_deg: 1}", "line 1, [1].axis: "),
    ],
)
def test_effects_file_reports_mistakes_like_a_rig_file(tmp_path, text, told):
    file = tmp_path / "effects.yaml"
    file.write_text(text)
    with pytest.raises(FileError) as caught:
        load_hidden(file)
    assert any(told in line for line in caught.value.lines()), caught.value.lines()


@pytest.mark.parametrize("text", ["effects: []", "effects:", "[]", TEXT.partition("\neffects:")[0]])
def test_file_may_state_no_effects(tmp_path, text):
    file = tmp_path / "effects.yaml"
    file.write_text(text)
    assert not load_hidden(file).effects


CERTIFICATE = "number: A-1, date: 2025-03-01, u_mm: 0.001, k: 2"


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (
            "correction_mm: [[0, 0], [2, 0.001], [1, 0.002]]",
            "1 mm follows 2 mm",
        ),
        ("correction_mm: [[0, 0], [0, 0.001]]", "0 mm follows 0 mm"),
        ("correction_mm: [[0, 0.5], [0.1, -0.5]]", "between 0 and 0.1 mm"),
        ("correction_mm: [[0, 0]]", "least two"),
        ("correction_mm: [[0, 0], [10, 3.5]]", "at most 1, not 3.5"),
        ("correction_mm: [[0, .nan], [10, 0]]", "finite"),
        ("polynomial_mm: [0, -1.1], range_mm: [0, 10]", "decrease"),
        ("polynomial_mm: [0, 0.001]", "belong together"),
        ("range_mm: [0, 10]", "belong together"),
        ("polynomial_mm: [0, 0.001], range_mm: [10, 0]", "smaller end"),
        ("polynomial_mm: [0], range_mm: [0, 1], correction_mm: [[0, 0], [1, 0]]", "one of"),
        ("date: 2925-03-01", "2925-03-01 "),
        ("date: soon", "date"),
        ("u_mm: -0.001", "at least 0, not -0.001"),
        ("k: 0", "greater than 0"),
        ("valid_until: 2024-01-01", "valid_until 2024-01-01 "),
        ("valid_until: 2026-03-01, interval_months: 12", "one of"),
        ("correcton_mm: [[0, 0], [1, 0]]", "correction_mm?"),
    ],
)
def test_a_certificate_that_cannot_be_is_one_line(changed, told):
    keys = {part.partition(":")[0]: part for part in [*CERTIFICATE.split(", "), *re.split(r", (?=[a-z_]+:)", changed)]}
    text = TEXT.replace("accuracy_mm: 0.0005", f"certificate: {{{', '.join(keys.values())}}}", 1)
    ((place, (line, message)),) = _problems(text).items()
    assert told in message and place.startswith("gauges.g1.certificate") and line == _line(text, "certificate:")


def test_ball_link_and_temperature_have_bounds():
    parts = [f"ball: {{{CERTIFICATE}, form_mm: -1}}", f"link: {{{CERTIFICATE}, length_mm: 200}}", "temperature: {}"]
    problems = {place: message for place, (_, message) in _problems("\n".join([TEXT, *parts])).items()}
    assert problems.keys() == {"ball.form_mm", "temperature.mean_c", "temperature.u_c", "tests"}
    assert all(value in problems["tests"] for value in ("200 mm", "radius_mm 400", "10 mm"))


def test_the_day_that_a_certificate_is_due():
    def due(**more: object) -> dt.date | None:
        return Certificate.model_validate({"number": "1", "u_mm": 1e-3, "k": 2, "date": "2024-01-31", **more}).due

    assert due() is None and due(valid_until="2025-01-31") == dt.date(2025, 1, 31)
    assert due(interval_months=12) == dt.date(2025, 1, 31)
    assert (due(interval_months=1), due(interval_months=11)) == (dt.date(2024, 2, 29), dt.date(2024, 12, 31))


def test_file_with_calibrated_is_read():
    old = TEXT.replace("accuracy_mm: 0.0005", "accuracy_mm: 0.0005\n    calibrated: 2026-05-11", 1)
    assert parse(old, "cell.yaml").gauges.g1.certificate is None


def _with(**sections: object) -> str:
    data = yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text())
    kept = {"name": "tracker", "robot": data["robot"]}
    return yaml.safe_dump(kept | {name: data[name] for name in sections})


def test_a_cell_with_a_tracker_alone_names_neither_gauges_nor_feedback():
    rig = parse(_with(), "tracker")
    assert rig.gauges.recorded == {} and dict(rig.gauges) == {}
    with refused("rig_file.invalid", "neither gauges nor feedback to read"):
        streams_of(rig)


def test_gauges_are_there_with_feedback_and_touches_need_feedback_alone():
    with refused("rig_file.invalid", "add feedback, or remove the gauges"):
        parse(_with(gauges=True), "tracker")
    rig = parse(_with(feedback=True), "touches")
    assert [stream.name for stream in streams_of(rig)] == ["robot"] and rig.gauges.baseline_mm == 0
    automatic = "automatic: {rules: [{test: radial, when: {from_deg: [0, 0, 0, 0, 0, 0], to_deg: [9, 0, 0, 0, 0, 0]}}]}"
    with refused("rig_file.invalid", "requires gauges and feedback"):
        parse(_with(feedback=True) + automatic, "touches")


def test_maker_follows_from_feedback_or_name():
    ur, any_makers = load("ur10e-cell")[0], load("paper-fanuc")[0]
    assert (ur.makers, any_makers.makers) == (("ur",), ("fanuc",))
    nameless = any_makers.model_copy(update={"robot": any_makers.robot.model_copy(update={"name": "elbow arm"})})
    assert nameless.maker is None and nameless.makers == MAKERS


@pytest.mark.parametrize("name", ["ur10-cell", "ur10e-cell"])
def test_a_shipped_cell_has_the_arm_of_the_library(name):
    cell, arm = load(name)[0].robot, load_arm(name.removesuffix("-cell")).robot
    assert cell.build == arm.build
    for shipped_axis, axis in zip(cell.axes, arm.axes, strict=True):
        assert shipped_axis.model_copy(update={"name": axis.name}) == axis


@pytest.mark.parametrize(
    ("written", "in_metres", "place"),
    [
        ("xyz_mm: [0, 0, 150]", "xyz_mm: [0, 0, 0.15]", "robot.tool"),
        ("ball_mm: [0, 0, 120]", "ball_mm: [0, 0, 0.12]", "tests.touch.ball_mm"),
    ],
)
def test_a_place_on_the_flange_in_metres_is_doubted(written, in_metres, place):
    text = shipped()["ur10e-cell"].read_text(encoding="utf-8")
    text = text.replace("tests:\n", "tests:\n  touch: {sockets: [A, B], ball_mm: [0, 0, 120]}\n")
    parse(text, "cell.yaml")
    with refused("rig_file.invalid", "has no coordinate of") as told:
        parse(text.replace(written, in_metres), "cell.yaml")
    assert re.search(rf"line \d+, {place}: ", str(told.value))
    parse(text.replace(written, written[: written.index("[")] + "[0, 0, 0]"), "cell.yaml")


def test_a_name_with_capitals_is_refused_in_plain_words():
    _, text = load("ur10e-cell")
    with refused("rig_file.invalid", "begins with a letter or digit,") as told:
        parse(text.replace("name: ur10e", "name: My Cell", 1), "cell.yaml")
    assert "'My Cell'" in str(told.value) and "pattern" not in str(told.value)
