"""``scripts/demo.sh`` in a clean clone: what a new user does first."""

import os
import site
import subprocess
import sys
from pathlib import Path

import pytest

from tests.compiled_kernels import lend_compiled_kernels

ROOT = Path(__file__).parents[1]
NEW = {"track.csv", "flight.rrd", "verification.json", "plan.json", "mission.waypoints", "mission.plan", "upload.json"}


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    folder = tmp_path / "clone"
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(folder)], check=True, capture_output=True, timeout=300)
    return folder


def environment(**more: str) -> dict[str, str]:
    kept = {
        key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VIRTUAL_ENV", "UAVCOVER_"))
    }
    return {**kept, "PYTHON": sys.executable, **more}


def demo(clone: Path, out: Path, *arguments: str, timeout_s: float, **more: str) -> subprocess.CompletedProcess[str]:
    # From another folder, and with a relative name: the script finds its own.
    return subprocess.run(
        ["sh", str(clone / "scripts" / "demo.sh"), out.name, *arguments],
        cwd=out.parent, env=environment(**more), capture_output=True, text=True, timeout=timeout_s, check=False,
    )  # fmt: skip


def written_into(clone: Path) -> set[str]:
    status = ["git", "-C", str(clone), "status", "--porcelain", "-z", "--ignored", "--untracked-files=all"]
    lines = subprocess.run(status, check=True, capture_output=True, text=True, timeout=300).stdout.split("\0")
    paths = {line[3:] for line in lines if line}
    return {path for path in paths if not path.startswith(".venv/") and "__pycache__/" not in path}


def test_names_with_spaces_in_the_environment_are_not_written_into_the_clone(tmp_path: Path) -> None:
    """git quotes them, so that test_demo_from_nothing took "script (dev).tmpl" of setuptools for a file outside of .venv."""
    subprocess.run(["git", "init", "--quiet", str(tmp_path)], check=True, capture_output=True, timeout=300)
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv" / "script (dev).tmpl").touch()
    (tmp_path / "two words.txt").touch()
    assert written_into(tmp_path) == {"two words.txt"}


def test_demo_in_a_clean_clone_and_once_more(clone: Path, tmp_path: Path) -> None:
    """The environment sees this one's packages, so that pip finds everything there and needs no network."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", clone / ".venv"], check=True, timeout=300)
    (packages,) = (clone / ".venv" / "lib").glob("python*/site-packages")
    (packages / "borrowed.pth").write_text("".join(f"{path}\n" for path in site.getsitepackages()))
    lend_compiled_kernels(clone)
    arguments = ("--evaluations", "40", "--speed", "50")

    first = demo(clone, tmp_path / "out", *arguments, timeout_s=3000, PIP_NO_INDEX="1")
    assert first.returncode == 0, first.stdout + first.stderr
    assert "set-up: re-using .venv" in first.stdout
    assert "set-up: installing the pinned dependencies" in first.stdout
    assert "Open next" in first.stdout
    assert {path.name for path in (tmp_path / "out").iterdir()} >= NEW
    assert written_into(clone) == set()
    which = [clone / ".venv" / "bin" / "python", "-c", "import uavcover; print(uavcover.__file__)"]
    found = subprocess.run(which, check=True, capture_output=True, text=True, cwd=tmp_path, env=environment())
    assert Path(found.stdout.strip()).is_relative_to(clone)

    again = demo(clone, tmp_path / "out", timeout_s=300, PIP_NO_INDEX="1")
    assert again.returncode == 2
    assert "set-up: re-using .venv" in again.stdout
    assert "installing" not in again.stdout
    assert again.stderr.startswith("error: ")
    assert "--force" in again.stderr


def test_python_that_is_missing_or_too_old(clone: Path, tmp_path: Path) -> None:
    missing = demo(clone, tmp_path / "out", timeout_s=300, PYTHON="no-such-python")
    assert missing.returncode == 2
    assert "no no-such-python found" in missing.stderr
    old = tmp_path / "old-python"
    old.write_text('#!/bin/sh\n[ "$1" = --version ] && echo Python 3.8.1 && exit 0\nexit 1\n')
    old.chmod(0o755)
    too_old = demo(clone, tmp_path / "out", timeout_s=300, PYTHON=str(old))
    assert too_old.returncode == 2
    assert "Python 3.8.1 is too old" in too_old.stderr
    assert written_into(clone) == set()


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_demo_from_nothing(clone: Path, tmp_path: Path) -> None:
    """The real thing: a new environment, packages from the index."""
    done = demo(clone, tmp_path / "out", timeout_s=1100)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "set-up: making .venv" in done.stdout
    assert {path.name for path in (tmp_path / "out").iterdir()} >= NEW
    assert written_into(clone) == set()
