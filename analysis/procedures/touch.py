"""Touch test: the ball on the tool seated in sockets in many postures; deviation of the computed ball position from one
point.

Ball position on the tool (3) and socket positions (3 each) are least-squares estimates from all touches, linear in
both. The residual is the arm's error at one point, measured without an instrument. ASME B89.4.22-2004 (single-point
articulation): per socket the largest distance from the mean, and 2 s of the distances, s² = Σ δ² / (n - 1).

Uncertainties: scatter of a seated ball and of robot stops, propagated through the fit. They contain noise only, because
the arm's errors are the measurand. The distance between sockets is affected by these errors, so the residual counts as
noise for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from analysis.procedures.checks.columns import FEWEST, judged_by_sockets, off_sockets
from analysis.procedures.checks.places import WILDNESS, far_touches, left_out, outlying_touches
from analysis.procedures.shared.lap_curve import SEED
from analysis.procedures.shared.quantity import Quantity, figures_of
from analysis.procedures.shared.result_curves import PoseCurve
from analysis.procedures.shared.test_kind import (
    Facts,
    Finders,
    Instruments,
    Labels,
    Outliers,
    PathDeviation,
    Simulation,
    Verdict,
    check_joints,
    check_numbers,
    path_of,
)
from analysis.procedures.simulate import simulated_touches
from analysis.procedures.stops import PlaceTest
from analysis.robot.geometry.pose_setup import socket_design
from analysis.robot.kinematics.arm import Arm, Array, Integers, forward
from analysis.robot.predict import Model, SetUp, model_of, moved
from analysis.runs.noise.cell_noise import SEAT_MM, TARGET_MM
from analysis.runs.noise.readings import rms
from analysis.runs.noise.spectrum import DRAWS
from analysis.runs.tables import TouchTable
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction

_FEWEST = 6
"""Minimum touches of two sockets, or of one, to exceed the unknowns."""
_BLIND = 1e-3
"""Relative singular value below which a direction of the ball position on the tool is undetermined."""


@dataclass(frozen=True)
class SocketDistance:
    between: tuple[str, str]
    distance: Quantity
    known: Quantity | None


@dataclass(frozen=True)
class TouchResult:
    """Result of a touch test. position_mm (n, 3): ball relative to its socket, in the world. ball_mm (3,): ball
    position on the tool. sockets: positions (3,) mm in the world by name. distances: of pairs in the rig file, or
    of all pairs of up to four sockets.
    """

    position_mm: Array
    ball_mm: Array
    sockets_mm: dict[str, Array]
    distances: tuple[SocketDistance, ...]
    figures: dict[str, Quantity]
    samples: int
    notes: tuple[str, ...]
    rows: Integers

    @property
    def as_curve(self) -> PoseCurve:
        return PoseCurve(self.position_mm, None)


def evaluate(table: TouchTable, model: Model, where: str = "the touch table") -> TouchResult:
    """Figures of touches with a model of the arm: rms_mm and max_mm of the ball relative to its socket,
    spat_mm, and socket_distance_mm for two sockets.

    Raises FileError for too few touches, and for a robot that did not move.
    """
    _require_enough(table, where)
    table = table.in_content_order()
    T = forward(model.arm, table.q) if not model.effects else moved(model, path_of(model, table)).T
    far = far_touches(table, T)
    notes = (left_out(table, far.wild, far.far_mm),) if far.wild.any() else ()
    rows, sockets_seen, T = table.rows[~far.wild] - 1, table.socket[~far.wild], T[~far.wild]
    names, socket = np.unique(sockets_seen, return_inverse=True)
    design = socket_design(T, socket.ravel(), len(names))
    seen = -T[:, :3, 3].ravel()
    solved = np.linalg.pinv(design)
    terms = solved @ seen
    off = (design @ terms - seen).reshape(-1, 3)
    rng = np.random.default_rng(SEED)
    level = np.hypot(SEAT_MM, TARGET_MM.low * (TARGET_MM.high / TARGET_MM.low) ** rng.uniform(size=(DRAWS, 1)))
    noise = level * rng.standard_normal((DRAWS, len(seen)))
    drawn_terms = terms + noise @ solved.T
    drawn = off - (noise - noise @ solved.T @ design.T).reshape(DRAWS, -1, 3)
    counted = socket.ravel(), len(names)
    figures = figures_of(_plain(off, *counted), _plain(drawn, *counted), len(off), noise="assumed")
    sockets = dict(zip(names.tolist(), terms[3:].reshape(-1, 3), strict=True))
    spread = terms + np.hypot(level, rms(off)) / level * (drawn_terms - terms)
    distances = _distances(model, names.tolist(), terms, spread, len(off))
    if len(names) == 2:
        figures["socket_distance_mm"] = distances[0].distance
    singular = np.linalg.svd(design / np.linalg.norm(design, axis=0), compute_uv=False)
    if singular[-1] <= _BLIND * singular[0]:
        notes = (*notes, "the tool turned too little to separate the ball from the sockets: turn the wrist more")
    notes = (*notes, *known_otherwise(distances), *unknown_distance(distances))
    if once := ", ".join(names[np.bincount(socket.ravel()) < 2].tolist()):
        notes = (*notes, f"{once} touched only once, which is not evaluable: touch each socket in many postures")
    shown = np.argsort(rows)
    return TouchResult(off[shown], terms[:3], sockets, distances, figures, len(off), notes, rows[shown])


def _require_enough(table: TouchTable, where: str) -> None:
    check_numbers(where, q=table.q)
    count = len(np.unique(table.socket))
    if 3 * len(table.q) <= 3 + 3 * count or len(table.q) < _FEWEST:
        touches = f"{len(table.q)} touch{'es' * (len(table.q) > 1)} of {count} socket{'s' * (count > 1)}"
        problem = f"has {touches}, too few to fit their places"
        raise FileError(
            where, problem, f"give at least {max(_FEWEST, count + 2)}, in postures that differ", code="readings.too_few"
        )
    check_joints(where, table.q, "touch each socket in many postures")


def _plain(off: Array, socket: Integers, sockets: int) -> dict[str, Array]:
    distance = np.linalg.norm(off, axis=-1)
    worst = np.zeros(distance.shape[:-1])
    for number in range(sockets):
        of_socket = off[..., socket == number, :]
        if (count := of_socket.shape[-2]) > 1:
            away = np.linalg.norm(of_socket - of_socket.mean(axis=-2, keepdims=True), axis=-1)
            worst = np.maximum(worst, 2 * np.sqrt((away**2).sum(axis=-1) / (count - 1)))
    return {"rms_mm": np.sqrt((distance**2).mean(axis=-1)), "max_mm": distance.max(axis=-1), "spat_mm": worst}


def _distances(
    model: Model, names: Sequence[str], terms: Array, drawn: Array, samples: int
) -> tuple[SocketDistance, ...]:
    declared = model.rig.tests.touch.distances if model.rig.tests.touch else ()
    stated = {frozenset(pair.between): Quantity(pair.distance_mm, pair.u_mm, "mm") for pair in declared}
    distances = []
    for first, second in combinations(range(len(names)), 2):
        pair = frozenset((names[first], names[second]))
        if len(names) > _ALL_PAIRS and pair not in stated:
            continue
        places = [slice(3 + 3 * k, 6 + 3 * k) for k in (first, second)]
        apart, draws = (np.linalg.norm(all_[..., places[0]] - all_[..., places[1]], axis=-1) for all_ in (terms, drawn))
        figure = figures_of({"d_mm": apart}, {"d_mm": draws}, samples, noise="assumed")["d_mm"]
        distances.append(SocketDistance((names[first], names[second]), figure, stated.get(pair)))
    return tuple(distances)


_ALL_PAIRS = 4
"""Number of sockets up to which each pair has a figure."""


def known_otherwise(distances: Sequence[SocketDistance]) -> tuple[str, ...]:
    return tuple(
        f"sockets {pair.between[0]} and {pair.between[1]} are {pair.known} apart, but {pair.distance} according to the "
        "arm: its constants are wrong by a part of the difference, or the distance is wrong"
        for pair in distances
        if pair.known
        and abs(pair.distance.value - pair.known.value) > 2 * float(np.hypot(pair.distance.u, pair.known.u))
    )


def unknown_distance(distances: Sequence[SocketDistance]) -> tuple[str, ...]:
    if not distances or any(pair.known for pair in distances):
        return ()
    first, second = distances[0].between
    return (
        "the distances of the sockets are unknown, so these touches hardly show how large the arm is: measure the "
        f"distance of {first} and {second} and write it into tests.touch.distances; the error elsewhere then falls to "
        "about a sixth",
    )


class Touch(PlaceTest[TouchTable]):
    """Touches; each row is a separate visit, and each socket has a separate set-up."""

    test = "touch"
    table = TouchTable
    fields = ("socket", "q")
    optional = ("came_from",)
    facts = Facts(
        of_places=True,
        constants_apart=True,
        setup_terms=6,
        frame_terms=3,
        # For a ball seated by hand: a model of constants, gravity and curves leaves 0.1 to 0.2 mm for two Pandas and
        # an iiwa (Franzese et al., MUKCa, 2024). The readings refine this value. If it starts too low, scatter is
        # mistaken for errors of the arm.
        assumed_sd_mm=0.1,
    )
    labels = Labels(
        example=("rms_mm", 0.5, 1.0),
        part="touch",
        further=("touch", "one place in many postures, without gauges"),
        setup="the places of the sockets and of the ball on the tool",
        no_repeats=(
            "no posture was touched twice, so the scatter of a seated ball is estimated from the residuals of the "
            "model; touch some postures twice"
        ),
        no_scale=(
            "no distance between two sockets is stated, so a common scale of all lengths is uncertain; measure one, "
            "write tests.touch.distances in the rig file, and diagnose with --rig FILE"
        ),
        rows="touches",
        joints_fit="touches return to their sockets",
        distance_from="from its socket",
        outlier_check="check that the ball was seated when the joints were read, and that nothing moved",
    )
    finders: ClassVar[Finders] = {WILDNESS: outlying_touches}

    def evaluate(self, table: TouchTable, rig: Rig, where: str, instruments: Instruments) -> TouchResult:
        return evaluate(table, model_of(rig), where)

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> TouchTable:
        return simulated_touches(rig, run.seed, run.effects)

    def setup(self, rig: Rig) -> SetUp:
        setup = super().setup(rig)
        if rig.tests.touch:
            setup.T_tool_target[:3, 3] = rig.tests.touch.ball_mm
        return setup

    def cannot_tell(self, table: TouchTable, rig: Rig) -> str:
        return "" if len(table.q) >= FEWEST else f"{len(table.q)} touches are too few; {FEWEST} are needed"

    def judged_joints(self, table: TouchTable, rig: Rig) -> Verdict:
        return judged_by_sockets(table, rig)

    def off_path(self, table: TouchTable, rig: Rig, T_tool: Array) -> PathDeviation | None:
        return off_sockets(T_tool, table.socket)

    def parts(self, table: TouchTable) -> NDArray[np.str_]:
        return table.socket

    def outliers(self, table: TouchTable, arm: Arm) -> Outliers:
        return far_touches(table, forward(arm, table.q))

    def doubts(self, table: TouchTable, model: Model, where: str) -> tuple[str, ...]:
        declared = model.rig.tests.touch
        if declared is None or not declared.distances:
            return ()
        try:
            return known_otherwise(evaluate(table, model, where).distances)
        except FileError:
            return ()
