"""What README and docs say can be followed: links lead somewhere, commands and scenario keys exist, examples are valid."""

import dataclasses
import importlib.util
import json
import re
import shlex
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer

from uavcover.cli.main import app
from uavcover.new.catalog import CURVES
from uavcover.scenario.scenario_file import load_scenario, parse_scenario

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "docs" / "examples"
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / ".github").rglob("*.md")])
# Pages that record what was done with an older version name its commands and files.
GUIDES = [page for page in PAGES if page.name != "CHANGELOG.md" and "results" not in page.parts]


# What users read: README and docs, without the laboratory's results.
USER_PAGES = [
    ROOT / "README.md",
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if "results" not in page.parts),
]
PATHS = ("Survey", "Search", "Research")
DIALECT = (
    r"so many", r"so much so", r"nobody", r"anybody", r"somebody", r"everybody", r"likewise", r"dear(er|est)?", r"hardly",
    r"lately", r"what is asked", r"tells? of", r"told of", r"(is|are) told", r"(goes|go) with",
    r"made small", r"makes? small", r"(gives?|giving|gave) way", r"who ?ever", r"whatever", r"way there", r"ways? there and home",
    r"of its own", r"of their own", r"what is seen", r"what was seen", r"what can be seen", r"its nose", r"the nose",
    r"so long,? and so", r"by so much", r"is looked at", r"comes? out of it", r"beats? no", r"pictures? by distance",
    r"in case of need", r"is reckoned", r"reckoned", r"mended?", r"given away",
)  # fmt: skip
"""Words of no technical writer, as patterns between word boundaries; GLOSSARY.md of the project has what to write instead."""


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^ *```{language}\n(.*?)^ *```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def heading_anchors(text: str) -> set[str]:
    """Anchors as Python-Markdown and code hosts make them of plain headings."""
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    plain = [re.sub(r"[^\w\s-]", "", title.replace("`", "")).strip().lower() for title in titles]
    return {re.sub(r"\s+", "-", title) for title in plain}


def site_hook() -> ModuleType:
    spec = importlib.util.spec_from_file_location("docs_site", ROOT / "scripts" / "docs" / "docs_site.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def prose(text: str) -> str:
    """A page without its code, whose words are those of files and programs."""
    return re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)


def dialect_in(text: str) -> list[str]:
    found = re.finditer(rf"\b(?:{'|'.join(DIALECT)})\b", re.sub(r"\s+", " ", prose(text)), re.IGNORECASE)
    return [match[0] for match in found]


@pytest.mark.parametrize("page", USER_PAGES, ids=named)
def test_user_pages_are_in_plain_technical_english(page: Path) -> None:
    assert dialect_in(page.read_text(encoding="utf-8")) == []


def test_dialect_is_found_across_lines_and_in_any_case() -> None:
    assert dialect_in("So\nmany cells. Nobody flies. A dear `dear` deer.") == ["So many", "Nobody", "dear"]
    assert dialect_in("```text\nso many\n```\nOverlap is nearly there; the deary hardlyness stays.") == []


def test_readme_names_every_extra() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    table = text[text.index("## Extras") : text.index("## What it does not do")]
    packages = {file.parent.name for file in (ROOT / "uavcover" / "extras").glob("*/__init__.py")}
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == packages


