"""What a measurement was made on, in words that name no person, path or host."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from pathlib import Path
from typing import Any

import jax
import numpy as np

from pl_mc.engine.compiling import compiler_options, instruction_set
from pl_mc.runtime.threads import cores

_PACKAGES = ("pl_mc", "jax", "jaxlib", "numpy", "scipy", "statsmodels")


def describe_machine() -> dict[str, Any]:
    """Processor, cores, memory, versions and load."""
    device = jax.local_devices()[0]
    return {
        "processor": processor_name(),
        "cores": cores(),
        "memory_gb": _memory_gb(),
        "instruction_set": instruction_set(),
        "system": platform.system(),
        "backend": jax.default_backend(),
        "device": device.device_kind,
        "devices": jax.local_device_count(),
        "compiler_options": compiler_options(),
        "versions": {"python": platform.python_version()} | versions(),
        "blas": _blas(),
        "load_average": load_average(),
    }


def processor_name() -> str:
    """The processor's own name, or its family where that cannot be read."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def load_average() -> list[float] | None:
    """Processes that wanted a core, averaged over 1, 5 and 15 minutes; None where the system does not tell."""
    return [round(value, 2) for value in os.getloadavg()] if hasattr(os, "getloadavg") else None


def versions() -> dict[str, str]:
    """Versions of the packages that compute; those that are not installed are left out."""
    found = {}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _memory_gb() -> float | None:
    try:
        return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9, 1)
    except (AttributeError, ValueError, OSError):
        return None


def _blas() -> str:
    """The linear algebra library under NumPy."""
    config: Any = np.show_config(mode="dicts")
    blas = (config or {}).get("Build Dependencies", {}).get("blas", {})
    return f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip()
