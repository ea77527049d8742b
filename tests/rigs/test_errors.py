import ast
import copy
import pickle
from pathlib import Path

import pytest

from rigs.error_codes import ERROR_CODES
from rigs.errors import CellError, FileError, PathError, RigPlace
from rigs.load import load, named_by


def test_a_message_is_one_line_that_a_terminal_can_bear():
    error = FileError("g1-0001.parquet", "columns a\nb, \x1b[31mred, Ω\ud800", "restore it")
    assert str(error) == r"g1-0001.parquet: columns a\nb, \x1b[31mred, Ω\ud800; restore it"


def test_long_message_keeps_place_and_remedy():
    said = str(FileError("g1-0001.parquet", "columns " + "x" * 50_000, "restore it"))
    assert said.startswith("g1-0001.parquet: columns") and said.endswith("xx; restore it") and len(said) < 1010


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (FileError("a.csv", "lacks x", "add it"), "file"),
        (FileError("a.csv", "lacks x", "add it", code="table.invalid"), "table.invalid"),
        (PathError("ur10", "too fast", "drive slower", "speed"), "path.impossible"),
        (
            copy.copy(CellError("p1", "is silent", "plug it", code="gauge.silent")),
            "gauge.silent",
        ),
    ],
)
def test_an_error_has_the_code_of_its_kind_or_its_own(error, code):
    assert error.to_dict() == {
        "code": code, "where": error.where, "what": error.what, "remedy": error.remedy, "exit_code": error.exit_code,
    }  # fmt: skip


def test_every_code_that_is_raised_is_in_the_list_and_no_other():
    files = [file for top in ("rigs", "daq", "analysis") for file in (Path(__file__).parents[2] / top).rglob("*.py")]
    words = (
        word
        for file in files
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.Call)
        for word in node.keywords
    )
    codes = {value.value for word in words if word.arg == "code" and isinstance(value := word.value, ast.Constant)}
    assert codes | {"rig", "usage", "file", "cell"} == set(ERROR_CODES)


RIG = load("ur10e-cell")[0]


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
