"""``uavcover doctor``: what is installed, what works, what the optional parts would need."""

from typing import Annotated

import typer

from uavcover.cli import options


def doctor(
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = 0,
    imports: Annotated[bool, typer.Option(help="Try every package, not only look it up.")] = True,
) -> int:
    """Say what is installed, what works, and what each optional part would need."""
    from uavcover.cli.console import Console
    from uavcover.cli.examination import examine

    console = Console(as_json=as_json, verbosity=options.verbosity(quiet, verbose))
    findings = examine(try_imports=imports)
    for finding in findings:
        console.say(
            f"{'ok     ' if finding.ok else 'MISSING' if finding.needed else 'absent '} {finding.name:28} {finding.text}"
        )
    healthy = all(finding.ok for finding in findings if finding.needed)
    console.result({"healthy": healthy, "findings": [vars_of(finding) for finding in findings]})
    return 0 if healthy else 1


def vars_of(finding: object) -> dict[str, object]:
    """A finding as a dictionary."""
    import dataclasses

    return dataclasses.asdict(finding)  # type: ignore[call-overload, no-any-return]
