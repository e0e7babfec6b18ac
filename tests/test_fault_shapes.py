"""Faults of every shape: their text, when and where they count, and the biases that they become."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pl_mc
from pl_mc import InputError
from pl_mc.engine.drawn_biases import numbers_of_draw
from pl_mc.faults import Bias, fault_text, parse_fault
from pl_mc.injection import inject, row_biases
from pl_mc.statistics import fault_effects, ls_quantities
from reference.problems import random_series

SIZES = st.floats(-1e9, 1e9).filter(lambda size: abs(size) > 1e-8)


@st.composite
def some_biases(draw: st.DrawFn) -> Bias:
    of = draw(st.lists(st.sampled_from(["G01", "G13", "C08", "E05", "G", "C"]), min_size=1, max_size=3, unique=True))
    law = draw(st.sampled_from(["fixed", "uniform", "normal"]))
    per_second = draw(st.booleans())
    first = draw(st.none() | st.integers(0, 10_000))
    numbers: tuple[float, ...] = (draw(SIZES),)
    if law == "uniform":
        numbers = tuple(sorted(draw(st.lists(SIZES, min_size=2, max_size=2, unique_by=lambda size: round(size, 8)))))
    if law == "normal":
        numbers = (draw(SIZES | st.just(0.0)), abs(draw(SIZES)))
    return Bias(
        of=tuple(of), law=law, numbers=numbers, either_sign=draw(st.booleans()), per_second=per_second,
        independent=(len(of) > 1 or len(of[0]) == 1) and draw(st.booleans()), first_epoch=first,
        last_epoch=None if first is None else draw(st.none() | st.integers(first, 20_000)),
    )  # fmt: skip


@given(st.lists(some_biases(), max_size=4).map(tuple))
def test_text_and_record_are_the_same(biases: tuple[Bias, ...]) -> None:
    text = fault_text(biases)
    assert parse_fault(text) == biases
    assert fault_text(parse_fault(text)) == text


@pytest.fixture(scope="module")
def day() -> pl_mc.Geometry:
    """Half a day of a site, every 15 minutes: satellites rise and set."""
    return pl_mc.simulate(site="CUT0", epochs=48, interval_s=900.0)


@pytest.mark.parametrize(
    ("text", "label"),
    [
        ("G01+G12:+30m", "G01:+30m,G12:+30m"), ("G01:+30m, C08:-20 m", "G01:+30m,C08:-20m"), ("G:20", "G:+20m"),
        ("G:+20m  independent", "G:+20m independent"), ("G:+20m common", "G:+20m"),
        ("G:uniform(5,100)m common:3-9", "G:uniform(5,100)m:3-9"), ("G:+-20m independent", "G:+20m independent"),
        ("G01:±30m", "G01:+-30m"), ("G01:0.1m/s", "G01:+0.1m/s"), ("G01:-1e-3m/s:3-", "G01:-0.001m/s:3-"),
        ("G01:+30m:0-3,G01:-30m:4-9", "G01:+30m:0-3,G01:-30m:4-9"), ("G01:uniform( 5, 100 )m", "G01:uniform(5,100)m"),
        ("G01:-uniform(5,100)", "G01:uniform(-100,-5)m"), ("G01:-normal(3,10)m", "G01:normal(-3,10)m"),
        ("G+C01:+-normal(3,10)m independent:5-7", "G+C01:+-normal(3,10)m independent:5-7"), ("none", "none"),
    ],
)  # fmt: skip
def test_labels_are_faults(day: pl_mc.Geometry, text: str, label: str) -> None:
    faults = pl_mc.biases(day, text)
    assert faults.labels == (label,)
    again = pl_mc.biases(day, label)
    assert (again.labels, again.shaped) == (faults.labels, faults.shaped)
    np.testing.assert_array_equal(again.bias_m, faults.bias_m)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("R:+20m", "'R' is not in view: none of GLONASS is there (valid: G, C)"),
        ("G99:+30m", "satellite: 'G99' is not in view (nearest: G"),
        ("g01:+30m", "nearest: G01"),
        ("G01:+0m", "bias of G01: a bias of size zero is no fault"),
        ("G01:+0m/s", "a bias of size zero is no fault"),
        ("G01:nanm", "a bias is a finite number of metres, not nanm"),
        ("G01:-inf", "a bias is a finite number of metres, not -inf"),
        ("G01:+1e10m", "up to 1e+09, not 10000000000."),
        ("G01:uniform(5,5)m", "uniform takes two sizes in order"),
        ("G01:uniform(5)m", "uniform takes two numbers"),
        ("G01:normal(0,0)m", "normal takes a mean and a positive standard deviation"),
        ("G01:gauss(0,1)m", "'gauss' is no distribution of a size (valid: uniform, normal)"),
        ("G01:fixed(5)m", "'fixed' is no distribution"),
        ("G01:+20m independent", "one satellite has none to be independent of"),
        ("G01:+30m:9-5", "the window 9-5 ends before it begins; did you mean 5-9?"),
        ("G01:+30m:40-48", "fault G01:+30m:40-48: epochs run from 0 to 47."),
        ("G01:+30m:48-", "epochs run from 0 to 47."),
        ("G01:+30m:x-5", "'x-5' is no window; first-last is needed"),
        ("C01:+0.1m/s:47-", "a ramp in time needs epochs at several times, and its window is a single epoch"),
        ("G:+3m,G12:+4m", "G12 is named twice"),
        ("G+G:+3m", "G is named twice"),
        ("G01:+3m:0-9,G01:+4m:9-12", "G01 is named twice"),
        ("each:none", "is no fault"),
        ("pairs G01:+30m", "no such satellites are in view"),
        ("each:+3m,G01:+3m", "one bias follows each"),
    ],
)
def test_what_is_no_fault(day: pl_mc.Geometry, text: str, words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        pl_mc.biases(day, text)
    assert "\n" not in str(caught.value)


def test_what_needs_epochs_or_times(day: pl_mc.Geometry) -> None:
    with pytest.raises(InputError, match=r"fault G01:\+0.1m/s: a ramp in time needs a series of epochs"):
        pl_mc.biases(day[0], "G01:+0.1m/s")
    with pytest.raises(InputError, match=r"fault G01:\+3m:4-9: the one epoch is 0\."):
        pl_mc.biases(day[0], "G01:+3m:4-9")
    timeless = random_series(np.random.default_rng(1), np.ones((3, 7), dtype=bool), "GGGGGCC")
    with pytest.raises(InputError, match="a ramp in time needs epochs at several times, and the geometry has no times"):
        pl_mc.biases(timeless, "G01:+0.1m/s")
    absent = next(name for k, name in enumerate(day.names) if not (day.satellite[:4] == k)[day.in_view[:4]].any())
    with pytest.raises(InputError, match=rf"{absent} is out of view at all epochs of the window \(in view: G01"):
        pl_mc.biases(day, f"{absent}:+30m:0-3")


def by_satellite(g: pl_mc.Geometry, text: str) -> np.ndarray:
    """(epochs, m), the biases of a fault by satellite; NaN where a satellite is out of view."""
    bias_m, drawn = row_biases(g, pl_mc.biases(g, text), np.arange(len(g)), np.zeros(len(g), dtype=int))
    assert drawn is None
    found = np.full((len(g), len(g.names)), np.nan)
    epochs, rows = np.nonzero(g.in_view)
    found[epochs, g.satellite[epochs, rows]] = bias_m[epochs, rows]
    return found


def test_biases_in_time(day: pl_mc.Geometry) -> None:
    one, other, third = day.names.index("G01"), day.names.index("C01"), day.names.index("C02")
    time_s = np.arange(48) * 900.0
    seen = ~np.isnan(by_satellite(day, "none"))
    system = np.array(day.systems)
    expected = {
        "G:+20m": np.where(system == "G", 20.0, 0.0) * np.ones((48, 1)),
        "C01:+3m:5-9,C02:-4m:9-": np.zeros((48, len(day.names))),
        "C01:-0.01m/s": np.zeros((48, len(day.names))),
        "C01+C02:+0.02m/s:10-19": np.zeros((48, len(day.names))),
    }
    expected["C01:+3m:5-9,C02:-4m:9-"][5:10, other], expected["C01:+3m:5-9,C02:-4m:9-"][9:, third] = 3.0, -4.0
    expected["C01:-0.01m/s"][:, other] = -0.01 * time_s
    for k in (other, third):
        expected["C01+C02:+0.02m/s:10-19"][10:20, k] = 0.02 * (time_s[10:20] - time_s[10])
    for text, biases in expected.items():
        np.testing.assert_allclose(by_satellite(day, text), np.where(seen, biases, np.nan), rtol=1e-12, err_msg=text)
    # A part of the series has the ramp of the whole.
    part, faults = day[12:15], pl_mc.biases(day, "C01:-0.01m/s")
    bias_m, _ = row_biases(part, faults, np.arange(3), np.zeros(3, dtype=int))
    assert bias_m.sum() == pytest.approx(-0.01 * time_s[12:15].sum())
    assert one != other


def test_faults_count_at_epochs_of_their_windows_with_their_satellites(day: pl_mc.Geometry) -> None:
    seen = ~np.isnan(by_satellite(day, "none"))
    setting = next(k for k in range(len(day.names)) if seen[0, k] and not seen[:, k].all())
    name = day.names[setting]
    texts = {
        "G:+20m": np.ones(48, dtype=bool), "G:+20m:3-5": np.isin(np.arange(48), (3, 4, 5)),
        f"{name}:+3m": seen[:, setting],
        f"{name}:uniform(1,2)m:0-40": seen[:, setting] & (np.arange(48) <= 40),
        f"G+{name}:+-3m" if name[0] == "C" else f"C+{name}:+-3m": seen[:, setting],
        f"{name}:+3m:0-4,C01:+3m:5-": np.where(np.arange(48) < 5, seen[:, setting], True),
    }  # fmt: skip
    faults = sum((pl_mc.biases(day, text) for text in texts), pl_mc.no_fault(day))
    np.testing.assert_array_equal(faults.applies(day)[:, 1:].T, list(texts.values()))
    table = pl_mc.sweep(day, faults, draws=3, seed=1, methods="ls", by_epoch=True, progress=False)
    for text, applies in texts.items():
        label = pl_mc.biases(day, text).labels[0]
        assert table.epoch[table.fault == label].tolist() == np.flatnonzero(applies).tolist()
    assert (
        f"{name}: out of view at {48 - seen[:, setting].sum()} of 48 epochs, which give no row." in table.attrs["notes"]
    )


def test_every_satellite_and_every_pair(day: pl_mc.Geometry) -> None:
    single = day[0]
    pairs = pl_mc.biases(single, "pairs:+30m")
    np.testing.assert_array_equal(pairs.bias_m, pl_mc.pairs(single, 30.0).bias_m)
    each = pl_mc.biases(single, "each G:-5m")
    assert each.labels == tuple(f"{name}:-5m" for name in single.names if name[0] == "G")
    ever = pl_mc.biases(day, "each:+0.01m/s:5-9")
    seen = ~np.isnan(by_satellite(day, "none"))
    assert ever.labels == tuple(f"{n}:+0.01m/s:5-9" for k, n in enumerate(day.names) if seen[5:10, k].any())
    both = pl_mc.biases(day, "pairs C:uniform(5,9)m")
    assert all(label.startswith("C") and "+C" in label for label in both.labels)
    assert both.applies(day).any(axis=0).all()


def test_one_epoch_makes_plain_faults_of_all_but_the_drawn(day: pl_mc.Geometry) -> None:
    g = day[7]
    plain = pl_mc.biases(g, "G:+20m,C01:+3m:2-9")
    assert plain.labels == ("G:+20m,C01:+3m:2-9",)
    assert plain.shaped == {}
    expected = [20.0 if name[0] == "G" else 3.0 * (name == "C01") for name in g.names]
    np.testing.assert_array_equal(plain.bias_m[0], expected)
    np.testing.assert_array_equal(pl_mc.biases(g, {"G": 20.0, "C01": 3.0}).bias_m[0], expected)
    assert np.isnan(pl_mc.biases(g, "C01:normal(0,3)m").scalar_bias_m[0])


def test_joined_and_chosen_faults_keep_their_shapes(day: pl_mc.Geometry) -> None:
    texts = ("none", "G:+20m", "C01:+3m", "C01:normal(0,3)m", "C01:+3m:1-2")
    faults = sum((pl_mc.biases(day, text) for text in texts[1:]), pl_mc.no_fault(day))
    assert faults.labels == texts
    assert sorted(faults.shaped) == [1, 3, 4]
    assert faults.drawn.tolist() == [False, False, False, True, False]
    chosen = faults.only(4, 2, 1)
    assert chosen.labels == ("C01:+3m:1-2", "C01:+3m", "G:+20m")
    assert {k: fault_text([bias for bias, _ in parts]) for k, parts in chosen.shaped.items()} == {
        0: "C01:+3m:1-2", 2: "G:+20m",
    }  # fmt: skip


def test_exact_rates_of_biases_in_time_are_those_of_each_epoch(day: pl_mc.Geometry) -> None:
    ramp = pl_mc.exact.ls_rates(day, pl_mc.biases(day, "C01:+0.002m/s:4-"))
    assert ramp.epoch.tolist() == list(range(4, 48))
    for k in (4, 20, 47):
        alone = pl_mc.exact.ls_rates(day[k], pl_mc.biases(day[k], {"C01": 0.002 * 900.0 * (k - 4)}))
        rates = [name for name in ramp if name.endswith("_rate")]
        np.testing.assert_allclose(ramp[ramp.epoch == k][rates], alone[rates], rtol=1e-9)
    common = fault_effects(day, pl_mc.biases(day, "C:+20m"), ls_quantities(day))
    # The clock of the system takes it all.
    assert np.abs(common.vertical_m).max() < 1e-9


def test_rare_events_and_multipliers_see_the_bias_of_the_epoch(day: pl_mc.Geometry) -> None:
    g, faults = day[8:10], pl_mc.biases(day, "C01:+0.002m/s:4-")
    options = {"event": "alarm", "method": "ls", "seed": 1, "max_evaluations": 2_000_000, "progress": False}
    risk = pl_mc.risk(g, faults, **options)
    alone = pl_mc.risk(g[1:2], faults.only(0), **options)
    assert risk.fault.tolist() == ["C01:+0.002m/s:4-"] * 2
    assert alone.probability.iloc[0] == risk.probability.iloc[1]
    exact = pl_mc.exact.ls_rates(g, faults).alarm_rate.to_numpy()
    assert (risk.low <= exact).all()
    assert (exact <= risk.high).all()
    needed = pl_mc.calibrate(g, method="ls", target=1e-4, faults=faults)
    sizes = [pl_mc.biases(g, {"C01": 0.002 * 900.0 * k}) for k in (4, 5)]
    for k, size in enumerate(sizes):
        other = pl_mc.calibrate(g[k : k + 1], method="ls", target=1e-4, faults=size)
        assert needed.k_vertical.iloc[k] == pytest.approx(other.k_vertical.iloc[0], rel=1e-6)


@pytest.mark.parametrize(
    "call",
    [
        lambda g, faults: pl_mc.risk(g, faults, event="misleading", seed=1),
        lambda g, faults: pl_mc.calibrate(g, target=1e-3, faults=faults),
        lambda g, faults: pl_mc.tune(g, target=1e-3, faults=faults),
        lambda g, faults: pl_mc.exposure(g, faults, tau_s=0.0, draws=10, seed=1),
        lambda g, faults: inject(g.as_series(), np.zeros((1, len(g.names))), faults),
    ],
)
def test_what_cannot_draw_says_so(day: pl_mc.Geometry, call) -> None:
    g = day[3]
    with pytest.raises(InputError, match=r"faults: C01:normal\(0,3\)m is drawn anew for every draw") as caught:
        call(g, pl_mc.biases(g, "none") + pl_mc.biases(g, "C01:normal(0,3)m"))
    assert "\n" not in str(caught.value)


def test_injected_faults_add_up_where_their_satellites_are_in_view(day: pl_mc.Geometry) -> None:
    seen = ~np.isnan(by_satellite(day, "none"))
    setting = next(k for k in range(len(day.names)) if seen[0, k] and not seen[:, k].all())
    name, hidden = day.names[setting], int((~seen[:, setting]).sum())
    texts = (f"{name}:+3m", "C01:+2m:1-4", "C01:normal(1,3)m:4-5")
    faults = pl_mc.biases(day, texts[0]) + pl_mc.biases(day, texts[1]) + pl_mc.biases(day, texts[2])
    numbers = numbers_of_draw(day, seed=3)
    errors_m, faulted, notes = inject(day, np.ones(day.sigma_m.shape), faults, numbers)
    added = np.full(seen.shape, np.nan)
    epochs, rows = np.nonzero(day.in_view)
    added[epochs, day.satellite[epochs, rows]] = errors_m[epochs, rows] - 1.0
    one = day.names.index("C01")
    row = [int(np.flatnonzero((day.satellite[k] == one) & day.in_view[k])[0]) for k in (4, 5)]
    drawn = [1.0 + 3.0 * numbers[k, 0, place] for k, place in zip((4, 5), row, strict=True)]
    np.testing.assert_allclose(added[:7, one], [0, 2, 2, 2, 2 + drawn[0], drawn[1], 0], atol=1e-12)
    np.testing.assert_array_equal(added[seen[:, setting], setting], 3.0)
    np.testing.assert_array_equal(faulted, seen[:, setting] | np.isin(np.arange(48), range(1, 6)))
    assert notes == (f"Fault {texts[0]}: {name} is out of view at {hidden} of 48 epochs.",)
    both = pl_mc.biases(day, f"C01:+2m,{name}:+3m")
    (note,) = inject(day, np.ones(day.sigma_m.shape), both)[2]
    assert note == f"Fault {both.labels[0]}: a satellite of it is out of view at {hidden} of 48 epochs."
    # What is injected is the draw of a sweep.
    sampled = pl_mc.sample(day, pl_mc.biases(day, texts[2]), draws=1, seed=3, methods="ls")
    plain = pl_mc.sample(day, pl_mc.no_fault(day), draws=1, seed=3, methods="ls")
    shift = sampled.up_m.to_numpy() - plain.up_m[plain.epoch.isin((4, 5))].to_numpy()
    gain = ls_quantities(day).gain[[4, 5], row]
    np.testing.assert_allclose(shift, gain * drawn, rtol=1e-9)


def test_records_of_biases_are_checked() -> None:
    with pytest.raises(InputError, match="law: 'gauss' is unknown"):
        Bias(of=("G01",), law="gauss", numbers=(1.0,))
    with pytest.raises(InputError, match="numbers: fixed takes one number"):
        Bias(of=("G01",), numbers=(1.0, 2.0))
    with pytest.raises(InputError, match="first_epoch: a whole number"):
        Bias(of=("G01",), numbers=(1.0,), last_epoch=5)
    with pytest.raises(dataclasses.FrozenInstanceError):
        Bias(of=("G01",), numbers=(1.0,)).of = ()  # type: ignore[misc]


def test_tables_of_distributions_and_records(day: pl_mc.Geometry) -> None:
    assert pl_mc.biases(day, {"C01": ("uniform", 5, 100)}).labels == ("C01:uniform(5,100)m",)
    assert pl_mc.biases(day, {"C01+C02": ["normal", 0, 10], "G01": 3.0}).labels == ("C01+C02:normal(0,10)m,G01:+3m",)
    text = "G:+20m,C01:+0.1m/s:3-9"
    assert pl_mc.biases(day, parse_fault(text)).labels == (text,)
    assert pl_mc.biases(day, ()).labels == ("none",)
    for table, words in (
        ({"C01": ("gamma", 2)}, "law: 'gamma' is unknown"),
        ({"C01": ()}, "law: '' is unknown"),
        ({"C01": ("uniform", 5)}, "numbers: fixed takes one number, a distribution two"),
        ({"C01": ("uniform", 5, "x")}, "bias of C01: a finite number is needed"),
        ({"C01": ("normal", 0, 9), "C01+C02": 3.0}, "C01 is named twice"),
        ({"C99": ("normal", 0, 9)}, "'C99' is not in view"),
        ((3.0,), "a table by satellite"),
    ):
        with pytest.raises(InputError, match=re.escape(words)):
            pl_mc.biases(day, table)
