"""The plan of a run folder, read back."""

from uavcover.run.documents import PlannedDocument, read_plan_document
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site, load_site


def read_planned(run: RunFolder) -> tuple[Site, PlannedDocument]:
    """Site and chosen route of a run folder.

    Raises:
        InputError: a file is missing or broken; says which command makes it.
    """
    site = load_site(run.existing("scenario.toml", made_by="uavcover plan"))
    document = run.read_json("plan.json", made_by="uavcover plan")
    return site, read_plan_document(document, source=str(run.file("plan.json")))
