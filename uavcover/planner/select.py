"""Another route of a Pareto set that is in a run folder already."""

from collections.abc import Sequence

from uavcover.errors import InfeasibleError, InputError
from uavcover.missions.flights import compile_flights, one_or_several
from uavcover.missions.objectives import judge_route
from uavcover.missions.sorties import Sortie
from uavcover.model.route import Plan, RouteMember
from uavcover.model.vehicle import AutopilotName
from uavcover.planner.pareto_file import read_pareto, read_pareto_routes
from uavcover.planner.plan_files import fleet_document, save_plan
from uavcover.planner.selection_rule import parse_rule, select, with_sizes
from uavcover.run.documents import read_plan_document
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import groups_of

_ROUTES = "pareto_routes.csv"


def read_members(run: RunFolder, site: Site) -> list[RouteMember]:
    """The Pareto set of a run folder, judged anew on the cells of the area.

    Raises:
        InputError: a file is missing or broken; says which command makes it.
    """
    path = run.existing(_ROUTES, made_by="uavcover plan")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: the file cannot be read ({error}); create it again with: uavcover plan") from error
    routes = read_pareto_routes(text, source=str(path))
    makers = [entry.made_by for entry in read_pareto(run.existing("pareto.csv", made_by="uavcover plan"))]
    if len(makers) != len(routes):
        raise InputError(
            f"{path}: the file has {len(routes)} routes, but pareto.csv has {len(makers)}; create both files again "
            "with: uavcover plan"
        )
    groups = len(groups_of(site.scenario)) or 1
    if any(len(route.parts) != groups for route in routes):
        raise InputError(f"{path}: each route must have {groups} parts; create the file again with: uavcover plan")
    return [judge_route(site, route, maker, margin_m=0.0) for route, maker in zip(routes, makers, strict=True)]


def choose(
    run: RunFolder, site: Site, rule_text: str, *, autopilot: AutopilotName, command: Sequence[str]
) -> tuple[Plan, tuple[Sortie, ...], RunFolder | None]:
    """Choose another member by a rule, and write ``plan.json``, ``pareto.csv`` and the mission files for it.

    Files of the previous route are removed too; one that was flown is kept in a folder of its own.

    Returns:
        The plan, its flights (none for a scenario that has no position on Earth), and where the route before is kept.

    Raises:
        InputError: the rule is none, or a file of the run is missing or broken.
        InfeasibleError: the route has no checked mission; nothing is written.
    """
    rule = parse_rule(rule_text)
    members = read_members(run, site)
    document = run.read_json("plan.json", made_by="uavcover plan")
    choice = select(members, rule)
    chosen = members[choice.index]
    try:
        result = Plan(
            chosen=chosen, members=tuple(members), baselines=(), rule=rule.text, rule_met=choice.met,
            algorithm=str(document["algorithm"]), evaluations=int(document["evaluations"]),
            wall_s=float(document["wall_s"]), interrupted=bool(document["interrupted"]),
        )  # fmt: skip
        seed, bounds, baselines = int(document["seed"]), dict(document["bounds"]), list(document["baselines"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{run.file('plan.json')}: cannot read the file as a plan ({type(error).__name__}: {error}); create it "
            "again with: uavcover plan"
        ) from error
    vehicles = read_plan_document(document, source=str(run.file("plan.json"))).vehicles
    result = with_sizes(site, result, autopilot=autopilot, vehicles=vehicles)
    flights: tuple[Sortie, ...] = ()
    if site.frame is not None and site.home_m is not None:
        try:
            flights = compile_flights(site, result.chosen.route, autopilot=autopilot, vehicles=vehicles)
        except InfeasibleError as error:
            index = result.members.index(result.chosen)
            raise InfeasibleError(f"member {index}: {error}; {run} was not changed") from error
    compiled, sorties = one_or_several(site, flights)
    older = save_plan(
        run, site, result, compiled=compiled, autopilot=autopilot, seed=seed,
        command=command, sorties=sorties, proved=bounds, baselines=baselines,
        fleet=fleet_document(site, flights) if vehicles > 1 else None,
    )  # fmt: skip
    return result, flights, older
