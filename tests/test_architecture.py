"""docs/explanation/architecture.md says what the tree is, and the tree does not grow beyond it."""

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "explanation" / "architecture.md"
ROW = re.compile(r"^\| ([^|]+?) \| *\d* *\| *\d* *\| (\d+) \| *\d* *\|$", re.MULTILINE)


def test_no_figure_is_above_what_the_page_states() -> None:
    command = [sys.executable, str(ROOT / "scripts" / "docs" / "measure_architecture.py"), "--json"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout
    counted: dict[str, int] = json.loads(shown)
    stated = {name: int(today) for name, today in ROW.findall(PAGE.read_text(encoding="utf-8"))}
    assert set(stated) == set(counted)
    grown = {name: (counted[name], stated[name]) for name in counted if counted[name] > stated[name]}
    assert not grown, "counted, stated: join or delete something, or state it with its reason in the commit"


def test_every_path_that_the_map_names_is_there() -> None:
    """In backticks, under uavcover unless it begins with mission_io, docs or tests; a first cell of a table row, too."""
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    below = text.index("## Where to begin")
    named = set(re.findall(r"`([a-z_]+(?:/[a-z_]+)*/?(?:\.py|\.toml)?)`", text[below:]))
    named |= {
        path
        for row in re.findall(r"^\| (`[^|]+/`[^|]*) \|", text[:below], re.MULTILINE)
        for path in re.findall(r"`([^`]+)`", row)
    }
    roots = (ROOT / "uavcover", ROOT, ROOT / "mission_io")
    paths = sorted(path for path in named if "/" in path or path.endswith((".py", ".toml")))
    assert len(paths) > 30
    assert [path for path in paths if not any((root / path).exists() for root in roots)] == []
