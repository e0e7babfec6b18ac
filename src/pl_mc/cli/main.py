"""The command line, ``pl-mc``.

Exit codes: 0 done, 2 input that cannot be used (one sentence on standard error), 130 interrupted. Nothing is left
half-written by the last two.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import cyclopts
from cyclopts import App, Parameter

import pl_mc
from pl_mc.input_errors import InputError

app = App(
    name="pl-mc",
    version=pl_mc.__version__,
    help="How often does a protection level alarm, how often does it miss, under which fault?",
    help_format="markdown",
    # Ctrl-C is this program's to answer, with a sentence and an exit code.
    suppress_keyboard_interrupt=False,
)


@app.command
def run(
    experiment: str = "ramp",
    /,
    *,
    out: Path | None = None,
    draws: int | None = None,
    seed: int | None = None,
    resume: Annotated[bool, Parameter(negative="")] = False,
    fresh: Annotated[bool, Parameter(negative="")] = False,
    shard: str | None = None,
    workers: int | None = None,
    devices: int | None = None,
    scheduler: str | None = None,
    progress: bool | None = None,
) -> None:
    """Run an experiment and write its tables, figures, summary and manifest.

    Finished parts of a sweep are kept beside the results until these are written, so that a run that was stopped,
    in whatever way, can go on.

    Parameters
    ----------
    experiment
        A name that `pl-mc list` shows, the path of a TOML file, or the `manifest.json` of an earlier run.
    out
        Results folder; `runs/EXPERIMENT` unless given. An earlier result there is replaced.
    draws
        Noise draws for each fault and epoch, instead of the experiment's.
    seed
        Seed of the noise, instead of the experiment's.
    resume
        Go on with an unfinished run of the same experiment.
    fresh
        Forget an unfinished run in the same place.
    shard
        `2/8` counts the second of eight shares alone, for job arrays; `pl-mc merge` makes the results.
    workers
        Threads that compute, or threads of each worker of a scheduler; as many as cores unless given.
    devices
        Devices of this machine that share the work, such as GPUs.
    scheduler
        A Dask scheduler that gives the parts to its workers, `tcp://host:8786`, or `local` or `local:4` for
        processes on this machine; needs the extra `pl_mc[dask]`.
    progress
        Show a progress bar; unless given, only on a terminal.
    """
    from pl_mc.engine import Execution
    from pl_mc.experiments.loading import load_experiment
    from pl_mc.experiments.running import run_shard

    overrides = {key: value for key, value in (("draws", draws), ("seed", seed)) if value is not None}
    name, record = load_experiment(experiment, overrides)
    share = None if shard is None else _share(shard)
    execution = Execution(workers=workers, devices=devices, scheduler=scheduler, resume=resume, shard=share)
    if share is None:
        _run(name, record, out, progress, execution, fresh)
    else:
        _print(run_shard(name, record, out, execution, progress=progress))


@app.command
def merge(folders: Annotated[tuple[Path, ...], Parameter(negative="")], /, *, out: Path) -> None:
    """Make the results of a run from the parts that its shares (`pl-mc run --shard`) stored.

    Parameters
    ----------
    folders
        The folders given to the shares as `--out`; one, if they shared it.
    out
        Results folder.
    """
    from pl_mc.experiments.merging import merge as merge_shares

    _print(merge_shares(folders, out))


@app.command
def bench(
    *,
    seconds: float = 10.0,
    precision: Annotated[tuple[str, ...], Parameter(negative="")] = ("float64", "float32"),
    devices: int | None = None,
    limit: Path | None = None,
    scaling: str | None = None,
    out: Path | None = None,
    json: Annotated[bool, Parameter(negative="")] = False,
    progress: bool | None = None,
) -> None:
    """Measure this machine: sweeps beside batched NumPy and others, and how exact they are.

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


@app.command(name="list")
def list_experiments() -> None:
    """List the experiments that come with the package."""
    from pl_mc.experiments.loading import experiment_files, load_experiment

    names = list(experiment_files())
    width = max(map(len, names), default=0)
    for name in names:
        print(f"{name.ljust(width)}  {load_experiment(name)[1].title}")


@app.command
def observe(
    observations: Path,
    navigation: Path,
    /,
    *,
    truth: str,
    systems: str = "G,C",
    fault: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    mask_deg: float = 10.0,
    error_model: str = "residual",
    method: Annotated[tuple[str, ...], Parameter(negative="")] = ("ls", "igg3"),
    out: Path | None = None,
    progress: bool | None = None,
) -> None:
    """Solve every epoch of a receiver's files with every method: errors, protection levels, alarms.

    Parameters
    ----------
    observations
        RINEX 3 observation file, plain, gzipped or Hatanaka-compressed.
    navigation
        RINEX 3 navigation file with broadcast ephemerides of that day.
    truth
        The true position: `X,Y,Z` Earth-fixed [m], or a CSV file with a track.
    systems
        Systems to use, RINEX letters: `G,C`, `G` or `C`.
    fault
        A fault to inject, `G02:+30m:545-645`: satellite, bias, first and last epoch counted from 0; repeatable.
    mask_deg
        Elevation mask [deg].
    error_model
        Standard deviations: residual, none or uire; `user` needs an experiment file.
    method
        A method; repeatable.
    out
        Results folder; `runs/observe-NAME` unless given. An earlier result there is replaced.
    progress
        Show a progress bar; unless given, only on a terminal.
    """
    from pl_mc.experiments.loading import build_experiment

    station = observations.name.split(".")[0]
    content: dict[str, Any] = {
        "kind": "observe",
        "title": f"{station}: position errors and protection levels",
        "observations": observations,
        "navigation": navigation,
        "truth": truth,
        "systems": tuple(letter.strip() for letter in systems.split(",")),
        "mask_deg": mask_deg,
        "error_model": error_model,
        "faults": fault,
        "methods": [{"name": name} for name in method],
    }
    _run(f"observe-{station}", build_experiment(content, source="observe"), out, progress)


def _run(
    name: str, record: Any, out: Path | None, progress: bool | None, execution: Any = None, fresh: bool = False
) -> None:
    from pl_mc.experiments.running import run_experiment

    _print(run_experiment(name, record, out, progress=progress, execution=execution, fresh=fresh))


def _print(result: Any) -> None:
    print(result.summary)
    print(f"Results: {result.folder}")


def _share(text: str) -> tuple[int, int]:
    index, slash, count = text.partition("/")
    if not (slash and index.strip().isdigit() and count.strip().isdigit()):
        raise InputError(f"shard: i/n is needed, such as 2/8, not {text!r}.")
    return int(index), int(count)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: bad input becomes one sentence and exit code 2."""
    try:
        app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except (InputError, cyclopts.CycloptsError) as error:
        print(
            f"pl-mc: {' '.join(str(error).split()) if isinstance(error, cyclopts.CycloptsError) else error}",
            file=sys.stderr,
        )
        sys.exit(2)
    except KeyboardInterrupt as stop:
        print(f"pl-mc: {str(stop) or 'interrupted; nothing was written.'}", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
