"""What a measurement was made on, in words that name no person, path or host."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import platform
import re
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
    cpuinfo = Path("/proc/cpuinfo")
    text = cpuinfo.read_text(encoding="utf-8") if cpuinfo.is_file() else ""
    said = re.search(r"^model name[^:]*:(.*)$", text, re.MULTILINE)
    return said[1].strip() if said else platform.processor() or platform.machine()


def load_average() -> list[float] | None:
    """Processes that wanted a core, averaged over 1, 5 and 15 minutes; None where the system does not tell."""
    return [round(value, 2) for value in os.getloadavg()] if hasattr(os, "getloadavg") else None


def versions() -> dict[str, str]:
    """Versions of the packages that compute; those that are not installed are left out."""
    found = {}
    for package in _PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[package] = importlib.metadata.version(package)
    return found


def _memory_gb() -> float | None:
    with contextlib.suppress(AttributeError, ValueError, OSError):
        return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9, 1)
    return None


def _blas() -> str:
    """The linear algebra library under NumPy."""
    config: Any = np.show_config(mode="dicts")
    blas = (config or {}).get("Build Dependencies", {}).get("blas", {})
    return f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip()
