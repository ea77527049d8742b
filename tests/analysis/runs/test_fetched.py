import os
import shutil
import signal
import sys
import tempfile
from collections import namedtuple
from functools import partial
from pathlib import Path

import pytest

from analysis.runs.batch import CompletedItem, FailedItem, each
from analysis.runs.remote import explained, fetched, location
from rigs.distribution import to_install
from rigs.errors import FileError

pytest.importorskip("fsspec", reason="fsspec is an extra: pip install s3fs sshfs")
from tests.support.refusals import refused
from tests.support.trial_store import url_of

FILES = {"manifest.json": b"{}", "ledger.jsonl": b"\n", "g1-0001.parquet": b"PAR1", "marks.json": b"{}"}


@pytest.fixture
def run(tmp_path):
    return made(tmp_path / "plant" / "run")


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    return place


def made(path: Path) -> Path:
    path.mkdir(parents=True)
    for name, data in FILES.items():
        (path / name).write_bytes(data)
    (path / "film.mp4").write_bytes(b"large")
    return path


@pytest.mark.parametrize("protocol", ["file", "trial"])
def test_the_files_that_are_read_are_there_and_then_gone(protocol, run, place):
    with fetched(location(f"file://{run}" if protocol == "file" else url_of(run))) as found:
        assert {file.name: file.read_bytes() for file in found.iterdir()} == FILES
        assert found.is_relative_to(place)
    assert not list(place.iterdir())


def test_an_error_names_the_run_and_not_its_copy(run, place):
    url = url_of(run)
    with pytest.raises(FileError) as error, fetched(location(url)) as found:
        raise FileError(str(found / "x"), f"bad in {found}", f"`rig recover {found}`")
    assert str(error.value) == f"{url}/x: bad in {url}; `rig recover {url}`"
    assert not list(place.iterdir())


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("denied", "store.denied"),
        ("vanished", "store.silent"),
        ("grown", "run.changed"),
        ("nowhere", "url.missing"),
        ("empty", "run.missing"),
    ],
)
def test_unfetchable_url_is_one_line(name, code, tmp_path, place):
    if name == "empty":
        (tmp_path / name).mkdir()
    elif name != "nowhere":
        made(tmp_path / name)
    url = url_of(tmp_path / name)
    with refused(code) as error, fetched(location(url)):
        pass
    assert error.value.where == url
    assert not list(place.iterdir())


def test_a_run_larger_than_the_room_is_not_begun(run, monkeypatch):
    usage = namedtuple("usage", "free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(3))
    with refused("disk.full"), fetched(location(url_of(run))):
        pass


@pytest.mark.parametrize("place_is", ["missing", "a file"])
def test_a_temporary_directory_that_takes_nothing_is_one_line(place_is, run, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere" if place_is == "missing" else run / "film.mp4"))
    url = location(url_of(run))
    with refused("disk.no_temporary"):
        list(each(size_of, [url]))
    with refused("disk.no_temporary"), fetched(url):
        pass


def test_signals_are_handled_as_before_once_the_copies_are_gone(run, place):
    def handlers() -> list[object]:
        return [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)]

    before = handlers()
    found = each(size_of, [location(url_of(run))] * 2)
    next(found)
    assert handlers() != before and len(list(place.iterdir())) == 1
    found.close()
    assert handlers() == before and not list(place.iterdir())


def test_names_that_lead_out_of_the_directory_are_not_written(run, tmp_path, place):
    (run / ".names").write_text(f"{run}/../manifest.json {run}/x/../../y.parquet {run}/a\\b.parquet")
    with fetched(location(url_of(run))) as found:
        assert {file.name for file in found.iterdir()} == set(FILES)
    assert {file.name for file in tmp_path.rglob("*.parquet")} == {"g1-0001.parquet"}


def test_errors_of_a_store_hide_secrets():
    said = "no answer from 'https://me:hidden@h/x?X-Amz-Signature=hidden' now"
    url = location("s3://b/x")
    with refused("store.unreadable") as error, explained(url):
        raise RuntimeError(said)
    assert "https://h/x" in error.value.what and "hidden" not in str(error.value)


@pytest.mark.parametrize(("url", "what"), [("s3://b/x", "s3fs"), ("sftp://h/x", "sshfs")])
def test_a_package_that_is_missing_is_named(url, what, monkeypatch):
    monkeypatch.setitem(sys.modules, what, None)
    with refused("package.missing") as error, fetched(location(url)):
        pass
    assert error.value.remedy == to_install(what)


def size_of(run: Path) -> int:
    with fetched(run) as found:
        return sum(file.stat().st_size for file in found.iterdir())


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_bad_run_costs_itself_in_any_number_of_processes(jobs, tmp_path, place):
    runs = [location(url_of(made(tmp_path / name))) for name in ("one", "denied", "two")]
    found = list(each(size_of, runs, jobs=jobs))
    size = sum(map(len, FILES.values()))
    assert [one.value if isinstance(one, CompletedItem) else None for one in found] == [size, None, size]
    assert isinstance(found[1], FailedItem) and found[1].item == runs[1]
    assert not list(place.iterdir())


def test_a_process_that_is_killed_over_a_copy_leaves_nothing(tmp_path, run, place):
    signed = tmp_path / "signed"
    (failed,) = each(partial(killed_over, signed), [location(url_of(run))])
    assert failed.deaths == 2 and signed.exists()
    assert not list(place.iterdir())


def killed_over(signed: Path, run: Path) -> int:
    with fetched(run):
        signed.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 0
