import io
import re
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.interchange.bags import file_of
from analysis.apps.interchange.pose_bag import stands_of_bag
from analysis.intake.readers import StandTable
from analysis.runs.loading import load_measured
from rigs.arms import load_arm
from rigs.errors import FileError
from rigs.load import load
from rigs.rig import Rig
from tests.support.changed_rigs import rig_with
from tests.support.command_line import errors_of, ran, succeeded
from tests.worlds.arms import soft_arm
from tests.worlds.arms.seven_axes import draw_truth, pose_table

pytest.importorskip("rosbags.rosbag2")
from tests.support.driven_bag import (
    JOINTS,
    POINT,
    POSE,
    TF,
    TRANSFORM,
    Driven,
    StoragePlugin,
    drive,
    drive_points,
)
from tests.support.refusals import refused

MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3


def stands(path: Path, rig: Rig | None = None, topic: str = "") -> StandTable:
    file = file_of(path)
    return stands_of_bag(file.read_bytes(), str(file), rig or load("ur10-cell")[0], topic)


def columns(found: StandTable) -> dict[str, np.ndarray]:
    rows = np.genfromtxt(io.BytesIO(found.text), delimiter=",", names=True)
    return {name: rows[name] for name in rows.dtype.names}


@pytest.fixture
def rng():
    return np.random.default_rng(4)


@pytest.fixture
def bag(tmp_path):
    return tmp_path / "bag"


def held(found: StandTable, truth: Driven, kept: slice = slice(None)) -> None:
    table = columns(found)
    q = np.stack([table[f"{name}_rad"] for name in JOINTS], axis=1)
    assert q == pytest.approx(truth.q[kept], abs=2e-6)
    place = np.stack([table[f"{axis}_m"] for axis in "xyz"], axis=1)
    assert np.abs(place - truth.place_m[kept]).max() < 5e-5
    assert 0.005 < table["std_x_mm"].mean() < 0.04 and table["readings"].min() >= 10


@pytest.mark.parametrize("storage", [MCAP, SQLITE])
@pytest.mark.parametrize("kind", [POSE, POINT, TRANSFORM, TF])
def test_each_stop_is_a_row_with_its_scatter(bag, rng, kind, storage):
    truth = drive(bag, rng, kind=kind, storage=storage)
    found = stands(bag, topic="/seen:target" if kind == TF else "")
    held(found, truth)
    assert ("qx" in columns(found)) == (kind != POINT)


def test_joints_are_those_that_the_rig_file_names(bag, rng):
    truth = drive(bag, rng)
    feedback = {"interface": "ros2_joint_states", "port": "tcp://robot:9090", "joints": JOINTS}
    found = stands(bag, rig_with("ur10-cell", feedback=feedback))
    assert "finger_rad" not in columns(found)
    held(found, truth)
    with refused("table.invalid", "contains fewer than two messages of"):
        stands(bag, rig_with("ur10-cell", feedback=feedback | {"joints": list("abcdef")}))


def test_stops_that_the_instrument_did_not_see_are_counted(bag, rng):
    truth = drive(bag, rng, blind=(0, 1, 2))
    found = stands(bag)
    held(found, truth, slice(3, None))
    assert any(doubt.startswith("3 of 20 stops") for doubt in found.doubts)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"clock_off_s": 7.0}, r"differ by -7\.00. s"),
        ({"stamped": False}, "timestamps"),
    ],
)
def test_differing_clocks_are_reported_and_the_bag_time_used(bag, rng, given, told):
    truth = drive(bag, rng, **given)
    found = stands(bag)
    held(found, truth)
    assert any(re.search(told, doubt) for doubt in found.doubts)


@pytest.mark.parametrize(
    ("kind", "topic", "told"),
    [
        (TF, "", r" 3 .* \(/seen:link_1, /seen:link_2, /seen:target\)"),
        (POSE, "/other", "'/other'; .* /seen"),
    ],
)
def test_ambiguous_topics_are_asked_about(bag, rng, kind, topic, told):
    drive(bag, rng, kind=kind, stops=2)
    with pytest.raises(FileError, match=told):
        stands(bag, topic=topic)


def test_a_bag_is_imported_by_a_map_that_the_run_keeps(tmp_path, bag, rng):
    truth = drive(bag, rng, storage=SQLITE)
    done = succeeded(f"import {bag} --rig ur10-cell --test pose -o {tmp_path}/run")
    assert "topic: /seen" in done.stderr and "qx … qw" in done.stderr
    assert "checksums" in done.stderr
    measured = load_measured(tmp_path / "run")
    assert measured.table.q == pytest.approx(truth.q, abs=2e-6)
    ran(f"export {tmp_path}/run --to map -o {tmp_path}/map.yaml")
    succeeded(
        f"import {bag} --rig ur10-cell --test pose -o {tmp_path}/again --map {tmp_path}/map.yaml",
    )
    assert load_measured(tmp_path / "again").table.q == pytest.approx(measured.table.q)


