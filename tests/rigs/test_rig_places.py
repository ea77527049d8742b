import pickle

import pytest

from rigs.errors import FileError, RigPlace
from rigs.load import load, named_by

RIG = load("ur10e")[0]


@pytest.mark.parametrize(("part", "named"), [("", "cell.yaml"), ("tests.circle", "cell.yaml, tests.circle")])
def test_a_place_of_the_rig_is_named_by_its_file(part, named):
    error = FileError(RigPlace.of(RIG.name, part), "is wrong", "correct it")
    for one in (error, pickle.loads(pickle.dumps(error))):  # noqa: S301 - our own
        with pytest.raises(FileError) as found, named_by("cell.yaml", RIG):
            raise one
        assert found.value.where == named and found.value.what == "is wrong"


@pytest.mark.parametrize("where", [RIG.name, f"{RIG.name}, tests.circle", RigPlace.of("another", "tests.circle")])
def test_similar_text_is_kept(where):
    with pytest.raises(FileError) as found, named_by("cell.yaml", RIG):
        raise FileError(where, "is wrong", "correct it")
    assert found.value.where == where
