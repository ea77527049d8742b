"""Held-out readings: their set-ups are fitted to a frozen model, and a set-up must not absorb what it is to judge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from analysis.fitting.estimate import fit
from analysis.fitting.observation import Observation
from analysis.fitting.placements import TO_SPARE
from analysis.fitting.setups import FRAME_TERMS, at_instrument, terms_of
from analysis.model.predict import Model, SetUp
from analysis.traces.tables import PoseTable


def pose_setup(observations: Sequence[Observation], setups: Mapping[str, SetUp]) -> SetUp | None:
    """Return one of the set-ups of poses, whose tool all placements share, or None where no poses, of (m, 3) mm, were
    used."""
    return next((setups[one.setup] for one in observations if isinstance(one.table, PoseTable)), None)


def with_enough_to_judge(
    observations: Sequence[Observation], setups: Mapping[str, SetUp], poses: SetUp | None
) -> tuple[list[Observation], list[str]]:
    """Return the held-out observations whose readings (m, k) mm are more than the terms of a set-up of their own, and
    messages about the others. `setups` are those of the readings used, and `poses` one of them or None."""
    reasons: dict[str, str] = {}
    for setup, own in _by_setup(observations, setups).items():
        readings = sum(one.values.size for one in own)
        terms = FRAME_TERMS if poses and isinstance(own[0].table, PoseTable) else terms_of(own[0].table)
        if readings <= terms:
            reasons[setup] = f"its {readings} readings are too few for the {terms} terms of the set-up alone"
    messages = [f"{setup} is not judged: {why}" for setup, why in reasons.items()]
    return [one for one in observations if one.setup not in reasons], messages


def held_out_setups(
    model: Model, observations: Sequence[Observation], setups: Mapping[str, SetUp], poses: SetUp | None
) -> dict[str, SetUp]:
    """Return all set-ups, those of held-out observations of (m, k) mm fitted to the model. A placement of few poses
    has the tool of `poses`, because with one of its own it would absorb its readings."""
    found, others = dict(setups), list[Observation]()
    for setup, own in _by_setup(observations, setups).items():
        spare = sum(one.values.size for one in own) - terms_of(own[0].table)
        if poses and isinstance(own[0].table, PoseTable) and spare < TO_SPARE:
            found[setup] = at_instrument(poses, [(model, one) for one in own])
        else:
            others += own
    return found | (fit(model, others).setups if others else {})


def _by_setup(observations: Sequence[Observation], known: Mapping[str, SetUp]) -> dict[str, list[Observation]]:
    """Return the observations of each set-up that is not known."""
    found: dict[str, list[Observation]] = {}
    for one in observations:
        if one.setup not in known:
            found.setdefault(one.setup, []).append(one)
    return found
