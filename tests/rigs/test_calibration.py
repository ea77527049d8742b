import base64
import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import ValidationError

from analysis.procedures.shared.test_kind import nominal_setup, path_of, predict
from analysis.robot.kinematics.arm import Array
from analysis.robot.predict import driven, model_of
from rigs import load as reading
from rigs.calibration import (
    CalibratedModel,
    CalibrationFile,
    GaugePortions,
    effects_of,
    packed_factor,
)
from rigs.edit import extended
from rigs.effects import (
    VOCABULARY,
    Backlash,
    Effect,
    GaugeInclination,
    JointOffset,
    LinkGeometry,
    TransmissionError,
)
from rigs.errors import FileError
from rigs.load import SHIPPED, calibrated_beside, load, parse
from rigs.schema.effect import healthy, phases, scaled, size_of
from tests.support.diagnosis_cells import RIG, table_of
from tests.support.handmade_calibration import NAMED, SMALL, calibrated_model, written
from tests.support.refusals import refused


@pytest.fixture(autouse=True)
def _nothing_remembered():
    """Clear the caches before each test."""
    reading._calibrations.clear()  # private: calibrations are kept by their digest
    yield
    reading._calibrations.clear()  # private: as above


def _added(effects: Sequence[Effect]) -> Array:
    """Change of the readings (m, 2) mm of a circle by effects."""
    table = table_of("yaw", "cw", None)
    model = model_of(RIG, ())
    path, setup = path_of(model, table), nominal_setup(RIG, table)
    return predict(model_of(RIG, effects), table, path, setup) - predict(model, table, path, setup)


def _turned(effect: Effect) -> Array:
    """Joint errors (n, 6) rad by an effect on a circle."""
    path = path_of(model_of(RIG, ()), table_of("yaw", "cw", None))
    return driven(model_of(RIG, (effect,)), path).link_q - path.q


def test_a_file_is_read_back_as_it_was_written(tmp_path):
    model = calibrated_model()
    rig_file, beside = written(tmp_path, model)
    rig, text = load(rig_file)
    assert rig.calibrated == model
    assert beside.name == "cell.calibration.json" and text.startswith((SHIPPED / "paper-fanuc.yaml").read_text())
    assert rig.calibration == CalibrationFile(file=beside.name, sha256=hashlib.sha256(beside.read_bytes()).hexdigest())
    np.testing.assert_array_equal(rig.calibrated.root, model.root)
    np.testing.assert_array_equal(np.triu(model.root, 1), 0.0)
    # The README of the file: the terms can be read by any program, without rig.
    plain = json.loads(beside.read_text())
    assert [one["times"] for one in plain["terms"]] == [1.0, *(times for _, times in SMALL)]
    assert len(base64.b64decode(plain["factor"])) == 4 * 5 * 6 // 2


def test_the_model_of_a_rig_has_the_effects_of_both_files(tmp_path):
    rig, _ = load(written(tmp_path)[0])
    assert rig.effects[0].effect == "backlash" and rig.calibrated
    everything = [(NAMED, 1.0), *SMALL]
    kinds = [one.effect for one in model_of(rig).effects]
    assert kinds.count("backlash") == 1 and "joint_portions" in kinds and "joint_curve" in kinds
    assert len(kinds) == len(everything)


def _changed(data: dict[str, Any], **changed: Any) -> dict[str, Any]:
    return data | changed


def _bad_term(data: dict[str, Any], **changed: Any) -> dict[str, Any]:
    first, *rest = data["terms"]
    return data | {"terms": [first | changed, *rest]}


