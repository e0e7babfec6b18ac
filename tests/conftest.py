"""Settings of the suite: 64-bit JAX, compiled quickly, the folder of real data, reproducible property tests."""

from __future__ import annotations

import ctypes
import ctypes.util
import gc
import hashlib
import importlib
import importlib.util
import os
import pickle
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

# Each process of the suite has a core to itself: threads of the linear algebra that wait for work take it from others.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.pop("JAX_COMPILATION_CACHE_DIR", None)
# A tenth of the time of a compilation is the C library's allocator's. Processes that are started from here, those that
# run tests among them, take jemalloc, where the system has it, and less memory.
if "LD_PRELOAD" not in os.environ and sys.platform == "linux" and (jemalloc := ctypes.util.find_library("jemalloc")):
    os.environ["LD_PRELOAD"] = jemalloc
# What a user's own runs have kept is none of the tests' business, and theirs is none of the user's.
os.environ["PL_MC_CACHE"] = "off"

import jax
import psutil
import pytest
from hypothesis import HealthCheck, settings

# Most of the time of a full compilation of the suite is the compiler's. Its quick way takes a seventh of that and
# makes code that runs four times as long, the middle one half of it and runs as fast (JAX 0.10, IGG-III); last bits
# may differ. A file or a test says which way is its own: the ``quick`` one unless marked, ``counting`` where it runs
# long, ``optimised``, as users compile, where it is about bits, precision or speed. Processes that tests start compile
# quickly, by their environment, and have the bits of the quick way. The variable takes one way for all. A function is
# compiled in one piece: pieces are for more cores than one.
SIMPLE = {"xla_cpu_use_fusion_emitters": False, "xla_cpu_parallel_codegen_split_count": 1}
WAYS: dict[str, dict[str, Any]] = {
    "quick": {"xla_backend_optimization_level": 0, **SIMPLE},
    "counting": {"xla_backend_optimization_level": 1, **SIMPLE},
    "optimised": {
        "xla_backend_optimization_level": 3,
        "xla_cpu_use_fusion_emitters": True,
        "xla_cpu_parallel_codegen_split_count": 32,
    },
}
QUICK = next(iter(WAYS))
WAY_VARIABLE = "PL_MC_TEST_COMPILER"
FLAGS_VARIABLE = "XLA_FLAGS"
OWN_FLAGS = [f"--{name}={str(value).lower()}" for name, value in WAYS[os.environ.get(WAY_VARIABLE) or QUICK].items()]
os.environ[FLAGS_VARIABLE] = " ".join(dict.fromkeys([*os.environ.get(FLAGS_VARIABLE, "").split(), *OWN_FLAGS]))

# The library never touches the caller's configuration; the tests are a caller that wants double precision. Those of
# kernels and methods are strict about the promotion of types as well.
jax.config.update("jax_enable_x64", True)

# Files of tests run the same programs again and again, and so do processes that they start, some of which are killed as
# they write: each is compiled once by the ones and once by the others.
CACHE_VARIABLE = "PL_MC_TEST_CACHE"
if CACHE_VARIABLE not in os.environ:
    os.environ[CACHE_VARIABLE] = OWN_CACHE = tempfile.mkdtemp(prefix="pl_mc_tests_")
else:
    OWN_CACHE = ""
os.environ["JAX_COMPILATION_CACHE_DIR"] = os.environ[CACHE_VARIABLE]
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.2"


def share_programs(folder: Path) -> None:
    """Programs of this process and of those beside it in a folder, where they are moved when they are whole.

    JAX writes them in place, and another process that reads one in that moment warns. What stores them is no public
    name; where it has gone, each file of tests compiles for itself.
    """
    found = importlib.util.find_spec("jax._src.lru_cache")
    cache = getattr(importlib.import_module("jax._src.lru_cache"), "LRUCache", None) if found else None
    put = getattr(cache, "put", None)
    if cache is None or put is None:
        return

    def whole(self: Any, key: str, value: bytes) -> None:
        own = cache(str(folder / str(os.getpid())), max_size=-1)
        put(own, key, value)
        for file in own.path.iterdir():
            file.replace(self.path / file.name)

    cache.put = whole
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


