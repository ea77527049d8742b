import os
import signal
import subprocess
import sys
import urllib.request

import pytest

from rigs.distribution import to_install
from tests.support.bench import BIN
from tests.support.command_line import errors_of, ran


@pytest.mark.parametrize(("end", "code"), [(signal.SIGTERM, 0), (signal.SIGINT, 0)])
def test_it_serves_without_a_daemon_and_leaves_nothing_behind(tmp_path, end, code):
    env = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path), "TMPDIR": str(tmp_path)}
    command = [BIN / "rig", "window", "ur10e-cell", "--port", "0", "--control"]
    process = subprocess.Popen(
        command, cwd=tmp_path, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    address = process.stdout.readline().split(" ")[0]
    with urllib.request.urlopen(f"{address}/events", timeout=300) as answer:  # noqa: S310 - of the test
        assert "retry" in answer.readline().decode()
        assert len(list(tmp_path.glob("rig-window-*"))) == 1
        process.send_signal(end)
        _, said = process.communicate(timeout=300)
    assert (process.returncode, said) == (code, "")
    assert list(tmp_path.glob("rig-window-*")) == []


def test_wrong_options_are_refused_in_one_line(tmp_path, monkeypatch):
    (tmp_path / "short").write_text("short")
    for words, code, part in (
        (("--listen", "192.0.2.1"), 2, "--token"),
        (("--listen", "cell"), 2, "192.168.1.5"),
        (("--listen", "192.0.2.1", "--token", "none"), 3, "none"),
        (("--listen", "192.0.2.1", "--token", "short"), 3, "openssl"),
        (("--name", "*.plant"), 2, "*.plant"),
        (("nothing.yaml",), 3, "nothing.yaml"),
        (("--session", "s"), 2, "CELL"),
        (("--port", "70000"), 2, "65535"),
    ):
        done = ran("window", *words, cwd=tmp_path)
        assert (done.returncode, len(done.stderr.splitlines())) == (code, 1), (words, done.stderr)
        assert part in done.stderr, (words, done.stderr)
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    for name in [name for name in sys.modules if name.startswith("analysis.apps.window")]:
        monkeypatch.delitem(sys.modules, name)
    assert to_install("starlette", "uvicorn") in errors_of("window", cwd=tmp_path, exit_code=4)
