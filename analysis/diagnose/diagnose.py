"""From runs to a diagnosis: find the disagreement, name the missing effect, add it, prove that the gap shrinks.

runs → blocks (whitened) → names by evidence, defended on the simulator → verdict, proof, what to do
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnose.blocks import Block, blocks_of
from analysis.diagnose.candidates import candidates_for, name_of
from analysis.diagnose.diagnosis import Curve, Diagnosis, Gap, Map, Named, Rival, Verdict
from analysis.diagnose.evidence import Dictionary
from analysis.diagnose.explain import Explained, Explainer
from analysis.diagnose.leftover import LIMIT, excess, leftovers
from analysis.diagnose.linear import Linear
from analysis.diagnose.locate import places, turns_of
from analysis.diagnose.observed import GRID, Seen, curve, see
from analysis.diagnose.remedy import remedy
from analysis.diagnose.search import LEVELS, QUIET, Search
from analysis.fitting.estimate import fit
from analysis.fitting.observation import residuals_of, rms
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp, model_of
from analysis.model.targets import target_angles
from analysis.reading.loading import Measured
from analysis.reading.tables import CircleTable, PoseTable, RepeatabilityTable
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig

_RIVALRY = 20.0
"""Odds under which a rival makes a name ambiguous."""
_ENOUGH = 3
"""Readings for each set-up term, at least, without which nothing can be told."""


def diagnose(
    rig: Rig,
    used: Sequence[Measured],
    held_out: Sequence[Measured],
    unseen: Sequence[Measured],
    progress: Callable[[str], None],
) -> Diagnosis:
    """Diagnose runs of one robot beside the model of a rig; judge on runs left out and at an unseen place.

    Raises FileError for runs of another robot, or that cannot be read as what they say.
    """
    begin = time.perf_counter()
    progress("reading the runs")
    runs = _seen(rig, used)
    setups = _first_setups(runs)
    blocks, noise = blocks_of(runs, setups)
    linear = Linear(blocks, setups)
    progress("what each effect would show")
    search = Search(Dictionary(linear, candidates_for(linear)))
    progress("searching for names")
    found = _explained(linear, search)
    unexplained = excess(blocks, found.refined.left, found.background)
    verdict, why = _verdict(linear, search, found, unexplained)
    progress("proving it on runs left out")
    effects = found.refined.effects if verdict in ("named", "ambiguous", "outside_library") else ()
    kept = () if verdict == "outside_library" else effects
    train = _gap(runs, setups, found.refined.setups if kept else setups, kept, blocks)
    named = tuple(
        Named(
            effect,
            found.refined.sd(k),
            found.posterior[k],
            tuple(Rival(rival.effect, rival.sd, rival.posterior) for rival in found.rivals[k]),
            _without(linear, found, k, train),
            remedy(effect),
        )
        for k, effect in enumerate(effects)
    )
    before = [block.mean_mm for block in blocks]
    after = _after(linear, found, kept)
    return Diagnosis(
        verdict=verdict,
        why=why,
        rig=rig,
        runs=tuple(run.run.manifest.name for run in used),
        where=places(blocks, before),
        effects=named,
        train=train,
        held_out=_judged(rig, held_out, kept, blocks),
        unseen=_judged(rig, unseen, kept, blocks),
        left=leftovers(blocks, found.refined.left, found.background),
        setups=found.refined.setups if kept else dict(setups),
        groups=tuple(_group(one) for one in named if one.rivals and verdict == "ambiguous"),
        not_testable=search.not_testable,
        next_test=None,
        repeated=noise.measured,
        level=found.level,
        doubts=_doubts(runs, blocks, measured=noise.measured),
        curves=tuple(_curve(block, b, a) for block, b, a in zip(blocks, before, after, strict=True) if block.sampling),
        maps=tuple(_map(block, b, a) for block, b, a in zip(blocks, before, after, strict=True) if not block.sampling),
        seconds=time.perf_counter() - begin,
    )


def _seen(rig: Rig, runs: Sequence[Measured]) -> list[Seen]:
    """Runs about the model of a rig, each with the circle and targets of its own rig file."""
    seen: list[Seen] = []
    cells: list[Rig] = []
    for run in runs:
        if run.rig.robot != rig.robot:
            raise FileError(
                str(run.path),
                f"is of another robot than {rig.name} ({_differing(run.rig, rig)})",
                "diagnose the runs of one robot at a time, or give the --rig that they were made with",
            )
        cell = run.rig.model_copy(update={"effects": rig.effects, "name": rig.name, "description": ""})
        if cell not in cells:
            cells.append(cell)
        one = see(model_of(cell), run.table, str(run.path))
        place = cells.index(cell)
        # Another circle or other gauges are another set-up.
        setup = one.one.setup + f" {place + 1}" * (place > 0)
        seen.append(replace(one, one=replace(one.one, setup=setup)))
    return seen


def _differing(one: Rig, other: Rig) -> str:
    fields = [name for name in type(one.robot).model_fields if getattr(one.robot, name) != getattr(other.robot, name)]
    return f"its {', '.join(fields)} differ{'s' * (len(fields) == 1)}"


def _first_setups(runs: Sequence[Seen]) -> dict[str, SetUp]:
    """Set-ups fitted to the first run of each kind: near enough to be refined."""
    setups: dict[str, SetUp] = {}
    for names in _by_model(runs).values():
        firsts = list({run.name: run for run in reversed(names)}.values())
        setups |= fit(firsts[0].model, [run.one for run in firsts]).setups
    return setups


def _by_model(runs: Sequence[Seen]) -> dict[int, list[Seen]]:
    """Runs of the same circle and targets together."""
    rigs: list[Rig] = []
    grouped: dict[int, list[Seen]] = {}
    for run in runs:
        if run.model.rig not in rigs:
            rigs.append(run.model.rig)
        grouped.setdefault(rigs.index(run.model.rig), []).append(run)
    return grouped


def _explained(linear: Linear, search: Search) -> Explained:
    """Names where a healthy arm shows little of everything; where that leaves too much, where it shows more."""
    explainer = Explainer(linear, search)
    quiet = explainer.explain(QUIET)
    left = excess(linear.blocks, quiet.refined.left, quiet.background)
    if left <= LIMIT:
        return quiet
    rich = explainer.explain(LEVELS[len(QUIET) :])
    return rich if rich.score - quiet.score > left else quiet


def _verdict(linear: Linear, search: Search, found: Explained, unexplained: float) -> tuple[Verdict, str]:
    terms = linear.U.shape[1]
    if not search.testable.any() or len(linear.y) < _ENOUGH * terms:
        return "not_testable_here", "these runs leave no reading free that could tell one effect from the set-up"
    if unexplained > LIMIT:
        return "outside_library", "something is there that no effect of the vocabulary explains"
    if not found.names:
        return "within_tolerance", "nothing stands out of the noise and of what a healthy arm shows anyway"
    doubtful = [name for name, p in zip(found.names, found.posterior, strict=True) if p < _RIVALRY / (1 + _RIVALRY)]
    if doubtful:
        return "ambiguous", f"these tests cannot tell {doubtful[0]} from its rivals"
    return "named", "each name explains what no other does"


@dataclass(frozen=True)
class _Left:
    """Residuals before and after, and how many readings."""

    before: list[Array]
    after: list[Array]


def _gap(
    runs: Sequence[Seen],
    setups: dict[str, SetUp],
    fitted: dict[str, SetUp],
    effects: Sequence[Effect],
    blocks: Sequence[Block],
) -> Gap:
    before, after = [], []
    for run in runs:
        before += residuals_of(run.model, [run.one], _own(run, setups))
        grown = replace(run.model, effects=(*run.model.effects, *effects))
        after += residuals_of(grown, [run.one], _own(run, fitted))
    names = tuple(dict.fromkeys(run.name for run in runs))
    return Gap(names, 1e3 * rms(before), 1e3 * rms(after) if effects else 1e3 * rms(before), _floor(blocks, names))


def _own(run: Seen, setups: dict[str, SetUp]) -> dict[str, SetUp]:
    return {run.one.setup: setups[run.one.setup]}


def _floor(blocks: Sequence[Block], names: Sequence[str]) -> float:
    """Root mean square in µm that the noise of a run gives: from repeats, else from the noise assumed."""
    total = count = 0.0
    for block in blocks:
        if block.name in names or not any(one.name in names for one in blocks):
            sd = (
                block.apart_mm if np.isfinite(block.apart_mm) else float(np.sqrt(np.mean(block.sd_mm**2 * block.count)))
            )
            size = len(block.one.rows) * block.count
            total, count = total + size * sd**2, count + size
    return 1e3 * float(np.sqrt(total / count))


def _judged(rig: Rig, runs: Sequence[Measured], effects: Sequence[Effect], blocks: Sequence[Block]) -> Gap | None:
    """The frozen model on runs that had no part in it, their set-ups fitted."""
    if not runs:
        return None
    before, after = [], []
    seen = _seen(rig, runs)
    for group in _by_model(seen).values():
        model, observations = group[0].model, [run.one for run in group]
        plain = fit(model, observations)
        before += plain.residuals
        grown: Model = replace(model, effects=(*model.effects, *effects))
        after += fit(grown, observations, setups=plain.setups).residuals if effects else plain.residuals
    names = tuple(dict.fromkeys(run.name for run in seen))
    return Gap(tuple(run.run.manifest.name for run in runs), 1e3 * rms(before), 1e3 * rms(after), _floor(blocks, names))


def _without(linear: Linear, found: Explained, k: int, train: Gap) -> float:
    """The gap on the runs used where one effect is taken out again: by its share of the blocks' energy."""
    columns = linear.columns([found.refined.effects[k]])[:, 0]
    with_it = float(found.refined.left @ found.refined.left)
    without = float(np.sum((found.refined.left + columns) ** 2))
    whole = float(linear.y @ linear.y)
    if whole <= with_it:
        return train.before_um
    share = min(1.0, max(0.0, (without - with_it) / (whole - with_it)))
    return float(np.sqrt(train.after_um**2 + share * max(0.0, train.before_um**2 - train.after_um**2)))


