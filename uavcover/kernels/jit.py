"""Rules for kernels: compilation, arguments, state, and the cache of machine code.

**What a kernel takes.** Numbers, NumPy arrays, tuples and NamedTuples of these, other kernels, and a ``np.random.Generator``;
no dataclass, dictionary, string or callback. Arrays are C-contiguous and of the type that the annotation states; a read-only
array and a writable one are two compiled versions (:func:`uavcover.kernels.arrays.read_only` makes them one). A group of values
that belong together is a NamedTuple (``Surface``, ``Sight``, ``Cells``, ``SearchProblem``).

**Who owns arrays.** The caller: a :func:`kernel` makes none and does not count their users (numba's run-time library, NRT).
Counting takes two atomic operations for each array of a group in each call, which was about half of the time of a local
search. A kernel that makes arrays is an :func:`allocating_kernel`.

**What a kernel changes.** Nothing that it is given, unless its docstring says which array it writes. Working memory that
outlives a call is a NamedTuple of arrays that owns them (``RouteState``), made by the caller and used by one thread at a
time; its docstring names the owner.

**What a kernel keeps.** Nothing between calls: no module state, no clock, no global random stream. Module constants are
compiled in.

**Settings.** No fastmath: no-data is NaN, and NaN must stay NaN. ``nogil`` lets threads evaluate routes side by side.
``NUMBA_DISABLE_JIT=1`` runs kernels as plain Python, for debugging and for measuring test coverage.

**Cache.** Numba's own cache checks the file that a function stands in, but not the files of the kernels that are compiled
into it. Here each file of kernels, in an extra too, has a folder for one state of its source, of the kernels that it imports,
directly or not, of numba and of numpy; another state has another folder. So machine code is never older than its sources, and a
change in one file recompiles what depends on it and nothing else. The folders are beside the sources of this package, in the
user's cache where that cannot be written to, or in ``NUMBA_CACHE_DIR`` where that is set; where none of them can be used, kernels
are compiled in every run.
"""

import contextlib
import functools
import hashlib
import importlib
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite
import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.misc.appdirs import AppDirs

SETTINGS: Any = numba.config
"""Of numba, from its environment variables."""

_FOLDER = "kernels"
_KEPT = 3
"""States of a file whose machine code is kept: this one and the latest others, for work on two branches."""
_PACKAGE = Path(__file__).parents[1]
_IMPORT = re.compile(rf"^\s*(?:from|import) {_PACKAGE.name}\.([\w.]+)(?: import (\w+))?", re.MULTILINE)


def keep_compiled(dispatcher: Any) -> None:
    """Let a compiled function load and store its machine code, if a folder for it exists."""
    if root() is not None:
        # As numba's ``cache=True``, with another class of cache.
        dispatcher._cache = _KernelCache(dispatcher.py_func)  # type: ignore[no-untyped-call]


@functools.cache
def root() -> Path | None:
    """The folder of all machine code, created if necessary; None if no folder is writable."""
    of_user = AppDirs(appname="uavcover", appauthor=False).user_cache_dir  # type: ignore[no-untyped-call]
    locations = [Path(__file__).parent / "__pycache__", Path(of_user)]
    if SETTINGS.CACHE_DIR:
        locations.insert(0, Path(SETTINGS.CACHE_DIR))
    for location in locations:
        with contextlib.suppress(OSError):
            (location / _FOLDER).mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=location / _FOLDER).close()
            return location / _FOLDER
    return None


@functools.cache
def folder(source: Path) -> Path | None:
    """The folder of this state of a file of kernels; created if necessary, older ones removed; None without a folder."""
    location = root()
    if location is None:
        return None
    found = location / f"{source.stem}-{_key(source)}"
    with contextlib.suppress(OSError):
        if not found.is_dir():
            found.mkdir(exist_ok=True)
            _remove_old(location, source.stem)
        os.utime(found)  # newer than unused ones
    return found


def _key(source: Path) -> str:
    """Dependencies of machine code that numba does not check (it checks the processor and the version of Python)."""
    state = hashlib.sha256()
    settings = (SETTINGS.OPT, SETTINGS.BOUNDSCHECK)
    state.update(repr((numba.__version__, llvmlite.__version__, np.__version__, settings)).encode())
    for file in (Path(__file__), *sorted(_sources(source))):
        content = file.read_bytes()
        state.update(f"{file.name} {len(content)}\n".encode() + content)
    return state.hexdigest()[:20]


