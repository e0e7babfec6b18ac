"""What a run says of draws that had not settled."""

from __future__ import annotations

import pandas as pd

from pl_mc.report.findings import Table, convergence_note


def test_of_many_methods_those_with_the_largest_shares_are_named() -> None:
    counts = [3, 50, 0, 9, 20, 7, 40, 8, 1]
    data = pd.DataFrame({
        "method": [f"m{k}" for k in range(9)], "draws": 1000, "unconverged": counts, "tied": [0] * 8 + [2],
    })  # fmt: skip
    unsettled, tied = convergence_note([Table("rates", data)])
    names = ["m1 0.05 (50 of 1,000)", "m6 0.04", "m4 0.02", "m3 0.009", "m7 0.008", "m5 0.007"]
    places = [unsettled.index(name) for name in names]
    assert places == sorted(places)
    assert unsettled.endswith("; 2 more methods, 0.003 or less each.")
    assert "m2" not in unsettled
    assert tied.endswith("m8 0.002 (2 of 1,000), at most 0.002 in a row of the table.")
    # Few are named in their order.
    few = convergence_note([Table("rates", data.iloc[:5])])[0]
    assert few.index("m0") < few.index("m1") < few.index("m4")
