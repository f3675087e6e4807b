"""What a planner would have handed over had it been stopped earlier: one run tells all its moments."""

from collections.abc import Callable, Sequence

from uavcover.model.route import Route

NamedRoute = tuple[Route, str]
"""A route and what made it: the algorithm, or the name of a baseline."""


class Snapshots:
    """The routes that were worth judging at given moments of a run, and at its end.

    Attributes:
        moments_s: when, by the effort's clock, since planning started; ascending.
        taken: the routes by moment; a moment that the run did not reach has what the run ended with.
        last: the routes at the end.
    """

    def __init__(self, moments_s: Sequence[float]) -> None:
        self.moments_s = tuple(sorted(moments_s))
        self.taken: dict[float, tuple[NamedRoute, ...]] = {}
        self.last: tuple[NamedRoute, ...] = ()

    def look(self, elapsed_s: float, found: Callable[[], Sequence[NamedRoute]]) -> None:
        """Keep what ``found`` gives for every moment that has passed and has nothing yet; else ``found`` is not called."""
        due = [moment for moment in self.moments_s if moment <= elapsed_s and moment not in self.taken]
        if due:
            self.taken |= dict.fromkeys(due, tuple(found()))

    def close(self, routes: Sequence[NamedRoute]) -> None:
        """Keep what the run ended with."""
        self.last = tuple(routes)
        self.taken |= {moment: self.last for moment in self.moments_s if moment not in self.taken}
