from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from analysis.intake.read import check_sequence, parse_csv
from analysis.procedures.checks.columns import unit_findings
from analysis.procedures.simulate import planned_touches, simulated_touches
from analysis.procedures.touch import evaluate
from analysis.robot.kinematics.arm import forward
from analysis.robot.model.predict import model_of
from analysis.runs.tables import TouchTable, columns_of, table_from
from rigs.arms import load_arm
from rigs.errors import FileError
from rigs.load import parse
from rigs.rig import Rig
from tests.support.refusals import refused

TOUCH = "tests: {touch: {sockets: [A, B], ball_mm: [5, 3, 90], touches: 30, distances: [DISTANCE]}}"


def rig_with(distance_mm: float = 1.0, arm: str = "kuka-lbr-iiwa-14") -> Rig:
    known = f"{{between: [A, B], distance_mm: {distance_mm}, u_mm: 0.05}}"
    return parse(f"name: cell\n{load_arm(arm).text}{TOUCH.replace('DISTANCE', known)}\n", "cell.yaml")


def test_an_arm_without_errors_has_its_ball_in_the_sockets() -> None:
    rig = rig_with()
    found = evaluate(planned_touches(rig), model_of(rig))
    assert found.figures["rms_mm"].value < 1e-5
    np.testing.assert_allclose(found.ball_mm, (5, 3, 90), atol=1e-4)


def test_the_figures_are_those_by_hand() -> None:
    rig = rig_with()
    table = simulated_touches(rig, 3)
    rng = np.random.default_rng(1)
    table = TouchTable(table.socket, table.q + np.radians(rng.normal(0, 0.05, table.q.shape)))
    found = evaluate(table, model_of(rig))
    T = forward(model_of(rig).arm, table.q)
    ball = T[:, :3, 3] + T[:, :3, :3] @ found.ball_mm
    away = np.concatenate([
        np.linalg.norm(ball[table.socket == one] - ball[table.socket == one].mean(axis=0), axis=1) for one in "AB"
    ])  # fmt: skip
    assert found.figures["rms_mm"].value == pytest.approx(np.sqrt(np.mean(away**2)), rel=1e-6)
    assert found.figures["max_mm"].value == pytest.approx(away.max(), rel=1e-6)
    worst = max(2 * np.sqrt(np.sum(own**2) / (len(own) - 1)) for own in (away[:15], away[15:]))
    assert found.figures["spat_mm"].value == pytest.approx(worst, rel=1e-6)
    places = [ball[table.socket == one].mean(axis=0) for one in "AB"]
    assert found.figures["socket_distance_mm"].value == pytest.approx(np.linalg.norm(places[0] - places[1]), abs=1e-4)


def test_socket_distance_covers_the_truth_and_its_u_grows_with_arm_errors() -> None:
    rig = rig_with()
    exact = evaluate(planned_touches(rig), model_of(rig)).figures["socket_distance_mm"].value
    off = []
    for seed in range(12):
        figure = evaluate(simulated_touches(rig_with(), seed), model_of(rig)).figures["socket_distance_mm"]
        true = evaluate(simulated_touches(rig, seed=None), model_of(rig)).figures["socket_distance_mm"].value
        assert true == pytest.approx(exact, abs=1e-4)
        # each seed has its own sockets: compare with its own noise-free plan
        own = evaluate(planned_touches(rig, seed), model_of(rig)).figures["socket_distance_mm"].value
        off.append((figure.value - own) / figure.u)
    assert np.mean(np.abs(off) <= 2) > 0.7


def test_distance_known_otherwise_is_reported() -> None:
    touched = planned_touches(rig_with(distance_mm=50.0))
    found = evaluate(touched, model_of(rig_with(distance_mm=51.0)))
    assert found.distances[0].known is not None
    assert any("sockets A and B are 51.000 ± 0.050 mm apart, but 50.0" in note for note in found.notes)
    assert not any("apart" in note for note in evaluate(touched, model_of(rig_with(distance_mm=50.0))).notes)


