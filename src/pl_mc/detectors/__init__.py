"""Detectors: tests of the residuals for a fault, one file each, one signature."""

from pl_mc.detectors.base import Detector, Verdict, View
from pl_mc.detectors.chi2 import Chi2
from pl_mc.detectors.mean_check import MeanCheck, satterthwaite
from pl_mc.detectors.registry import DETECTORS, as_detectors, detector

__all__ = ["DETECTORS", "Chi2", "Detector", "MeanCheck", "Verdict", "View", "as_detectors", "detector", "satterthwaite"]
