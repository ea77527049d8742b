import datetime as dt
import re

import numpy as np
import pytest

from analysis.diagnosis.evidence.given import given_effects, parse_effects, without_fixed
from analysis.diagnosis.evidence.observation import outside_effect_coverage
from rigs.effects import Effect, EffectProvenance, JointOffset
from rigs.errors import UseError


@pytest.mark.parametrize(
    ("words", "count"),
    [
        ("joint_offset", 6),
        ("link_geometry", 18),
        ("link_geometry:3", 3),
        ("link_geometry:3.beta", 1),
        ("transmission_error:4:2", 2),
        ("transmission_error", 24),
        ("backlash:1, backlash:1 ,time_lag", 2),
        ("gauge_scale", 2),
        ("wrist_coupling:4.5,ball_form:3,vibration:8.5,gauge_cyclic:g1:0.5", 7),
    ],
)
def test_words_stand_for_effects(words, count):
    assert len(parse_effects(words)) == count


@pytest.mark.parametrize(
    "word",
    [
        *("backlsh", "backlash:x", "backlash:1-3", "backlash:7", "backlash:1.a", "backlash:1:2", "joint_offset:²"),
        *("link_geometry:q.a", "transmission_error:4:abc", "transmission_error:4:0", "time_lag:3", "gauge_scale:g3"),
        *("wrist_coupling", "ball_form", "vibration", "gauge_cyclic:g1", "ball_form:99"),
    ],
)
def test_words_that_stand_for_none_say_how_to_write_it(word):
    with pytest.raises(UseError, match="--fit"):
        parse_effects(word)


def test_a_wave_is_asked_for_with_one_phase_and_its_fit_finds_the_other():
    assert len(given_effects("transmission_error:4:2")) == 1 < len(parse_effects("transmission_error:4:2"))


def test_fixed_effects_are_not_fitted():
    kept, fixed = without_fixed(given_effects("joint_offset,link_geometry:3"), "joint_offset:1,link_geometry:3.d")
    assert [effect.axis for effect in kept] == [2, 3, 4, 5, 6, 3, 3]
    assert [effect.effect for effect in fixed] == ["joint_offset", "link_geometry"]


@pytest.mark.parametrize("words", ["backlash:1", "joint_offset", "joint_offset:9"])
def test_list_that_excludes_nothing_or_all_is_refused(words):
    with pytest.raises(UseError, match="--fix"):
        without_fixed(given_effects("joint_offset"), words)


def _effect(axis: int, *ranges: tuple[float, float]) -> Effect:
    found = EffectProvenance(date=dt.date(2026, 11, 20), runs=("a",), joints_deg=ranges or None)
    return JointOffset(axis=axis, offset_deg=0.1, found=found)


WIDE = ((-180.0, 180.0),) * 5


def test_the_narrowest_range_counts_and_a_few_degrees_more_do_not():
    effects = [_effect(1, (-50.0, 40.0), *WIDE), _effect(2, (-20.0, 60.0), *WIDE), _effect(3)]
    q = np.radians([[-22.0, 0, 0, 0, 0, 0], [42.0, 0, 0, 0, 0, 0]])
    assert outside_effect_coverage(effects, q, "it") == []
    (line,) = outside_effect_coverage(effects, np.radians([[-24.0, 0, 0, 0, 0, 0], [30.0, 0, 0, 0, 0, 0]]), "it")
    assert re.match("it: axis 1 .*-24.0° to 30.0°, 1 of 2 .*-20.0° to 40.0°", line)