@pytest.mark.parametrize(("rows", "code"), [(slice(0, 4), "table.few_rows"), (np.zeros(12, dtype=int), "table.still")])
def test_touches_that_show_nothing_are_refused(rows: slice | np.ndarray, code: str) -> None:
    rig = rig_with()
    table = planned_touches(rig)
    with refused(code):
        evaluate(TouchTable(table.socket[rows], table.q[rows]), model_of(rig))


def test_a_table_is_read_as_it_was_written() -> None:
    rig = rig_with()
    table = planned_touches(rig)
    columns = columns_of(table)
    assert columns.column_names == [
        "socket", *(f"q{axis}_deg" for axis in range(1, 8)), *(f"q{axis}_from_deg" for axis in range(1, 8))
    ]  # fmt: skip
    rows = [columns.column_names, *([str(value) for value in row.values()] for row in columns.to_pylist())]
    text = "\n".join(",".join(row) for row in rows)
    again = table_from(parse_csv(text.encode(), "t.csv", "touch", rig), "touch", None, "t.csv")
    assert isinstance(again, TouchTable)
    assert again.socket.tolist() == table.socket.tolist()
    np.testing.assert_allclose(again.q, table.q, atol=1e-12)
    np.testing.assert_allclose(again.came_from, table.came_from, atol=1e-12)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("header", "row", "what"),
    [
        ("socket,q1_deg", "A,1", "q7_deg"),
        ("socket," + ",".join(f"q{k}_deg" for k in range(1, 8)) + ",q1_from_deg", "A" + ",1" * 8, "q1_from_deg only"),
        (
            "socket," + ",".join(f"q{k}_deg" for k in range(1, 8)),
            "" + ",1" * 7,
            "socket: is empty",
        ),
        ("socket," + ",".join(f"q{k}_deg" for k in range(1, 8)), "A" * 41 + ",1" * 7, "not a name of a socket"),
    ],
)
def test_bad_touch_table_names_the_mistake(header: str, row: str, what: str) -> None:
    with pytest.raises(FileError) as caught:
        parse_csv(f"{header}\n{row}\n".encode(), "t.csv", "touch", rig_with())
    assert what in "\n".join(caught.value.lines())


def test_simulated_sockets_have_the_distances_that_are_known() -> None:
    known = (
        "[{between: [A, B], distance_mm: 50}, {between: [A, C], distance_mm: 80}, {between: [B, C], distance_mm: 60}]"
    )
    text = f"name: cell\n{load_arm('ur5').text}tests: {{touch: {{sockets: [A, B, C], distances: {known}}}}}\n"
    rig = parse(text, "cell.yaml")
    found = evaluate(planned_touches(rig), model_of(rig))
    assert [one.distance.value for one in found.distances] == pytest.approx([50, 80, 60], abs=1e-3)
    apart = rig_with(9000.0)
    with refused("touch.no_postures"):
        planned_touches(apart)


def test_touches_in_radians_and_joints_that_the_arm_has_not_are_refused() -> None:
    rig = rig_with(50.0)
    table = simulated_touches(rig, 3)
    assert not list(unit_findings(table, rig))
    (finding,) = unit_findings(TouchTable(table.socket, np.radians(table.q)), rig)
    assert finding.strength == "impossible" and "radians" in finding.what
    six = parse(f"name: cell\n{load_arm('ur5').text}{TOUCH.replace('DISTANCE', '')}\n", "cell.yaml")
    columns = columns_of(table)
    lines = np.arange(2, 2 + columns.num_rows)
    named = dict(zip(columns.column_names, columns.columns, strict=True))
    (problem,) = check_sequence(named, lines, "touch", six, None)
    assert "7 joints" in str(problem)
    renamed = named | {"socket": pa.chunked_array([["Z", *columns["socket"].to_pylist()[1:]]])}
    (problem,) = check_sequence(renamed, lines, "touch", rig, None)
    assert "'Z'" in str(problem)
