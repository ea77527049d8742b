"""Requirements of every effect, from the rig file to the correction. As a program it checks the named effects."""

from __future__ import annotations

import datetime as dt
import sys
from functools import cache
from typing import get_args

import numpy as np

from analysis.apps.correct.corrected_constants import joint_zeros, link_constants
from analysis.apps.planning import plan_report
from analysis.apps.report.diagnosis_words import plain_name, size
from analysis.correction.support import supports
from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.given import given_effects, parse_effects
from analysis.diagnosis.evidence.observation import observe_run
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.background import background_of
from analysis.diagnosis.fit.candidates import Level, candidates_for, columns_for
from analysis.diagnosis.fit.refine import refine
from analysis.diagnosis.fit.responses import linearise
from analysis.diagnosis.fit.search import fit_given
from analysis.diagnosis.judge.named import Named
from analysis.procedures.simulate import simulate
from analysis.robot.predict import model_of
from analysis.runs.tables import CircleTable
from rigs.edit import extended
from rigs.effects import VOCABULARY, Effect, EffectProvenance, bounds, size_field
from rigs.load import parse
from rigs.problems import RigFileError
from rigs.schema.effect import AT_AXIS, SEATS, Use, healthy, identity, is_play, name_of, scaled
from rigs.schema.scene import STAGES
from tests.support.diagnosis_cells import RIG, TEXT, WAYS, plan_without_further_tests

TIMES = 20.0
"""Size of a fault in healthy sizes: real faults have about 5 to 100."""


def word_for(name: str) -> str:
    """Command-line word for an effect, on axis 2 (moved by every test) if the effect has an axis."""
    place = VOCABULARY[name].PLACE
    where = "2" if place is AT_AXIS else place.example.partition(" ")[0]
    return f"{name}:{where}" if where else name


def fault(name: str) -> Effect:
    sound = healthy(parse_effects(word_for(name))[0])
    most = bounds(sound, size_field(sound))[1] / size_of(sound)
    return scaled(sound, min(TIMES, 0.8 * most))


def size_of(effect: Effect) -> float:
    """Size parameter of an effect in its own unit."""
    return float(getattr(effect, size_field(effect)))


def in_a_rig_file(name: str) -> None:
    """Check that the effect survives writing to and reading from a rig file, and that a misspelt key is reported
    with the nearest correct key.
    """
    found = EffectProvenance(
        date=dt.date(2026, 1, 2), runs=("yaw-1",), sd={size_field(fault(name)): 0.1}, gap_um=(3.0, 1.0)
    )
    effect = fault(name).model_copy(update={"found": found})
    text = extended(TEXT, [effect], "cell.yaml")
    assert parse(text, "cell.yaml").effects == (effect,)
    try:
        parse(text.replace(f"{size_field(effect)}:", f"{size_field(effect)}x:"), "cell.yaml")
    except RigFileError as error:
        assert f"did you mean {size_field(effect)}?" in str(error), error
    else:
        raise AssertionError("an unknown key was taken")


def declared(name: str) -> None:
    """Check that file, name, stage and seat are consistent, and that the identity excludes fitted parameters."""
    effect = fault(name)
    assert type(effect).__module__.rpartition(".")[2] == effect.effect == name
    assert effect.STAGE in STAGES and effect.healthy > 0
    assert identity(effect) == identity(scaled(effect, 3.0)) and hash(identity(effect))
    needed = {key for key, info in type(effect).model_fields.items() if info.is_required()}
    assert needed & set(SEATS) or not effect.seat
    assert {shape.field for shape in (*effect.FREE, *effect.STRETCHED)} <= set(type(effect).model_fields)


@cache
def tables_of(name: str) -> tuple[CircleTable, ...]:
    """Simulate two circles in each direction with a fault of this effect."""
    planted = (fault(name),)
    made = [simulate(RIG, "yaw", way, 10 * k + half, planted) for half in (0, 5) for k, way in enumerate(WAYS, 1)]
    return tuple(table for table in made if isinstance(table, CircleTable))


