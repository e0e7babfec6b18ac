"""What decides the counts of a sweep, in a form that can be stored, compared and told."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np

from pl_mc.engine import plan as cut
from pl_mc.engine.compiling import compiler_options, instruction_set
from pl_mc.engine.noise import LANES
from pl_mc.engine.task import SweepTask
from pl_mc.noise_models import GAUSSIAN

Identity = Mapping[str, Mapping[str, Any]]

# What was asked for; and where it runs, which can move the last bits of a number.
ASKED, WHERE = "experiment", "environment"

# What a field that is left out means.
_UNSAID = {"noise": repr(GAUSSIAN)}


def identity_of(task: SweepTask) -> Identity:
    """Two sweeps with the same identity give the same counts."""
    g = task.geometry.as_series()
    asked = {
        "geometry": _digest(g.design, g.sigma_m, g.in_view, g.satellite, g.epoch, g.names),
        "faults": _digest(task.faults.bias_m, task.faults.names, task.faults.labels),
        "draws": task.draws,
        "seed": task.seed,
        "methods": [repr(method) for method in task.methods],
        "vertical alert limit [m]": float(task.alert.vertical_m),
        "precision": task.precision,
        "draws per block": LANES,
        "scenarios per call": cut.SCENARIOS_PER_CALL,
        "calls per part": task.plan.calls_per_part,
    }
    # What Gaussian sweeps have stored stays theirs: they say nothing of a noise model.
    if task.noise != GAUSSIAN:
        asked["noise"] = repr(task.noise)
    return {ASKED: asked, WHERE: environment()}


def environment() -> dict[str, Any]:
    """Versions and machine, as far as they can change a bit of a result."""
    return {
        "pl_mc": importlib.metadata.version("pl_mc"),
        "jax": importlib.metadata.version("jax"),
        "jaxlib": importlib.metadata.version("jaxlib"),
        "backend": jax.default_backend(),
        "device": jax.local_devices()[0].device_kind,
        "instruction set": instruction_set(),
        "compiler options": compiler_options(),
        "compiler flags": _compiler_flags(),
    }


def mark(section: Mapping[str, Any]) -> str:
    """A short name of a section of an identity."""
    return hashlib.sha256(json.dumps(section, sort_keys=True).encode()).hexdigest()


def differences(before: Identity, now: Identity, sections: Sequence[str] = (ASKED, WHERE)) -> list[str]:
    """What changed, as ``draws: 100 before, 200 now``."""
    found = []
    for section in sections:
        old, new = before.get(section, {}), now.get(section, {})
        for field in [*old, *(field for field in new if field not in old)]:
            if old.get(field) != new.get(field):
                told = field in ("geometry", "faults")
                was, is_now = (part.get(field, _UNSAID.get(field)) for part in (old, new))
                found.append(f"{field}" if told else f"{field}: {was} before, {is_now} now")
    return found


def _compiler_flags() -> list[str]:
    """What the caller told the compiler, but for the number of devices, which moves no bit."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    return sorted(flag for flag in flags if not flag.startswith("--xla_force_host_platform_device_count"))


def _digest(*parts: Any) -> str:
    total = hashlib.sha256()
    for part in parts:
        array = np.asarray(part)
        total.update(f"{array.dtype.str}{array.shape}".encode())
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()
