"""Signals in one table: a row is all that another signal needs, and its carrier and group delays count."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pl_mc.receiver import read_receiver_series, read_truth, signals
from pl_mc.receiver.signals import SIGNALS, Signal

ESBC = "ESBC00DNK_R_20201770000_01D_30S_GC.rnx.gz", "ESBC00DNK_R_20201770000_01D_GC_nav.rnx.gz"
TRUTH = "3582104.8991, 532590.1966, 5232755.2961"
EPOCHS = 30
F1, F2, B1, B2, B3 = 1575.42e6, 1227.60e6, 1561.098e6, 1207.14e6, 1268.52e6

# IS-GPS-200, 20.3.3.3.3.2: a user of L2 alone takes gamma TGD from the clock, gamma the ratio of squared carriers.
L2 = Signal("G", "mine", ("C2W",), F2, {"LNAV": {"TGD": (F1 / F2) ** 2}}, {"LNAV": -1})
# BDS-SIS-ICD-2.1, 5.2.4.10: the clock is that of B3I; B2I has a group delay of its own.
B2I = Signal("C", "mine", ("C7I",), B2, {"D1/D2": {"TGD2": 1.0}}, {"D1/D2": -1})
B3I = Signal("C", "mine", ("C6I",), B3, {"D1/D2": {}}, {"D1/D2": -1})

FIRST_DELAY = {"LNAV": "TGD", "D1/D2": "TGD1"}


@pytest.fixture(scope="module")
def hour(data_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first epochs of a day."""
    text = gzip.decompress((data_folder / ESBC[0]).read_bytes()).decode()
    lines = text.splitlines(keepends=True)
    begins = [k for k, line in enumerate(lines) if line.startswith(">")]
    path = tmp_path_factory.mktemp("signals") / "hour.rnx"
    path.write_text("".join(lines[: begins[EPOCHS]]))
    return path


def errors_m(hour: Path, data_folder: Path, system: str) -> dict[tuple[int, str], float]:
    """Pseudorange errors by epoch and satellite [m]."""
    series = read_receiver_series(hour, data_folder / ESBC[1], read_truth(TRUTH), systems=(system,))
    g = series.geometry
    return {
        (int(epoch), g.names[g.satellite[epoch, row]]): float(series.errors_m[epoch, row])
        for epoch, row in zip(*np.nonzero(g.in_view), strict=True)
    }


def differences(errors: dict[tuple[int, str], float], usual: dict[tuple[int, str], float]) -> np.ndarray:
    """Differences of errors, less the mean of each epoch, which the receiver's clock takes."""
    parts = []
    for epoch in range(EPOCHS):
        names = [name for at, name in usual if at == epoch and (epoch, name) in errors]
        assert len(names) >= 3
        values = np.array([errors[epoch, name] - usual[epoch, name] for name in names])
        parts.append(values - values.mean())
    return np.concatenate(parts)


@pytest.mark.parametrize("signal", [L2, B2I, B3I], ids=["L2", "B2I", "B3I"])
def test_a_row_is_all_that_a_signal_needs(
    hour: Path, data_folder: Path, monkeypatch: pytest.MonkeyPatch, signal: Signal
) -> None:
    usual = errors_m(hour, data_folder, signal.system)
    monkeypatch.setattr(signals, "SIGNALS", (signal, *SIGNALS))
    difference_m = differences(errors_m(hour, data_folder, signal.system), usual)
    # Another code with noise of its own, through an ionosphere that is not modelled to the decimetre.
    assert 0.05 < np.std(difference_m) < 4.0
    # With the group delays of the first signal, which are metres apart from satellite to satellite, it fits worse.
    wrong = {message: {name: 1.0} for message, name in FIRST_DELAY.items()}
    monkeypatch.setattr(signals, "SIGNALS", (replace(signal, group_delays=wrong), *SIGNALS))
    worse_m = differences(errors_m(hour, data_folder, signal.system), usual)
    assert np.std(worse_m) > 1.2 * np.std(difference_m)


def test_the_delay_of_the_ionosphere_is_inverse_to_the_square_of_the_carrier() -> None:
    l1, b1i = (signals.signals_of(letter)[0] for letter in "GC")
    assert [signal.ionosphere_factor() for signal in (l1, b1i, L2, B3I)] == pytest.approx(
        [1.0, (F1 / B1) ** 2, (F1 / F2) ** 2, (F1 / B3) ** 2], rel=1e-14
    )


def test_of_a_system_the_first_row_counts() -> None:
    first = [signals.observables_of(letter, dual=False)[0].name for letter in "GCEJ"]
    assert first == ["L1 C/A", "B1I", "E1", "L1 C/A"]
