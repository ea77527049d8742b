from pathlib import Path

import pytest

from analysis.runs.batch import run_directories
from rigs.errors import FileError
from tests.analysis.runs.conftest import made

EVERY = ["a/[x]*?", "a/deep/one", "a-b/first", "a.b/first", "b/early", "b/later", "b/without-manifest"]


def test_every_run_below_a_directory_in_the_order_of_names(plant):
    assert [str(run.relative_to(plant)) for run in run_directories([plant])] == EVERY


def test_runs_stay_in_the_order_in_which_they_were_named(plant, monkeypatch):
    monkeypatch.chdir(plant)
    assert run_directories([Path("b/later"), Path("a/deep")]) == [Path("b/later"), Path("a/deep/one")]


@pytest.mark.parametrize("again", ("b", "b/later", "{plant}/b/later"))
def test_a_run_that_is_named_twice_is_refused(plant, monkeypatch, again):
    monkeypatch.chdir(plant)
    with pytest.raises(FileError) as refused:
        run_directories([Path("b/later"), Path(again.format(plant=plant))])
    assert refused.value.code == "run.copied"


def test_links_are_followed_and_lead_in_no_circle(plant, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (plant / "empty" / "share").symlink_to(elsewhere)
    made(elsewhere / "far")
    (elsewhere / "back").symlink_to(plant)
    runs = run_directories([plant])
    assert plant / "empty" / "share" / "far" in runs and len(runs) == len(EVERY) + 1


def test_directories_that_link_to_each_other_are_entered_once(tmp_path):
    cells = [made(tmp_path / f"cell-{number:02d}" / "run").parent for number in range(12)]
    for cell in cells:
        for other in cells:
            (cell / f"to-{other.name}").symlink_to(other)
    # A walk along every path takes days.
    assert [run.resolve() for run in run_directories([tmp_path])] == [cell / "run" for cell in cells]


def test_a_directory_that_may_be_listed_and_not_entered_stands_for_itself(plant, monkeypatch):
    is_dir = Path.is_dir

    def as_for_another_user(path: Path) -> bool:
        if path.parent == plant / "b":
            raise PermissionError(13, "Permission denied")
        return is_dir(path)

    monkeypatch.setattr(Path, "is_dir", as_for_another_user)
    assert run_directories([plant]) == [*(plant / name for name in EVERY[:4]), plant / "b"]
