import os
import signal
import subprocess
import sys

from daq.store.run_directory import files_into, new_directory

FILLS = """
import sys, time
from pathlib import Path
from daq.store.run_directory import new_directory
with new_directory(Path(sys.argv[1])) as made:
    (made / "half").write_text("half")
    print("filled", flush=True)
    time.sleep(60)
"""


def test_remains_of_a_killed_process_are_removed_by_the_next_command(tmp_path):
    child = subprocess.Popen([sys.executable, "-c", FILLS, tmp_path / "run"], stdout=subprocess.PIPE, text=True)
    with child:
        assert child.stdout and child.stdout.readline() == "filled\n"
        (hidden,) = tmp_path.iterdir()
        with new_directory(tmp_path / "other") as made:  # while it is being filled it stays
            (made / "whole").write_text("whole")
        assert (hidden / "half").read_text() == "half"
        os.kill(child.pid, signal.SIGKILL)
    foreign = tmp_path / ".mine.tmp"
    foreign.mkdir()
    with files_into(tmp_path) as made:
        (made / "file").write_text("file")
    assert sorted(one.name for one in tmp_path.iterdir()) == [".mine.tmp", "file", "other"]


def test_two_that_are_being_filled_do_not_remove_each_other(tmp_path):
    with new_directory(tmp_path / "one") as first, new_directory(tmp_path / "two") as second:
        (first / "a").write_text("1")
        (second / "b").write_text("2")
    assert (tmp_path / "one" / "a").read_text() == "1" and (tmp_path / "two" / "b").read_text() == "2"