FACTOR = calibrated_model().factor
WRONG: dict[str, tuple[Callable[[dict[str, Any]], dict[str, Any]], str]] = {
    "factor cut off": (lambda data: _changed(data, factor=FACTOR[:-8]), "factor has 54 bytes, but 5 parameters need"),
    "factor of text": (lambda data: _changed(data, factor="what is a root?"), "factor is not base64"),
    "factor not finite": (
        lambda data: _changed(data, factor=packed_factor(np.full((5, 5), np.nan))), "factor contains numbers"
    ),
    "no factor": (lambda data: {key: one for key, one in data.items() if key != "factor"}, "factor: Field required"),
    "times not finite": (lambda data: _bad_term(data, times=float("nan")), "terms.0.times: "),
    "foreign field": (lambda data: _changed(data, owner="anna"), "owner: Extra inputs"),
    "foreign effect": (lambda data: _bad_term(data, effect={"effect": "joint_curve", "axis": 1}), "terms.0.effect"),
    "escape in a key": (lambda data: _changed(data, **{"\x1b[2J\n": 1}), "Extra inputs"),
    "term that is not there": (
        lambda data: _changed(data, parameters=[*data["parameters"][:-1], {"term": 5, "field": "times"}]),
        "a parameter refers to term 5, but there are only 5 terms",
    ),
    "is not a number of that effect": (
        lambda data: _changed(data, parameters=[{"term": 0, "field": "found"}, *data["parameters"][1:]]),
        "a parameter refers to found of backlash, which is not a number of that effect",
    ),
    "too many terms": (lambda data: _changed(data, terms=[data["terms"][0]] * 20_001), "terms: "),
    "a list": (lambda data: [data], "the file: "),
}  # fmt: skip


def _named_as(directory: Path, content: bytes) -> Path:
    directory.mkdir(exist_ok=True)
    (directory / "cell.calibration.json").write_bytes(content)
    named = CalibrationFile(file="cell.calibration.json", sha256=hashlib.sha256(content).hexdigest())
    rig_file = directory / "cell.yaml"
    rig_file.write_text(extended((SHIPPED / "paper-fanuc.yaml").read_text(), (), "cell", named))
    return rig_file


@pytest.mark.parametrize("case", WRONG)
def test_wrong_content_is_one_line(case, tmp_path):
    change, words = WRONG[case]
    data = json.loads(calibrated_model().model_dump_json())
    rig_file = _named_as(tmp_path, json.dumps(change(data)).encode())
    with pytest.raises(FileError) as told:
        load(rig_file)
    (line,) = told.value.lines()
    assert line.startswith(f"{tmp_path / 'cell.calibration.json'}: is not a calibration: "), line
    assert words in line and line.endswith("; diagnose again") and line.isprintable()


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b"[" * 100_000, b"null"])
def test_invalid_json_is_one_line(content, tmp_path):
    with refused("calibration.invalid", "is not a calibration") as told:
        load(_named_as(tmp_path, content))
    assert len(told.value.lines()) == 1


def test_a_changed_file_is_refused(tmp_path):
    rig_file, beside = written(tmp_path)
    beside.write_text(beside.read_text().replace("-0.4", "-0.5", 1))
    with refused("calibration.invalid", "differs from that in the rig") as told:
        load(rig_file)
    assert told.value.where == str(beside) and len(told.value.lines()) == 1


def test_special_or_oversized_file_is_refused(tmp_path):
    rig_file, beside = written(tmp_path)
    beside.unlink()
    beside.mkdir()
    with refused("calibration.missing", "same directory, but cannot be read"):
        load(rig_file)
    beside.rmdir()
    with beside.open("wb") as file:
        file.truncate(100_000_001)
    with refused("file.too_large", "MB, the limit for such files") as told:
        load(rig_file)
    assert told.value.where == str(beside)


def test_rig_file_names_only_a_file_of_its_directory():
    for name in ("../up.calibration.json", "/etc/x.calibration.json", "a/b.calibration.json", ".calibration.json", "x"):
        with pytest.raises(ValidationError):
            CalibrationFile(file=name, sha256="0" * 64)
    with pytest.raises(ValidationError):
        CalibrationFile(file="x.calibration.json", sha256="0" * 63)


