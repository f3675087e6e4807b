"""JSON documents whose values know their path, so that an error can name it."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from mission_io.errors import FormatError

ResultT = TypeVar("ResultT")

_LARGEST = 1e300
"""Larger numbers are treated as mistakes (1e999 would read as infinite)."""


@dataclass(frozen=True, slots=True)
class Node:
    """A value in the document with its location."""

    value: Any
    where: str

    def get(self, key: str) -> "Node":
        """The value of a required key."""
        if not isinstance(self.value, Mapping):
            raise FormatError("expected an object", where=self.where)
        if key not in self.value:
            raise FormatError("the key is missing", where=f"{self.where}.{key}")
        return Node(self.value[key], f"{self.where}.{key}")

    def optional(self, key: str, read_node: "Callable[[Node], ResultT]", default: ResultT) -> ResultT:
        """The value of an optional key."""
        missing = isinstance(self.value, Mapping) and key not in self.value
        return default if missing else read_node(self.get(key))

    def nodes(self) -> list["Node"]:
        """The entries of a list."""
        if not isinstance(self.value, list):
            raise FormatError("expected a list", where=self.where)
        return [Node(value, f"{self.where}[{index}]") for index, value in enumerate(self.value)]

    def number(self) -> float:
        """A number as a double."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float) or abs(self.value) > _LARGEST:
            raise FormatError(f"expected a number, not {_shown(self.value)}", where=self.where)
        return float(self.value)

    def whole(self) -> int:
        """A number without a fraction."""
        value = self.number()
        if value != int(value):
            raise FormatError(f"expected a whole number, not {value}", where=self.where)
        return int(value)

    def truth(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise FormatError("expected true or false", where=self.where)
        return self.value

    def text(self) -> str:
        """A string."""
        if not isinstance(self.value, str):
            raise FormatError("expected a string", where=self.where)
        return self.value

    def floats(self, size: int) -> list[float]:
        """A list of a given number of numbers."""
        nodes = self.nodes()
        if len(nodes) != size:
            raise FormatError(f"expected {size} numbers, not {len(nodes)}", where=self.where)
        return [node.number() for node in nodes]


def parse_json(text: str, name: str) -> Node:
    """Parse a document, whose root is called ``name`` in errors.

    Raises:
        FormatError: invalid JSON, nesting too deep, or NaN and other numbers that JSON does not have.
    """
    try:
        return Node(json.loads(text, parse_constant=_refuse_constant), name)
    except RecursionError:
        raise FormatError("the JSON is nested too deeply", where=name) from None
    except json.JSONDecodeError as error:
        raise FormatError(f"cannot read the file as JSON: {error.msg}", where=f"line {error.lineno}") from None
    except ValueError as error:
        raise FormatError(f"cannot read a number: {error}"[:80], where=name) from None


def _refuse_constant(name: str) -> float:
    raise ValueError(name)


def _shown(value: Any) -> str:
    """A value in short form, even one with a million entries or digits."""
    if isinstance(value, str):
        return repr(value[:20])
    if isinstance(value, int | float) and not isinstance(value, bool):
        return "a number that is too large"
    return {dict: "an object", list: "a list", bool: "true or false"}.get(type(value), "null")
