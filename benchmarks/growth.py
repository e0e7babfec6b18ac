"""Time and memory against the number of geometries, of ARAIM and of service volumes, each point in its own process.

    python benchmarks/growth.py v3 1000 10000 100000
    python benchmarks/growth.py v3 1000000 --chunk 10000
    python benchmarks/growth.py v4.2 1000 10000
    python benchmarks/growth.py service 45 15 5

`v3` and `v4.2` take the sky of a user, epoch by epoch, with 24 GPS and 24 Galileo satellites in orbit, all at once or
in chunks of which levels alone are kept; `service` takes the step of the grid of users [deg], 40 epochs and three
methods. Prints a table of CSV. Seconds begin after the imports, include compilation and leave out the making of the
geometries that ARAIM gets.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from typing import Any

import numpy as np

# Of a service volume.
EPOCHS = 40

# Of the sky of a user: no divisor of a day, so that no sky comes again soon.
START, INTERVAL_S = np.datetime64("2017-11-21T00:00:00"), 97


def ism() -> Any:
    """What both standards want to know."""
    from pl_mc.araim import Ism

    return Ism(
        sigma_ura_m=0.75, sigma_ure_m=0.5, b_nom_m=0.75, r_sat_per_h=1e-5, mfd_sat_h=1.0,
        r_const_per_h={"G": 1e-8, "E": 1e-4}, mfd_const_h=1.0, name="growth",
    )  # fmt: skip


def araim(standard: str, number: int, chunk: int) -> dict[str, float]:
    """Levels of so many geometries, handed over in chunks of which the levels are kept.

    ``given_memory_mb`` is the largest memory before the first levels, when the first geometries were made.
    """
    import pl_mc
    from pl_mc.benchmark.scaling_point import peak_memory_bytes

    message, levels, seconds, given_mb = ism(), np.empty((number, 2)), np.zeros(2), 0.0
    model = pl_mc.error_model("dual_frequency", ism=message)
    for first in range(0, number, chunk):
        g = pl_mc.simulate(
            site="CUT0", constellations="ADD-24+24", epochs=min(chunk, number - first), interval_s=INTERVAL_S,
            start=START + np.timedelta64(first * INTERVAL_S, "s"), mask_deg=5.0, error_model=model,
        )  # fmt: skip
        given_mb = given_mb or peak_memory_bytes() / 1e6
        begin = now_s()
        found = pl_mc.araim.protection_levels(
            g.design, g.sigma_m**2, systems=np.array(g.systems)[g.satellite], in_view=g.in_view, ism=message,
            standard=standard,
        )  # fmt: skip
        seconds += now_s() - begin
        levels[first : first + len(g.design)] = np.stack([found.hpl_m, found.vpl_m], axis=1)
    return {
        "points": number, "chunk": chunk, "rows": g.design.shape[1], "modes": found.excluded.shape[1],
        "vpl_median_m": float(np.median(levels[:, 1])), "wall_s": seconds[0], "processor_s": seconds[1],
        "given_memory_mb": given_mb,
    }  # fmt: skip


def service(step_deg: float) -> dict[str, float]:
    """A service volume of GPS and Galileo: least squares, IGG-III (100 draws each) and ARAIM."""
    import pl_mc

    begin = now_s()
    volume = pl_mc.service_volume(step_deg=step_deg, step_s=300.0, duration_s=300.0 * EPOCHS, progress=False)
    wall_s, processor_s = now_s() - begin
    users = len(volume.grid)
    return {
        "points": users * EPOCHS, "users": users, "epochs": EPOCHS, "scenarios": int(volume.world.scenarios.sum()),
        "wall_s": wall_s, "processor_s": processor_s,
    }  # fmt: skip


def now_s() -> np.ndarray:
    """By the wall, and of the processor: user and system time of this process, which other work hardly moves."""
    return np.array([time.perf_counter(), time.process_time()])


def point(what: str, size: float, chunk: int | None) -> dict[str, float]:
    """What a process of its own takes."""
    import jax

    from pl_mc.benchmark.scaling_point import peak_memory_bytes

    jax.config.update("jax_enable_x64", True)
    found = service(size) if what == "service" else araim(what, int(size), chunk or int(size))
    return found | {"peak_memory_mb": peak_memory_bytes() / 1e6}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("v3", "v4.2", "service"))
    parser.add_argument("sizes", nargs="+", type=float)
    parser.add_argument("--chunk", type=int)
    parser.add_argument("--point", action="store_true", help="in this process, as a line of JSON")
    asked = parser.parse_args()
    if asked.point:
        print(json.dumps(point(asked.what, asked.sizes[0], asked.chunk)))
        sys.exit()
    for k, one in enumerate(asked.sizes):
        chunk = [] if asked.chunk is None else ["--chunk", str(asked.chunk)]
        command = [sys.executable, __file__, asked.what, str(one), "--point", *chunk]
        row = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True).stdout)
        if not k:
            print(*row, sep=",")
        print(*(value if isinstance(value, int) else f"{value:.6g}" for value in row.values()), sep=",", flush=True)
