"""A diagnosis for scripts: one object with the keys of docs/diagnosis.md; what is not known is null, never NaN."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from analysis.diagnosis.diagnosis import Diagnosis, Gap, Named, Place, Rival
from analysis.model.predict import SetUp
from analysis.reporting.for_json import for_json
from analysis.reporting.parameters import parameters_of
from rigs.schema.effect import SEATS, name_of


def as_object(found: Diagnosis) -> dict[str, Any]:
    """Angles in degrees, gaps in µm, each parameter in the unit of its name."""
    answer = {
        "verdict": found.verdict,
        "why": found.why,
        "rig": found.rig.name,
        "runs": list(found.runs),
        "effects": [_named(one) for one in found.effects],
        "remainder": {
            "um": found.remainder.um,
            "share": found.remainder.share,
            "words": found.remainder.words,
            "healthy_um": found.remainder.healthy_um,
        },
        "where": [_place(place) for place in found.where],
        "gap": {
            "unit": "um",
            "noise_floor": found.train.noise_floor_um,
            "train": _gap(found.train),
            "held_out": _gap(found.held_out),
            "unseen_place": _gap(found.unseen),
        },
        "left": [asdict(one) for one in found.left],
        "setup": {name: _setup(name, setup) for name, setup in found.setups.items()},
        "groups": [list(group) for group in found.groups],
        "not_testable": list(found.not_testable),
        "next_test": asdict(found.next_test) if found.next_test else None,
        "repeats_measured": found.repeated,
        "level": found.level,
        "doubts": list(found.doubts),
        "seconds": found.seconds,
    }
    plain: dict[str, Any] = for_json(answer)
    return plain


def _named(one: Named) -> dict[str, Any]:
    return {
        **_effect(one),
        "rivals": [_effect(rival) for rival in one.rivals],
        "worth_um": one.worth_um,
        "material": one.material,
        "held_out_gain": one.held_out_gain,
        "gap_without_um": one.gap_without_um,
        "remedy": one.remedy,
    }


def _effect(one: Named | Rival) -> dict[str, Any]:
    effect = one.effect
    places = {key: getattr(effect, key) for key in SEATS if hasattr(effect, key)}
    return {
        "effect": effect.effect,
        **places,
        "name": name_of(effect),
        "parameters": {
            field: {"value": value, "sd": one.sd.get(field)} for field, value in parameters_of(effect).items()
        },
        "posterior": one.posterior,
    }


def _place(place: Place) -> dict[str, Any]:
    return {"channel": place.test, **{key: value for key, value in asdict(place).items() if key != "test"}}


def _gap(gap: Gap | None) -> dict[str, Any] | None:
    if gap is None:
        return None
    return {
        "before": gap.before_um,
        "after": gap.after_um,
        "calibrated": gap.calibrated_um,
        "noise_floor": gap.noise_floor_um,
        "runs": list(gap.runs),
    }


def _setup(name: str, setup: SetUp) -> dict[str, Any]:
    if name.startswith("pose"):
        return {
            "T_instrument_world": setup.T_instrument_world.tolist(),
            "T_tool_target": setup.T_tool_target.tolist(),
        }
    return {"ball_mm": setup.ball.tolist(), "zeros_mm": setup.zeros_mm.tolist()}
