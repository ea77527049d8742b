import pytest

from tests.support.command_line import ran
from tests.support.dask_cluster import cluster
from tests.support.dated_runs import dated_run


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory):
    pytest.importorskip("distributed", reason="dask.distributed is an extra: pip install distributed")
    with cluster(tmp_path_factory.mktemp("dask")) as made:
        yield made


def test_a_table_is_the_same_from_a_cluster(two_workers, tmp_path):
    for day in range(4):
        dated_run(tmp_path / "plant" / "robot", day, 0.01)
    (tmp_path / "plant" / "bad").mkdir()
    (tmp_path / "plant" / "bad" / "manifest.json").write_text("{}")
    words = ["analyse", str(tmp_path / "plant"), "--json"]
    here, there = ran(*words), ran(*words, "--scheduler", two_workers.address)
    assert here.stdout and (there.returncode, there.stdout, there.stderr) == (3, here.stdout, here.stderr)
