import math
import os
import random
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.acquisition.host_clock import DriftMonitor
from daq.protocol.conversation import NO_TIME, FaultKind, Sample
from daq.service.exposition import Metric, render
from daq.service.maintenance import Maintenance, write_atomically
from rigs.errors import CellError
from rigs.text import escape_lines
from tests.support.nightly import examples
from tests.support.simulated_bench import SimulatedBench

_LINE = re.compile(r'([a-zA-Z_:][a-zA-Z0-9_:]*)(?:\{((?:[a-zA-Z_]\w*="(?:[^"\\\n]|\\["\\n])*",?)*)\})? (\S+)', re.ASCII)
_LABEL = re.compile(r'(\w+)="((?:[^"\\\n]|\\["\\n])*)"', re.ASCII)
Read = dict[tuple[str, frozenset[tuple[str, str]]], float]


def read(text: str) -> Read:
    """Every value by its name and labels; each name told once, with its type before it, as the format demands."""
    types: dict[str, str] = {}
    values: Read = {}
    assert text.endswith("\n")
    for line in text.removesuffix("\n").split("\n"):
        if line.startswith("# TYPE "):
            name, kind = line.split(" ")[2:]
            assert name not in types and kind in ("gauge", "counter")
            types[name] = kind
        elif line.startswith("# HELP "):
            assert line.split(" ")[2] not in types
        else:
            match = _LINE.fullmatch(line)
            assert match, line
            name, labels, value = match.groups()
            assert list(types)[-1] == name and name.endswith("_total") == (types[name] == "counter")
            pairs = frozenset((key, _plain(quoted)) for key, quoted in _LABEL.findall(labels or ""))
            assert (name, pairs) not in values
            values[name, pairs] = float(value)
    return values


def _plain(quoted: str) -> str:
    return re.sub(r"\\(.)", lambda match: "\n" if match[1] == "n" else match[1], quoted)


@examples(30, 100)
def test_any_label_is_read_back(examples):
    @settings(max_examples=examples)
    @given(st.text(), st.dictionaries(st.sampled_from("abc"), st.text()), st.floats())
    def holds(words: str, labels: dict[str, str], value: float) -> None:
        values = read(render([Metric("rig_x", "gauge", words, ((labels, value),))]))
        ((key, back),) = values.items()
        assert key == ("rig_x", frozenset((label, escape_lines(text)) for label, text in labels.items()))
        assert back == value or (math.isnan(back) and math.isnan(value))

    holds()


def test_metric_without_value_is_left_out():
    assert render([Metric("rig_x", "gauge", "x", ())]) == ""


def test_daemon_exports_readings_and_recordings(tmp_path):
    target = tmp_path / "rig.prom"
    with SimulatedBench(tmp_path, metrics=target) as bench:
        bench.start().all_reading()
        path = bench.record("lap")
        bench.recorded(20)
        values = read(bench.run("metrics").stdout)
        assert ("rig_recording", frozenset({("rig", "bench")})) in read(target.read_text())
    assert list(tmp_path.glob("rig.prom*")) == []  # a daemon that has ended tells nothing

    def value(metric: str, **given: str) -> float:
        return values[metric, frozenset({"rig": "bench", **given}.items())]

    for stream in ("g1", "g2", "robot"):
        assert value("rig_connected", stream=stream) == 1 and value("rig_rate_hertz", stream=stream) > 1
        assert value("rig_samples_total", stream=stream) > 20 and value("rig_queue_items", stream=stream) >= 0
        kinds = set(FaultKind) - {FaultKind.CLOCK}
        assert all(value("rig_faults_total", stream=stream, kind=kind) >= 0 for kind in kinds)
    assert value("rig_faults_total", stream="host", kind="clock") == 0
    assert 0 <= value("rig_reading_age_seconds", stream="g1", column="g1_mm") < 60
    assert value("rig_recording") == 1 and value("rig_recording_seconds") > 0
    assert value("rig_recording_info", name="lap", test="yaw", direction="acw", run=str(path)) == 1
    assert 0 < value("rig_disk_free_bytes") <= value("rig_disk_size_bytes")
    assert not any(name.startswith(("rig_automatic", "rig_retention")) for name, _ in values)  # it has neither


