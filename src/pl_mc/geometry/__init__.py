"""Geometry: nominal constellations or receiver files, turned into design rows and standard deviations."""

from pl_mc.geometry.record import Geometry

__all__ = ["Geometry"]
