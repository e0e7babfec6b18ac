"""The tests of Guo et al. 2022 against the number of BeiDou satellites: python benchmarks/guo_satellites.py [FOLDER].

The experiment guo2022 every five minutes, with other parts of BeiDou and other elevation masks. Writes rates.csv,
rates.png and rates.svg; FOLDER is results/guo2022-satellites unless given.
"""

from __future__ import annotations

import sys
from pathlib import Path

import jax
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pl_mc.detectors import Chi2, MeanCheck
from pl_mc.experiments.loading import load_experiment
from pl_mc.geometry import Geometry
from pl_mc.report.figures import in_common_look, legend_below, new_figure, save_figure
from pl_mc.report.look import series_style
from pl_mc.statistics.reliability import least_detectable
from pl_mc.studies.guo.paper import PRINTED
from pl_mc.studies.guo.series import GuoSeries, day_of_detections

GEO = ("C01", "C02", "C03", "C04", "C05", "C59", "C60", "C61")
BOTH, TWO, THREE = ("GPS", "BDS-2", "BDS-3"), ("GPS", "BDS-2"), ("GPS", "BDS-3")
# Constellations, satellites left out, mask [deg].
PARTS = {
    "BDS-2 and BDS-3 with GEO": (BOTH, (), 10.0),
    "BDS-2 and BDS-3 with GEO, mask 20 deg": (BOTH, (), 20.0),
    "without GEO (guo2022)": (BOTH, GEO, 10.0),
    "without GEO, mask 15 deg": (BOTH, GEO, 15.0),
    "without GEO, mask 20 deg": (BOTH, GEO, 20.0),
    "without GEO, mask 25 deg": (BOTH, GEO, 25.0),
    "BDS-3 with GEO": (THREE, (), 10.0),
    "BDS-3 without GEO": (THREE, GEO[5:], 10.0),
    "BDS-2 with GEO": (TWO, (), 10.0),
    "BDS-2 without GEO": (TWO, GEO[:5], 10.0),
}
TESTS = (Chi2(), MeanCheck(), MeanCheck(one_sided=True), MeanCheck(reading="shared_clock"))
COLUMNS = [
    "part", "gps", "bds", "test", "reading", "level", "bias_m", "draws", "detections", "detection_rate", "low", "high",
]  # fmt: skip
DRAWN = (("chi2", "apriori"), ("mean_check", "shift_kept"), ("mean_check", "shift_kept, one-sided"))
LETTER = {"chi2": "F", "mean_check": "T"}


def series_of(name: str) -> GuoSeries:
    """Every five minutes of the day of guo2022 with one part of BeiDou."""
    constellations, without, mask = PARTS[name]
    experiment = load_experiment("guo2022")[1]
    changed = {
        "constellations": constellations,
        "without": without,
        "mask_deg": mask,
        "epochs": 288,
        "interval_s": 300.0,
    }
    source = experiment.source.model_copy(update=changed)
    loaded = source.series(draws=1, seed=experiment.seed, precision=experiment.precision)
    g, errors_m = loaded.geometry, loaded.errors_m[0]
    row = least_detectable(g, system="C")
    return GuoSeries(g, errors_m, row, (0.0, *experiment.biases_m), real=False)


def satellites_of(g: Geometry) -> dict[str, float]:
    """Median number of satellites in view, of each system."""
    system = np.array([one[0] for one in g.names])[g.satellite]
    return {letter: float(np.median(((system == letter) & g.in_view).sum(axis=1))) for letter in "GC"}


def rates(name: str) -> pd.DataFrame:
    """Detection rates at nominal and equal thresholds with one part of BeiDou."""
    series = series_of(name)
    day = day_of_detections(
        series, TESTS, draws=64, calibration_draws=499, p_fa=0.01, seed=1, precision="float64", progress=False
    )
    counts = satellites_of(series.geometry)
    return day.drawn.assign(part=name, gps=counts["G"], bds=counts["C"])


def main(out: Path) -> None:
    """Table and figure."""
    jax.config.update("jax_enable_x64", True)
    table = pd.concat([rates(name) for name in PARTS], ignore_index=True).sort_values(["bds", "part"], kind="stable")
    table = table[table.bias_m > 0][COLUMNS]
    out.mkdir(parents=True, exist_ok=True)
    table.to_csv(out / "rates.csv", index=False)
    for _, rows in table.groupby(table.level == "nominal"):
        wide = rows.pivot_table(index=["bds", "part"], columns=["test", "reading", "bias_m"], values="detection_rate")
        print(wide.round(4).to_string())
    save_figure(figure(table), out, "rates")


@in_common_look
def figure(table: pd.DataFrame) -> Figure:
    """Nominal detection rates against the number of BeiDou satellites; each point is a part of BeiDou of its own."""
    drawn, panels = new_figure(1, 3, width_in=11.0, height_in=3.8, sharey=True)
    nominal = table[table.level == "nominal"]
    for panel, bias in zip(panels, (10.0, 20.0, 30.0), strict=True):
        for k, (test, reading) in enumerate(DRAWN):
            rows = nominal[(nominal.test == test) & (nominal.reading == reading) & (nominal.bias_m == bias)]
            half = 100 * np.array([rows.detection_rate - rows.low, rows.high - rows.detection_rate])
            style = series_style(k)
            panel.errorbar(
                rows.bds, 100 * rows.detection_rate, half, fmt=style.marker, color=style.colour, markersize=5,
                label=f"{LETTER[test]} {reading}",
            )  # fmt: skip
        for test, line in (("chi2", ":"), ("mean_check", "-.")):
            panel.axhline(100 * PRINTED[test][bias], color="0.4", ls=line, label=f"the paper's {LETTER[test]}")
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
        panel.set(title=f"{bias:g} m", xlabel="median number of BeiDou satellites")
    panels[0].set_ylabel("detected at the nominal\nthreshold [%]")
    legend_below(drawn, panels, columns=5)
    return drawn


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "results/guo2022-satellites"))
