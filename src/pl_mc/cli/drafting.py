"""``pl-mc list``, ``init``, ``check``, ``explain``: what there is to run, a file to begin with, whether it is sound."""

from __future__ import annotations

import sys
from pathlib import Path

from pl_mc.cli.printing import Draws, Flag, Json, Named, Quiet, Seed, Texts, Which, overrides, print_json
from pl_mc.input_errors import InputError, system_reason
from pl_mc.runtime.kept_programs import keep_programs


def list_experiments(*, json: Json = False, quiet: Quiet = False) -> None:
    """List the experiments that come with the package, and what they need that does not.

    Examples: `pl-mc list`; `pl-mc list --json`

    Parameters
    ----------
    json
        Print names, kinds, titles and needs as JSON.
    quiet
        Print the names alone.
    """
    from pl_mc.experiments.source_files import experiment_files, needs_of, read_source
    from pl_mc.studies.registry import in_todays_words

    # As they are written: those of the package are sound.
    contents = {name: in_todays_words(read_source(name).content) for name in experiment_files()}
    needs = {name: needs_of(one) for name, one in contents.items()}
    if json:
        fields = ("kind", "title")
        print_json([{"name": name} | {key: one[key] for key in fields} | {"needs": needs[name]}
                    for name, one in contents.items()])  # fmt: skip
        return
    if quiet:
        print("\n".join(contents))
        return
    told = {name: _needed(**one) for name, one in needs.items()}
    rows = [("name", "needs", "title"), *((name, told[name], one["title"]) for name, one in contents.items())]
    widths = [max(len(row[k]) for row in rows) for k in range(2)]
    for name, needed, title in rows:
        print(f"{name.ljust(widths[0])}  {needed.ljust(widths[1])}  {title}")
    print("\nFiles are looked for in the folder that PL_MC_DATA names; pip install 'pl_mc[maps]' adds an extra.")


def _needed(files: list[str], extras: list[str]) -> str:
    """``2 files``, ``extra maps``; a dash for nothing."""
    counted = [f"{len(files)} file{'s' * (len(files) > 1)}"] if files else []
    return ", ".join([*counted, *(f"extra {extra}" for extra in extras)]) or "-"


def init(which: Named = "sweep", /, *, out: Path | None = None) -> None:
    """Write an experiment file to begin with: every field with its meaning, unit, rule and default.

    Examples:

    `pl-mc init --out my.toml` begins with a ramp of biases on one satellite.

    `pl-mc init stanford --out my.toml` begins with the packaged experiment of that name.

    `pl-mc init sweep` prints one of the kind `sweep`.

    Parameters
    ----------
    which
        A name that `pl-mc list` shows, or a kind of experiment.
    out
        The file to write; standard output unless given. A file that is there is left alone.
    """
    from pl_mc.experiments.template import template_for

    text = template_for(which)
    if out is None:
        print(text, end="")
        return
    if out.suffix != ".toml":
        raise InputError(f"{out}: the name of an experiment file ends in .toml.")
    try:
        # Opened to be made anew alone, so that nobody's file is lost.
        with out.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{out}: a file of that name is there; name another one.") from None
    except OSError as error:
        raise InputError(f"{out}: the file cannot be written ({system_reason(error)}).") from None
    print(f"Written: {out}; pl-mc check {out} says what it will cost.")


def check(
    experiment: Which,
    /,
    *,
    draws: Draws = None,
    seed: Seed = None,
    fault: Texts = (),
    measure: Flag = False,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Check an experiment without running it: every error at once, and what a run will cost.

    Each error is named with its field, its line in the file, and the nearest valid value. Costs are scenarios,
    time and memory; time is an estimate from stored rates unless `--measure` is given. The exit code is 0 where
    the experiment is sound and 2 where it is not.

    Examples: `pl-mc check my.toml`; `pl-mc check ramp --draws 1000000 --measure`

    Parameters
    ----------
    fault
        A fault instead of the experiment's, `G01:+30m`; repeatable, for several.
    measure
        Measure the rate of this machine by a small part of the run, which takes up to a minute.
    json
        Print problems and costs as JSON.
    quiet
        Print nothing where the experiment is sound.
    """
    from dataclasses import asdict

    from pl_mc.experiments.source_files import read_source

    # What cannot be read is refused before any library is loaded.
    read_source(experiment)
    if measure:
        keep_programs()
    from pl_mc.experiments.checking import check_experiment

    found = check_experiment(experiment, overrides(draws, seed), faults=fault, measure=measure)
    if json:
        problems, cost = [asdict(one) for one in found.problems], found.cost and asdict(found.cost)
        print_json({"name": found.name, "sound": not problems, "problems": problems, "cost": cost})
    elif found.problems:
        print(found.text(), file=sys.stderr)
    elif not quiet and found.cost is not None and found.experiment is not None:
        print(f"{found.file}: sound. {found.experiment.title}")
        print(f"Cost: {found.cost.text()}")
    return 2 if found.problems else 0


def explain(*word: str, json: Json = False) -> None:
    """Say what a word of tables, files and pages means: an event, its columns, a term, a field, a method, an option.

    Examples: `pl-mc explain misleading`; `pl-mc explain HMI`; `pl-mc explain k0`

    Parameters
    ----------
    word
        The word, in whatever case.
    json
        Print the sentences as JSON.
    """
    from pl_mc.experiments.explaining import explain as explained

    said = explained(" ".join(word))
    if json:
        print_json(said)
    else:
        print("\n".join(said))
