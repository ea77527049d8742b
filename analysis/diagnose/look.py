"""A look at runs: set-ups fitted, noise told, names found and defended; again where these change what was looked at.

A large effect moves the ball that a fit without it had found, and a swing of the link hides in every run's noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnose.blocks import blocks_of
from analysis.diagnose.candidates import candidates_for
from analysis.diagnose.evidence import Dictionary
from analysis.diagnose.explain import Explained, Explainer
from analysis.diagnose.freeforms import STRANGE, strangest
from analysis.diagnose.leftover import LIMIT, excess, unknown, whole
from analysis.diagnose.linear import Linear
from analysis.diagnose.observed import Seen
from analysis.diagnose.search import QUIET, RICH, Search
from analysis.diagnose.settle import grown, settled
from analysis.diagnose.shake import Swing, stilled, swing
from analysis.model.predict import SetUp
from rigs.effects import Effect, healthy_size, size_field

_REFINED = 100.0
"""Log evidence that names may gain when they are refined."""
_LOOKS = 3
_FAR_MM = 0.3
"""A ball that moves further than this when names are added makes the first look a rough one."""


@dataclass(frozen=True)
class Look:
    """Runs about set-ups, and the names found there; foreign: what else is there in a few words, None where names leave
    noise; repeated: whether the noise is from repeats; swing: of the link, taken out of the runs before they were
    looked at."""

    linear: Linear
    search: Search
    found: Explained
    foreign: str | None
    repeated: bool
    swing: Swing | None = None


def looked(runs: Sequence[Seen], progress: Callable[[str], None]) -> Look:
    """Names found in runs, once more where a swing was found beside them."""
    look = _looked(runs, progress)
    refined = look.found.refined
    with_names = grown(runs, refined.effects)
    found = swing(with_names, refined.setups)
    if found is None or found.gain < look.search.price or not _counts(found.effect, look.found.level):
        return look
    progress("once more without the swing of the link")
    still = stilled(with_names, refined.setups, found.frequency_hz)
    calm = [replace(run, one=one.one) for run, one in zip(runs, still, strict=True)]
    return replace(_looked(calm, progress), swing=found)


def _looked(runs: Sequence[Seen], progress: Callable[[str], None]) -> Look:
    """Names found about fitted set-ups; anew about those that a large effect moves."""
    setups = _first_setups(runs)
    for _ in range(_LOOKS):
        blocks, noise = blocks_of(runs, setups)
        linear = Linear(blocks, setups)
        progress("what each effect would show")
        search = Search(Dictionary(linear, candidates_for(linear)))
        progress("searching for names")
        found, foreign = _explained(linear, search)
        look = Look(linear, search, found, foreign, noise.measured)
        there = found.refined.setups
        moved = max([float(np.abs(there[name].ball - setup.ball).max()) for name, setup in linear.setups.items()])
        if moved < _FAR_MM:
            break
        setups = there
    return look


def _first_setups(runs: Sequence[Seen]) -> dict[str, SetUp]:
    """Set-ups fitted to the first run of each kind: near enough to be refined."""
    return settled(list({run.name: run for run in reversed(runs)}.values()))[0]


def _explained(linear: Linear, search: Search) -> tuple[Explained, str | None]:
    """Names where a healthy arm shows little of everything, and what is foreign beside them; where something is, names
    where it shows more, if this explains it better than anything unknown would."""
    explainer = Explainer(linear, search)
    quiet = explainer.defended(explainer.explain(QUIET))
    refined = quiet.refined
    left = excess(linear.blocks, refined.left, quiet.background)
    stranger = strangest(linear, refined, quiet.background)
    if left <= LIMIT and stranger.gain <= STRANGE:
        return quiet, None
    foreign = stranger.words if stranger.gain > max(left, STRANGE) else ""
    noise = unknown(linear.blocks, refined.left) - search.price * len(quiet.names)
    wanted = max(noise, explainer.score(refined) + stranger.gain - search.price)
    if search.best(RICH).score + _REFINED < wanted:
        return quiet, foreign
    rich = explainer.explain(RICH)
    if explainer.score(rich) <= wanted:
        return quiet, foreign
    # An arm that shows more of everything: of its names only those count that are more than a healthy arm's.
    beyond = whole(rich.left, explainer.background) > LIMIT
    return explainer.defended(explainer.beyond_healthy(rich)), "" if beyond else None


def _counts(effect: Effect, level: float) -> bool:
    """Whether an effect is more than what an arm with so much of everything shows anyway."""
    size: float = abs(getattr(effect, size_field(effect)))
    return level <= max(QUIET) or size > healthy_size(effect)
