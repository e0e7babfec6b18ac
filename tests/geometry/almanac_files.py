"""Made-up almanacs of GPS in both text forms."""

from __future__ import annotations

import numpy as np

WEEK, TOA_S = 2111, 405_504.0


def elements(count: int, seed: int = 1) -> list[dict[str, float]]:
    """Satellites such as GPS has, rounded as a file rounds them."""
    rng = np.random.default_rng(seed)
    return [
        {
            "prn": k + 1,
            "health": 63 if k == 3 else 0,
            "e": round(float(rng.uniform(0.0, 0.02)), 9),
            "i": round(float(np.pi * 0.3 + rng.normal(0, 0.02)), 9),
            "rate": round(float(rng.normal(-8e-9, 3e-10)), 17),
            "root": round(5153.6 + float(rng.normal(0, 0.3)), 5),
            "raan": round(float(rng.uniform(-np.pi, np.pi)), 9),
            "perigee": round(float(rng.uniform(-np.pi, np.pi)), 9),
            "mean": round(float(rng.uniform(-np.pi, np.pi)), 9),
        }
        for k in range(count)
    ]


def yuma(records: list[dict[str, float]], week: int = WEEK % 1024) -> str:
    return "\n".join(
        f"******** Week {week} almanac for PRN-{r['prn']:02d} ********\n"
        f"ID:                         {r['prn']:02d}\nHealth:                     {r['health']:03d}\n"
        f"Eccentricity:               {r['e']:.10E}\nTime of Applicability(s):  {TOA_S:.4f}\n"
        f"Orbital Inclination(rad):   {r['i']:.10f}\nRate of Right Ascen(r/s):  {r['rate']:.10E}\n"
        f"SQRT(A)  (m 1/2):           {r['root']:.6f}\nRight Ascen at Week(rad):  {r['raan']:.10E}\n"
        f"Argument of Perigee(rad):   {r['perigee']:.9f}\nMean Anom(rad):            {r['mean']:.10E}\n"
        f"Af0(s):                     0.1E-003\nAf1(s/s):                   0.0E+000\n"
        f"week:                        {week}\n"
        for r in records
    )


def sem(records: list[dict[str, float]], week: int = WEEK % 1024) -> str:
    head = f"{len(records):02d} CURRENT.ALM\n{week:4d} {TOA_S:.0f}\n\n"
    return head + "\n".join(
        f"{r['prn']}\n60\n0\n {r['e']:.15E} {r['i'] / np.pi - 0.3:.15E} {r['rate'] / np.pi:.15E}\n"
        f" {r['root']:.15E} {r['raan'] / np.pi:.15E} {r['perigee'] / np.pi:.15E}\n"
        f" {r['mean'] / np.pi:.15E} 1.0E-04 0.0E+00\n{r['health']}\n11\n"
        for r in records
    )
