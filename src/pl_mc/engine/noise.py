"""Where `pl_mc.kernels.noise` was."""

from __future__ import annotations

from pl_mc.deprecated import moved_names

__getattr__ = moved_names(__name__)
