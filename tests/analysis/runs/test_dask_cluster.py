from __future__ import annotations

import os
import re
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from analysis.runs.batch import CompletedItem, each
from rigs.distribution import to_install
from rigs.errors import FileError
from tests.support.child_processes import sign_in, signed_in, until
from tests.support.command_line import ran
from tests.support.dask_cluster import Cluster, cluster
from tests.support.dated_runs import dated_run
from tests.support.nightly import cases

RIG = [sys.executable, "-c", "from analysis.cli import main; main()"]


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    pytest.importorskip("distributed", reason="dask.distributed is an extra: pip install distributed")
    with cluster(tmp_path_factory.mktemp("dask")) as made:
        yield made


def held(item: tuple[Path, int]) -> int:
    directory, number = item
    sign_in(directory)
    until((directory / "released").exists)
    if number == 3:
        raise FileError("item 3", "is bad", "give another")
    return number**2


def test_a_table_is_the_same_from_a_cluster(two_workers: Cluster, tmp_path: Path) -> None:
    for day in range(4):
        dated_run(tmp_path / "plant" / "robot", day, 0.01)
    (tmp_path / "plant" / "bad").mkdir()
    (tmp_path / "plant" / "bad" / "manifest.json").write_text("{}")
    words = ["analyse", str(tmp_path / "plant"), "--json"]
    here, there = ran(*words), ran(*words, "--scheduler", two_workers.address)
    assert here.stdout and (there.returncode, there.stdout, there.stderr) == (3, here.stdout, here.stderr)


def test_a_worker_that_dies_costs_time(two_workers: Cluster, tmp_path: Path) -> None:
    """The last of them: the cluster has one worker afterwards."""
    outcomes = each(held, [(tmp_path, number) for number in range(20)], scheduler=two_workers.address)

    def kill_one() -> None:
        until(lambda: len(signed_in(tmp_path)) == 2)
        two_workers.workers[0].kill()
        (tmp_path / "released").touch()

    killer = threading.Thread(target=kill_one)
    killer.start()
    found = [one.value if isinstance(one, CompletedItem) else str(one.error) for one in outcomes]
    killer.join()
    assert found == [*(n**2 for n in range(3)), "item 3: is bad; give another", *(n**2 for n in range(4, 20))]
    assert two_workers.workers[0].poll() is not None  # it was killed in the middle


ADDRESSES = ("an address", "http://127.0.0.1:80", "tls://127.0.0.1:1", "")


@pytest.mark.parametrize("address", cases(ADDRESSES, ADDRESSES[:1]))
def test_no_scheduler_is_one_line(address: str) -> None:
    pytest.importorskip("distributed")
    done = ran("verify", "nothing", "--scheduler", address)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 4 and line.startswith(f"error: --scheduler {address}: ")


def test_missing_dask_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(FileError, match=re.escape(to_install("distributed"))):
        list(each(os.path.exists, ["."], scheduler="tcp://127.0.0.1:8786"))
