"""Saving what pymoo's algorithms hold: a pickle that also finds functions which pymoo's decorators have made nameless."""

import io
import pickle
import sys
from importlib import import_module
from types import FunctionType
from typing import Any


def pickled(value: object) -> bytes:
    """``value`` as bytes, for ``pickle.loads``.

    Raises:
        pickle.PicklingError, AttributeError, TypeError: Something in it cannot be pickled.
    """
    buffer = io.BytesIO()
    _Pickler(buffer).dump(value)
    return buffer.getvalue()


class _Pickler(pickle.Pickler):
    def reducer_override(self, obj: Any) -> Any:
        # A decorator without functools.wraps leaves the name of its own inner function on what is a module's public one.
        if isinstance(obj, FunctionType) and "<locals>" in obj.__qualname__:
            for module_name, module in list(sys.modules.items()):
                if module_name.startswith("pymoo."):
                    for name, value in vars(module).items():
                        if value is obj:
                            return _member, (module_name, name)
        return NotImplemented


def _member(module_name: str, name: str) -> Any:
    return getattr(import_module(module_name), name)