def simulated(name: str) -> None:
    """Check that the effect changes the readings and that size zero does not."""
    nothing, whole, none = (
        simulate(RIG, "yaw", "cw", None, effects).g_mm  # type: ignore[union-attr]
        for effects in ((), (fault(name),), (scaled(fault(name), 0.0),))
    )
    assert np.abs(none - nothing).max() < 1e-12
    assert 1e-4 < np.abs(whole - nothing).max() < 50


def calibrated(name: str) -> None:
    """Check that a calibration of the named effect returns the simulated size.

    The tolerance is twice u for a growth, whose time constant is uncertain from laps of a minute, and for a lag, which
    also varies between runs.
    """
    runs = [observe_run(model_of(RIG), table, table.direction) for table in tables_of(name)]
    refined = fit_given(runs, given_effects(word_for(name)), lambda _: None).fit
    (found,) = refined.effects
    assert name_of(found) == name_of(fault(name))
    near(found, fault(name), 2 * refined.sd(0)[size_field(found)] if found.STRETCHED or name == "time_lag" else 0.0)


def near(found: Effect, planted: Effect, unsure: float) -> None:
    """Check that a fitted size agrees with the true size within 15 % plus its uncertainty."""
    off = abs(size_of(found) - size_of(planted))
    assert off < unsure + 0.15 * size_of(planted), (found, planted, unsure)


def in_a_plan(name: str) -> None:
    """Check that plans contain the effect, unless it is searched in the time of each run."""
    planned = plan_without_further_tests()
    names = {sight.effect.effect for sight in planned.detectabilities}
    assert (name in names) != (VOCABULARY[name].swinging(5.0, 0.01) is not None)
    assert all(row["unit"] is not None for row in plan_report.as_object(planned)["effects"])


def diagnosed(name: str) -> None:
    """Check that the effect is a candidate, its shapes are fitted with it, and reports can describe it."""
    runs = [observe_run(model_of(RIG), table, table.direction) for table in tables_of(name)]
    setups, _ = fit_run_setups(runs)
    linear = linearise(blocks_of(runs, setups), setups)
    candidates = [one for one in candidates_for(linear) if one.effect.effect == name]
    assert bool(candidates) == (VOCABULARY[name].swinging(5.0, 0.01) is None)
    assert all(np.isclose(size_of(one.effect), one.size * one.effect.healthy) for one in candidates)
    assert all((one.size == one.effect.STRAIGHT) or is_play(one.effect) for one in candidates)
    columns = columns_for(linear, candidates_for(linear))
    seen = {form.name for form in columns.forms} | set(columns.not_seen)
    assert {one.name for one in candidates} <= seen
    background = background_of(columns, np.ones(len(linear.y)), columns.variance(Level(0.0)))
    found = refine(linear, background, [scaled(fault(name), 0.7)])
    (effect,) = found.effects
    near(effect, fault(name), 5 * found.sd(0)[size_field(effect)])
    named = Named(effect, found.sd(0), 1.0, (), 1.0, effect.remedy(), 1.0, True, None)
    told = (plain_name(RIG, effect), size(named), effect.remedy(), name_of(effect), effect.idle)
    assert all(words and "{" not in words and "\n" not in words for words in told), told
    if "axis" in type(effect).model_fields:
        assert "axis 2 (W)" in plain_name(RIG, effect) or fault(name).seat[0] != "2"


def corrected(name: str) -> None:
    """Check that a correction is possible or the reason is given, and that a correctable constant exists in the rig
    file.
    """
    found = EffectProvenance(date=dt.date(2026, 1, 2), runs=("yaw-1",), sd={size_field(fault(name)): 1e-9})
    effect = fault(name).model_copy(update={"found": found})
    rig = RIG.model_copy(update={"effects": (effect,)})
    (support,) = supports(rig)
    assert support.use in get_args(Use) and support.reason
    assert bool(effect.compensation().why_not) == (support.use == "none")
    corrections = joint_zeros(rig, [support]) + link_constants(rig, [support])
    assert len(corrections) == (support.use in ("joint zero", "link constant"))
    assert all(one.delta == size_of(effect) for one in corrections)


STEPS = (in_a_rig_file, declared, simulated, calibrated, in_a_plan, diagnosed, corrected)

if __name__ == "__main__":
    for asked in sys.argv[1:]:
        for step in STEPS:
            step(asked)
