"""From runs to a diagnosis: find the disagreement, name the missing effect, add it, prove that the gap shrinks.

runs → blocks (whitened) → names by evidence, defended on the simulator → verdict, proof, what to do
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnose.blocks import Block, blocks_of
from analysis.diagnose.candidates import candidates_for, name_of
from analysis.diagnose.diagnosis import Curve, Diagnosis, Gap, Map, Named, NextTest, Verdict
from analysis.diagnose.evidence import Dictionary
from analysis.diagnose.explain import Explained, Explainer
from analysis.diagnose.leftover import LIMIT, excess, leftovers, unknown, whole
from analysis.diagnose.linear import Linear
from analysis.diagnose.locate import places, turns_of
from analysis.diagnose.observed import GRID, Seen, curve, see
from analysis.diagnose.parting import parting
from analysis.diagnose.remedy import remedy
from analysis.diagnose.search import QUIET, RICH, Search
from analysis.diagnose.settle import grown, settled
from analysis.diagnose.shake import Swing, stilled, swing
from analysis.diagnose.signatures import parts
from analysis.fitting.observation import rms
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp, model_of
from analysis.model.targets import target_angles
from analysis.reading.loading import Measured
from analysis.reading.tables import CircleTable, PoseTable, RepeatabilityTable
from rigs.effects import Effect, healthy_size, size_field
from rigs.errors import FileError
from rigs.rig import Rig

_REFINED = 100.0
"""Log evidence that names may gain when they are refined."""
_GROWN = 1.02
"""A gap that grows by more than this with its names is none that they explain."""
_BETTER = 0.97
"""Of the gap with an effect of the rig file: less without it is a reason to doubt it."""
_LOOKS = 3
_FAR_MM = 0.3
"""A ball that moves further than this when names are added makes the first look a rough one."""
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
    look = _looked(runs, progress)
    shaken = _shaken(runs, look)
    if shaken:
        progress("once more without the swing of the link")
        refined = look.found.refined
        still = stilled(grown(runs, refined.effects), refined.setups, shaken.effect.frequency_hz)
        look = _looked([replace(run, one=calm.one) for run, calm in zip(runs, still, strict=True)], progress)
    blocks, linear, search, found = look.linear.blocks, look.linear, look.search, look.found
    verdict, why = _verdict(look, shaken is not None)
    next_test = None
    if verdict == "ambiguous":
        progress("which test would part the rivals")
        next_test, more = _next_test(rig, found, used)
        why += more
    progress("proving it on runs left out")
    effects = found.refined.effects if verdict in ("named", "ambiguous", "outside_library") else ()
    kept = () if verdict == "outside_library" else effects
    train = _gap(runs, kept, blocks, _names(used))
    if kept and train.after_um > _GROWN * train.before_um:
        verdict, why, kept = "outside_library", "with the names found the gap grows instead of shrinking", ()
        train, next_test = _gap(runs, kept, blocks, _names(used)), None
    named = tuple(
        Named(
            effect,
            found.refined.sd(k),
            found.posterior[k],
            found.rivals[k],
            _without(linear, found, k, train),
            remedy(effect),
        )
        for k, effect in enumerate(effects)
    )
    if shaken:
        # It begins anew with every run, so no model takes it out of the readings.
        named += (Named(shaken.effect, shaken.sd, 1.0, (), train.after_um, remedy(shaken.effect)),)
    before = _in_mm(linear, linear.y)
    after = _in_mm(linear, found.refined.left) if kept else before
    return Diagnosis(
        verdict=verdict,
        why=why,
        rig=rig,
        runs=tuple(_names(used)),
        where=places(blocks, before),
        effects=named,
        train=train,
        held_out=_judged(rig, held_out, kept, blocks),
        unseen=_judged(rig, unseen, kept, blocks),
        left=leftovers(blocks, found.refined.left, found.background),
        setups=found.refined.setups if kept else linear.setups,
        groups=tuple(_group(one) for one in named if one.rivals and verdict == "ambiguous"),
        not_testable=search.not_testable,
        next_test=next_test,
        repeated=look.repeated,
        level=found.level,
        doubts=(*_doubts(runs, blocks, measured=look.repeated), *_of_the_rig(rig, runs)),
        curves=tuple(_curve(block, b, a) for block, b, a in zip(blocks, before, after, strict=True) if block.sampling),
        maps=tuple(_map(block, b, a) for block, b, a in zip(blocks, before, after, strict=True) if not block.sampling),
        seconds=time.perf_counter() - begin,
    )


@dataclass(frozen=True)
class _Look:
    """Runs about set-ups, and the names found there; unexplained: log evidence of what they leave; repeated: whether
    the noise is from repeats."""

    linear: Linear
    search: Search
    found: Explained
    unexplained: float
    repeated: bool


def _looked(runs: Sequence[Seen], progress: Callable[[str], None]) -> _Look:
    """Names found about fitted set-ups; anew about those that a large effect moves."""
    setups = _first_setups(runs)
    for _ in range(_LOOKS):
        blocks, noise = blocks_of(runs, setups)
        linear = Linear(blocks, setups)
        progress("what each effect would show")
        search = Search(Dictionary(linear, candidates_for(linear)))
        progress("searching for names")
        found, unexplained = _explained(linear, search)
        look = _Look(linear, search, found, unexplained, noise.measured)
        there = found.refined.setups
        moved = max([float(np.abs(there[name].ball - setup.ball).max()) for name, setup in linear.setups.items()])
        if moved < _FAR_MM:
            break
        setups = there
    return look


def _shaken(runs: Sequence[Seen], look: _Look) -> Swing | None:
    """A swing beside the names found, where one pays for itself."""
    found = swing(grown(runs, look.found.refined.effects), look.found.refined.setups)
    if found is None or found.gain < look.search.price or not _counts(found.effect, look.found.level):
        return None
    return found


def _counts(effect: Effect, level: float) -> bool:
    """Whether an effect is more than what an arm with so much of everything shows anyway."""
    size: float = abs(getattr(effect, size_field(effect)))
    return level <= max(QUIET) or size > healthy_size(effect)


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
    return settled(list({run.name: run for run in reversed(runs)}.values()))[0]


def _explained(linear: Linear, search: Search) -> tuple[Explained, float]:
    """Names where a healthy arm shows little of everything, and log evidence of what they leave; where that is much,
    names where it shows more, if this explains it better than anything unknown would."""
    explainer = Explainer(linear, search)
    quiet = explainer.explain(QUIET)
    left = excess(linear.blocks, quiet.left, explainer.background)
    if left <= LIMIT:
        return explainer.defended(quiet), left
    # A rival in the place of one of them may leave less.
    mended = explainer.defended(quiet)
    rest = excess(linear.blocks, mended.refined.left, mended.background)
    if rest <= LIMIT:
        return mended, rest
    if rest < left:
        quiet, left = mended.refined, rest
    withdrawn = explainer.undefended(quiet)
    wanted = unknown(linear.blocks, quiet.left) - search.price * len(quiet.effects)
    if search.best(RICH).score + _REFINED < wanted:
        return withdrawn, left
    rich = explainer.explain(RICH)
    if explainer.score(rich) <= wanted:
        return withdrawn, left
    # An arm that shows more of everything: of its names only those count that are more than a healthy arm's.
    return explainer.defended(explainer.beyond_healthy(rich)), whole(rich.left, explainer.background)


def _verdict(look: _Look, shaken: bool) -> tuple[Verdict, str]:
    found, terms = look.found, look.linear.U.shape[1]
    if not look.search.testable.any() or len(look.linear.y) < _ENOUGH * terms:
        return "not_testable_here", "these runs leave no reading free that could tell one effect from the set-up"
    if look.unexplained > LIMIT:
        return "outside_library", "something is there that no effect of the vocabulary explains"
    if not found.names and not shaken:
        return "within_tolerance", "nothing stands out of the noise and of what a healthy arm shows anyway"
    if found.doubtful:
        return "ambiguous", f"these tests do not tell {found.names[found.doubtful[0]]} from its rivals"
    return "named", "each name explains what no other does"


def _gap(runs: Sequence[Seen], effects: Sequence[Effect], blocks: Sequence[Block], names: Sequence[str]) -> Gap:
    """Runs before and after effects are in their model, set-ups fitted both times."""
    setups, before = settled(runs)
    after = settled(grown(runs, effects), setups)[1] if effects else before
    floor = _floor(blocks, {run.name for run in runs})
    return Gap(tuple(names), 1e3 * rms(before), 1e3 * rms(after), floor)


def _next_test(rig: Rig, found: Explained, used: Sequence[Measured]) -> tuple[NextTest | None, str]:
    """The test that parts the first doubtful name from its nearest rival best, and what to say where none does."""
    place = found.doubtful[0]
    rivals = (found.refined.effects[place], found.rivals[place][0].effect)
    tests = tuple(dict.fromkeys(run.run.manifest.test for run in used))
    further = parting(rig, rivals, tests)
    if not further or not parts(further[0].sigma):
        return None, "; no other test parts them either, so their corrections do the same"
    return NextTest(further[0].test, further[0].why, further[0].sigma), ""


def _floor(blocks: Sequence[Block], names: Collection[str]) -> float:
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
    """The frozen model on runs that had no part in it."""
    return _gap(_seen(rig, runs), effects, blocks, _names(runs)) if runs else None


def _names(runs: Sequence[Measured]) -> list[str]:
    return [run.run.manifest.name for run in runs]


def _without(linear: Linear, found: Explained, k: int, train: Gap) -> float:
    """The gap on the runs used where one effect is taken out again, set-ups fitted."""
    column = linear.columns([found.refined.effects[k]])[:, 0]
    left = _in_mm(linear, found.refined.left)
    back = _in_mm(linear, found.refined.left + column)
    more = float(np.mean(np.concatenate(back) ** 2) - np.mean(np.concatenate(left) ** 2))
    return float(np.sqrt(max(0.0, train.after_um**2 + 1e6 * more)))


def _in_mm(linear: Linear, left: Array) -> list[Array]:
    """What is left (N,) in standard deviations as each block's vector in mm: less what set-up and scatter can do."""
    ends = np.cumsum([len(block.y) for block in linear.blocks])
    return [part * block.sd_mm for part, block in zip(np.split(left, ends[:-1]), linear.blocks, strict=True)]


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


def _of_the_rig(rig: Rig, runs: Sequence[Seen]) -> tuple[str, ...]:
    """Effects of the rig file without which the readings are explained better."""
    if not rig.effects:
        return ()
    whole = rms(settled(runs)[1])
    doubts = []
    for k, effect in enumerate(rig.effects):
        bare = (*rig.effects[:k], *rig.effects[k + 1 :])
        without = rms(settled([replace(run, model=replace(run.model, effects=bare)) for run in runs])[1])
        if without < _BETTER * whole:
            doubts.append(
                f"without {name_of(effect)} of the rig file the gap is {1e3 * without:.1f} instead of "
                f"{1e3 * whole:.1f} µm: take it out and diagnose again"
            )
    return tuple(doubts)


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