share_programs(Path(os.environ[CACHE_VARIABLE], "tests"))

# A first example compiles, the others do not: neither a deadline nor a health check of the time means anything.
# A run of the suite is the same every time; PL_MC_TEST_EXAMPLES=new looks elsewhere.
settings.register_profile(
    "same", deadline=None, database=None, print_blob=True, derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)  # fmt: skip
settings.register_profile("new", settings.get_profile("same"), derandomize=False)
settings.load_profile(os.environ.get("PL_MC_TEST_EXAMPLES", "same"))

DATA_VARIABLE = "PL_MC_DATA"


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of receiver files and truth tables that the environment names; the test is skipped without one."""
    named = os.environ.get(DATA_VARIABLE)
    if not named:
        pytest.skip(f"{DATA_VARIABLE} names no folder of receiver files")
    folder = Path(named)
    if not folder.is_dir():
        pytest.skip(f"{DATA_VARIABLE} names {named}, which is no folder")
    return folder


MUCH_BYTES = 1.5e9
# What the C library has of memory that is free goes back to the system, where it can be asked.
TRIM: Any = getattr(ctypes.CDLL(None), "malloc_trim", lambda _: 0) if os.name == "posix" else lambda _: 0


class Compilation:
    """Options for all that is compiled from now on.

    JAX takes options of one function or of a process, not of a stretch of time. What it collects them with is no
    public name; where it has gone, every test is compiled as users do.
    """

    def __init__(self) -> None:
        self.file: Path | None = None
        self.way = "optimised"
        found = importlib.util.find_spec("jax._src.compiler")
        self.compiler = importlib.import_module("jax._src.compiler") if found else None
        self.collect = getattr(self.compiler, "get_compile_options", None)
        if self.collect is not None and jax.default_backend() == "cpu":
            self.compiler.get_compile_options = self.options

    def options(self, *args: Any, env_options_overrides: dict[str, Any] | None = None, **kwargs: Any) -> Any:
        chosen = WAYS[self.way] | (env_options_overrides or {})
        return self.collect(*args, env_options_overrides=chosen, **kwargs)

    def choose(self, file: Path, way: str) -> None:
        """What was compiled in another way, or for another file, goes: processes grew to four gigabytes.

        Looking for what else went with it takes a third of a second, and is worth it where there is much.
        """
        if (file, way) != (self.file, self.way):
            self.file, self.way = file, way
            jax.clear_caches()
            if psutil.Process().memory_info().rss > MUCH_BYTES:
                gc.collect()
                TRIM(0)


COMPILATION = Compilation()


def way_of(item: pytest.Item) -> str:
    """How a test is compiled."""
    marked = [mark.name for mark in item.iter_markers() if mark.name in WAYS]
    return os.environ.get(WAY_VARIABLE) or next(iter(marked), QUICK)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    COMPILATION.choose(item.path, way_of(item))
    DRAWING.choose(item.get_closest_marker("drawn") is not None)


class Drawing:
    """Figures that runs write: of a sort the first is rendered, and the others, in all processes, are copies of it.

    A sort is known by the name of the figure, its look, and the number and scales of its axes. Rendering took a third
    of the tests of experiments, nearly all of which look at tables and at words. Where files of figures are looked at
    or compared, tests are marked ``drawn``, and every figure is rendered.
    """

    def __init__(self) -> None:
        self.always = True
        self.render: Any = None
        self.known: dict[Any, dict[str, bytes]] = {}

    def choose(self, always: bool) -> None:
        self.always = always
        files = sys.modules.get("pl_mc.report.files")
        if files is not None and self.render is None:
            self.render, files.save_figure = files.save_figure, self.save  # type: ignore[attr-defined]

    def save(self, figure: Any, folder: Path, name: str) -> str:
        from pl_mc.report.look import look_now

        look = look_now()
        sort = (name, look, tuple((axes.get_xscale(), axes.get_yscale()) for axes in figure.axes))
        # What could not be drawn has no axes.
        known = self.rendered(sort) if figure.axes and not self.always else None
        if known is None:
            why = str(self.render(figure, folder, name))
            if not why:
                self.keep(sort, [folder / f"{name}.{ending}" for ending in look.endings])
            return why
        for axes in figure.axes:
            # Names of ticks, which are words of the figure, are made when they are asked for.
            axes.get_xticklabels()
            axes.get_yticklabels()
        for file, content in known.items():
            (folder / file).write_bytes(content)
        return ""

    def rendered(self, sort: Any) -> dict[str, bytes] | None:
        """Files of a sort, by name, that this process or one beside it has rendered."""
        place = self.place(sort)
        if sort not in self.known and place.is_file():
            self.known[sort] = pickle.loads(place.read_bytes())
        return self.known.get(sort)

    def keep(self, sort: Any, files: list[Path]) -> None:
        self.known[sort] = {file.name: file.read_bytes() for file in files}
        place = self.place(sort)
        place.parent.mkdir(exist_ok=True)
        own = place.with_suffix(f".{os.getpid()}")
        own.write_bytes(pickle.dumps(self.known[sort]))
        own.replace(place)

    def place(self, sort: Any) -> Path:
        digest = hashlib.sha256(repr(sort).encode()).hexdigest()
        return Path(os.environ[CACHE_VARIABLE], "figures", f"{digest}.pickle")


DRAWING = Drawing()


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs make no figures, for tests of tables: a figure that fails costs itself alone, and other tests look at it."""
    monkeypatch.setattr("pl_mc.report.files.write_pictures", lambda *_: ((), {}))


