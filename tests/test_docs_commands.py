"""The commands of README and the first pages run one after the other, as written, and print what the pages show."""

import re
import shutil
import socket
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "docs" / "examples"
WATCHDOG_S = 600.0


@dataclass(frozen=True)
class Lesson:
    """A page, the blocks of it that are run, and what a reader has beside."""

    page: str
    blocks: tuple[int, ...]
    files: tuple[tuple[str, str], ...] = ()


LESSONS = (
    Lesson("README.md", (1, 4)),
    Lesson("docs/quick_start.md", (1, 2, 3), (("valley.toml", "valley.toml"), ("valley.geojson", "valley.geojson"))),
    Lesson(
        "docs/how-to/survey_from_files.md", (1,),
        (("valley.geojson", "area.geojson"), ("../../uavcover/data/jacksboro.tif", "dem.tif")),
    ),
    Lesson("docs/how-to/search.md", (0,), (("search.toml", "search.toml"), ("valley.geojson", "valley.geojson"))),
)  # fmt: skip
"""``blocks`` are numbers of the page's ``sh`` blocks, from 0."""
# A number of evaluations, for two seconds of a loaded machine end before the tuned baseline that the pages show.
FASTER = (
    (r"--budget \d+s", "--evaluations 100"),
    ("--speed 20", "--speed 100"),
    ("plan jacksboro", "plan jacksboro --evaluations 40"),
    ("area.kml", "area.geojson"),
)


def blocks_of(page: Path) -> list[tuple[str, str]]:
    """The ``sh`` blocks of a page, each with the ``text`` block that follows it directly."""
    found = re.findall(r"^```sh\n(.*?)^```\n(?:\n```text\n(.*?)^```)?", page.read_text(encoding="utf-8"), re.M | re.S)
    return [(commands, printed) for commands, printed in found]


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def shape(line: str) -> str:
    """A line with its numbers left out: machines differ in what a search of some seconds finds."""
    return re.sub(r"\s+", " ", re.sub(r"-?\d[\d.,]*", "#", line)).strip()


@pytest.mark.parametrize("lesson", LESSONS, ids=lambda lesson: Path(lesson.page).stem)
def test_the_commands_of_a_page_work_one_after_the_other(lesson: Lesson, tmp_path: Path) -> None:
    for source, name in lesson.files:
        shutil.copy(EXAMPLES / source, tmp_path / name)
    if lesson.page == "README.md":
        shutil.copytree(EXAMPLES, tmp_path / "docs" / "examples")
        (tmp_path / "uavcover" / "data").mkdir(parents=True)
        shutil.copy(ROOT / "uavcover" / "data" / "jacksboro.tif", tmp_path / "uavcover" / "data")
    pairs, port = blocks_of(ROOT / lesson.page), free_port()
    background: list[subprocess.Popen[str]] = []
    try:
        for number in lesson.blocks:
            commands, printed = pairs[number]
            output = ""
            for line in commands.splitlines():
                words = line.partition(" #")[0].strip()
                if not words.startswith("uavcover "):
                    continue
                for before, after in (*FASTER, ("14550", str(port)), (r"^uavcover", f"{sys.executable} -m uavcover")):
                    words = re.sub(before, after, words)
                if words.endswith("&"):
                    background.append(subprocess.Popen(f"exec {words[:-1]}", shell=True, cwd=tmp_path, text=True))
                    continue
                if " inspect " in words:
                    words += " --text"
                ended = subprocess.run(
                    words, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=WATCHDOG_S, check=False
                )
                assert ended.returncode == 0, f"{line}\n{ended.stdout}{ended.stderr}"
                output += ended.stdout + ended.stderr
            shown = {shape(line) for line in output.splitlines()}
            missing = [line for line in printed.splitlines() if shape(line) and shape(line) not in shown]
            assert not missing, f"{lesson.page} shows what was not printed: {missing}\n{output}"
    finally:
        for process in background:
            process.terminate()
            process.wait(timeout=30.0)
