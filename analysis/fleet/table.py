"""Every figure of every run of a plant as one Parquet file: a row a figure, for DuckDB, pandas and Power BI."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC
from pathlib import Path
from typing import Any

from analysis.fleet.catalogue import Key
from analysis.fleet.gather import Fleet, collected_in
from analysis.history.collect import Collected
from analysis.history.records import Record, escaped
from daq.store import durable
from rigs.errors import FileError


def write_figures(fleet: Fleet, path: Path) -> None:
    """Write the table, in place of a file that is there, which stays until the new one is whole; in memory is one robot
    at a time. A run without figures has one row, whose `problem` says why.

    Raises FileError where it cannot be written.
    """
    import pyarrow as pa  # noqa: PLC0415 - slow to import, needed for Parquet only
    import pyarrow.parquet as pq  # noqa: PLC0415

    words = pa.dictionary(pa.int32(), pa.string())
    columns = dict.fromkeys(("robot", "folder"), words) | {"run": pa.string(), "started_utc": pa.timestamp("ms")}
    columns |= dict.fromkeys(("test", "direction", "placement", "program", "corrected", "figure"), words)
    columns |= {"value": pa.float64(), "u": pa.float64(), "unit": words, "samples": pa.int64(), "noise": words}
    columns |= {"watch": pa.float64(), "fail": pa.float64(), "standing": words, "problem": pa.string()}
    schema = pa.schema(columns)
    temporary = path.with_name(path.name + durable.TEMPORARY)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with pq.ParquetWriter(temporary, schema, compression="zstd") as file:
            for key in sorted(fleet.digests):
                rows = list(_rows(key, collected_in(fleet.catalogue, key)))
                file.write_table(pa.Table.from_pylist(rows, schema))
            strays = [_label("", "", run) | {"problem": why} for run, why in fleet.strays]
            file.write_table(pa.Table.from_pylist(strays, schema))
        durable.rename(temporary, path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError):
            raise FileError(str(path), error.strerror or str(error), "give another --parquet") from None
        raise


def _rows(key: Key, collected: Collected) -> Iterator[dict[str, Any]]:
    folder, robot = key
    for record in collected.broken:
        yield _label(robot, folder, record.name) | _of_run(record) | {"problem": record.problem}
    for record in collected.runs:
        label = _label(robot, folder, record.name) | _of_run(record)
        for name, quantity in record.figures.items():
            figure = {
                "value": quantity.value,
                "u": quantity.u,
                "unit": quantity.unit,
                "samples": quantity.samples,
                "noise": quantity.noise,
            }
            limit = collected.limits.of(record.test, name)
            limited = (
                {"watch": limit.watch, "fail": limit.fail, "standing": limit.standing(quantity.value, quantity.u)}
                if limit
                else {}
            )
            yield label | {"figure": name} | figure | limited


def _label(robot: str, folder: str, run: str) -> dict[str, Any]:
    return {"robot": robot, "folder": escaped(folder), "run": escaped(run)}


def _of_run(record: Record) -> dict[str, Any]:
    started = None
    with suppress(ValueError):
        started = record.when.astimezone(UTC).replace(tzinfo=None)  # DuckDB reads times with a zone through pytz alone
    places = {"test": record.test, "direction": record.direction}
    return (
        {"started_utc": started}
        | places
        | {"placement": record.placement, "program": record.program, "corrected": record.corrected}
    )
