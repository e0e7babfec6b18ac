"""``pl-mc bench``: what this machine can do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pl_mc.cli.printing import Json


def bench(
    *,
    seconds: float = 10.0,
    precision: Annotated[tuple[str, ...], Parameter(negative="")] = ("float64", "float32"),
    devices: int | None = None,
    limit: Path | None = None,
    scaling: str | None = None,
    out: Path | None = None,
    json: Json = False,
    progress: bool | None = None,
) -> None:
    """Measure this machine: sweeps beside batched NumPy and others, and how exact they are.

    Examples: `pl-mc bench --seconds 3`; `pl-mc bench --scaling 1e6,1e7 --out scaling`

    Parameters
    ----------
    seconds
        Time for each computation, over all its repetitions [s].
    precision
        float64 or float32; repeatable; both unless given.
    devices
        Devices of this machine over which sweeps are spread too.
    limit
        A hand-written kernel to compare with: a C++ source or a program.
    scaling
        Instead: time and memory at these numbers of scenarios, `1e6,1e7,1e8`, in the first precision.
    out
        Folder for bench.json, bench.csv and bench.md, or for the curve.
    json
        Print JSON instead of tables.
    progress
        Show a progress bar; unless given, only on a terminal.
    """
    from json import dumps

    from pl_mc import benchmark

    if scaling is not None:
        table, text = benchmark.run_scaling(
            benchmark.scenario_counts(scaling), precision=precision[0], out=out, progress=progress
        )
        print(table.to_json(orient="records", indent=2) if json else text)
        return
    record, text = benchmark.run_bench(
        seconds=seconds, precisions=precision, devices=devices, limit=limit, out=out, progress=progress
    )
    print(dumps(record.as_dict(), indent=2, ensure_ascii=False) if json else text)
