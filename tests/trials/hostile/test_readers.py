import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import typer

import analysis.intake.read
import analysis.intake.table_files
from analysis import cli
from analysis.intake.read import read_file
from daq.store import RunWriter, chunk, new_manifest, read_run, recover, verify
from daq.store.chunk import FAULTS, from_parquet, salvage, schema_of
from rigs.errors import CellError, FileError
from rigs.load import load
from tests.support.command_line import ended, ran
from tests.support.store_cases import ledger_records, put_ledger

BIN = Path(sys.executable).parent
SOON_S = 200.0


@pytest.fixture
def run(tmp_path):
    """A run without a row."""
    who = {"rig_name": "r", "rig_text": "", "streams": {"g1": ("g1_mm",)}, "operator": "ada"}
    writer = RunWriter.create(tmp_path, new_manifest(name="lap", test="radial", direction=None, **who))
    writer.close("complete", "", {})
    return writer.path


def replaced(file: Path, make: Callable[[Path], object]) -> None:
    file.unlink(missing_ok=True)
    make(file)


@pytest.mark.parametrize(
    "make",
    [os.mkfifo, lambda path: path.symlink_to("/dev/zero"), Path.mkdir],
    ids=["a FIFO", "a link to a device", "a directory"],
)
def test_no_command_blocks_on_special_files(tmp_path, run, make):
    odd = tmp_path / "odd"
    make(odd)
    commands = (
        ("check", odd),
        ("plan", odd),
        ("import", odd, "--rig", "paper-fanuc", "--test", "pose", "-o", tmp_path / "made"),
        ("correct", "paper-fanuc", "-o", tmp_path / "corrections", "--path", odd),
        ("replay", odd, "paper-fanuc", "-o", tmp_path / "played"),
        ("simulate", "paper-fanuc", "--test", "radial", "-o", tmp_path / "simulated", "--effects", odd),
    )
    for command in commands:
        done = ran(*command)
        told = done.stderr.splitlines()
        assert done.returncode == 3 and len(told) == 1 and told[0].startswith("error: "), (command, done.stderr)
    for name in ("manifest.json", "marks.json", "g1-0001.arrow", "g1-0001.parquet", ".lock"):
        spoilt = shutil.copytree(run, tmp_path / "spoilt")
        replaced(spoilt / name, make)
        for verb in ("verify", "recover"):
            done = ran(verb, spoilt)
            assert "Traceback" not in done.stderr and done.returncode in (0, 1, 3, 4), (name, verb, done.stderr)
        shutil.rmtree(spoilt)


def test_a_lock_that_is_a_link_is_not_followed(tmp_path, run):
    outside = tmp_path / "another"
    replaced(run / ".lock", lambda lock: lock.symlink_to(outside))
    with pytest.raises(CellError, match="lock"):
        recover(run)
    assert not outside.exists()


def test_a_table_has_an_end(tmp_path, monkeypatch):
    table = tmp_path / "t.csv"
    columns = [f"q{axis}_deg" for axis in range(1, 7)] + ["x_mm", "y_mm", "z_mm"]
    table.write_text("\n".join([",".join(columns), *[",".join("1" * 9)] * 100]))
    paper, _ = load("paper-fanuc")
    # private: a table of that many cells would take minutes to write
    monkeypatch.setattr(analysis.intake.read, "_MOST_CELLS", 400)
    with pytest.raises(FileError, match="400 cells"):
        read_file(table, "pose", paper)
    table.write_text(",".join(f"c{number}" for number in range(5000)) + "\n")
    with pytest.raises(FileError, match="5000 columns"):
        read_file(table, "pose", paper)
    monkeypatch.setattr(analysis.intake.table_files, "MOST_BYTES", 1000)
    with pytest.raises(FileError, match=r"0\.001 MB"):
        read_file(table, "pose", paper)


