"""What every optimizer offers: ask for candidates, tell what they are worth, read the Pareto set.

The optimizer proposes, the caller evaluates: however, wherever and in as many processes as it likes. All objectives are
minimised; a constraint is a number that is > 0 when violated.
"""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
State = dict[str, object]


@dataclass(frozen=True, slots=True, eq=False)
class ParetoSet:
    """The best that was found; all arrays are read-only and share their rows.

    Attributes:
        x: ``(k, d)`` decision vectors, k = solutions, d = variables.
        objectives: ``(k, m)``, minimised, m = objectives.
        violations: ``(k, c)``, > 0 where violated, c = constraints.
        feasible: True when every row keeps every constraint. False when no feasible point is known: then the rows are
            the ones with the smallest total violation, and non-dominated among themselves.
    """

    x: FloatArray
    objectives: FloatArray
    violations: FloatArray
    feasible: bool

    def __len__(self) -> int:
        """The number of solutions."""
        return len(self.x)


class Optimizer(Protocol):
    """A multi-objective optimizer that is asked and told, one whole population at a time.

    A round is one ``ask`` and one successful ``tell``. Round 0 samples the first population, the others move it.
    """

    @property
    def iteration(self) -> int:
        """Rounds completed so far."""
        ...

    @property
    def evaluations(self) -> int:
        """Candidates whose values have been told so far."""
        ...

    @property
    def should_stop(self) -> bool:
        """True once all rounds are done."""
        ...

    def ask(self) -> FloatArray:
        """The candidates to evaluate next.

        Asking again before telling returns the same candidates.

        Returns:
            ``(n, d)`` read-only, inside [lower, upper]; n = population size, d = variables.

        Raises:
            OptimizerError: All rounds are done.
        """
        ...

    def tell(self, objectives: npt.ArrayLike, violations: npt.ArrayLike | None = None) -> None:
        """Give the values of the candidates asked last, in their order.

        Args:
            objectives: ``(n, m)``, finite, minimised; m = objectives.
            violations: ``(n, c)``, finite, > 0 where violated; c = constraints. May be left out when c is 0. Their
                positive parts are summed, so constraints should be of comparable scale.

        Raises:
            OptimizerError: Nothing was asked, a shape is wrong, or a value is not finite. Nothing has changed then: the
                same candidates can be told again.
        """
        ...

    def pareto_set(self) -> ParetoSet:
        """The non-dominated solutions kept so far; feasible ones if there are any, else the least violating.

        Raises:
            OptimizerError: Nothing has been told yet.
        """
        ...

    def state_dict(self) -> State:
        """All that is needed to go on later, random streams included: dicts, numbers, strings and copied arrays."""
        ...

    @classmethod
    def from_state(cls, state: State) -> Self:
        """The optimizer that ``state_dict`` described; it continues exactly as the saved one would have.

        Raises:
            OptimizerError: The state belongs to another algorithm.
        """
        ...
