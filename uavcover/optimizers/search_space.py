"""The box of allowed decision vectors, and the two ways to sample it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uavcover.errors import OptimizerError
from uavcover.optimizers.interface import FloatArray
from uavcover.optimizers.solutions import finite_array, read_only


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """All x with ``lower <= x <= upper``; both ``(d,)``, read-only, finite. Equal ends fix a variable."""

    lower: FloatArray
    upper: FloatArray

    @classmethod
    def checked(cls, lower: npt.ArrayLike, upper: npt.ArrayLike) -> "Box":
        """A box from what a caller gave.

        Raises:
            OptimizerError: The bounds are empty, of different length, not finite, or inverted.
        """
        low, high = finite_array(lower, "lower bounds"), finite_array(upper, "upper bounds")
        if low.ndim != 1 or low.size == 0 or low.shape != high.shape:
            raise OptimizerError(
                f"bounds have shapes {low.shape} and {high.shape}: give two lists with one entry per variable"
            )
        inverted = np.flatnonzero(low > high)
        if inverted.size:
            j = int(inverted[0])
            raise OptimizerError(f"bounds of variable {j} are inverted: lower {low[j]} > upper {high[j]}: swap them")
        with np.errstate(over="ignore"):
            if not np.isfinite(high - low).all():
                raise OptimizerError("bounds are too far apart for floating point: upper - lower must be finite")
        return cls(read_only(low), read_only(high))

    @property
    def n_variables(self) -> int:
        """The number of variables, d."""
        return len(self.lower)

    def contains(self, x: FloatArray) -> bool:
        """Whether all rows of ``x`` ``(n, d)`` are inside."""
        return bool(((x >= self.lower) & (x <= self.upper)).all())

    def clipped(self, x: FloatArray) -> FloatArray:
        """``x`` ``(n, d)`` with every coordinate that left the box put on the bound it crossed."""
        return np.clip(x, self.lower, self.upper)

    def scaled(self, unit: FloatArray) -> FloatArray:
        """Points ``(n, d)`` of the unit cube stretched onto the box."""
        return self.clipped(self.lower + unit * (self.upper - self.lower))  # Eq. 19; clipped only against rounding

    def uniform(self, n: int, rng: np.random.Generator) -> FloatArray:
        """``(n, d)`` independent uniform samples."""
        return self.scaled(rng.random((n, self.n_variables)))

    def latin_hypercube(self, n: int, rng: np.random.Generator) -> FloatArray:
        """``(n, d)`` samples, exactly one in each of the n equal slices of every variable."""
        # scipy.stats takes a second to import, which commands that plan nothing need not wait for.
        from scipy.stats import qmc

        # A drawn integer and not rng itself: scipy would spawn from it, which depends on more than its saved state.
        own_seed = int(rng.integers(2**63))
        return self.scaled(qmc.LatinHypercube(self.n_variables, rng=own_seed).random(n))
