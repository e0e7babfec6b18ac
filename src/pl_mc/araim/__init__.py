"""ARAIM: protection levels and tests by multiple-hypothesis solution separation."""

from pl_mc.araim.budget import LPV_200, Budget
from pl_mc.araim.levels import AraimLevels, protection_levels
from pl_mc.araim.modes import FaultModes, fault_modes
from pl_mc.ism import Ism

__all__ = ["LPV_200", "AraimLevels", "Budget", "FaultModes", "Ism", "fault_modes", "protection_levels"]
