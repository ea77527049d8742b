"""What has no name is told by what it goes with; what has one, and noise, leave no free form much to explain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from cells import Array, circles, found_in, healthy, holding, measured, no_background, white

from analysis.diagnose.blocks import Block
from analysis.diagnose.evidence import Background
from analysis.diagnose.freeforms import STRANGE, free_forms, strangest
from analysis.diagnose.refine import Refined, Unknown, refine
from analysis.reading.tables import CircleTable
from rigs.effects import Backlash, JointOffset


def _unnamed(left: Array, tangents: Array | None = None) -> Refined:
    """Nothing named, and what is left (N,); tangents: of what is free beside."""
    free = np.empty((len(left), 0)) if tangents is None else tangents
    unknowns = tuple(Unknown(k, "size", 0.0, 1e3) for k in range(free.shape[1]))
    return Refined((), unknowns, np.empty(0), np.empty((0, 0)), np.ones(len(unknowns), bool), left, free, {}, 0.0)


def _rates(block: Block) -> Array:
    return np.asarray(np.gradient(block.one.path.q, block.one.path.t_s, axis=0), dtype=float)


def _slips(block: Block) -> Array:
    q = block.one.path.q[:, 1]
    return np.where(q > q.min() + 0.4 * np.ptp(q), 2e-5, 0.0)[:, None]


ERRORS: dict[str, tuple[int, Callable[[Block], Array]]] = {
    "an error of axis 2 that goes with its angle": (2, _slips),
    "an error of axis 4 that goes with its speed, whichever way it turns": (
        4,
        lambda block: 3e-3 * np.abs(_rates(block)[:, [3]]),
    ),
    "an error of axis 1 that goes with the way axis 3 turns": (
        1,
        lambda block: 1e-5 * np.sign(_rates(block)[:, [2]]),
    ),
}


@pytest.mark.parametrize("words", ERRORS)
def test_an_error_that_no_effect_describes_is_told_by_what_it_goes_with(words: str) -> None:
    linear = healthy()
    axis, off = ERRORS[words]
    added = linear.projected(linear.by_joint(axis, off))[:, 0]
    left = white(linear, 1) + added * 30 / np.linalg.norm(added)
    found = strangest(linear, _unnamed(left), no_background(linear))
    assert found.words == words and found.gain > STRANGE
    fitted = left - added * (added @ left) / (added @ added)
    beside = strangest(linear, _unnamed(fitted, added[:, None]), no_background(linear))
    assert beside.gain < STRANGE / 4, "what a name does is not done again"


def test_beside_names_and_a_background_a_form_gains_what_the_density_gains() -> None:
    """By brute force: a form of any size on top of noise, background and names of any size, over none."""
    linear = healthy()
    rng = np.random.default_rng(5)
    background = Background(linear.columns([JointOffset(axis=axis, offset_deg=2e-3) for axis in (2, 3, 4, 5)]))
    free = linear.columns([Backlash(axis=axis, width_deg=1e-3) for axis in (1, 2)])
    C = np.eye(len(free)) + background._B @ background._B.T + 1e6 * free @ free.T
    added = linear.projected(
        linear.by_joint(4, ERRORS["an error of axis 4 that goes with its speed, whichever way it turns"][1])
    )
    y = rng.normal(size=len(free)) + added[:, 0] * 20 / np.linalg.norm(added)
    weighted = background.weighted(free)
    left = y - free @ np.linalg.solve(weighted.T @ free + 1e-6 * np.eye(2), weighted.T @ y)
    found = strangest(linear, _unnamed(left, free), background)
    form = next(form for form in free_forms(linear) if form.words == found.words).columns
    densities = [_log_density(y, C + s * form @ form.T) for s in 4.0 ** np.arange(-4, 11)]
    assert found.gain == pytest.approx(max(densities) - _log_density(y, C), rel=1e-3) and found.gain > STRANGE


def test_a_shape_at_its_bound_takes_nothing_off_a_form() -> None:
    """A play whose flanks lean the other way than any preload leans them: fitted to 0, which is its least."""
    linear = healthy()
    play = Backlash(axis=2, width_deg=0.02, preload=0.2)
    plain = play.model_copy(update={"preload": 0.0})
    leaning = linear.columns([plain])[:, 0] - (linear.columns([play]) - linear.columns([plain]))[:, 0]
    found = refine(holding(linear, white(linear, 3) + leaning), no_background(linear), [plain])
    shapes = [unknown.field for unknown, free in zip(found.unknowns, found.free, strict=True) if not free]
    assert shapes == ["preload"]
    gain = strangest(linear, found, no_background(linear)).gain
    freed = strangest(linear, replace(found, free=np.ones(len(found.free), bool)), no_background(linear)).gain
    assert gain < freed


def _log_density(y: Array, C: Array) -> float:
    """Of a Gaussian, the constant left out."""
    return float(-0.5 * (y @ np.linalg.solve(C, y) + np.linalg.slogdet(C)[1]))


def test_what_changes_with_time_is_told_by_the_gauge() -> None:
    linear = healthy()

    def settles(block: Block) -> Array:
        t = block.one.path.t_s
        return np.where(t > 0.3 * t[-1], 1e-3, 0.0)[:, None]

    added = linear.projected(linear.by_gauge((0.0, 1.0), settles))[:, 0]
    left = white(linear, 2) + added * 30 / np.linalg.norm(added)
    found = strangest(linear, _unnamed(left), no_background(linear))
    assert found.words == "something that changes with time in gauge 2" and found.gain > STRANGE


def test_a_dent_is_told_as_of_the_ball() -> None:
    linear = healthy()

    def dented(block: Block) -> Array:
        lap = np.linspace(0, 2 * np.pi, len(block.one.path.t_s))
        lap = lap if block.name.endswith("acw") else -lap
        return -1e-3 * np.exp(-0.5 * ((lap % (2 * np.pi) - 2.0) / 0.1) ** 2)[:, None]

    added = linear.projected(linear.by_gauge((1.0, 1.0), dented))[:, 0]
    left = white(linear, 3) + added * 30 / np.linalg.norm(added)
    found = strangest(linear, _unnamed(left), no_background(linear))
    assert found.words == "something of the ball that goes with where the link is" and found.gain > STRANGE


def test_noise_alone_has_no_form() -> None:
    linear = healthy()
    gains = [strangest(linear, _unnamed(white(linear, seed)), no_background(linear)).gain for seed in range(10)]
    assert max(gains) < STRANGE / 4


def test_a_slip_is_outside_the_library_and_told_by_its_axis() -> None:
    """A coupling that jumps at one angle of joint 2, up on the way there and down on the way back."""
    runs = []
    for one in circles(seed=31):
        table = one.table
        assert isinstance(table, CircleTable)
        slipped = table.q.copy()
        q = table.q[:, 1]
        slipped[:, 1] -= np.radians(0.002) * (q > q.min() + 0.35 * np.ptp(q))
        runs.append(
            measured(
                CircleTable(table.test, table.direction, table.t_s, slipped, table.g_mm), "yaw", one.run.manifest.name
            )
        )
    found = found_in(runs)
    assert found.verdict == "outside_library" and found.why.endswith("an error of axis 2 that goes with its angle")
