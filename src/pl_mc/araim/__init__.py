"""ARAIM: protection levels and tests by multiple-hypothesis solution separation."""

from pl_mc.araim.budget import LPV_200, LPV_200_V42, RNP_V42, Budget
from pl_mc.araim.levels import protection_levels
from pl_mc.araim.modes import FaultModes, fault_modes
from pl_mc.araim.record import AraimLevels, PositionLevels
from pl_mc.ism import Ism

__all__ = [
    "LPV_200",
    "LPV_200_V42",
    "RNP_V42",
    "AraimLevels",
    "Budget",
    "FaultModes",
    "Ism",
    "PositionLevels",
    "fault_modes",
    "protection_levels",
]
