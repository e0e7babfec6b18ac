"""Methods by name, as experiment files and the command line call them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pl_mc.geometry.record import Geometry
from pl_mc.kernels.parameters import with_numbers
from pl_mc.methods.araim import Araim
from pl_mc.methods.base import Method
from pl_mc.methods.danish import Danish
from pl_mc.methods.hampel import Hampel
from pl_mc.methods.huber import Huber
from pl_mc.methods.ibpl import Ibpl
from pl_mc.methods.igg3 import Igg3
from pl_mc.methods.igg3_gated import GatedIgg3
from pl_mc.methods.l1 import L1
from pl_mc.methods.leave_one_out import LeaveOneOut
from pl_mc.methods.ls import Ls
from pl_mc.methods.max_dop import MaxDop
from pl_mc.methods.mm import MM
from pl_mc.methods.nioraim import Nioraim
from pl_mc.methods.parity import Parity
from pl_mc.methods.range_comparison import RangeComparison
from pl_mc.methods.sbas import Sbas
from pl_mc.methods.separated import Separated
from pl_mc.methods.slope import Slope
from pl_mc.methods.tukey import Tukey
from pl_mc.methods.w_test import WTest
from pl_mc.named import as_records, build_named, registry

METHODS = registry(
    "method",
    {
        "ls": Ls,
        "igg3": Igg3,
        "igg3_gated": GatedIgg3,
        "araim": Araim,
        "separated": Separated,
        "ibpl": Ibpl,
        "slope": Slope,
        "max_dop": MaxDop,
        "parity": Parity,
        "w_test": WTest,
        "leave_one_out": LeaveOneOut,
        "range_comparison": RangeComparison,
        "nioraim": Nioraim,
        "sbas": Sbas,
        "huber": Huber,
        "tukey": Tukey,
        "hampel": Hampel,
        "danish": Danish,
        "l1": L1,
        "mm": MM,
    },
)


def method(name: str, **options: Any) -> Method:
    """A method by name with its options; an `InputError` names what is unknown and the nearest choice."""
    return build_named(name, METHODS, options, what="method")


def as_methods(methods: Sequence[str | Method], g: Geometry | None = None) -> tuple[Method, ...]:
    """Names and records, made records; an `InputError` for none, for strangers and for two of one name.

    With a geometry also for those that say by a function ``require_geometry`` of theirs that they cannot be used there.
    """
    return fit_for(as_records(methods, METHODS, Method, what="method", read=with_numbers), g)


def fit_for(methods: tuple[Any, ...], g: Geometry | None) -> tuple[Any, ...]:
    """The methods; an `InputError` of one of them that cannot be used with a geometry."""
    for one in methods if g is not None else ():
        if callable(require := getattr(one, "require_geometry", None)):
            require(g)
    return methods
