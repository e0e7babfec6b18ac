"""What one answer of each loop beside the sweep costs: python benchmarks/loops.py [--tree NAME=SRC ...] [--out FOLDER].

Fault detection, rare events, the service volume, ARAIM levels, worst cases and multipliers: the first call of a
process, which compiles, and further ones, in processor and wall seconds. With `--tree` the same calls run on other
source trees too, such as the `src` of a worktree of an earlier commit: a process for each tree, in turn, so that a busy
machine hits all alike. A tree that has no such call, or another one, is told so in its row, and so is whether its
numbers are those of the tree before, bit for bit. Prints a Markdown table; `--out` stores loops.md and loops.csv.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

SOURCE = Path(__file__).resolve().parents[1] / "src"
# The numbers of an answer that are compared, by name.
Answer = dict[str, Any]
COLUMNS = {
    "loop": "loop", "tree": "tree", "first_wall_s": "first call [s]", "first_cpu_s": "first call, processor [s]",
    "wall_s": "further calls [s]", "cpu_s": "further calls, processor [s]", "answer": "answer",
}  # fmt: skip


@dataclass(frozen=True)
class Loop:
    """A loop, what is asked of it, and what makes the call; a short one if told so."""

    name: str
    what: str
    make: Callable[[bool], Callable[[], Answer]]


def _geometry() -> Any:
    import pl_mc

    return pl_mc.simulate(site="CUT0", start="2017-11-21T00:00:00", constellations=("GPS", "GAL"), epochs=1)[0]


def _columns(table: Any, *names: str) -> Answer:
    return {name: table[name].to_numpy() for name in names}


def _detect(epochs: int, faults: int, draws: int, calibration: int) -> Callable[[bool], Callable[[], Answer]]:
    def make(short: bool) -> Callable[[], Answer]:
        import pl_mc

        # One of the tests compares GPS with BeiDou.
        series = pl_mc.simulate(
            site="CUT0", constellations=("GPS", "BDS-2"), epochs=min(epochs, 3) if short else epochs
        )
        g = series if epochs > 1 else series[0]
        ramp = pl_mc.ramp(g, satellite=g.names[0], start_m=5.0, stop_m=5.0 * faults, step_m=5.0)
        sizes = (200, 200) if short else (draws, calibration)
        options: dict[str, Any] = dict(zip(("draws", "calibration_draws"), sizes, strict=True))
        return lambda: _columns(
            pl_mc.detect(g, ramp, seed=7, progress=False, **options), "detections", "threshold", "p_fa_measured"
        )

    return make


def _risk(method: str, size_m: float) -> Callable[[bool], Callable[[], Answer]]:
    def make(short: bool) -> Callable[[], Answer]:
        import pl_mc

        g = _geometry()
        fault = pl_mc.biases(g, {g.names[0]: size_m})
        one = pl_mc.igg3(iterations=10) if method == "igg3" else method
        options = {"max_evaluations": 500_000, "target_cov": 0.5} if short else {"max_evaluations": 4_000_000}
        return lambda: _columns(
            pl_mc.risk(g, fault, event="misleading", method=one, seed=7, progress=False, **options),
            "probability", "standard_error", "evaluations",
        )  # fmt: skip

    return make


def _service(short: bool) -> Callable[[], Answer]:
    import pl_mc

    options = {"step_deg": 90.0, "step_s": 43_200.0, "draws": 4} if short else {"step_deg": 20.0, "step_s": 1800.0}
    methods = ("ls", pl_mc.igg3(iterations=10), "araim")

    def call() -> Answer:
        found = pl_mc.service_volume(methods=methods, progress=False, **options)
        return _columns(found.sites, "available") | _columns(found.levels, "vpl_50_m", "hpl_99_m")

    return call


def _skies(users: int, *, packed: bool) -> dict[str, Any]:
    """Geometries of 24 GPS and 24 Galileo satellites of circular orbits, seen by users anywhere, above 5 deg.

    Rows in view first, or each satellite in a row of its own.
    """
    rng = np.random.default_rng(24)
    rows = []
    for planes, inclination, radius_m in ((6, 55.0, 26.56e6), (3, 56.0, 29.6e6)):
        k = np.arange(24)
        node, phase = 2 * np.pi * (k % planes) / planes, 2 * np.pi * (k // planes * planes / 24 + k % planes / 24)
        rows.append((node, phase, np.full(24, np.radians(inclination)), np.full(24, radius_m)))
    node, phase, tilt, radius = np.concatenate(rows, axis=1)
    turn = rng.uniform(0.0, 2 * np.pi, (users, 1))
    along, across = np.cos(phase + turn), np.sin(phase + turn)
    satellite = radius[:, None] * np.stack(
        [
            np.cos(node) * along - np.sin(node) * np.cos(tilt) * across,
            np.sin(node) * along + np.cos(node) * np.cos(tilt) * across,
            np.sin(tilt) * across,
        ],
        axis=-1,
    )
    latitude, longitude = np.arcsin(rng.uniform(-1.0, 1.0, users)), rng.uniform(-np.pi, np.pi, users)
    up = np.stack([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)], -1)
    east = np.stack([-np.sin(longitude), np.cos(longitude), np.zeros(users)], -1)
    sight = satellite - 6.378e6 * up[:, None]
    sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
    local = np.einsum("gnc,gcq->gnq", sight, np.stack([east, np.cross(up, east), up], axis=-1))
    seen = local[..., 2] >= np.sin(np.radians(5.0))
    order = np.arange(48)[None].repeat(users, axis=0)
    if packed:
        order = np.argsort(~seen, axis=1, kind="stable")[:, : int(seen.sum(axis=1).max())]
    seen, local = np.take_along_axis(seen, order, 1), np.take_along_axis(local, order[..., None], 1)
    clocks = np.stack([order < 24, order >= 24], axis=-1)
    variance = 0.5 + 0.3 / np.maximum(local[..., 2], 0.05) ** 2
    return {
        "design": np.where(seen[..., None], np.concatenate([-local, clocks], axis=-1), 0.0), "c_int": variance,
        "in_view": seen, "systems": np.where(order < 24, "G", "E").tolist(),
    }  # fmt: skip


def _levels(found: Any) -> Answer:
    return {name: getattr(found, name) for name in ("vpl_m", "hpl_m", "p_not_monitored")}


def _araim(users: int, *, packed: bool) -> Callable[[bool], Callable[[], Answer]]:
    def make(short: bool) -> Callable[[], Answer]:
        import pl_mc

        given = _skies(20 if short else users, packed=packed)
        given |= {"c_acc": 0.8 * given["c_int"], "b_nom": 0.75, "p_sat": 1e-5, "p_const": {"G": 1e-8, "E": 1e-4}}
        return lambda: _levels(pl_mc.araim.protection_levels(**given))

    return make


def _araim_v42(budget: str, users: int) -> Callable[[bool], Callable[[], Answer]]:
    def make(short: bool) -> Callable[[], Answer]:
        from pl_mc import araim

        ism = araim.Ism(
            sigma_ura_m=0.5, sigma_ure_m=0.4, b_nom_m=0.75, r_sat_per_h=1e-5, mfd_sat_h=1.0,
            r_const_per_h={"G": 1e-8, "E": 1e-4}, mfd_const_h=1.0,
        )  # fmt: skip
        given = _skies(4 if short else users, packed=True)
        given |= {"ism": ism, "standard": "v4.2", "budget": budget, "exclusion": "satellites"}
        return lambda: _levels(araim.protection_levels(**given))

    return make


def _worst(method: str, satellites: int) -> Callable[[bool], Callable[[], Answer]]:
    def make(short: bool) -> Callable[[], Answer]:
        import pl_mc

        g = _geometry()
        one = pl_mc.igg3(iterations=10) if method == "igg3" else method
        options: dict[str, Any] = {"satellites": 1 if short else satellites}
        if method == "igg3":
            pairs = [(g.names[j], g.names[k]) for k in range(5) for j in range(k)]
            few: list[Any] = [g.names[0]] if satellites == 1 else pairs[:1] if short else pairs
            options = {
                "satellites": few,
                "refine": 1,
                "target_cov": 0.5 if short else 0.2,
                "max_evaluations": 1_000_000,
            }
        return lambda: _columns(
            pl_mc.worst_case(g, method=one, event="misleading", **options), "probability", "low", "high"
        )

    return make


def _calibrate(target: float, **options: Any) -> Callable[[bool], Callable[[], Answer]]:
    def make(short: bool) -> Callable[[], Answer]:
        import pl_mc

        g, one = _geometry(), pl_mc.igg3(iterations=10)
        given = {"target": 0.01, "draws": 2000} if short else {"target": target, **options}
        return lambda: _columns(pl_mc.calibrate(g, method=one, **given), "k_vertical", "k_low", "k_high")

    return make


LOOPS = (
    Loop("detect", "20 faults at one epoch, 10,000 draws, calibrated by 100,000", _detect(1, 20, 10_000, 100_000)),
    Loop("detect, series", "5 faults at 100 epochs, 1,000 draws, calibrated by 10,000", _detect(100, 5, 1000, 10_000)),
    Loop("risk, ls", "misleading, 10 m on one satellite", _risk("ls", 10.0)),
    Loop("risk, igg3", "misleading, 30 m on one satellite", _risk("igg3", 30.0)),
    Loop("service_volume", "162 users, 48 epochs, ls, igg3 (100 draws) and araim", _service),
    Loop("araim", "v3, 20,000 geometries of 24 + 24 satellites, those in view first", _araim(20_000, packed=True)),
    Loop("araim, fixed rows", "v3, 2,000 of them, a row for each of the 48", _araim(2000, packed=False)),
    Loop("araim v4.2, LPV", "2,000 with exclusion of satellites", _araim_v42("LPV-200 v4.2", 2000)),
    Loop("araim v4.2, RNP", "1,000 with exclusion of satellites", _araim_v42("RNP v4.2", 1000)),
    Loop("worst_case, ls", "misleading, all pairs, exact", _worst("ls", 2)),
    Loop("worst_case, igg3", "misleading, one satellite", _worst("igg3", 1)),
    Loop("worst_case, pairs", "misleading, ten pairs, igg3", _worst("igg3", 2)),
    Loop("calibrate", "igg3, 1e-7, rare events", _calibrate(1e-7)),
    Loop("calibrate, counted", "igg3, 1e-3, 200,000 draws", _calibrate(1e-3)),
)  # fmt: skip


def worker(name: str, short: bool, calls: int) -> dict[str, Any]:
    """What one process measures: the first call, further ones, and the sum of the bits of its answer."""
    loop = next(one for one in LOOPS if one.name == name)
    try:
        call = loop.make(short)
        times, answer = [], Answer()
        for _ in range(1 + calls):
            wall, cpu = time.perf_counter(), time.process_time()
            answer = call()
            times.append((time.perf_counter() - wall, time.process_time() - cpu))
    except (AttributeError, TypeError, ImportError) as error:
        return {"none": f"{type(error).__name__}: {error}".split("\n")[0][:80]}
    bits = zlib.crc32(b"".join(np.ascontiguousarray(value).tobytes() for _, value in sorted(answer.items())))
    return {"times": times, "bits": bits}


def measured(loop: Loop, trees: dict[str, Path], *, short: bool, calls: int, rounds: int) -> list[dict[str, Any]]:
    """A row for each tree; each round runs a process of every tree."""
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in trees}
    for _ in range(rounds):
        for name, source in trees.items():
            if found[name] and "none" in found[name][0]:
                continue
            # A cache of compiled programs would hide what the first call costs.
            own = {"PYTHONPATH": str(source), "JAX_ENABLE_COMPILATION_CACHE": "false"}
            command = [sys.executable, __file__, "--worker", loop.name, "--calls", str(calls)]
            with tempfile.TemporaryDirectory() as elsewhere:
                done = subprocess.run(
                    command + ["--short"] * short, env=os.environ | own, cwd=elsewhere, capture_output=True, text=True,
                    check=False,
                )  # fmt: skip
            if done.returncode:
                raise SystemExit(f"{loop.name} with the tree {name}: {done.stderr.strip()[-600:]}")
            found[name].append(json.loads(done.stdout.splitlines()[-1]))
    rows, before = [], None
    for name, each in found.items():
        row: dict[str, Any] = dict.fromkeys(COLUMNS, "") | {"loop": loop.name, "tree": name}
        if "none" in each[0]:
            rows.append(row | {"answer": f"no such call ({each[0]['none']})"})
            continue
        if len({one["bits"] for one in each}) > 1:
            raise SystemExit(f"{loop.name} with the tree {name}: not the same numbers in every process.")
        for place, column in enumerate(("wall_s", "cpu_s")):
            row[f"first_{column}"] = statistics.median(one["times"][0][place] for one in each)
            further = [pair[place] for one in each for pair in one["times"][1:]]
            row[column] = statistics.median(further)
        row["answer"] = "" if before is None else "the same bits" if before == each[0]["bits"] else "other numbers"
        before = each[0]["bits"]
        rows.append(row)
    return rows


def markdown(rows: list[dict[str, Any]]) -> str:
    """Rows as a table."""
    lines = [list(COLUMNS.values())] + [
        [f"{value:.3g}" if isinstance(value, float) else str(value) for value in row.values()] for row in rows
    ]
    text = ["| " + " | ".join(line) + " |" for line in lines]
    return "\n".join([text[0], "|---" * len(COLUMNS) + "|", *text[1:]])


def machine() -> str:
    """What it was measured on, in one line."""
    sys.path.insert(0, str(SOURCE))
    from pl_mc.benchmark.measure import describe_machine

    of = describe_machine()
    options = ", ".join(f"{name}={value}" for name, value in of["compiler_options"].items())
    names = ", ".join(f"{name} {version}" for name, version in of["versions"].items())
    return (
        f"{of['processor']} ({of['instruction_set']}), cores: {of['cores']}, {of['memory_gb']} GB, {of['system']}, "
        f"load average {(of['load_average'] or [float('nan')])[0]} at the end. {names}; {of['blas']}; backend "
        f"{of['backend']}, compiler options of this tree: {options or 'none'}."
    )


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tree", action="append", default=[], metavar="NAME=SRC", help="another source tree, first")
    parser.add_argument("--loop", action="append", choices=[one.name for one in LOOPS], help="these loops alone")
    parser.add_argument("--out", type=Path, help="folder for loops.md and loops.csv")
    parser.add_argument("--short", action="store_true", help="tiny calls, to see that they run")
    parser.add_argument("--calls", type=int, default=3, help="further calls of each process")
    parser.add_argument("--rounds", type=int, default=3, help="processes of each tree")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.worker:
        print(json.dumps(worker(asked.worker, asked.short, asked.calls)))
        return
    trees = {name: Path(source).resolve() for name, _, source in (one.partition("=") for one in asked.tree)}
    trees["this"] = SOURCE
    rows: list[dict[str, Any]] = []
    loops = [one for one in LOOPS if not asked.loop or one.name in asked.loop]
    for loop in loops:
        rows += measured(loop, trees, short=asked.short, calls=asked.calls, rounds=asked.rounds)
        print(markdown(rows[-len(trees) :]), flush=True)
    parts = (
            "# The other loops", machine(),
            f"Processes of each tree, in turn: {asked.rounds}; further calls of each: {asked.calls}; medians. An "
            "answer is compared with that of the tree above it.",
            markdown(rows), "\n".join(f"- {one.name}: {one.what}." for one in loops),
    )  # fmt: skip
    text = "\n\n".join(parts)
    if asked.out:
        asked.out.mkdir(parents=True, exist_ok=True)
        (asked.out / "loops.md").write_text(text + "\n", encoding="utf-8")
        with (asked.out / "loops.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, list(COLUMNS), lineterminator="\n")
            writer.writeheader()
            short = [{k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows]
            writer.writerows(short)


if __name__ == "__main__":
    main()
