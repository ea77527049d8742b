from importlib.metadata import EntryPoint

import numpy as np
import pytest

from analysis.procedures.shared.test_kind import kind_of, nominal_setup, shows_joints
from analysis.runs.tables import PathTable, format_of
from rigs.errors import FileError
from rigs.load import load
from rigs.schema import vocabulary


def test_a_test_without_joints_predicts_nothing():
    path = PathTable(np.zeros(1), np.zeros((1, 3)))
    assert shows_joints("pose") and not shows_joints("path")
    with pytest.raises(FileError):
        nominal_setup(load("ur10e-cell")[0], path)
    assert kind_of("path").cannot_tell(path, load("ur10e-cell")[0])


@pytest.fixture
def offered(request, monkeypatch):
    value = request.param
    monkeypatch.setitem(vocabulary.OTHER_TESTS, "other", EntryPoint("other", value, "rig.tests"))
    yield value
    format_of.cache_clear()


@pytest.mark.parametrize(
    "offered", ["nowhere:Kind", "analysis.procedures.touch:Touch", "analysis.procedures.touch"], indirect=True
)
def test_an_unusable_kind_is_refused_with_the_name_that_is_offered(offered):
    with pytest.raises(FileError) as error:
        format_of("other")
    assert error.value.code == "package.missing" and offered in error.value.what
