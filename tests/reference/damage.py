"""What is left of stored files: what disks, transfers and hands make of a part or a record of a sweep."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pl_mc.engine import checkpoint_store
from reference.small_sweep import COUNTS

CHANGED = ("truncated", "flipped", "zeroed", "empty", "text", "swapped", "other")


def changed(kind: str, content: bytes, where: float, *, neighbour: bytes, stranger: bytes) -> bytes:
    """A stored file, damaged in one of the ways of ``CHANGED``.

    Args:
        kind: the way.
        content: the sound file.
        where: from where on or at which byte, 0 to 1.
        neighbour: another file of the same folder.
        stranger: the same file of another sweep.
    """
    place = int(where * len(content))
    if kind == "flipped":
        return content[:place] + bytes([content[place] ^ (1 << place % 8)]) + content[place + 1 :]
    return {
        "truncated": content[:place],
        "zeroed": content[:place] + bytes(len(content) - place),
        "empty": b"",
        "text": b"no such file\n",
        "swapped": neighbour,
        "other": stranger,
    }[kind]


# Rows of a part that somebody has changed.
FORGED_ROWS: Mapping[str, Callable[[pd.DataFrame], pd.DataFrame]] = {
    "more draws": lambda rows: rows.assign(draws=10 * rows.draws),
    "reversed": lambda rows: rows[::-1].reset_index(drop=True),
    "halves": lambda rows: rows.assign(**{name: rows[name] + 0.5 for name in COUNTS}),
    "another epoch": lambda rows: rows.assign(epoch=rows.epoch + 1),
    "another method": lambda rows: rows.assign(
        method=rows.method.astype(str).str.replace("ls", "huber").astype("category")
    ),
    "another fault": lambda rows: rows.assign(fault=rows.fault.astype(str).str.replace("0", "9").astype("category")),
    "another bias": lambda rows: rows.assign(bias_m=rows.bias_m + 1.0),
    "fewer rows": lambda rows: rows[:-1],
    "one alarm more": lambda rows: rows.assign(alarms=rows.alarms + 1),
    "more than drawn": lambda rows: rows.assign(exceeded=rows.draws + 1),
    "a column less": lambda rows: rows.drop(columns="missed"),
    "a column more": lambda rows: rows.assign(weight=1),
    "columns the other way round": lambda rows: rows[["fault", "epoch", *rows.columns[2:]]],
    "no bias": lambda rows: rows.assign(bias_m=np.nan),
    "draws that are no whole numbers": lambda rows: rows.assign(draws=rows.draws.astype(float)),
    "a count that is missing": lambda rows: rows.assign(exceeded=rows.exceeded.astype("Int64").mask(rows.index == 0)),
    "a fault that is missing": lambda rows: rows.assign(fault=rows.fault.astype(object).mask(rows.index == 0, None)),
}

# What a part says of itself, of a form that no part has.
FORGED_WORDS: Mapping[str, Any] = {
    "no number": {"part": "3"},
    "another part": {"part": 10**30},
    "no task": {"experiment": None},
    "an environment that is a list": {"environment": ["jax"]},
    "an environment that is a word": {"environment": "here"},
    "an environment that is a number": {"environment": 7},
    "no environment": {"environment": None},
}


def forged(
    content: bytes,
    rows: Callable[[pd.DataFrame], pd.DataFrame] = lambda rows: rows,
    words: Mapping[str, Any] | None = None,
    *,
    checksum: bool = True,
) -> bytes:
    """A part with other rows or other words about itself; with a checksum that is right, or that of before."""
    file = pq.ParquetFile(io.BytesIO(content))
    about = json.loads(file.metadata.metadata[checkpoint_store._KEY])
    about |= (words or {}) | ({"sha256": checkpoint_store._NO_CHECKSUM} if checksum else {})
    table = pa.Table.from_pandas(rows(file.read().to_pandas()), preserve_index=False)
    sink = io.BytesIO()
    with pq.ParquetWriter(sink, table.schema, compression="zstd") as writer:
        writer.write_table(table)
        writer.add_key_value_metadata({checkpoint_store._KEY: json.dumps(about).encode()})
    made = sink.getvalue()
    return checkpoint_store._with_checksum(made) if checksum else made