# Files by how long they take, longest first: what comes last should be short, so that no process waits for another.
LONGEST = (
    "docs/test_documents.py",
    "integrity_risk/test_horizontal_risk.py",
    "experiments/test_frontier.py",
    "docs/test_site.py",
    "experiments/test_axes_of_every_kind.py",
    "benchmark/test_bench.py",
    "cli/test_observe.py",
    "kernels/test_twins.py",
    "methods/test_protocol.py",
    "experiments/test_axes_of_experiments.py",
    "methods/test_sandwich.py",
    "integrity_risk/test_worst_case.py",
    "integrity_risk/test_tuning.py",
    "kernels/test_transformations.py",
    "engine/test_sweep_cut.py",
    "experiments/test_figures_for_print.py",
    "integrity_risk/test_given_residuals.py",
    "methods/test_parameters.py",
    "kernels/test_kernels_against_reference.py",
    "experiments/test_ramps_and_maps.py",
    "methods/test_robust_estimators.py",
    "integrity_risk/test_rare.py",
    "conformance/test_conform.py",
    "receiver/test_receiver_data.py",
    "methods/test_separated.py",
    "integrity_risk/test_continuity.py",
    "experiments/test_observed_claims.py",
    "cli/test_stopping.py",
    "fuzzing/test_fuzzing.py",
    "integrity_risk/test_laws_of_errors.py",
    "engine/test_drawn_faults.py",
    "integrity_risk/test_budget.py",
    "araim/test_araim_method_ism.py",
    "kernels/test_one_call.py",
    "integrity_risk/test_calibrate.py",
    "methods/test_araim_exclusion.py",
)


def pytest_unconfigure() -> None:
    if OWN_CACHE:
        shutil.rmtree(OWN_CACHE, ignore_errors=True)


def pytest_collection_finish() -> None:
    """What was imported stays: a fifth of the time of small tests went into looking through it for garbage."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(300_000, 20, 20)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Longest files first; in a file what is compiled in one way together, so that it is compiled once."""
    longest = [Path(__file__).parent / name for name in LONGEST]
    rank = {path: k for k, path in enumerate(dict.fromkeys([*longest, *(item.path for item in items)]))}
    items.sort(key=lambda item: (rank[item.path], list(WAYS).index(way_of(item))))
