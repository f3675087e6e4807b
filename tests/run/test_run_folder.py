import json
import math
import os
import stat
from pathlib import Path

import pytest

from uavcover.errors import InputError, OutputError
from uavcover.run.folder import RunFolder, json_line, json_text, write_text


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_files_are_written_whole_with_usual_rights(tmp_path: Path) -> None:
    write_text(tmp_path / "a.txt", "é\n")
    assert (tmp_path / "a.txt").read_bytes() == "é\n".encode()
    assert names(tmp_path) == {"a.txt"}
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o666 & ~mask


def test_what_cannot_be_written_leaves_all_as_it_was(tmp_path: Path) -> None:
    run = RunFolder(tmp_path)
    run.write_together({"a": "1", "b": "2"})
    (tmp_path / "old").write_text("old")
    with pytest.raises(OutputError, match=r"b.*cannot be written"):
        run.write_together({"a": "3", "b/d": "4"}, stale=["old"])
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a": "1", "b": "2", "old": "old"}


def test_stale_files_go_with_the_new_ones(tmp_path: Path) -> None:
    run = RunFolder(tmp_path)
    run.write_together({"a": "1", "old": "0"})
    run.write_together({"a": "2"}, stale=["old", "never there"])
    assert names(tmp_path) == {"a"}


def test_full_device() -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        write_text(Path("/proc/x"), "text")


def test_reserved_folder_is_made_and_kept_to_oneself(tmp_path: Path) -> None:
    run = RunFolder(tmp_path / "deep" / "run")
    with run.reserved(["a"], force=False):
        assert run.path.is_dir()
        with (
            pytest.raises(OutputError, match="another uavcover process is using"),
            RunFolder(run.path).reserved([], force=True),
        ):
            pass
    with run.reserved(["a"], force=False):
        pass


def test_reserved_refuses_what_is_there(tmp_path: Path) -> None:
    run = RunFolder(tmp_path)
    run.write_text("a", "1")
    with (
        pytest.raises(OutputError, match="a; use --force"),
        run.reserved(["a", "b"], force=False),
    ):
        pass
    with run.reserved(["a"], force=True):
        pass
    assert run.file("a").read_text() == "1", "reserving removes nothing"


def fails(run: RunFolder, texts: dict[str, str]) -> None:
    def work() -> None:
        with run.reserved([], force=False):
            run.write_together(texts)
            raise KeyError

    with pytest.raises(KeyError):
        work()


def test_an_error_leaves_no_empty_folder(tmp_path: Path) -> None:
    run = RunFolder(tmp_path / "run")
    fails(run, {})
    assert not run.path.exists()
    fails(run, {"a": "1"})
    assert names(run.path) == {"a"}, "what was written stays"


def test_missing_files_say_who_makes_them(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has no x; create it with: uavcover fly"):
        RunFolder(tmp_path).existing("x", made_by="uavcover fly")
    with pytest.raises(InputError, match="no such run folder"):
        RunFolder(tmp_path / "no").existing("x", made_by="uavcover fly")


@pytest.mark.parametrize("text", ["", "{", "[1]", "\x00", "[" * 100_000])
def test_broken_json(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(InputError, match=r"x\.json.*create it again with: uavcover plan"):
        RunFolder(tmp_path).read_json("x.json", made_by="uavcover plan")


def test_numbers_are_unrounded_and_finite() -> None:
    document = {"a": 0.1 + 0.2, "b": (math.nan, -math.inf, 1e-300), "c": {"d": "é"}}
    for text in (json_text(document), json_line(document)):
        assert json.loads(text) == {"a": 0.1 + 0.2, "b": [None, None, 1e-300], "c": {"d": "é"}}
    assert "\n" not in json_line(document)
    assert math.isnan(document["b"][0]), "the document itself is not changed"  # type: ignore[index, arg-type]
