"""What a diagnosis finds, in the order in which a person thinks.

where they disagree → what is missing → what the model says with it → what is left → what these tests cannot tell →
what to do → which test next
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName

ODDS = 20.0
"""Against a rival, from which on it is dismissed; nearer ones leave a name ambiguous, and two names alike."""

Verdict = Literal["named", "ambiguous", "outside_library", "within_tolerance", "not_testable_here"]


@dataclass(frozen=True)
class Place:
    """Where measurement and simulation disagree beyond the noise.

    part: `distance` (mean of the gauges) or `angle` (their difference over the baseline); from_deg, to_deg: circle
    angles, or numbers of targets (first, last) where test has targets; joint: that turns back there, if one does;
    why: in a few words; rms_um: of the residual there; sigma: that over its noise.
    """

    test: TestName
    direction: Direction | None
    part: Literal["distance", "angle"]
    from_deg: float
    to_deg: float
    joint: int | None
    why: str
    rms_um: float
    sigma: float


@dataclass(frozen=True)
class Rival:
    """Another effect in the place of a name: its parameters, what is known of them, its share of the evidence."""

    effect: Effect
    sd: dict[str, float]
    posterior: float


@dataclass(frozen=True)
class Named:
    """A missing effect: with fitted parameters, their standard uncertainties, its odds among its rivals, the gap on
    the runs used if it alone is taken out again, and what a person should do about it.

    worth_um: by how much it moves readings, rms, what a set-up could take up left out; material: by more than the
    scatter of one run, or a person's tolerance; held_out_gain: share of the gap's energy on runs left out that it
    removes, None where none were left out.
    """

    effect: Effect
    sd: dict[str, float]
    posterior: float
    rivals: tuple[Rival, ...]
    gap_without_um: float
    remedy: str
    worth_um: float
    material: bool
    held_out_gain: float | None


@dataclass(frozen=True)
class Remainder:
    """What names, and a healthy arm's share of everything, leave beyond the noise: rms in µm, its share of the gap's
    energy, and what it looks like; healthy_um: what the healthy share is worth, which a calibration could gain."""

    um: float
    share: float
    words: str
    healthy_um: float


@dataclass(frozen=True)
class Gap:
    """Root mean square in µm of what a model leaves of readings, set-up fitted, before and after the effects are in it.

    runs: their names; noise_floor_um: what noise and scatter of a run give by themselves, of which a set-up fitted to
    it may take up a part; calibrated_um: with a healthy arm's share of everything taken out as well, as far as the runs
    used show it.
    """

    runs: tuple[str, ...]
    before_um: float
    after_um: float
    noise_floor_um: float
    calibrated_um: float


@dataclass(frozen=True)
class Leftover:
    """What is still unexplained in one band of orders (cycles a lap), or at targets: chi-square over what noise gives,
    and in words."""

    test: TestName
    direction: Direction | None
    part: Literal["distance", "angle", "targets"]
    orders: tuple[int, int] | None
    ratio: float
    words: str


@dataclass(frozen=True)
class NextTest:
    """The test that would part the rivals best, and by how many sigma."""

    test: str
    why: str
    expected_sigma: float


@dataclass(frozen=True)
class Curve:
    """A circle's residuals (n, 2) µm of the two gauges at circle angles phi_deg (n,): mean of its runs, set-up fitted;
    turns: (circle angle in degrees, joint) where joints turn back."""

    test: TestName
    direction: Direction
    phi_deg: Array
    before_um: Array
    after_um: Array
    turns: tuple[tuple[float, int], ...]


@dataclass(frozen=True)
class Map:
    """Residuals (n,) µm at targets: number, polar and azimuth (n,) in degrees. For poses the distance left (n,), and
    numbers of rows."""

    test: TestName
    target: Array
    polar_deg: Array
    azimuth_deg: Array
    before_um: Array
    after_um: Array


@dataclass(frozen=True)
class Diagnosis:
    """All that was found.

    verdict: on all of it; rig: the model begun with; runs: names of those used; effects: those that pay, the material
    ones first, by what they are worth; groups: names that these tests cannot part, of those named;
    not_testable: names that no size would show here; repeated: whether the noise is from repeats; level: of
    the healthy background, 1 in an arm that shows of everything what healthy ones show; doubts: what to know before
    trusting it.
    """

    verdict: Verdict
    why: str
    rig: Rig
    runs: tuple[str, ...]
    where: tuple[Place, ...]
    effects: tuple[Named, ...]
    remainder: Remainder
    train: Gap
    held_out: Gap | None
    unseen: Gap | None
    left: tuple[Leftover, ...]
    setups: dict[str, SetUp]
    groups: tuple[tuple[str, ...], ...]
    not_testable: tuple[str, ...]
    next_test: NextTest | None
    repeated: bool
    level: float
    doubts: tuple[str, ...]
    curves: tuple[Curve, ...]
    maps: tuple[Map, ...]
    seconds: float