def test_copy_without_its_calibration_is_refused_where_needed(tmp_path):
    """A run stores the text of its rig file, but not the neighbouring calibration file."""
    rig_file, beside = written(tmp_path / "here")
    (tmp_path / "there").mkdir()
    copy = Path(shutil.copy(rig_file, tmp_path / "there"))
    with refused("calibration.missing", "same directory, but cannot be read"):
        load(copy)
    rig = parse(rig_file.read_text(), "cell.yaml")
    assert calibrated_beside(rig, tmp_path / "there") is rig
    with refused("calibration.missing", "which is missing in the directory") as told:
        model_of(rig)
    assert "--rig" in told.value.remedy and len(told.value.lines()) == 1
    assert model_of(rig, ()).effects == ()  # who names the effects needs no calibration
    shutil.copy(beside, tmp_path / "there")
    assert calibrated_beside(rig, tmp_path / "there").calibrated == calibrated_model()
    # private: the property raises where a calibration is named and was not read
    assert parse(rig_file.read_text(), "cell.yaml")._calibrated is None  # the rig of the text alone stays as it is


def test_a_rig_can_have_the_errors_of_another_one(tmp_path):
    rig, _ = load(written(tmp_path)[0])
    other = parse((SHIPPED / "paper-fanuc.yaml").read_text(), "x")
    grown = other.modelled_as(rig)
    assert grown.calibrated == rig.calibrated and grown.effects == rig.effects
    assert grown.modelled_as(other).calibrated is None and grown.modelled_as(other).calibration is None


def test_a_second_calibration_takes_the_place_of_the_first(tmp_path):
    text = written(tmp_path)[0].read_text()
    later = CalibrationFile(file="later.calibration.json", sha256="a" * 64)
    behind = text.replace("calibration:", "automatic: null\ncalibration:", 1)
    for before in (text, f"# a remark\n{text}", behind, f"{text}\nautomatic: null\n# the end\n"):
        grown = extended(before, (JointOffset(axis=2, offset_deg=0.1),), "cell", later)
        assert grown.count("calibration:") == 1 and "cell.calibration.json" not in grown
        rig = parse(grown, "cell")
        assert rig.calibration == later and len(rig.effects) == 2


def test_constants_of_a_seat_sum_for_any_reference_sizes():
    deltas = (0.2, 0.01, -0.05, *np.random.default_rng(4).normal(0.0, 0.1, 50).tolist())
    terms = [(LinkGeometry(axis=3, field="a", delta=delta), 0.7 * k + 0.1) for k, delta in enumerate(deltas)]
    own = effects_of([*terms, (LinkGeometry(axis=3, field="d", delta=0.1), 2.0)])
    assert {(one.axis, one.field) for one in own if isinstance(one, LinkGeometry)} == {(3, "a"), (3, "d")}
    total = sum(one.delta for one in own if isinstance(one, LinkGeometry) and one.field == "a")
    assert total == pytest.approx(sum(times * one.delta for one, times in terms), rel=1e-12)
    assert len(own) == 2  # one constant is one effect


def test_waves_of_a_joint_become_one_curve_that_is_their_sum():
    rng = np.random.default_rng(3)
    waves = [
        (TransmissionError(axis=2, order=order, amplitude_deg=0.005, phase_deg=phase), float(rng.normal()))
        for order in (0.7, 1, 2, 6.283, 60, 121)
        for phase in (0.0, 90.0)
    ]
    other = (TransmissionError(axis=5, order=3, amplitude_deg=0.005), 0.5)
    curve, alone = effects_of([*waves, other])
    assert (curve.axis, alone.axis) == (2, 5)
    q = rng.uniform(-3.0, 3.0, 10_000)  # more than are computed at a time
    expected = np.zeros_like(q)
    for wave, times in waves:
        expected += times * wave.amplitude_deg * np.sin(wave.order * q + np.radians(wave.phase_deg))
    np.testing.assert_allclose(curve.at(q), expected, rtol=0, atol=1e-15)
    np.testing.assert_allclose(_added([curve]), _added([_times(one, times) for one, times in waves]), atol=1e-12)


def _times(effect: TransmissionError, times: float) -> TransmissionError:
    return effect.model_copy(update={"amplitude_deg": times * effect.amplitude_deg})


def test_a_wave_with_a_harmonic_is_a_share_of_itself():
    wave = TransmissionError(axis=2, order=2, amplitude_deg=0.005, third=0.3)
    (one,) = effects_of([(wave, -1.7)])
    np.testing.assert_allclose(_turned(one), -1.7 * _turned(wave), rtol=0, atol=1e-15)


