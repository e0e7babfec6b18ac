"""The sweep: geometry x fault x noise, all methods on the same noise, counted in constant memory."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import LPV_200, AlertLimits
from pl_mc.engine.checks import LARGEST_DRAWS, LARGEST_SEED, notes_on_faults, require_inputs
from pl_mc.engine.core import count_events
from pl_mc.engine.events import EVENTS
from pl_mc.engine.noise import LANES
from pl_mc.engine.plan import Chunk, make_plan
from pl_mc.engine.precision import dtype_of, precision_scope
from pl_mc.engine.progress import with_progress
from pl_mc.engine.table import rate_table
from pl_mc.engine.threads import cores, in_order
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import require_whole
from pl_mc.methods import Method, as_methods

_count_events = jax.jit(count_events, static_argnames=("methods", "blocks"))


def sweep(
    g: Geometry,
    faults: Faults,
    *,
    draws: int,
    seed: int,
    methods: Sequence[str | Method] = ("ls", "igg3"),
    alert: AlertLimits = LPV_200,
    precision: str = "float64",
    workers: int | None = None,
    progress: bool | None = None,
) -> pd.DataFrame:
    """Count alarms, hazards and missed detections of every method, for every fault at every epoch.

    Args:
        g: one epoch or a series.
        faults: bias vectors, from `ramp`, `biases` or `no_fault`.
        draws: noise draws for each fault at each epoch; every method and every fault sees the same draws.
        seed: chooses the noise, 0 to 2^32 - 1. The same seed gives the same counts.
        methods: names or records of methods.
        alert: alert limits; the vertical one decides.
        precision: ``float64`` or ``float32``. Single precision draws other noise from the same seed, and none
            beyond 5.42 sigma: rates near 1e-7 are not to be had from it.
        workers: threads that compute; as many as cores unless given. No effect on the counts.
        progress: whether to show a progress bar; where standard error is a terminal unless given.

    Returns:
        A table with one row per epoch, method and fault: ``epoch, method, fault, bias_m, draws``, the counts
        ``alarms, hazards, missed, exceeded, misleading, false_alarms, unavailable`` (defined in
        `pl_mc.engine.events`), and for each of them ``<event>_rate, <event>_low, <event>_high``: count / draws with
        95 % Clopper-Pearson bounds. A fault gives no row at epochs where one of its satellites is out of view;
        ``table.attrs["notes"]`` says where.

    Raises:
        InputError: bad options, or faults of another geometry.
    """
    require_inputs(g, faults, alert)
    draws = require_whole(draws, field="draws", low=1, high=LARGEST_DRAWS)
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    threads = cores() if workers is None else require_whole(workers, field="workers", low=1)
    chosen = as_methods(methods)
    dtype = dtype_of(precision)
    plan = make_plan(g, faults, draws)

    def run(chunk: Chunk) -> NDArray[np.int32]:
        with precision_scope(precision):
            counts = _count_events(
                plan.batch(chunk, dtype),
                np.uint32(seed),
                np.int32(chunk.first_block),
                np.int32(draws // LANES),
                np.int32(draws % LANES),
                jnp.asarray(alert.vertical_m, dtype),
                methods=chosen,
                blocks=plan.blocks_per_call,
            )
            return np.asarray(counts)

    shape = (len(plan.epochs), plan.fault_index.shape[1], len(chosen), len(EVENTS))
    total = np.zeros(shape, dtype=np.int64)
    results = with_progress(
        in_order(run, plan.chunks(), threads), total=plan.chunk_count, what="Sweep", show=progress
    )
    for chunk, counts in results:
        total[chunk.first_epoch : chunk.stop_epoch] += counts[: chunk.stop_epoch - chunk.first_epoch]
    table = rate_table(plan, total, [method.name for method in chosen], draws)
    table.attrs["notes"] = list(notes_on_faults(g, faults))
    return table
