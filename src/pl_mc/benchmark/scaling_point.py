"""One point of the scaling curve, in a process of its own: ``python -m pl_mc.benchmark.scaling_point``.

Prints one line of JSON with the time of the sweep and the largest memory that the process ever held.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path


def peak_memory_bytes() -> int:
    """The largest resident memory of this process so far.

    Linux counts the memory of the process that started this one into its resource usage, so the figure that belongs
    to this program alone is asked for first.
    """
    try:
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def main(arguments: list[str]) -> None:
    """Sweep ``draws`` draws of the reference problem in a precision with some threads."""
    draws, precision, workers = int(arguments[0]), arguments[1], int(arguments[2])
    import pl_mc
    from pl_mc.benchmark.problem import METHODS, reference_faults, reference_geometry

    g = reference_geometry()
    faults = reference_faults(g)
    start = time.perf_counter()
    table = pl_mc.sweep(
        g, faults, draws=draws, seed=1, methods=METHODS, precision=precision, workers=workers or None, progress=False
    )  # fmt: skip
    seconds = time.perf_counter() - start
    scenarios, alarms = draws * len(faults), int(table.alarms.sum())
    found = {"scenarios": scenarios, "alarms": alarms, "sweep_s": seconds, "peak_bytes": peak_memory_bytes()}
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1:])