def test_share_of_a_play_scales_the_effect_and_not_the_width():
    play = Backlash(axis=2, width_deg=0.02, transit=0.5)
    whole = _turned(play)
    for share in (0.25, -0.6, 3.0):
        (one,) = effects_of([(play, share)])
        assert [(own.of, own.times) for own in one.portions] == [(play, share)]
        np.testing.assert_allclose(_turned(one), share * whole, rtol=0, atol=1e-15)
    narrower = _turned(Backlash(axis=2, width_deg=0.005, transit=0.5))
    assert np.abs(narrower - 0.25 * whole).max() > 1e-6  # a play of a quarter of the width is another thing


def test_share_of_a_gauge_effect_scales_its_readings():
    tilt = GaugeInclination(gauge="g1", angle_deg=2.0)
    (one,) = effects_of([(tilt, -0.5)])
    assert isinstance(one, GaugePortions)
    np.testing.assert_allclose(_added([one]), -0.5 * _added([tilt]), atol=1e-12)


def test_zero_terms_are_left_out():
    assert effects_of([(JointOffset(axis=3, offset_deg=0.02), 9e-5), (JointOffset(axis=3), 4.0)]) == []
    assert len(effects_of([(JointOffset(axis=3, offset_deg=0.02), -2e-4)])) == 1


@pytest.mark.parametrize("name", VOCABULARY)
def test_every_effect_can_be_a_term(name):
    """Whatever a diagnosis writes, a rig that is read again simulates: what a negative share does is small and defined,
    and twice as many times do twice as much."""
    need = {"axis": 2, "field": "d", "gauge": "g1", "from_axis": 4, "to_axis": 5, "order": 8, "lobes": 3}
    fields = VOCABULARY[name].model_fields
    need |= {"period_mm": 0.5, "frequency_hz": 8.5}
    if "way" in fields:
        need["way"] = get_args(fields["way"].annotation)[0]
    bare: Effect = VOCABULARY[name].model_validate({key: value for key, value in need.items() if key in fields})
    for whole in phases(_small(bare)):
        model = calibrated_model([(whole, -0.5)])
        again = CalibratedModel.model_validate_json(model.model_dump_json())
        assert again == model
        half, all_of_it = (_added(effects_of([(whole, times)])) for times in (-0.5, -1.0))
        assert np.isfinite(half).all()
        largest = np.abs(all_of_it).max()
        np.testing.assert_allclose(2 * half, all_of_it, atol=0.05 * largest + 1e-9)


def _small(effect: Effect) -> Effect:
    found = scaled(healthy(effect), 0.1)
    assert size_of(found) == pytest.approx(0.1)
    return found


GOOD = calibrated_model()
COUNT = len(GOOD.parameters)


def _with_term(**changed: Any) -> dict[str, Any]:
    first, second, *rest = GOOD.terms
    return {"terms": (first, second.model_copy(update=changed), *rest)}


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"rig": "ur10e"}, "ur10e, but"),
        (_with_term(times=1e30), "offset_deg of 2e+28"),
        ({"factor": packed_factor(1e30 * np.eye(COUNT))}, "of term 0 is 1e+30"),
        ({"factor": packed_factor(np.zeros((COUNT, COUNT)))}, "of term 0 is 0"),
        ({"widened": 1e30}, "large errors"),
        ({"joints_deg": ((-30.0, 30.0),) * 7}, "7 axes"),
        ({"joints_deg": ((30.0, -30.0),) * 6}, "joints_deg"),
        ({"before_um": 1e12}, "large errors"),
        ({"calibrated_um": -3.0}, "large errors"),
    ],
)
def test_a_calibration_that_cannot_be_that_of_the_rig_is_refused(tmp_path, changed, why):
    model = CalibratedModel.model_construct(**dict(GOOD) | changed)
    rig_file, beside = written(tmp_path, model)
    with refused("calibration.invalid") as told:
        load(str(rig_file))
    assert str(told.value).startswith(f"{beside}: ")
    assert why in str(told.value)