def _sources(source: Path) -> set[Path]:
    """A file of kernels and all files of kernels that it imports, directly or indirectly."""
    found: set[Path] = set()
    ahead = [source]
    while ahead:
        file = ahead.pop()
        if file not in found and file.is_file():
            found.add(file)
            for module, name in _IMPORT.findall(file.read_text(encoding="utf-8")):
                location = _PACKAGE.joinpath(*module.split("."))
                ahead += [location.with_suffix(".py"), location / f"{name}.py"]
    return found


def _remove_old(location: Path, stem: str) -> None:
    ages = {path: path.stat().st_mtime_ns for path in location.glob(f"{stem}-*") if path.is_dir()}
    for path in sorted(ages, key=lambda path: ages[path], reverse=True)[_KEPT:]:
        shutil.rmtree(path, ignore_errors=True)
    for path in location.parent.glob(f"{_FOLDER}-*"):  # of versions that kept all files together
        shutil.rmtree(path, ignore_errors=True)


class _Locator:
    """Locates the machine code of a kernel for numba, with its key."""

    def __init__(self, function: Callable[..., object], file: str, location: Path) -> None:
        self._py_file = file  # named so in numba's warnings
        self._line = function.__code__.co_firstlineno
        self._location = location

    @classmethod
    def from_function(cls, function: Callable[..., object], file: str) -> "_Locator | None":
        location = folder(Path(file))
        return None if location is None else cls(function, file, location)

    def ensure_cache_path(self) -> None:
        self._location.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        return str(self._location)

    def get_source_stamp(self) -> str:
        return self._location.name

    def get_disambiguator(self) -> str:
        return str(self._line)


class _KernelCacheFiles(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # type: ignore[list-item]  # noqa: RUF012 - as the base class has it


class _KernelCache(FunctionCache):
    """Numba's cache of one function in our folder: unreadable code is compiled again, write errors are ignored."""

    _impl_class = _KernelCacheFiles

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function of a signature; None if it is not cached."""
        _load_array_functions()
        return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            found = super()._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except OSError:
            return None
        except Exception:  # a broken pickle can raise almost any error
            self.flush()  # type: ignore[no-untyped-call]
            return None
        # Two processes that save at the same moment may give two files of machine code one name.
        return found if found is None or found.signature.args == tuple(sig) else None

    @contextlib.contextmanager
    def _guard_against_spurious_io_errors(self) -> Iterator[None]:
        with contextlib.suppress(OSError):
            yield


@functools.cache
def _load_array_functions() -> None:
    """Load numba's functions of arrays without SciPy's linear algebra, which takes 0.1 s and which no kernel needs.

    Numba loads both before its first kernel, to know whether ``np.kron`` can be compiled.
    """
    blas = "scipy.linalg.cython_blas"
    if blas not in sys.modules:
        sys.modules[blas] = None  # type: ignore[assignment] # not found
        try:
            importlib.import_module("numba.np.arraymath")
        finally:
            del sys.modules[blas]


_F = TypeVar("_F", bound=Callable[..., object])


def kernel(function: _F) -> _F:
    """Compile ``function`` to machine code on its first call. It makes no arrays; the compiler refuses one that does."""
    return _compiled(function, counts=False)


def allocating_kernel(function: _F) -> _F:
    """:func:`kernel` for a function that makes arrays or lists, or calls one that returns them."""
    return _compiled(function, counts=True)


def inlined_kernel(function: _F) -> _F:
    """A kernel with one caller, in the same file: compiled as a part of it.

    A kernel is compiled together with all that it calls, so each one between two others compiles the inner one once more.
    """
    return _compiled(function, counts=True, inline="always")


def _compiled(function: _F, *, counts: bool, inline: str = "never") -> _F:
    """``counts``: whether to count users of arrays; a kernel passes this on to its callees unless they set it."""
    # numba's stubs do not know _nrt
    settings: dict[str, Any] = {"nogil": True, "fastmath": False, "_nrt": counts, "inline": inline}
    compiled = numba.njit(**settings)(function)
    if not SETTINGS.DISABLE_JIT:
        keep_compiled(compiled)
        _forget_values(compiled)
    return cast(_F, compiled)


def _forget_values(dispatcher: Any) -> None:
    """Let kernels that call it with a number share one version; numba compiles one for each number it reads."""
    template = dispatcher.get_call_template

    def of_types(args: Sequence[Any], kws: dict[str, Any]) -> Any:
        return template(tuple(map(numba.types.unliteral, args)), kws)

    dispatcher.get_call_template = of_types
