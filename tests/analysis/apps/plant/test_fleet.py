import os
import re
import sys
from pathlib import Path
from urllib.parse import unquote

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.support.command_line import errors_of, json_of, separately, succeeded
from tests.support.plant_runs import known_robot, write_visits
from tests.support.store_cases import edit_manifest

VISITS = 10
PAGE = (Path(__file__).parents[4] / "docs" / "fleet.md").read_text()


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """A directory with the plant that the page names: three robots, one grown, one run cut off."""
    directory = tmp_path_factory.mktemp("work")
    for number in (1, 2, 3):
        one = known_robot(number, VISITS, 0.03 if number == 3 else 0.0)
        for _ in write_visits(directory / "plant" / one.name, one, list(range(VISITS))):
            pass
    cut = next((directory / "plant" / "robot-002").iterdir())
    next(cut.glob("*.parquet")).unlink()
    return directory


@pytest.fixture(autouse=True)
def here(work, monkeypatch):
    monkeypatch.chdir(work)
    monkeypatch.setenv("XDG_CACHE_HOME", str(work / "cache"))


def fleet(words: str) -> str:
    return succeeded(f"fleet {words}", COLUMNS="200").stdout


def test_robots_are_listed_by_urgency():
    printed = fleet("plant")
    names = re.findall(r"^(robot-\d+) +(\w+)", printed, re.M)
    assert names[0] == ("robot-003", "beyond") and len(names) == 3
    assert "1 run has" in printed and "ledger" in printed
    assert "30 runs, 30 of them" in printed


def test_json_has_every_robot_and_every_run_that_is_left_out():
    found = json_of("fleet plant")
    assert found["robots"][0]["robot"] == "robot-003"
    assert {one["robot"]: one["runs"] for one in found["robots"]} == {"robot-001": 10, "robot-002": 9, "robot-003": 10}
    left_out = next(one for one in found["robots"] if one["robot"] == "robot-002")["without_figures"]
    assert len(left_out) == 1 and found["runs"] == 30 and Path(found["catalogue"]).is_file()


def test_the_page_opens_the_history_of_each_robot(work):
    fleet("plant -o page/plant.html")
    html = (work / "page" / "plant.html").read_text()
    links = [unquote(link) for link in re.findall(r'<th scope="row"[^>]*><a href="([^"]+)"', html)]
    assert len(links) == 3 and all(link.startswith("plant-robots/robot-00") for link in links)
    pages = [work / "page" / link for link in links]
    assert all('<a href="../plant.html">all robots</a>' in page.read_text() for page in pages)
    written = [page.stat().st_mtime_ns for page in pages]
    fleet("plant -o page/plant.html")
    assert [page.stat().st_mtime_ns for page in pages] == written
    assert "<script" not in html and "http" not in html.replace("http-equiv", "")


def test_unchanged_fleet_has_empty_changes_and_marks_simulated_robots(work):
    simulated = "All runs were simulated or recorded in an emulated cell. No real robot was measured."
    printed = fleet("plant -o page/plant.html")
    html = (work / "page" / "plant.html").read_text()
    assert simulated in printed and simulated in html and html.count("<small>simulated") == 3
    rows = re.findall(r"<tr>\s*<th scope=.row..*?</tr>", html, re.S)
    changed = [re.search(r'data-label="what changed">(.*?)</td>', row, re.S)[1] for row in rows]
    assert "fell from" in changed[0] and changed[1:] == ["", ""]
    assert all(simulated in page.read_text() for page in (work / "page" / "plant-robots").iterdir())
    assert {one["simulated"] for one in json_of("fleet plant")["robots"]} == {9, 10}