def test_unwritable_metrics_file_ends_nothing(tmp_path, caplog):
    folder = tmp_path / "there"
    keeper = Maintenance(folder / "rig.prom", lambda: "x 1\n", None)
    for _ in range(3):
        # private: the thread does it every ten seconds
        keeper._write_metrics(folder / "rig.prom")
    assert len(caplog.records) == 1 and "be written" in caplog.text
    with pytest.raises(CellError):
        keeper.start()


def test_a_file_of_somebody_else_is_neither_replaced_nor_removed(bench):
    before = bench.rig.read_bytes()
    told = bench.fails("rigd", bench.rig, "--metrics", bench.rig, code=4)
    assert f"{bench.rig}: exists already" in told
    assert bench.rig.read_bytes() == before
    os.mkfifo(bench.folder / "pipe")
    told = bench.fails("rigd", bench.rig, "--metrics", bench.folder / "pipe", code=4)
    assert "pipe: exists already" in told


def test_only_metrics_are_removed_at_the_end(tmp_path):
    path, metrics = tmp_path / "rig.prom", render([Metric("rig_x", "gauge", "X.", (({}, 1.0),))])
    path.write_text(metrics)  # as a daemon that was killed leaves it
    for text, left in ((metrics, []), ("Dear all,", [path])):  # the latter as if another program had written it
        keeper = Maintenance(path, lambda text=text: text, None)
        keeper.start()
        keeper.stop()
        keeper.join()
        assert list(tmp_path.iterdir()) == left


def test_file_is_complete_or_missing(tmp_path):
    path = tmp_path / "rig.prom"
    write_atomically(path, "old\n")
    write_atomically(path, "a directory's name \udcff\n")
    assert path.read_text() == "a directory's name ?\n"
    path.with_name(f".rig.prom.{os.getpid()}").mkdir()
    with pytest.raises(OSError, match="directory"):
        write_atomically(path, "new\n")
    assert path.read_text() == "a directory's name ?\n"


# --- Clocks ---


def _samples(seconds: float, ppm: float, start_s: float, rng: random.Random, device_s: float = 1000.0) -> list[Sample]:
    """At 100 Hz, each up to 5 ms late; the host's clock runs `ppm` faster."""
    samples = []
    for number in range(round(seconds * 100)):
        true_s = number / 100
        host_ns = round((start_s + true_s * (1 + ppm * 1e-6) + rng.expovariate(1000)) * 1e9)
        samples.append(Sample((1.0,), NO_TIME, host_ns, host_ns, 60, device_s + true_s))
    return samples


def test_the_drift_of_a_clock_shows_through_late_messages():
    watch, rng = DriftMonitor(), random.Random(3)
    watch.feed(_samples(9, 30, 500, rng))
    assert watch.state() is None
    watch.feed(_samples(300, 30, 509, rng, 1009))
    state = watch.state()
    assert state.drift_ppm == pytest.approx(30, abs=3)
    assert state.offset_s == pytest.approx(-500 + 0.009, abs=1e-3) and 0.003 < state.late_s < 0.02


def test_restarted_clock_is_watched_again():
    watch, rng = DriftMonitor(), random.Random(4)
    watch.feed(_samples(100, 0, 500, rng))
    watch.feed(_samples(25, 0, 600, rng, device_s=3.0))
    state = watch.state()
    assert state.offset_s == pytest.approx(597, abs=1e-3) and state.drift_ppm is None


def test_an_instrument_without_a_clock_has_no_drift():
    watch = DriftMonitor()
    watch.feed([Sample((1.0,), NO_TIME, number, number, 7) for number in range(100)])
    assert watch.state() is None
