"""A run of seconds, for tests of what is done with finished runs."""

from __future__ import annotations

from typing import Any

from pl_mc.cli.main import main

# Three plain solutions are compiled in a part of the time that the settled default takes.
SMALL: dict[str, Any] = {
    "kind": "sweep", "title": "A small ramp", "draws": 300, "seed": 5, "geometry": {"epochs": 4, "epoch": 2},
    "faults": {"satellite": "G02", "otherwise": "median_redundancy", "start_m": 10, "stop_m": 40, "step_m": 15},
    "methods": ["ls", {"name": "igg3", "iterations": 3}],
}  # fmt: skip


def ended(*arguments: str) -> int:
    """The exit code of a command."""
    try:
        main(arguments)
    except SystemExit as end:
        return int(end.code or 0)
    return 0
