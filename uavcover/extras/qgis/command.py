"""``uavcover qgis-plugin``: write the plugin for QGIS."""

import io
import shutil
import sys
import zipfile
from importlib import metadata
from pathlib import Path
from typing import Annotated

from uavcover.cli import options
from uavcover.cli.options import option

PLUGIN = Path(__file__).parent / "plugin"
_DATE = (2026, 1, 1, 0, 0, 0)
"""Of every file in the zip: the same version gives the same bytes."""


def qgis_plugin(
    out: Annotated[Path, option("-o", "--out", "Zip file to write.", "FILE")],
    *,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Write a plugin for QGIS 3.22 or newer with the Processing algorithms new, plan, check, verify, judge photos and export.

    Install the file in QGIS with Plugins > Manage and Install Plugins > Install from ZIP. The plugin runs the uavcover that wrote
    it, as a separate program.
    """
    from uavcover.errors import OutputError
    from uavcover.run.file_group import write_file

    console = output.console()
    if out.exists() and not force:
        raise OutputError(f"{out} already exists; use --force to overwrite it, or choose another name")
    write_file(out, plugin_zip(program=_program()))
    console.say(f"wrote {out}")
    console.say(
        "in QGIS, select Plugins > Manage and Install Plugins > Install from ZIP; the tools are then in Processing > "
        "Toolbox > uavcover"
    )
    console.result({"file": str(out)})
    return 0


def plugin_zip(*, program: list[str]) -> bytes:
    """The plugin as the bytes of a zip file."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        texts = {path.name: path.read_text(encoding="utf-8") for path in sorted(PLUGIN.iterdir()) if path.is_file()}
        texts["metadata.txt"] = texts["metadata.txt"].replace("@VERSION@", metadata.version("uavcover"))
        texts["program.py"] = (
            f'"""The command that runs uavcover, as of the installation that wrote this plugin."""\n\nPROGRAM = {program!r}\n'
        )
        for name, text in texts.items():
            archive.writestr(zipfile.ZipInfo(f"uavcover/{name}", _DATE), text)
    return content.getvalue()


def _program() -> list[str]:
    """The ``uavcover`` beside this Python, or this Python with the module."""
    beside = Path(sys.executable).with_name("uavcover")
    if beside.is_file():
        return [str(beside)]
    found = shutil.which("uavcover")
    return [found] if found is not None else [sys.executable, "-m", "uavcover"]
