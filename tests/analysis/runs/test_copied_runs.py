import pickle
import sys
from pathlib import Path

import pytest

from analysis.runs.batch import on_cluster, run_directories
from analysis.runs.copied_runs import CopiedRun, local_run, location
from rigs.errors import FileError
from tests.analysis.runs.conftest import made
from tests.support.command_line import errors_of, ran
from tests.support.plant_runs import known_robot, write_visits
from tests.support.refusals import refused

fsspec = pytest.importorskip("fsspec", reason="fsspec is an extra: pip install s3fs sshfs")


@pytest.fixture
def store():
    store = fsspec.filesystem("memory")
    yield store
    store.rm("/", recursive=True)


@pytest.mark.parametrize("text", ["runs", "/srv/runs", "s3:/bucket", "C:/runs", "a b", ""])
def test_text_without_a_protocol_is_a_path(text):
    assert type(location(text)) is type(Path()) and location(text) == Path(text)


@pytest.mark.parametrize(
    "text",
    [
        "sftp://me:hidden@host/srv",
        "ftp://:hidden@host",
        "sftp://me:hid/hidden@host/srv",
        "simplecache::s3://me:hidden@runs/x",
        "https://host/runs?X-Amz-Signature=hidden",
    ],
)
def test_password_in_a_url_is_refused_and_not_shown(text):
    with refused("address.invalid", "key, which others on this computer") as error:
        location(text)
    assert "hidden" not in str(error.value)


def test_runs_at_a_url_are_those_of_the_directory(store, plant):
    store.put(str(plant), "/plant", recursive=True)
    found = run_directories([location("memory://plant")])
    assert [str(run) for run in found] == [
        f"memory://plant/{run.relative_to(plant)}" for run in run_directories([plant])
    ]
    assert pickle.loads(pickle.dumps(found[0])).run == found[0].run  # noqa: S301 - our own


def test_only_files_of_runs_below_the_url_are_copied(store, monkeypatch):
    for name in ("run/manifest.json", "run/g1-0001.parquet", "run/film.mp4", "other/manifest.json"):
        store.pipe(f"/plant/{name}", b"{}")
    outside = ["/plant/run/../../x/manifest.json", "/plant/run/a\\..\\manifest.json"]
    monkeypatch.setattr(type(store), "find", lambda self, top: [*type(self).__mro__[1].find(self, top), *outside])
    copied = location("memory://plant/run")
    assert isinstance(copied, CopiedRun)
    assert sorted(file.name for file in copied.run.rglob("*")) == ["g1-0001.parquet", "manifest.json"]
    assert not (copied.run.parent / "x").exists()


def test_error_names_the_url_and_not_the_copy(store):
    store.pipe("/plant/run/manifest.json", b"{}")
    url = location("memory://plant/run")
    with pytest.raises(FileError) as error, local_run(url) as copy:
        raise FileError(str(copy / "x"), f"bad in {copy}", f"`rig recover {copy}`")
    assert str(error.value) == "memory://plant/run/x: bad in memory://plant/run; `rig recover memory://plant/run`"


def test_url_without_runs_or_package_is_one_line(store, monkeypatch):
    with refused("run.missing", "contains no runs"):
        location("memory://nowhere")
    with refused("file.unreadable", "Protocol not known"):
        location("nosuch://x")
    monkeypatch.setitem(sys.modules, "sshfs", None)
    with refused("package.missing", "Python package that is not installed"):
        location("sftp://h/x")


def test_error_of_a_store_hides_secrets(monkeypatch):
    def fail(url: str) -> None:
        raise RuntimeError("no answer from 'https://me:hidden@h/x?X-Amz-Signature=hidden' now")

    monkeypatch.setattr(fsspec.core, "url_to_fs", fail)
    with refused("file.unreadable", "cannot be read") as error:
        location("s3://b/x")
    assert "https://h/x" in error.value.what and "hidden" not in str(error.value)


def test_host_keys_are_checked_for_sftp(monkeypatch):
    conf: dict[str, object] = {}
    monkeypatch.setattr(fsspec.config, "conf", conf)
    monkeypatch.setattr(fsspec.core, "url_to_fs", lambda url: 1 / 0)
    monkeypatch.setitem(sys.modules, "sshfs", sys)
    with refused("file.unreadable", "division by zero"):
        location("sftp://127.0.0.1:1/x")
    assert conf == {"sftp": {"known_hosts": ()}}


def test_cluster_refuses_a_url(store):
    store.pipe("/plant/run/manifest.json", b"{}")
    with refused("usage", "to this computer, where the workers"):
        next(on_cluster(len, [location("memory://plant/run")], "tcp://127.0.0.1:1"))
    assert "share" in errors_of("fleet memory://plant --scheduler tcp://127.0.0.1:1", exit_code=2)


@pytest.mark.parametrize(
    "command", ["verify {} --jobs 2", "analyse {}/robot-001 --json", "history robot-001 --runs {}"]
)
def test_output_for_a_url_equals_that_for_the_directory(command, store, tmp_path):
    one = known_robot(1, 2, 0.0)
    list(write_visits(tmp_path / "plant" / "robot-001", one, [0, 1]))
    made(tmp_path / "plant" / "robot-001" / "bad")
    store.put(str(tmp_path / "plant"), "/plant", recursive=True)
    here, there = (ran(*command.format(place).split()) for place in (tmp_path / "plant", "memory://plant"))
    out, err = (text.replace("memory://plant", str(tmp_path / "plant")) for text in (there.stdout, there.stderr))
    assert (there.returncode, out) == (here.returncode, here.stdout) and here.stdout
    assert err.count("error") == here.stderr.count("error")
