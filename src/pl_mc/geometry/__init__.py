"""Geometry: nominal constellations or receiver files, turned into design rows and standard deviations."""

from pl_mc.geometry.quality import Dops, dops, redundancy_numbers
from pl_mc.geometry.record import Geometry
from pl_mc.geometry.simulate import simulate

__all__ = ["Dops", "Geometry", "dops", "redundancy_numbers", "simulate"]
