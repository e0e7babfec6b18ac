"""The command line, ``pl-mc``: one file beside this one for each sort of command.

Exit codes: 0 done, 1 where a check finds something, 2 input that cannot be used (a sentence for each error on
standard error), 130 interrupted by Ctrl-C, 143 by SIGTERM, 129 by SIGHUP, 141 by the end of a pipe. Nothing is left
half-written by any of them.
"""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from collections.abc import Sequence

import cyclopts
from cyclopts import App

import pl_mc
from pl_mc.cli import conforming, drafting, reading, running
from pl_mc.input_errors import InputError
from pl_mc.runtime.closed_pipes import quiet_end
from pl_mc.runtime.stopping import stoppable
from pl_mc.runtime.typed_command import typed

app = App(
    name="pl-mc",
    version=pl_mc.__version__,
    help="""How often does a protection level alarm, how often does it miss, under which fault?

Begin with `pl-mc list`, `pl-mc run ramp`, and open `runs/ramp/report.html`. For an experiment of your own:
`pl-mc init --out my.toml`, `pl-mc check my.toml`, `pl-mc run my.toml`. `pl-mc COMMAND --help` shows examples.
""",
    help_epilogue="""Exit codes: 0 done; 1 where a check (`verify`, `conform`) finds something; 2 input that cannot be
used, with a sentence for each error on standard error; 130 interrupted (143 by SIGTERM, 129 by SIGHUP); 141 where
nobody reads the output. Nothing is left half-written.

Results go to standard output, progress and errors to standard error. Colours appear on terminals alone,
and not where NO_COLOR is set. Compiled programs are kept in the user's cache folder for the next run, unless
PL_MC_CACHE is `off`. Completion of commands and options: `pl-mc --install-completion`.
""",
    help_format="markdown",
    # Ctrl-C is this program's to answer, with a sentence and an exit code.
    suppress_keyboard_interrupt=False,
)

app.command(running.run)
app.command(drafting.list_experiments, name="list")
app.command(drafting.init)
app.command(drafting.check)
app.command(drafting.explain)
app.command(reading.report)
app.command(reading.compare)
app.command(reading.verify)
app.command(running.observe)
app.command(running.merge)
app.command(running.bench)
app.command(conforming.conform)
app.register_install_completion_command()


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: bad input becomes one sentence and exit code 2; without arguments those of the process are taken."""
    if arguments is None:
        # Loading libraries makes many objects and no garbage, which is looked for every 700 objects unless told.
        gc.set_threshold(10_000)
    given = sys.argv[1:] if arguments is None else arguments
    with quiet_end(), typed(given), stoppable() as stops:
        try:
            if any("\0" in argument for argument in (arguments or ())):
                raise InputError("an argument holds the character NUL, which no name of a file can.")
            code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        except (InputError, cyclopts.CycloptsError) as error:
            text = " ".join(str(error).split()) if isinstance(error, cyclopts.CycloptsError) else str(error)
            print(f"pl-mc: {text}", file=sys.stderr)
            sys.exit(2)
        except (KeyboardInterrupt, Exception) as stop:
            # A library may make something else of an interrupt in the middle of it.
            if not (stops.number or isinstance(stop, KeyboardInterrupt)):
                raise
            said = str(stop) or "interrupted; nothing was written."
            if not isinstance(stop, KeyboardInterrupt):
                said = "interrupted; finished parts, where there are any, are kept, --resume goes on."
            by = f" by {stops.name}" if stops.exit_code != 130 else ""
            print(f"pl-mc: {said.replace('interrupted', f'interrupted{by}', 1)}", file=sys.stderr)
            if arguments is None:
                # Threads of the compiler that still run do not survive the end of Python in good order.
                for stream in (sys.stdout, sys.stderr):
                    with contextlib.suppress(OSError, ValueError):
                        stream.flush()
                os._exit(stops.exit_code)
            sys.exit(stops.exit_code)
    # A check says by its code what it found.
    if isinstance(code, int) and code:
        sys.exit(code)


if __name__ == "__main__":
    main()