@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_the_first_pages_have_a_path_for_each_reader(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    paths = [re.search(rf"^(?:## |\| \*\*){name}\W.*?(?:\n## |\n\|)", text + "\n## ", re.M | re.S) for name in PATHS]
    assert [len(re.findall(r"\]\(", path[0])) >= 5 for path in paths if path] == [True, True, True]


def messages_of(page: Path) -> list[str]:
    """The first column of the page's tables: error messages, with an ellipsis for what differs."""
    return re.findall(r"^\| `([^`]+)` \|", page.read_text(encoding="utf-8"), re.MULTILINE)


def test_every_message_of_troubleshooting_is_one_of_the_code() -> None:
    sources = (
        file.read_text(encoding="utf-8") for name in ("uavcover", "mission_io") for file in (ROOT / name).rglob("*.py")
    )
    code = re.sub(r"\{[^{}\n]*\}", "…", re.sub(r'"\s*\n\s*f?"', "", "\n".join(sources)))
    messages = messages_of(ROOT / "docs" / "how-to" / "troubleshooting.md")
    assert len(messages) >= 20
    pieces = {message: [piece for piece in message.split("…") if piece.strip()] for message in messages}
    assert {message for message, parts in pieces.items() if any(part not in code for part in parts)} == set()


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    generated = {ROOT / "docs" / path for path in site_hook().PAGES}
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        linked = (page.parent / path).resolve() if path else page
        assert linked in generated or linked.exists(), f"{target} leads nowhere"
        if anchor and linked.suffix == ".md" and linked not in generated:
            assert anchor in heading_anchors(linked.read_text(encoding="utf-8")), f"{target}: no such heading"


def test_every_page_that_code_names_exists() -> None:
    missing = {
        f"{source.relative_to(ROOT)}: {path}"
        for folder in ("uavcover", "mission_io", "sitl_tests", "tests", "scripts")
        for source in (ROOT / folder).rglob("*.py")
        for path in re.findall(r"\bdocs/[\w/-]+\.md", source.read_text(encoding="utf-8"))
        # Comments of kernels change with their code alone: any change compiles all of them.
        if not (ROOT / path).exists() and "uavcover/kernels" not in str(source)
    }
    assert missing == set()


def known_options(command: Any) -> set[str]:
    return {"-h", "--help", *(name for each in command.params for name in (*each.opts, *each.secondary_opts))}


def commands_of(page: Path) -> list[list[str]]:
    lines = "\n".join(blocks(page, "sh")).replace("\\\n", " ").splitlines()
    calls = [call for line in lines for call in re.split(r"&&|;", line.partition(" #")[0])]
    words = [shlex.split(call.strip().rstrip("&")) for call in calls if re.match(r"\s*(\S*/)?uavcover\b", call)]
    return [call[1:] for call in words]


@pytest.mark.parametrize("page", [page for page in GUIDES if commands_of(page)], ids=named)
def test_every_command_and_option_exists(page: Path) -> None:
    for call in commands_of(page):
        command: Any = typer.main.get_command(app)
        words = list(call)
        known = known_options(command)
        while words and hasattr(command, "commands") and not words[0].startswith("-"):
            name = words.pop(0)
            assert name in command.commands, f"uavcover {' '.join(call)}: no command {name}"
            command = command.commands[name]
            known |= known_options(command)
        options = {word.partition("=")[0] for word in words if re.match(r"-{1,2}[a-z]", word)}
        assert options <= known, f"uavcover {' '.join(call)}: {options - known}"


def merged(block: dict[str, Any]) -> str:
    """A scenario: the smallest example with what a page's block says in its place."""
    scenario = tomllib.loads((EXAMPLES / "valley.toml").read_text(encoding="utf-8"))
    for key, value in block.items():
        replaces = not isinstance(value, dict) or "kind" in value or key in ("area", "home")
        scenario[key] = value if replaces else scenario.get(key, {}) | value
    tables = {
        name: scenario.pop(name)
        for name in ("no_fly", "vehicle", "launch_point")
        if isinstance(scenario.get(name), list)
    }
    top = [f"{key} = {json.dumps(value)}" for key, value in scenario.items() if not isinstance(value, dict)]
    for section, keys in scenario.items():
        if isinstance(keys, dict):
            top += [f"[{section}]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items())]
    for name, each in tables.items():
        for keys in each:
            homes = {key: value for key, value in keys.items() if isinstance(value, dict)}
            top += [f"[[{name}]]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items() if key not in homes)]
            for key, position in homes.items():
                top += [f"[{name}.{key}]", *(f"{part} = {json.dumps(value)}" for part, value in position.items())]
    return "\n".join(top)


CURVE_PAGE = ROOT / "docs" / "reference" / "detection.md"
SCENARIOS = [page for page in GUIDES if blocks(page, "toml") and page != CURVE_PAGE]


def test_the_curve_of_detection_is_understood(tmp_path: Path) -> None:
    (piece,) = blocks(CURVE_PAGE, "toml")
    (tmp_path / "curve.toml").write_text(piece, encoding="utf-8")
    assert CURVES.named(str(tmp_path / "curve.toml")).table.probability.shape == (3, 3)


@pytest.mark.parametrize("page", SCENARIOS, ids=named)
def test_every_piece_of_a_scenario_is_understood(page: Path) -> None:
    for piece in blocks(page, "toml"):
        keys = tomllib.loads(piece)
        if "no_fly" in keys:
            keys["no_fly"] = [zone for zone in keys["no_fly"] if "file" not in zone]
        keys.pop("obstacles", None)  # names a file of buildings, or lists tables of prisms
        if "area" in keys:
            keys["area"] = {"cell_size_m": 5.0, **keys["area"], "file": "valley.geojson"}
        if "terrain" in keys:
            keys["terrain"] = keys["terrain"] | {"file": "bundled:jacksboro.tif"}
        parse_scenario(merged(keys), source=named(page), folder=EXAMPLES)


@pytest.mark.parametrize("name", ["valley", "survey", "search"])
def test_every_example_loads(name: str) -> None:
    assert load_scenario(EXAMPLES / f"{name}.toml").name == name


def test_the_quick_start_shows_the_example() -> None:
    shown = blocks(ROOT / "docs" / "quick_start.md", "toml")[0]
    assert shown in (EXAMPLES / "valley.toml").read_text(encoding="utf-8")


def test_reference_has_every_command_and_a_meaning_for_every_row() -> None:
    page = site_hook().command_reference()
    root: Any = typer.main.get_command(app)
    benchmarks = root.commands["bench"].commands
    for name in [*root.commands, *(f"bench {each}" for each in benchmarks)]:
        assert f"## `uavcover {name}`\n" in page
    assert re.findall(r"^\|.*\|\s*\|$", page.replace("| | default | |", ""), re.MULTILINE) == []


def test_reference_has_every_key_of_a_scenario_with_its_default() -> None:
    page = site_hook().scenario_reference()
    scenario = load_scenario("jacksboro")
    for section in dataclasses.fields(scenario):
        value = getattr(scenario, section.name)
        for key in dataclasses.fields(value) if dataclasses.is_dataclass(value) else []:
            assert f"| `{key.name}` |" in page
    assert "| `select` | text | " in page
    assert "| `max_home_error_m` | number | above 0 | `10.0` | `10.0` | Largest" in page
    assert re.findall(r"^\|.*\|\s*\|$", page, re.MULTILINE) == []
    assert re.findall(r"^.*\| (?:none|required|`\[\]`) \| [^|]* \|$", page, re.MULTILINE) == []  # each has an example


def test_examples_of_the_reference_are_toml_of_their_type() -> None:
    rows = re.findall(
        r"^\| `(\w+)` \| (.*?) \| .*? \| .*? \| `(.*?)` \| .* \|$", site_hook().scenario_reference(), re.MULTILINE
    )
    assert len(rows) > 150
    kinds: dict[str, type | tuple[type, ...]] = {
        "number": (int, float),
        "integer": int,
        "text": str,
        "true or false": bool,
    }
    for key, kind, example in rows:
        value = tomllib.loads(f"value = {example}")["value"]
        if kind in kinds:
            assert isinstance(value, kinds[kind]), key
        elif kind.startswith(("list", "[")):
            assert isinstance(value, list), key


def test_ranges_of_the_reference_are_those_that_are_checked() -> None:
    """A value just outside is refused, one at the end of the range where it belongs to it is not."""
    scenario, tried = load_scenario("jacksboro"), 0
    for section in ("area", "sensor", "limits", "vehicle", "planner", "requirements", "uncertainty", "fleet"):
        part = getattr(scenario, section)
        for key, said in site_hook()._ranges(type(part)).items():
            if key not in {each.name for each in dataclasses.fields(part)}:
                continue
            number = re.match(r"(above|at least)? ?(-?[\d.]+)", said)
            if number is None or key in ("max_mission_items",):
                continue
            low = float(number[2]) if isinstance(getattr(part, key), float) else int(float(number[2]))
            tried += 1
            with pytest.raises(ValueError, match=rf"^{key}"):
                dataclasses.replace(part, **{key: low if number[1] == "above" else low - 1})
    assert tried > 25


def test_every_page_is_in_the_navigation_once() -> None:
    listed = re.findall(r"^ +- [^#]*?([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(listed) == sorted(set(listed))
    pages = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}
    assert (pages | set(site_hook().PAGES)) - set(listed) == set()


def test_the_laboratory_stays_small() -> None:
    results = sorted((ROOT / "docs" / "results").rglob("*.md"))
    assert len(results) <= 12
    assert [page.name for page in results if len(page.read_text(encoding="utf-8").splitlines()) > 90] == []
    scripts = [file for file in (ROOT / "scripts").rglob("*") if file.suffix in (".py", ".sh")]
    assert len(scripts) <= 32
    assert sum(len(file.read_text(encoding="utf-8").splitlines()) for file in scripts) <= 6_500


def test_the_results_name_data_that_is_there_and_no_other() -> None:
    folder = ROOT / "docs" / "results"
    shown = "".join(
        page.read_text(encoding="utf-8")
        for page in [*folder.glob("*.md"), *(ROOT / "docs" / "explanation").glob("*.md")]
    )
    assert {
        file.name for file in folder.rglob("*") if file.suffix not in ("", ".md") and file.name not in shown
    } == set()


def test_a_script_that_a_page_of_results_runs_exists_or_is_history() -> None:
    """With a command of today a script is in the tree; one of history is named alone, in brackets."""
    commands = {
        script
        for page in (ROOT / "docs" / "results").glob("*.md")
        for script in re.findall(r"`[^`\n]*?python (scripts/[\w/]+\.py)", page.read_text(encoding="utf-8"))
    }
    assert commands
    assert {script for script in commands if not (ROOT / script).exists()} == set()
