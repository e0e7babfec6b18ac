"""Processes that were forked from one in which JAX had computed: its threads are not there, and are waited for."""

from __future__ import annotations

import os
import sys

_forked = False


def require_own_threads() -> None:
    """Raise `InputError` in a process that was forked from one in which JAX had computed."""
    if _forked:
        # With it comes NumPy, and this file is loaded with the package.
        from pl_mc.input_errors import InputError

        raise InputError(
            "process: it was forked after JAX had computed in its parent, and would wait for threads that are not "
            "here; processes have to be spawned, as by multiprocessing.get_context('spawn')."
        )


def _in_child() -> None:
    global _forked
    # Not imported here: a process that has no JAX yet is sound. Should a version not say, every fork counts.
    bridge = sys.modules.get("jax._src.xla_bridge")
    started = getattr(bridge, "backends_are_initialized", lambda: "jax" in sys.modules)
    _forked = _forked or bool(started())


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)
