"""Integrity support messages: what is promised about each satellite and each constellation."""

from pl_mc.ism.codes import CODES, codes_of, satellite_codes
from pl_mc.ism.message import FIELDS, Ism
from pl_mc.ism.reading import as_ism, read_ism

__all__ = ["CODES", "FIELDS", "Ism", "as_ism", "codes_of", "read_ism", "satellite_codes"]
