"""``pl-mc run``, ``merge``, ``observe``, ``bench``: the commands that compute."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from pl_mc.cli.printing import (
    Axes,
    AxisWord,
    Count,
    Draws,
    ErrorModelWord,
    Figures,
    Flag,
    IonosphereWord,
    Json,
    Limit,
    Methods,
    Output,
    Precisions,
    Progress,
    Seed,
    Several,
    Texts,
    Which,
    overrides,
)
from pl_mc.input_errors import InputError, shown
from pl_mc.runtime.kept_programs import keep_programs

_DEFAULT = Output()
_AS_IN_THE_FILE = Figures()


def run(
    experiment: Which = "ramp",
    /,
    *,
    out: Path | None = None,
    draws: Draws = None,
    seed: Seed = None,
    val: Limit = None,
    hal: Limit = None,
    axes: Axes = (),
    fault: Texts = (),
    resume: Flag = False,
    fresh: Flag = False,
    shard: str | None = None,
    workers: Count = None,
    devices: Count = None,
    scheduler: str | None = None,
    bundle: Path | None = None,
    figures: Figures = _AS_IN_THE_FILE,
    output: Output = _DEFAULT,
) -> None:
    """Run an experiment and write its tables, figures, summary, page and manifest.

    Finished parts of a sweep are kept beside the results until these are written, so that a run that was stopped,
    in whatever way, can go on.

    Examples:

    `pl-mc run` runs the packaged experiment `ramp` into `runs/ramp`.

    `pl-mc run my.toml --out results/mine --draws 10000` runs one's own file with fewer draws.

    `pl-mc run results/mine/manifest.json --out again` redoes an earlier run.

    `pl-mc run my.toml --fault G01:+30m --fault G01+G13:+30m` puts two faults in place of the file's.

    `pl-mc run zhao2021-sweep --resume` goes on with a run that was stopped.

    `pl-mc run ramp --format png,svg,pdf --style paper --width 88mm` draws figures for print.

    `pl-mc run ramp --json` ends with the folder, the files and the answer as JSON.

    Parameters
    ----------
    out
        Results folder; `runs/EXPERIMENT` unless given. An earlier result there is replaced.
    val
        Vertical alert limit [m]; it and --hal, one or both, take the place of the experiment's limits.
    hal
        Horizontal alert limit [m].
    axes
        Which limits decide, instead of the experiment's: vertical, horizontal or either; repeatable.
    fault
        A fault instead of the experiment's, `G01:+30m`; repeatable, for several. See docs/how-to/faults.md.
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
    bundle
        A `.zip` file to hand the results over in, as of `pl-mc report --bundle`.
    """
    from pl_mc.experiments.source_files import read_source

    # What cannot be read is refused before any library is loaded.
    read_source(experiment)
    keep_programs()
    from pl_mc.engine import Execution
    from pl_mc.experiments.loading import load_experiment
    from pl_mc.experiments.running import results_place, run_experiment, run_shard
    from pl_mc.studies.spec import kind_of

    name, record = load_experiment(
        experiment, overrides(draws, seed, val, hal, axes), faults=fault, figures=figures.fields
    )
    given = next((option for option, limit in (("--val", val), ("--hal", hal)) if limit is not None), None)
    if given and not record.judged_axes():
        raise InputError(f"{given}: an experiment of the kind {kind_of(record)} judges by no alert limit.")
    share = None if shard is None else _share(shard)
    if bundle is not None:
        if share is not None:
            raise InputError("--bundle: a share of a run has no results yet; pl-mc merge makes them.")
        from pl_mc.experiments.bundling import SUFFIX, write_bundle
        from pl_mc.experiments.reading import require_place

        require_place("--bundle", bundle, SUFFIX, results_place(name, out))
    execution = Execution(
        workers=workers, devices=devices, scheduler=scheduler, resume=resume, shard=share,
        progress=output.bar,
    )  # fmt: skip
    if share is None:
        result = run_experiment(name, record, out, execution=execution, fresh=fresh)
        if bundle is not None:
            write_bundle(result.folder, bundle)
    else:
        result = run_shard(name, record, out, execution)
    output.show(result, bundle)


def merge(folders: Annotated[tuple[Path, ...], Several], /, *, out: Path, output: Output = _DEFAULT) -> None:
    """Make the results of a run from the parts that its shares (`pl-mc run --shard`) stored.

    Example: `pl-mc merge day --out runs/day`, after `pl-mc run NAME --shard 1/8 --out day` to `8/8`.

    Parameters
    ----------
    folders
        The folders given to the shares as `--out`; one, if they shared it.
    out
        Results folder.
    """
    keep_programs()
    from pl_mc.experiments.running import merge as merge_shares

    output.show(merge_shares(folders, out, progress=output.bar))


def observe(
    observations: Path,
    navigation: Annotated[tuple[Path, ...], Several],
    /,
    *,
    truth: Annotated[str, Parameter(allow_leading_hyphen=True)],
    systems: str | None = None,
    signals: str | None = None,
    fault: Texts = (),
    mask_deg: Annotated[float, Parameter(name=("--mask-deg", "--mask"), allow_leading_hyphen=True)] = 10.0,
    snr_dbhz: Annotated[float | None, Parameter(name=("--snr-dbhz", "--snr"))] = None,
    error_model: Annotated[ErrorModelWord, Parameter(show_choices=False)] = "residual",
    ionosphere: Annotated[IonosphereWord, Parameter(show_choices=False)] = "broadcast",
    ionex: Annotated[tuple[Path, ...], Several] = (),
    method: Methods = ("ls", "igg3"),
    val: Limit = None,
    hal: Limit = None,
    axes: Annotated[AxisWord | None, Parameter(show_choices=False)] = None,
    claims: Annotated[tuple[Path, ...], Several] = (),
    claim_multiplier: Limit = None,
    residuals: Flag = False,
    out: Path | None = None,
    figures: Figures = _AS_IN_THE_FILE,
    output: Output = _DEFAULT,
) -> None:
    """Solve every epoch of a receiver's files with every method: errors, protection levels, alarms.

    Example: `pl-mc observe OBS.rnx.gz NAV.rnx.gz --truth 3582104.9,532590.2,5232755.3 --fault G15:+30m:400-499`

    Parameters
    ----------
    observations
        RINEX 2 (GPS alone), 3 or 4 observation file, plain, Hatanaka-compressed, .gz, .zip, .Z or .bz2.
    navigation
        RINEX 2, 3 or 4 navigation files with broadcast ephemerides of that day, one or several; observation files
        among them are those of further days.
    truth
        The true position: `X,Y,Z` Earth-fixed [m], or a file with a track: CSV, a `.pos` of RTKLIB, an NMEA or UBX log.
    systems
        Systems to use, RINEX letters: G (GPS), E (Galileo), C (BeiDou), R (GLONASS), J (QZSS), such as `G,E`;
        those of the first three that the files have unless given.
    signals
        Other signals than L1 C/A, E1 and B1I, such as `L5,E5a`; with `--ionosphere dual` other pairs than the first
        that the files have, such as `E1+E5b,B1I+B2I`.
    fault
        A fault to inject, `G02:+30m:545-645`: satellite, bias, first and last epoch counted from 0; repeatable, all
        together. See docs/how-to/faults.md.
    mask_deg
        Elevation mask [deg].
    snr_dbhz
        Least strength of a signal that is read [dB-Hz].
    error_model
        Standard deviations: residual, none or uire; `user` needs an experiment file.
    ionosphere
        `broadcast`: corrected with the coefficients of the navigation files; `none`: its delay is left in;
        `dual`: pseudoranges of two carriers are combined so that it cancels, with their noise.
    ionex
        An IONEX file with maps of the ionosphere, in place of these coefficients; repeatable, for several days.
    method
        A method, `ls`, or one with options of its own, `igg3(k0=2, k1=6)`; repeatable.
    val
        Vertical alert limit [m]; it and --hal, one or both, take the place of those of LPV-200.
    hal
        Horizontal alert limit [m].
    axes
        Which limit decides: vertical, horizontal or either; the vertical one, where it is given, unless told.
    claims
        A file in which the receiver or a program says how good its positions are, judged beside the methods: a `.pos`
        of RTKLIB, an NMEA log with GST, a UBX log, a CSV file; repeatable. See docs/how-to/receiver.md.
    claim_multiplier
        What makes a claimed standard deviation a protection level; 6.18 horizontally and 5.33 vertically unless given.
    residuals
        Store the errors of all satellites, for `pl_mc.fit_overbound` and the noise model `empirical`.
    out
        Results folder; `runs/observe-NAME` unless given. An earlier result there is replaced.
    """
    keep_programs()
    from pl_mc.engine import Execution
    from pl_mc.experiments.loading import build_experiment
    from pl_mc.experiments.running import run_experiment
    from pl_mc.receiver.rinex_text import is_observation_file

    further = [path for path in navigation if is_observation_file(path)]
    # Without any of navigation, what is wrong is said of the first.
    further = further if len(further) < len(navigation) else []
    days, sent = (observations, *further), tuple(path for path in navigation if path not in further)
    station = observations.name.split(".")[0]
    content: dict[str, Any] = {
        "kind": "observe",
        "title": f"{station}: position errors and protection levels",
        "observations": days[0] if len(days) == 1 else days,
        "navigation": sent[0] if len(sent) == 1 else sent,
        "truth": truth,
        "systems": _words(systems),
        "signals": _words(signals),
        "mask_deg": mask_deg,
        "snr_dbhz": snr_dbhz,
        "error_model": error_model,
        "ionosphere": ionosphere,
        "ionex": ionex,
        "faults": fault,
        "methods": [_method(text) for text in method],
        "claims": claims,
        "claim_multiplier": claim_multiplier,
        "residuals": residuals,
        "figures": figures.fields,
        **overrides(None, None, val, hal, () if axes is None else (axes,)),
    }
    record = build_experiment(content, source="observe")
    output.show(run_experiment(f"observe-{station}", record, out, execution=Execution(progress=output.bar)))


def bench(
    *,
    seconds: float = 10.0,
    precision: Precisions = ("float64", "float32"),
    devices: int | None = None,
    limit: Path | None = None,
    scaling: str | None = None,
    parts: Path | None = None,
    out: Path | None = None,
    json: Json = False,
    progress: Progress = None,
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
    parts
        With `--scaling`: folder for finished parts; a point that was stopped goes on with those that it holds.
    out
        Folder for bench.json, bench.csv and bench.md, or for the curve.
    json
        Print JSON instead of tables.
    """
    from json import dumps

    from pl_mc.benchmark.run import run_bench
    from pl_mc.benchmark.scaling import run_scaling, scenario_counts

    if scaling is not None:
        table, text = run_scaling(
            scenario_counts(scaling), precision=precision[0], parts=parts, out=out, progress=progress
        )
        print(table.to_json(orient="records", indent=2) if json else text)
        return
    if parts is not None:
        raise InputError("parts: only the points of --scaling have parts.")
    record, text = run_bench(
        seconds=seconds, precisions=precision, devices=devices, limit=limit, out=out, progress=progress
    )
    print(dumps(record.as_dict(), indent=2, ensure_ascii=False) if json else text)


def _method(text: str) -> dict[str, Any]:
    """A method by name, with its options as in a file: ``igg3(k0=2, k1=6)``."""
    import tomllib

    name, bracket, rest = text.strip().partition("(")
    if not bracket:
        return {"name": name}
    try:
        if not rest.endswith(")"):
            raise ValueError
        options = tomllib.loads(f"options = {{{rest[:-1]}}}")["options"]
    except ValueError:
        raise InputError(
            f"method: {shown(text)} cannot be read; a name or the form igg3(k0=2, k1=6) is needed."
        ) from None
    if "name" in options:
        raise InputError(f"method: {shown(text)} has its name before the bracket, and no option of that name.")
    return {"name": name.strip(), **options}


def _words(text: str | None) -> tuple[str, ...] | None:
    return None if text is None else tuple(word.strip() for word in text.split(","))


def _share(text: str) -> tuple[int, int]:
    index, slash, count = text.partition("/")
    # Other alphabets have digits of their own, and a number of 5,000 digits is none.
    if not (slash and text.isascii() and len(text) < 40 and index.strip().isdigit() and count.strip().isdigit()):
        raise InputError(f"shard: i/n is needed, such as 2/8, not {shown(text)}.")
    return int(index), int(count)
