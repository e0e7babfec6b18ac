"""How many solutions IGG-III needs to settle, plain and accelerated: python benchmarks/convergence.py [FOLDER].

Epoch 545 of the simulated CUT0, no fault and every satellite faulted in turn. Each draw is followed to the 400th plain
solution, from the start and from where a scheme ended; where the two limits differ the scheme left the basin of the
plain iteration. Writes results/convergence/convergence.csv and, for P(exceeded), results/convergence/rates.csv; for the
other weight functions results/convergence/weights.csv.
"""

from __future__ import annotations

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

import pl_mc
from pl_mc.kernels import IrlsOptions, irls, linear_model, start_from
from pl_mc.kernels.estimate import Iterate
from pl_mc.kernels.reweighting import reweighted
from pl_mc.methods import L1, MM, Danish, Hampel, Huber, Tukey

DRAWS, LIMIT, SEED = 8192, 400, 3
BIASES_M = (1.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0)
SCHEMES = {
    "10 plain": IrlsOptions(iterations=10),
    "20 plain": IrlsOptions(iterations=20),
    "40 plain": IrlsOptions(iterations=40),
    "60 plain": IrlsOptions(iterations=60),
    "80 plain": IrlsOptions(iterations=80),
    "36 with Aitken (default)": IrlsOptions(),
}
RATE_FAULTS = (None, ("G09", 3.5), ("G09", 20.0))
OTHERS = [[of(iterations=count) for count in (10, 40, 80, None)] for of in (Huber, Tukey, Hampel, Danish, MM)]
# Whose default are 50 plain iterations.
OTHERS += [[L1(iterations=count) for count in (50, 150, 300, 600)]]
KEPT = ["method", "fault", "draws", "exceeded", "exceeded_rate", "exceeded_low", "exceeded_high"]
KEPT += ["unconverged", "unconverged_rate", "unconverged_low", "unconverged_high"]


def main(out: Path) -> None:
    """Both tables."""
    jax.config.update("jax_enable_x64", True)
    g = pl_mc.simulate(site="CUT0", start="2017-11-21T00:00:00", constellations=("GPS", "BDS-2"), epochs=546)[545]
    model = linear_model(jnp.asarray(g.design), jnp.asarray(g.sigma_m), one_clock_per_row=True)
    noise = np.random.default_rng(SEED).standard_normal((len(g.sigma_m), DRAWS)) * g.sigma_m[:, None]

    @jax.jit
    def limit_of(observed):
        return irls(model, start_from(model, observed), IrlsOptions(iterations=LIMIT))

    @jax.jit
    def limit_from(observed, estimate):
        """The limit of plain solutions from an estimate."""
        start = start_from(model, observed)
        residuals = -estimate.residuals_m * model.weight_root[:, None]
        first = Iterate(
            residuals, tuple(estimate.state - start.state), jnp.sum(estimate.weights * residuals**2, axis=0),
            estimate.available,
        )  # fmt: skip
        return reweighted(model, start, first, estimate.weights, IrlsOptions(iterations=LIMIT))

    schemes = {name: jax.jit(lambda o, s=s: irls(model, start_from(model, o), s)) for name, s in SCHEMES.items()}
    rows = []
    for name, bias in [("none", 0.0), *((name, bias) for name in g.names for bias in BIASES_M)]:
        seen = noise + bias * (np.array(g.names) == name)[:, None]
        last = limit_of(seen)
        for scheme, solve in schemes.items():
            found = solve(seen)
            end = limit_from(seen, found)
            sure = last.available & end.available & (last.change_m < 1e-4) & (end.change_m < 1e-4)
            apart = jnp.abs(end.state[:3] - last.state[:3]).max(axis=0) > 0.01
            far = jnp.abs(found.state[:3] - last.state[:3]).max(axis=0) > 0.01
            moving = found.available & (found.change_m > 0.01)
            rows.append((scheme, name, bias, DRAWS, *(int(one.sum()) for one in (moving, far & sure, apart & sure))))
        print(name, bias, flush=True)
    columns = ["scheme", "fault", "bias_m", "draws", "unconverged", "beyond_1_cm_of_its_limit", "other_limit"]
    table = pd.DataFrame(rows, columns=columns)
    out.mkdir(parents=True, exist_ok=True)
    table.to_csv(out / "convergence.csv", index=False)
    shares = table[columns[4:]].div(table.draws, axis=0)
    print(shares.groupby(table.scheme, sort=False).agg(["mean", "max"]).to_string())

    methods = [pl_mc.igg3(iterations=count) for count in (5, 10, 20, 40, 80, None)]
    rates = counted(g, methods, 1_000_000)
    rates.to_csv(out / "rates.csv", index=False)
    print(rates[["method", "fault", "exceeded_rate", "unconverged_rate"]].to_string())
    others(g, out)


def others(g, out: Path) -> None:
    """Other weights, by iterations."""
    rates = pd.concat([counted(g, methods, 100_000) for methods in OTHERS], ignore_index=True)
    rates.to_csv(out / "weights.csv", index=False)
    print(rates[["method", "fault", "exceeded_rate", "unconverged_rate"]].to_string())


def counted(g, methods, draws: int) -> pd.DataFrame:
    """Rates under `RATE_FAULTS`."""
    faults = [pl_mc.no_fault(g) if one is None else pl_mc.biases(g, dict([one])) for one in RATE_FAULTS]
    return pl_mc.sweep(g, faults[0] + faults[1] + faults[2], draws=draws, seed=SEED, methods=methods)[KEPT]


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "results/convergence"))
