from pathlib import Path

import pytest

NAMES = ("b/later", "b/early", "a/deep/one", "a-b/first", "a.b/first", "a/[x]*?", ".deleted/gone", "a/deep/one/inner")


def made(path: Path, file: str = "manifest.json") -> Path:
    path.mkdir(parents=True)
    (path / file).write_text("{}")
    return path


@pytest.fixture
def plant(tmp_path):
    for name in NAMES:
        made(tmp_path / name)
    made(tmp_path / "b" / "without-manifest", "ledger.jsonl")
    (tmp_path / "empty").mkdir()
    (tmp_path / "a" / "notes.txt").touch()
    return tmp_path