def many_equal_rows(rows: int) -> bytes:
    sink = pa.BufferOutputStream()
    column = pa.array(np.zeros(1_000_000, dtype=np.int64))
    table = pa.table({"a": pa.chunked_array([column] * (rows // 1_000_000))})
    pq.write_table(table, sink, compression="zstd")
    return bytes(sink.getvalue().to_pybytes())


def test_small_file_of_millions_of_rows_is_not_decoded(monkeypatch):
    data = many_equal_rows(120_000_000)
    assert len(data) < 1_000_000
    monkeypatch.setattr("pyarrow.parquet.ParquetFile.read", lambda *_, **__: pytest.fail("decoded"))
    with pytest.raises(OSError, match="120000000 rows"):
        from_parquet(data)


@pytest.mark.parametrize("is_repeated", [True, False], ids=["repeated", "long"])
def test_a_small_file_that_stands_for_much_text_is_not_decoded(is_repeated, monkeypatch):
    monkeypatch.setattr(chunk, "_MOST_DECODED", 1_000_000)  # private: 0.8 GB would take a minute
    text = pa.array(["x" * (10_000 if is_repeated else 2_000_000)])
    table = pa.table({"note": pa.DictionaryArray.from_arrays(pa.array([0] * 1000), text) if is_repeated else text})
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd", use_dictionary=is_repeated, store_schema=False)
    data = bytes(sink.getvalue().to_pybytes())
    assert len(data) < 10_000
    with pytest.raises(OSError, match="limit"):
        from_parquet(data)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_batch_that_is_compressed_is_damage(compression):
    """None is ever recorded, and it may stand for any number of rows."""
    schema = schema_of("g1", ("g1_mm",))
    batch = pa.record_batch([pa.array(np.zeros(1000), field.type, safe=False) for field in schema], schema=schema)
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, schema, options=pa.ipc.IpcWriteOptions(compression=compression)) as writer:
        writer.write_batch(batch)
    found = salvage(bytes(sink.getvalue().to_pybytes()), schema)
    assert found.rows == 0 and found.damage
    assert salvage(chunk.head(schema) + chunk.frame(batch, 0) + chunk.END, schema).rows == 1000


def test_a_file_that_no_recorder_has_written_is_named(run):
    """As a crash would have left it: in no ledger."""
    put_ledger(run, ledger_records(run)[:1])
    (run / "g1-0001.parquet").write_bytes(many_equal_rows(120_000_000))
    with pytest.raises(CellError, match=r"g1-0001\.parquet"):
        recover(run)


def _no_memory(*_: object, **__: object) -> None:
    raise pa.ArrowMemoryError("malloc of size 960000000 failed")


def test_lack_of_memory_is_not_blamed_on_the_file(run, monkeypatch):
    """A whole chunk that no ledger lists yet, as a crash leaves it: recovery could set it aside for damaged."""
    rows = schema_of("g1", ("g1_mm",)).empty_table()
    columns = {f.name: pa.array([1] * 3, f.type) for f in rows.schema}
    good = run / "g1-0001.parquet"
    good.write_bytes(chunk.to_parquet(pa.table(columns, schema=rows.schema)))
    put_ledger(run, ledger_records(run)[:1])
    before = {file.name: file.read_bytes() for file in run.iterdir()}
    with monkeypatch.context() as short:
        short.setattr(pq.ParquetFile, "read", _no_memory)
        with pytest.raises(CellError, match="memory"):
            recover(run)
        assert {file.name: file.read_bytes() for file in run.iterdir()} == before
    assert recover(run).rows == {"g1": 3}
    with monkeypatch.context() as short:
        short.setattr(pq.ParquetFile, "read", _no_memory)
        with pytest.raises(FileError, match="memory"):
            read_run(run)
        assert any("memory" in line for line in verify(run))


def test_a_damaged_length_is_damage_however_much_it_asks_for(monkeypatch):
    class Damaged:
        schema = schema_of(FAULTS, ())

        def read_next_batch_with_custom_metadata(self) -> None:
            _no_memory()

    monkeypatch.setattr(chunk, "_has_compression", lambda metadata: False)  # private: read before Arrow
    message = SimpleNamespace(type="record batch", metadata=pa.py_buffer(b""))
    monkeypatch.setattr(pa.ipc, "read_message", lambda data: message)
    monkeypatch.setattr(pa.ipc, "open_stream", lambda *_, **__: Damaged())
    assert "malloc" in str(salvage(bytes(1000), schema_of(FAULTS, ())).damage)


def test_out_of_memory_is_one_line(tmp_path):
    """Of the whole program, in an address space that is large enough to begin in; a good table takes twice as much."""
    table = tmp_path / "t.csv"
    header = ",".join(["t_s", "direction", *(f"q{axis}_deg" for axis in range(1, 7)), "g1_mm", "g2_mm"])
    table.write_text("\n".join([header, *(f"{k},acw,1,2,3,4,5,6,7,8" for k in range(1_000_000))]))
    command = [BIN / "rig", "import", table, "--rig", "paper-fanuc", "--test", "yaw", "-o", tmp_path / "made"]

    def little() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (700_000_000, resource.RLIM_INFINITY))

    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    limited = {"preexec_fn": little, "env": environment, "timeout": SOON_S}
    done = subprocess.run(command, capture_output=True, text=True, check=False, **limited)
    told = done.stderr.splitlines()
    assert len(told) == 1 and "memory" in told[0] and "Traceback" not in done.stderr, done.stderr[-2000:]
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    ("error", "numerical"),
    [
        (OverflowError("(34, 'out of range')"), True),
        (np.linalg.LinAlgError("SVD did not converge"), True),
        (RuntimeWarning("invalid value"), True),
        (ValueError("a bug"), False),
    ],
)
def test_a_numerical_failure_is_one_line_and_a_bug_is_not(error, numerical, monkeypatch, capsys):
    def fails() -> None:
        raise error

    app = typer.Typer()
    app.command()(fails)
    monkeypatch.setattr(cli, "app", app)
    if not numerical:
        with pytest.raises(ValueError, match="a bug"):
            ended()
        return
    code = ended()
    told = capsys.readouterr().err.splitlines()
    assert code == 3 and len(told) == 1 and told[0].startswith("error: numbers: ")
