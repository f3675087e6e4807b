"""What the scripts say to options that cannot be: one line, with exit code 2, before anything is measured."""

import argparse
import importlib.util
import os
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import pytest

from scripts.options import (
    existing_file,
    existing_folder,
    file_to_write,
    first_and_second,
    names_of,
    one_of,
    scenario_name,
    whole_numbers,
)
from scripts.pages import put_section

ROOT = Path(__file__).parents[1]

BAD = {
    "bench/fleet --vehicles 1,x": "argument --vehicles: 1,x: give whole numbers, with commas between them",
    "bench/flight_time --vehicles zz": "argument --vehicles: zz: not known; choose from mock-ardupilot, ",
    "bench/kinds -o page.md --recompute": "--recompute needs --runs DIR, the folder in which --runs kept the plans",
    "bench/kinds -o docs/results/data/kinds.csv --recompute --runs {empty}": "/plan.json in it; keep the plans with --runs first",
    "bench/kinds --only zz:nadir": "argument --only: zz: not known; choose from ",
    "bench/kinds -o {empty}/none/page.md": "argument -o/--out: {empty}/none/page.md: its folder is not there; create it first",
    "bench/large --only 1000:zz": "argument --only: 1000:zz: not known; choose from 1000, 1000:1, ",
    "attack/fuzz_formats --engine atheris": "--engine atheris: the package is not here; pip install atheris, or take --engine",
    "docs/measure_architecture --root {empty}": "--root {empty}: no pyproject.toml in it; name a checkout",
    "attack/mutate_judgement --module zz.py": "--module zz.py: no such file, or none whose tests TESTS at the top of the script",
    "attack/mutate_judgement --survivors": "--survivors needs -o PAGE with its .csv beside it: that has the survivors",
    "docs/make_pictures {empty} x={empty}/none.html": "argument NAME=FILE: {empty}/none.html: no such file; name one",
    "bench/real_photos {empty}/none": "argument folder: {empty}/none: no such folder; name one that is there",
    "bench/real_photos {empty} -o page.md": "argument folder: {empty}: none of drone_dataset_brighton_beach, dataset_banana, ",
    "bench/real_photos {empty} -o {empty}/x/page.md": "argument -o/--out: {empty}/x/page.md: its folder is not there; create it",
    "slowest_tests {empty}": "argument times: {empty}: no such file; name one that is there",
}
"""Command lines, {empty} is a folder with nothing in it, and what is said."""
NEED = {"attack/fuzz_formats": ["atheris"]}
"""Where these can be imported, there is nothing wrong."""


@pytest.mark.parametrize("command", BAD)
def test_a_script_says_in_one_line_what_is_wrong(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Among them bench/kinds --recompute without --runs, which ended in a traceback."""
    for packages in [names for begins, names in NEED.items() if command.startswith(begins)]:
        if all(map(importlib.util.find_spec, packages)):
            pytest.skip(f"{' and '.join(packages)} can be imported")
    name, *options = (word.format(empty=tmp_path) for word in command.split())
    code, out, err = run_script(name, *options, monkeypatch=monkeypatch, capsys=capsys)
    assert code == 2
    assert not out
    last = err.splitlines()[-1]
    assert last.startswith(f"{name.partition('/')[2] or name}.py: error: ")
    assert BAD[command].format(empty=tmp_path) in last


def run_script(
    name: str, *options: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[object, str, str]:
    """Its exit code, and what it said on stdout and stderr."""
    script = ROOT / "scripts" / f"{name}.py"
    monkeypatch.setattr(sys, "argv", [str(script), *options])
    monkeypatch.setattr(sys, "path", [str(script.parent), *sys.path])
    monkeypatch.chdir(ROOT)
    with mock.patch.dict(os.environ), pytest.raises(SystemExit) as ended:
        runpy.run_path(str(script), run_name="__main__")
    return (ended.value.code, *capsys.readouterr())


@pytest.mark.parametrize("name", ["docs/make_terrain"])
def test_help_is_no_run(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """It wrote its files, whatever stood behind the name."""
    code, out, _ = run_script(name, "--help", monkeypatch=monkeypatch, capsys=capsys)
    assert code == 0
    assert out.startswith(f"usage: {name.partition('/')[2]}.py")


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (whole_numbers, "1,2,40", [1, 2, 40]),
        (one_of(["a", "b"]), "b", "b"),
        (names_of(["a", "b"]), "b,a", ["b", "a"]),
        (first_and_second(["a"], ["b"]), "", ("", "")),
        (first_and_second(["a"], ["b"]), "a", ("a", "")),
        (first_and_second(["a"], ["b"]), ":b", ("", "b")),
        (first_and_second(["a"], ["b"]), "a:b", ("a", "b")),
        (scenario_name, "jacksboro", "jacksboro"),
    ],
)
def test_what_can_be_is_read(kind: Callable[[str], object], text: str, value: object) -> None:
    assert kind(text) == value


def test_paths_that_are_there(tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    plan.touch()
    assert existing_folder(str(tmp_path)) == tmp_path
    assert existing_file(str(plan)) == file_to_write(str(plan)) == plan
    assert file_to_write("page.md") == Path("page.md")


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (file_to_write, "/"),
        (first_and_second(["a"], ["b"]), "b:a"),
    ],
)
def test_what_cannot_be_is_refused(kind: Callable[[str], object], text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        kind(text)


def test_a_script_renews_its_own_section_of_a_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    put_section(page, "One", "first")
    put_section(page, "Two", "second")
    page.write_text("# Title\n\nwords\n\n" + page.read_text())
    put_section(page, "One", "\nanew\n\n### Part\n")
    assert page.read_text() == "# Title\n\nwords\n\n## One\n\nanew\n\n### Part\n\n## Two\n\nsecond\n"