def test_seven_axes_are_found_by_their_names(tmp_path, bag, rng):
    robot = load_arm("franka-fr3").robot
    table = pose_table(robot, draw_truth(robot, rng, ()), rng, np.array([10.0, 20.0, 100.0]), 20)
    drive_points(bag, rng, [f"fr3_joint{axis}" for axis in range(1, 8)], table.q, table.xyz_mm)
    rig = tmp_path / "fr3.yaml"
    rig.write_text("name: fr3\n" + ran("arms franka-fr3").stdout)
    succeeded(f"import {bag} --rig {rig} --test pose -o {tmp_path}/run")
    assert load_measured(tmp_path / "run").table.q == pytest.approx(table.q, abs=2e-6)


def test_a_camera_on_the_tool_is_recognised(tmp_path, bag, rng):
    drive(bag, rng, on_tool=True)
    done = succeeded(f"import {bag} --rig ur10-cell --test pose -o {tmp_path}/run")
    assert "sees: " in done.stderr
    succeeded(f"analyse {tmp_path}/run --json")


def _spoilt(change: Callable[[sqlite3.Connection], object], path: Path) -> bytes:
    with sqlite3.connect(path) as database:
        change(database)
    return path.read_bytes()


@pytest.mark.parametrize(
    "sql",
    [
        "DROP TABLE messages",
        "DROP TABLE messages; CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL "
        "SELECT id + 1 FROM n) SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n",
        "UPDATE messages SET data = x'00'",
        "UPDATE messages SET data = 5",
        "UPDATE topics SET type = 'x'",
        "DELETE FROM messages",
    ],
)
def test_a_database_that_is_no_bag_is_one_line(bag, rng, sql):
    drive(bag, rng, stops=2, storage=SQLITE)
    data = _spoilt(lambda database: database.executescript(sql), file_of(bag))
    for broken in (data, data[: len(data) // 2], data[:100] + bytes(len(data) - 100)):
        with pytest.raises(FileError) as error:
            stands_of_bag(broken, "bag.db3", load("ur10-cell")[0])
        assert "\n" not in str(error.value)


def test_missing_file_of_a_directory_is_reported(tmp_path):
    with refused("table.invalid", "is a directory with no files"):
        file_of(tmp_path)


@pytest.mark.parametrize("storage", [MCAP, SQLITE])
def test_damaged_bag_is_refused_or_read_up_to_the_damage(bag, rng, storage):
    drive(bag, rng, stops=3, storage=storage, kind=TF)
    whole = file_of(bag).read_bytes()
    for _ in range(40):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 8):
            data[at] = rng.integers(0, 256)
        try:
            stands_of_bag(bytes(data), "bag", load("ur10-cell")[0], "/seen:target")
        except FileError as error:
            assert "\n" not in str(error)


def test_messages_without_a_turn_or_of_another_kind_are_counted(bag, rng):
    truth = drive(bag, rng, storage=SQLITE)
    with sqlite3.connect(file_of(bag)) as database:
        (topic,) = database.execute("SELECT id FROM topics WHERE name = '/seen'").fetchone()
        rows = database.execute("SELECT id, data FROM messages WHERE topic_id = ? LIMIT 5", (topic,)).fetchall()
        for at, data in rows:
            database.execute("UPDATE messages SET data = ? WHERE id = ?", (data[:-32] + bytes(32), at))
    found = stands(bag)
    held(found, truth)
    assert any(re.search("/seen: 5 of .* messages", doubt) for doubt in found.doubts)


def test_bag_with_open_log_is_read_once_closed(bag, rng):
    truth = drive(bag, rng, storage=SQLITE)
    database = sqlite3.connect(file_of(bag))
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("CREATE TABLE more (id INTEGER)")
    database.commit()
    with refused("table.invalid", "the last messages are still in"):
        file_of(bag)
    database.close()
    held(stands(bag), truth)


@pytest.mark.parametrize("topic", ["/tcp_pose_broadcaster/pose", "/tf:tool0", "/franka/O_T_EE"])
def test_a_topic_of_the_controller_is_asked_about(tmp_path, bag, rng, topic, monkeypatch):
    """Its places are wrong by the noise of a tracker here, so that nothing but the name speaks."""
    monkeypatch.chdir(tmp_path)
    q = np.radians(rng.uniform((-90, -120, -110, -120, -80, -150), (90, -40, 110, 120, 80, 150), (20, 6)))
    arm = soft_arm.wrong(soft_arm.nominal("ur10"), rng)
    drive_points(bag, rng, JOINTS, q, arm.tool_mm(q, np.array([0.0, 0.0, 150.0])) + 400, topic)
    assert f"{topic} looks" in errors_of(f"import {bag} --rig ur10-cell --test pose -o {tmp_path}/run")


LEFT = [f"left_{name}" for name in JOINTS]


@pytest.mark.parametrize(
    ("names", "beside", "code"),
    [(JOINTS, ("/joint_states", LEFT), "table.invalid"), ([], None, "table.invalid")],
)
def test_joints_of_two_arms_or_without_names_are_refused(bag, rng, names, beside, code):
    q = np.radians(rng.uniform(-60, 60, (3, 6)))
    drive_points(bag, rng, names, q, q[:, :3] * 1000, beside=beside)
    with refused(code):
        stands(bag)
