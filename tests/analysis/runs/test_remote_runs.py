import pytest

from analysis.runs.batch import remote_runs, run_directories
from analysis.runs.remote import listed, location

pytest.importorskip("fsspec", reason="fsspec is an extra: pip install s3fs sshfs")
from tests.analysis.runs.conftest import made
from tests.support.refusals import refused
from tests.support.trial_store import url_of


def below(url: str) -> list[str]:
    return [str(run.path).removeprefix(f"{url}/") for run in listed(location(url))]


@pytest.mark.parametrize("protocol", ["file", "trial", "s3"])
def test_the_runs_are_those_of_the_directory(protocol, plant, monkeypatch):
    url = url_of(plant) if protocol != "file" else f"file://{plant}"
    if protocol == "s3":  # the one listing of an object store
        monkeypatch.setattr("analysis.runs.remote.OBJECT_STORES", ("trial",))
    assert [str(run) for run in run_directories([location(url)])] == [f"{url}/{name}" for name in below(url)]
    assert below(url) == [str(run.relative_to(plant)) for run in run_directories([plant])]


def test_run_or_empty_directory_is_listed_as_itself(plant):
    for name in ("b/later", "empty", "nowhere"):
        run = location(f"file://{plant}/{name}")
        assert run_directories([run]) == [run]
    (one,) = listed(location(f"file://{plant}/b/later"))
    assert one.files and [(file.name, file.size) for file in one.files] == [("manifest.json", 2)]
    assert all(file.stamp for file in one.files)


def test_unlistable_directory_is_given_without_files(plant):
    for name in ("denied", "lost+found"):
        made(plant / name / "run")
    without = [str(run.path) for run in listed(location(url_of(plant))) if run.files is None]
    assert without == [f"{url_of(plant)}/denied"]
    with refused("store.denied"):
        listed(location(url_of(plant / "denied")))


def test_a_store_that_is_lost_ends_the_listing(plant):
    made(plant / "vanished" / "run")
    with refused("store.silent"):
        remote_runs(location(url_of(plant)))


def test_links_are_not_followed_and_a_circle_of_them_ends(plant):
    (plant / "b" / "round").symlink_to(plant)
    assert len(below(f"file://{plant}")) == 7


def test_names_that_lead_elsewhere_are_left_out(plant):
    (plant / "a" / ".names").write_text(f".. {plant}/a/.. {plant}/b/later/manifest.json /etc/passwd {plant}/a/x/../y")
    assert len(below(url_of(plant))) == 7
