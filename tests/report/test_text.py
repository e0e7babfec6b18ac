"""Numbers as a reader wants them."""

from __future__ import annotations

from pl_mc.report.text import probability_text


def test_a_probability_close_to_one_says_how_close():
    assert [probability_text(p) for p in (0.0, 1.32e-10, 0.0229, 0.5, 0.995, 0.99906, 0.999887430669468, 1.0)] == [
        "0", "1.32e-10", "0.0229", "0.5", "0.995", "0.99906", "0.99989", "1",
    ]  # fmt: skip
