"""One point of the scaling curve, in a process of its own: ``python -m pl_mc.benchmark.scaling_point``.

Prints one line of JSON with the time of the sweep and the largest memory that the process ever held. With a folder for
its parts a point that was stopped goes on, and what the processes before this one had spent is told too.
"""

from __future__ import annotations

import contextlib
import json
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from pl_mc.runtime.whole_files import write_whole

# What a process that is killed has spent since it last said so is lost.
SAID_EVERY_S = 5.0

_BEGIN_S = time.perf_counter()


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


@contextlib.contextmanager
def _spending(folder: Path | None) -> Iterator[dict[str, float]]:
    """What earlier processes of this point have spent [s]; meanwhile this one's is written down beside it."""
    place = None if folder is None else folder / "spent.json"
    earlier = {"process_s": 0.0, "processor_s": 0.0, "sweep_s": 0.0}
    if place is None:
        yield earlier
        return
    with contextlib.suppress(FileNotFoundError):
        earlier = json.loads(place.read_text(encoding="utf-8"))
    place.parent.mkdir(parents=True, exist_ok=True)
    begin, over = time.perf_counter(), threading.Event()

    def say() -> None:
        now = time.perf_counter()
        own = {"process_s": now - _BEGIN_S, "processor_s": time.process_time(), "sweep_s": now - begin}
        write_whole(place, json.dumps({name: earlier[name] + spent for name, spent in own.items()}))

    def go_on_saying() -> None:
        while not over.wait(SAID_EVERY_S):
            say()

    teller = threading.Thread(target=go_on_saying, daemon=True)
    teller.start()
    try:
        yield earlier
    finally:
        over.set()
        teller.join()
        say()


def main(arguments: list[str]) -> None:
    """Sweep ``draws`` draws of the reference problem in a precision with some threads, perhaps into a folder."""
    draws, precision, workers = int(arguments[0]), arguments[1], int(arguments[2])
    folder = Path(arguments[3]) if len(arguments) > 3 else None
    import pl_mc
    from pl_mc.benchmark.problem import METHODS, reference_faults, reference_geometry

    g = reference_geometry()
    faults = reference_faults(g)
    with _spending(folder) as earlier:
        start = time.perf_counter()
        table = pl_mc.sweep(
            g, faults, draws=draws, seed=1, methods=METHODS, precision=precision, workers=workers or None,
            folder=folder, resume=folder is not None, progress=False,
        )  # fmt: skip
        seconds = time.perf_counter() - start
    found = {
        "scenarios": draws * len(faults), "alarms": int(table.alarms.sum()), "sweep_s": seconds,
        "processor_s": time.process_time(), "peak_bytes": peak_memory_bytes(), "earlier": earlier,
    }  # fmt: skip
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1:])