def _after(linear: Linear, found: Explained, effects: Sequence[Effect]) -> list[Array]:
    """Each block's mean residual (N,) mm with the effects in the model."""
    if not effects:
        return [block.mean_mm for block in linear.blocks]
    return [
        block.mean_mm - block.vector(linear.added_mm(k, effects, found.refined.setups))
        for k, block in enumerate(linear.blocks)
    ]


def _curve(block: Block, before: Array, after: Array) -> Curve:
    table = block.one.table
    assert isinstance(table, CircleTable)  # noqa: S101 - blocks with a sampling are circles
    phi = np.arange(GRID) * 360 / GRID
    return Curve(table.test, table.direction, phi, 1e3 * curve(before), 1e3 * curve(after), turns_of(block))


def _map(block: Block, before: Array, after: Array) -> Map:
    table = block.one.table
    if isinstance(table, PoseTable):
        sizes = [1e3 * np.linalg.norm(values.reshape(-1, 3), axis=1) for values in (before, after)]
        none = np.full(len(sizes[0]), np.nan)
        return Map("pose", np.arange(1.0, len(none) + 1), none, none, *sizes)
    assert not isinstance(table, CircleTable)  # noqa: S101 - circles have a sampling
    hemisphere = block.model.rig.tests.hemisphere
    assert hemisphere is not None  # noqa: S101 - its targets were checked when the run was read
    polar, azimuth = (np.degrees(angles)[table.target - 1] for angles in target_angles(hemisphere))
    test = "repeatability" if isinstance(table, RepeatabilityTable) else "radial"
    return Map(test, table.target.astype(float), polar, azimuth, 1e3 * before, 1e3 * after)  # type: ignore[arg-type]


def _group(one: Named) -> tuple[str, ...]:
    return (name_of(one.effect), *(name_of(rival.effect) for rival in one.rivals))


def _doubts(runs: Sequence[Seen], blocks: Sequence[Block], *, measured: bool) -> tuple[str, ...]:
    doubts = []
    circles = [block for block in blocks if block.sampling]
    if circles and not measured:
        doubts.append("no run was repeated: the noise is assumed (1.5 µm); repeat each circle at least once")
    ways: dict[str, set[str]] = {}
    for run in runs:
        table = run.one.table
        if isinstance(table, CircleTable):
            ways.setdefault(table.test, set()).add(table.direction)
    for test, seen in ways.items():
        if len(seen) == 1:
            doubts.append(f"{test} was driven {next(iter(seen))} only: what changes with the direction cannot be told")
    if not circles:
        doubts.append("no circle: what depends on speed or on reversals cannot be told")
    return tuple(doubts)