def test_a_hostile_name_reaches_no_page_and_no_terminal_raw(work):
    name = "<b>\x1b[31m../../x\u202e"
    one = known_robot(1, VISITS, 0.0)
    for path in write_visits(work / "hostile" / os.fsdecode(b"\xff\x1b<i>"), one, [0.0, 1.0]):
        edit_manifest(path, {"rig_name": name})
    next(path.glob("*.parquet")).unlink()
    (work / "hostile" / "bad\nforged").mkdir()
    (work / "hostile" / "bad\nforged" / "manifest.json").write_text("{")
    printed = fleet("hostile -o hostile.html --parquet hostile.parquet")
    assert "\x1b" not in printed and "\\x1b[31m" in printed
    assert "\nforged" not in printed and r"bad\nforged: " in printed
    html = (work / "hostile.html").read_text()
    assert "<b>" not in html and "&lt;b&gt;" in html and "\u202e" not in html and "\x1b" not in html
    (page,) = (work / "hostile-robots").iterdir()
    assert re.fullmatch(r"[A-Za-z0-9_.-]+\.html", page.name)
    assert pq.read_table(work / "hostile.parquet")["robot"][0].as_py() == name
    assert "3 runs, 1 of them" in fleet("hostile")
    assert "\x1b" not in fleet("hostile --json")


def test_the_table_has_every_figure_of_every_run(work):
    fleet("plant --parquet figures.parquet --jobs 2")
    table = pq.read_table(work / "figures.parquet").to_pylist()
    figures = [row for row in table if row["figure"]]
    assert {row["problem"] for row in figures} == {None}
    assert sum(row["figure"] == "reversal_mean_mm" for row in figures) == 3 * VISITS - 1
    assert len([row for row in table if row["problem"]]) == 1
    grown = [row for row in figures if row["robot"] == "robot-003" and row["figure"] == "reversal_mean_mm"]
    assert grown[0]["standing"] == "pass" and grown[-1]["standing"] == "fail" and grown[0]["fail"] == 0.26
    fleet("plant --parquet figures.parquet")
    assert pq.read_table(work / "figures.parquet").to_pylist() == table
    assert not list(work.glob("*.tmp"))


@pytest.mark.parametrize(
    ("words", "code", "line"),
    [
        ("nowhere", 3, "error: nowhere: "),
        ("empty", 3, "error: empty: "),
        ("plant --catalogue letter", 3, "error: letter: "),
        ("plant --catalogue letter/x", 4, "error: letter/x: "),
        ("plant -o page.txt", 2, "error: page.txt: "),
        ("plant --parquet empty", 3, "error: empty: Is a directory; choose a different --parquet"),
        ("plant --parquet letter", 3, "error: letter: already exists"),
        ("plant --parquet own.parquet", 3, "error: own.parquet: already exists"),
        ("plant --parquet letter/x", 3, "error: letter/x: Not a directory; choose a different --parquet"),
    ],
)
def test_wrong_use_is_one_line(work, words, code, line):
    (work / "empty").mkdir(exist_ok=True)
    (work / "letter").write_text("Dear all,")
    pq.write_table(pa.table({"robot": ["mine"]}), work / "own.parquet")
    assert errors_of(f"fleet {words}", exit_code=code).strip().startswith(line)
    assert (work / "letter").read_text() == "Dear all," and not list(work.glob("*.tmp"))


def snippet(language: str) -> str:
    (block,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.S)
    return str(block)


def test_the_commands_of_the_page_run(work):
    for line in snippet("sh").splitlines():
        command = line.split("#")[0].split()
        assert command[:2] == ["rig", "fleet"]
        fleet(" ".join(command[2:]))


def test_pandas_example_of_the_page_runs(work):
    pytest.importorskip("pandas")
    fleet("plant --parquet figures.parquet")
    done = separately(sys.executable, "-W", "error", "-c", snippet("python"), cwd=work)
    assert re.search(r"robot-003 .*0\.\d+", done.stdout) and not done.returncode


def test_duckdb_example_of_the_page_runs(work):
    duckdb = pytest.importorskip("duckdb")
    fleet("plant --parquet figures.parquet")
    rows = duckdb.sql(snippet("sql")).fetchall()
    assert rows[0][0] == "robot-003" and len(rows) == 1
