import datetime as dt
import re

import numpy as np

from analysis.diagnosis.evidence.observation import outside_effect_coverage
from rigs.effects import Effect, EffectProvenance, JointOffset


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
