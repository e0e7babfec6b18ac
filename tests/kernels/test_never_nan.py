"""Whatever the observations, nothing is ever NaN, and what is not available has infinite protection levels."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pl_mc import kernels
from pl_mc.kernels import IrlsOptions
from reference.problems import appendix_d

# What optimisation rearranges must not make a NaN either: as users compile.
pytestmark = pytest.mark.optimised

GEOMETRY = appendix_d()
OPTIONS = (
    IrlsOptions(),
    IrlsOptions(scale="apriori", redundancy="kept"),
    IrlsOptions(scale="posterior", redundancy="weights"),
    IrlsOptions(scale="mad", cofactor="reweighted"),
    IrlsOptions(scale="mad_floored", cofactor="none"),
    IrlsOptions(weight=kernels.TukeyWeight(), scale="posterior", cofactor="reweighted", redundancy="weights"),
    IrlsOptions(weight=kernels.HuberWeight(), scale="mad"),
    IrlsOptions(covariance="sandwich"),
)


@jax.jit
def all_estimates(design, sigma_m, observed_m, in_view):
    estimates = [kernels.ls(design, sigma_m, observed_m, in_view)]
    estimates += [kernels.igg3(design, sigma_m, observed_m, in_view, options=options) for options in OPTIONS]
    return [(estimate, kernels.protection_levels(estimate)) for estimate in estimates]


sizes = st.one_of(
    st.floats(-1e6, 1e6, allow_subnormal=True), st.sampled_from([0.0, -0.0, 1e6, -1e6, 100.0, 1e-300, 30.0])
)
observations = st.one_of(
    st.lists(sizes, min_size=10, max_size=10),
    # Duplicates: few different values, often one.
    st.lists(sizes, min_size=1, max_size=2).flatmap(
        lambda few: st.lists(st.sampled_from(few), min_size=10, max_size=10)
    ),
)


@given(observed=observations, in_view=st.lists(st.booleans(), min_size=10, max_size=10))
@example(observed=[0.0] * 10, in_view=[True] * 10)
@example(observed=[0.0] * 10, in_view=[False] * 10)
@example(observed=[1e6] * 10, in_view=[True] * 10)
@settings(max_examples=150)
def test_never_nan(observed, in_view):
    seen = np.array(in_view)
    # Padding may hold anything.
    design = np.where(seen[:, None], GEOMETRY.design, np.nan)
    sigma = np.where(seen, GEOMETRY.sigma_m, np.nan)
    for estimate, levels in all_estimates(design, sigma, np.where(seen, observed, np.nan), seen):
        for leaf in jax.tree.leaves((estimate, levels)):
            assert not np.isnan(leaf).any()
        assert np.isfinite(estimate.weights).all()
        assert np.isfinite(estimate.residuals_m).all()
        if estimate.available:
            assert seen.sum() > 3 + GEOMETRY.design[seen][:, 3:].any(axis=0).sum()
            assert np.isfinite([levels.vpl_m, levels.hpl_m]).all()
            assert np.isfinite(estimate.state).all()
        else:
            assert levels.vpl_m == levels.hpl_m == np.inf
            assert np.isinf(estimate.state).all()
