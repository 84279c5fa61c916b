"""Double precision for every test, and programs that compile fast and are kept in pytest's cache.

The library itself never touches `jax.config`. What the processes that tests start compile is not
kept in the user's cache folder. Types are checked in some calls of each function, since checking
all takes twice as long as the tests.
"""

import ctypes
import functools
import gc
import inspect
import os
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import suppress

import hypothesis
import jaxtyping
import psutil
import pytest

from tests import compile_fast

LARGEST_WORKER = psutil.virtual_memory().total / (os.cpu_count() or 1) / 4
"""Memory of a worker from which it lets go of its compiled programs [bytes]: with one worker on
each core, a quarter of all."""

CHECKED_CALLS = 5
"""First calls of a function in each test whose types are checked; then every hundredth is."""


compile_fast()
os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "0"

import jax

jax.config.update("jax_enable_x64", True)
for name, repeatable in (("repeatable", True), ("fresh", False)):
    hypothesis.settings.register_profile(  # a busy machine fails no test
        name,
        deadline=None,
        derandomize=repeatable,
        suppress_health_check=(hypothesis.HealthCheck.too_slow,),
    )
hypothesis.settings.load_profile("repeatable")

_calls: Counter[int] = Counter()


def _check_some(check_types: Callable) -> Callable:
    """A decorator like one of jaxtyping, which checks a function's types in some of its calls."""

    def decorate(function: Callable) -> Callable:
        if inspect.isclass(function):
            return check_types(function)
        code = id(function.__code__)  # that of an inner function is the same in all calls
        checked = functools.cache(lambda: check_types(function))  # made if the function is called

        @functools.wraps(function)
        def call(*args, **kwargs):
            _calls[code] = count = _calls[code] + 1
            checks = count <= CHECKED_CALLS or count % 100 == 0
            return (checked() if checks else function)(*args, **kwargs)

        return call

    return decorate


_jaxtyped = jaxtyping.jaxtyped
jaxtyping.jaxtyped = lambda **options: _check_some(_jaxtyped(**options))  # what the hook applies


@pytest.fixture(autouse=True)
def _count_calls_anew():
    _calls.clear()


def pytest_configure(config: pytest.Config) -> None:
    """Keep compiled programs in pytest's cache, for the other workers and for the next run."""
    cache = getattr(config, "cache", None)  # none with `-p no:cacheprovider`
    if cache is None:
        return
    jax.config.update("jax_enable_compilation_cache", True)
    jax.config.update("jax_compilation_cache_dir", str(cache.mkdir("jax")))
    jax.config.update("jax_compilation_cache_max_size", 2**30)  # where it is bounded it is locked
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


@pytest.fixture(autouse=True, scope="module")
def _bound_memory():
    """Let go of compiled programs, which are most of a worker's memory, once it has grown.

    Only between files, because the tests of a file share programs: those that call the host, or
    compile in less than 0.2 s, would be compiled again.
    """
    yield
    if psutil.Process().memory_info().rss > LARGEST_WORKER:
        jax.clear_caches()
        gc.collect()
        if sys.platform == "linux":
            with suppress(AttributeError):  # glibc keeps what was freed until it is asked
                ctypes.CDLL(None).malloc_trim(0)


@pytest.fixture
def unchecked():
    """As users run it: without the type checks of the tests."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
