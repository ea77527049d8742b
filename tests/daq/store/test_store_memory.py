import ctypes
import subprocess
import sys

import pytest

MAPPED = """
import ctypes
from daq.store.run_directory import keep_large_blocks_apart

class Info(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks".split()]
    _fields_ += [(name, ctypes.c_size_t) for name in "uordblks fordblks keepcost".split()]

libc = ctypes.CDLL(None)
libc.mallinfo2.restype = Info
{}
chunk = bytes(20 << 20)
del chunk
before = libc.mallinfo2().hblkhd
block = bytes(4 << 20)
print(libc.mallinfo2().hblkhd - before >> 20)
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="glibc before 2.33")
@pytest.mark.parametrize(("called", "mapped_mib"), [("", "0"), ("keep_large_blocks_apart()", "4")])
def test_after_a_chunk_large_blocks_are_still_mapped_by_themselves(called, mapped_mib):
    done = subprocess.run([sys.executable, "-c", MAPPED.format(called)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == mapped_mib


def test_the_first_rows_import_nothing():
    """An import would hold up the thread that drains the readers, as that of pandas did."""
    script = """
import sys, numpy as np, pyarrow as pa
from daq.recording.io_worker import IoWorker
from daq.recording.warnings import RateLimitedLog

IoWorker(RateLimitedLog())
before = set(sys.modules)
pa.array(np.arange(3.0)), pa.array(["silent"], pa.string())
print(sorted(set(sys.modules) - before))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
