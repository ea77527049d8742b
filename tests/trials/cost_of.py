"""Run a command and print its seconds, processor time and peak memory; small itself, since a child begins as a copy."""

import resource
import subprocess
import sys
import time

begin_s = time.monotonic()
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, check=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
seconds, processor_s = time.monotonic() - begin_s, used.ru_utime + used.ru_stime
print(f"{seconds:.1f} s, {processor_s:.1f} s of processor time, {used.ru_maxrss / 1e3:.0f} MB at most")
