"""How kernels are compiled and where their machine code is kept.

Numba's own cache looks at the file of the function that is called, not at those it calls in turn. The folder used here
carries a digest of every kernel's source, so that no stale machine code can be loaded.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

from robots.cache import cache_dir, content_hash

_Function = TypeVar("_Function", bound=Callable[..., Any])

DIGEST = content_hash(*[path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py"))])
"""Of the sources in this folder."""

if "NUMBA_CACHE_DIR" not in os.environ:
    numba.config.CACHE_DIR = str(cache_dir() / "kernels" / DIGEST)


def kernel(function: _Function) -> _Function:
    """The compiled function, to be called from others: without the interpreter's lock, floating point as written."""
    made = numba.njit(nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
    return cast(_Function, made(function))


def part(function: _Function) -> _Function:
    """As ``kernel``, but written into its caller before anything is compiled: for large functions called once."""
    return cast(_Function, numba.njit(nogil=True, error_model="numpy", inline="always")(function))


def lanes(function: _Function) -> _Function:
    """As ``kernel``, but sums and minima may be reordered: for loops over lanes, whose results are padded."""
    made = numba.njit(
        nogil=True,
        error_model="numpy",
        no_cpython_wrapper=True,
        no_cfunc_wrapper=True,
        fastmath={"nnan", "nsz", "contract", "reassoc", "arcp"},
    )
    return cast(_Function, made(function))


def entry(function: _Function) -> _Function:
    """As ``kernel``, but to be called from Python, and kept on disk with all that it calls."""
    return cast(_Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
