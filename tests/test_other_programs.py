"""The snippets of docs/other-programs.md read a recorded run as the page says, in each program that is there."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.support.command_line import ran
from tests.support.recorded_lap import recorded

PAGE = (Path(__file__).parents[1] / "docs" / "other-programs.md").read_text()


def snippet(language: str) -> str:
    (block,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.S)
    return str(block)


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    directory = tmp_path_factory.mktemp("work")
    (directory / "runs").mkdir()
    recorded(directory / "recorded").rename(directory / "runs" / "monday-acw")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(directory)
        _, *words = snippet("sh").partition("#")[0].split()
        assert ran(*words).returncode == 0
    return directory


def angles_deg(work: Path) -> tuple[float, float]:
    lap = pq.read_table(work / "lap.parquet")
    apart_mm = lap["g2_mm"].to_numpy() - lap["g1_mm"].to_numpy()
    angle_deg = np.degrees(np.arctan2(apart_mm, 50.0))
    return float(angle_deg.min()), float(angle_deg.max())


def readings(work: Path) -> int:
    return sum(pq.read_metadata(chunk).num_rows for chunk in (work / "runs" / "monday-acw").glob("g1-*.parquet"))


def check(printed: str, work: Path) -> None:
    lowest, highest = re.search(r"degrees: (\S+) to (\S+)", printed).groups()
    assert (float(lowest), float(highest)) == pytest.approx(angles_deg(work), abs=1e-6)
    assert re.search(rf"readings: {readings(work)} doubtful: 0\b", printed)


def test_pandas(work):
    pytest.importorskip("pandas")
    script = [sys.executable, "-W", "error", "-c", snippet("python")]
    check(subprocess.run(script, cwd=work, capture_output=True, text=True, check=True).stdout, work)


def test_duckdb(work, monkeypatch):
    duckdb = pytest.importorskip("duckdb")
    monkeypatch.chdir(work)
    lap, stream = snippet("sql").strip().removesuffix(";").split(";\n")
    assert duckdb.sql(lap).fetchall() == [pytest.approx(angles_deg(work))]
    ((count, doubtful, per_s, slowest_ms),) = duckdb.sql(stream).fetchall()
    assert (count, doubtful) == (readings(work), 0)
    assert 10 < per_s < 1000 and slowest_ms == pytest.approx(20.0)  # one answer of the lap took so long
