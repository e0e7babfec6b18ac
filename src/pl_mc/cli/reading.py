"""``pl-mc report``, ``compare``, ``verify``: commands that read results."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from pl_mc.cli.printing import Figures, Flag, Json, Progress, Quiet, print_json, result_content
from pl_mc.input_errors import InputError

_AS_THEY_ARE = Figures()


def report(
    folder: Path, /, *, tex: Path | None = None, bundle: Path | None = None, figures: Figures = _AS_THEY_ARE,
    json: Json = False, quiet: Quiet = False,
) -> None:  # fmt: skip
    """Make the page of a run, `report.html`, again from what its results folder holds; with `--format`, `--style` or
    `--width` its figures too, from the tables.

    Examples:

    `pl-mc report runs/ramp` makes the page again.

    `pl-mc report runs/ramp --format pdf --style paper --width 88mm` adds figures for print.

    `pl-mc report runs/ramp --bundle ramp.zip` packs all of it.

    Parameters
    ----------
    folder
        A results folder.
    tex
        A `.tex` file for the tables of the summary in LaTeX (booktabs), beside the page.
    bundle
        A `.zip` file to hand over: the results, the experiment, what was assumed, the packages, and how to verify
        and redo them.
    json
        Print folder, files, answer and notes as JSON.
    quiet
        Print the path of the page alone.
    """
    from pl_mc.experiments.bundling import SUFFIX, require_whole_run, write_bundle
    from pl_mc.experiments.reading import remake_page, require_place, tex_of, write_tex
    from pl_mc.experiments.redrawing import figure_fields, redraw

    fields = figure_fields(figures.fields)
    tables = None if tex is None else tex_of(folder, tex)
    if bundle is not None:
        require_place("--bundle", bundle, SUFFIX, folder)
        require_whole_run(folder, but_figures=bool(figures.fields))
    undrawn = redraw(folder, fields) if figures.fields else ()
    result = remake_page(folder)
    result = replace(result, notes=(*result.notes, *undrawn))
    if tex is not None and tables is not None:
        write_tex(tex, tables)
    if bundle is not None:
        write_bundle(folder, bundle)
    if json:
        print_json(result_content(result, bundle=bundle))
    elif quiet:
        print(folder / result.page)
    else:
        for sentence in result.answer:
            print(sentence)
        for note in result.notes:
            print(f"- {note}")
        made = [("Report", folder / result.page), ("tables", tex), ("bundle", bundle)]
        print(", ".join(f"{what}: {path}" for what, path in made if path is not None))


def compare(first: Path, second: Path, /, *, out: Path | None = None, json: Json = False, quiet: Quiet = False) -> None:
    """Lay two runs side by side: what was asked differently, and the difference of every rate with its interval.

    Example: `pl-mc compare runs/ramp runs/mine --out comparison`

    Parameters
    ----------
    first
        A results folder.
    second
        Another one; differences are second minus first.
    out
        Folder for compare.html and compare.csv; `runs/compare-FIRST-SECOND` unless given. An earlier comparison
        there is replaced.
    json
        Print the comparison as JSON.
    quiet
        Print the folder alone.
    """
    from pl_mc.experiments.reading import write_comparison

    made = write_comparison(first, second, out)
    if json:
        print_json(made.content())
    elif quiet:
        print(made.folder)
    else:
        print(made.comparison.text)
        print(f"Comparison: {made.folder}")


def verify(
    results: Path, /, *, partial: Flag = False, redo: Flag = False, progress: Progress = None, json: Json = False,
    quiet: Quiet = False,
) -> int:  # fmt: skip
    """Hold a results folder, or a bundle of one, against its manifest: files, inputs, and with `--redo` the numbers.
    Exit code 1 where one differs.

    Examples: `pl-mc verify results/ramp --partial --redo`; `pl-mc verify ramp.zip`

    Parameters
    ----------
    results
        A results folder, or the `.zip` file that `pl-mc report --bundle` made of one.
    partial
        Files that are not there were left out on purpose.
    redo
        Run the experiment again, elsewhere, and say what comes out different and why it may.
    json
        Print what was found as JSON.
    quiet
        Print the last line alone.
    """
    from pl_mc.experiments.bundling import verify_bundle
    from pl_mc.experiments.verifying import verify as verified

    if progress is not None and not redo:
        raise InputError("--progress: it does nothing without --redo; leave it out.")
    act = verify_bundle if os.path.isfile(results) else verified
    found = act(results, partial=partial, redo=redo, progress=progress)
    if json:
        print_json(found.content())
    else:
        for sentence in found.sentences()[-1 if quiet else 0 :]:
            print(sentence)
    return 0 if found.passed else 1
