"""The viewer: what can be tested without a screen."""

import os
import signal
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Self

import pytest

from uavcover.errors import OutputError
from uavcover.recording import layout, viewer
from uavcover.recording.layout import VIEWER, RecordingError
from uavcover.recording.viewer import open_viewer, screenshot

PNG = b"\x89PNG\r\n\x1a\n"


def make_photo_or_skip(recorded: Path, png: Path, at_share: float) -> bytes:
    try:
        screenshot(recorded, png, at_share=at_share)
    except RecordingError as error:
        if "no graphics driver" in str(error):
            pytest.skip(str(error))
        raise
    return png.read_bytes()


def test_pictures_of_two_moments(recorded: Path, tmp_path: Path) -> None:
    before = set(recorded.parent.iterdir())
    early, late = (make_photo_or_skip(recorded, tmp_path / f"{at}.png", at) for at in (0.2, 1.0))
    for image in (early, late):
        assert image.startswith(PNG)
        width, height = (int.from_bytes(image[i : i + 4], "big") for i in (16, 20))
        assert (width, height) == viewer.IMAGE_SIZE
    assert early != late
    assert set(recorded.parent.iterdir()) == before


def test_a_picture_that_cannot_be_written(recorded: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"missing.*picture\.png"):
        screenshot(recorded, tmp_path / "missing" / "picture.png")


def test_a_picture_that_is_not_made_leaves_the_old_one(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    image = tmp_path / "picture.png"
    image.write_text("old")
    monkeypatch.setattr(viewer, "_viewer_program", lambda: tmp_path / "missing")
    with pytest.raises(RecordingError, match="cannot start the rerun viewer"):
        screenshot(recorded, image)
    assert [p.name for p in tmp_path.iterdir()] == ["picture.png"]
    assert image.read_text() == "old"


def test_no_screen(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RecordingError, match=r"no display available.*--screenshot"):
        open_viewer(recorded)


def test_what_is_no_recording_is_not_opened(tmp_path: Path) -> None:
    other = tmp_path / "track.csv"
    other.write_text("time_s\n1.0\n")
    for show in (open_viewer, lambda path: screenshot(path, tmp_path / "picture.png")):
        with pytest.raises(RecordingError, match=r"track\.csv"):
            show(other)
    with pytest.raises(RecordingError, match=r"must be between 0 and 1"):
        screenshot(other, tmp_path / "picture.png", at_share=1.5)


def fake_viewer(folder: Path, script: str, monkeypatch: pytest.MonkeyPatch) -> None:
    program = folder / "rerun"
    program.write_text(f"#!{sys.executable}\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setattr(viewer, "_viewer_program", lambda: program)


@pytest.mark.skipif(sys.platform == "win32", reason="a script as a program is POSIX")
@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("import sys; sys.exit('Error: No graphics adapter was found')", "no graphics driver.*mesa-vulkan-drivers"),
        ("import sys; sys.exit('panicked at: Failed to get render context')", "no graphics driver"),
        ("import sys; sys.exit('Error: no X server')", r"the viewer ended with exit code 1 \(Error: no X server\)"),
        ("import sys; sys.exit('broken')", r"the viewer ended with exit code 1 \(broken\)"),
    ],
)
def test_a_viewer_that_ends_at_once(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, message: str
) -> None:
    fake_viewer(tmp_path, script, monkeypatch)
    monkeypatch.setenv("DISPLAY", ":99")
    with pytest.raises(RecordingError, match=message):
        screenshot(recorded, tmp_path / "picture.png")
    with pytest.raises(RecordingError, match=message):
        open_viewer(recorded)


@pytest.mark.skipif(sys.platform == "win32", reason="a script as a program is POSIX")
def test_a_viewer_that_never_answers_is_ended(recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pid_file = tmp_path / "pid"
    fake_viewer(
        tmp_path,
        f"import os, signal; open({str(pid_file)!r}, 'w').write(str(os.getpid())); signal.pause()",
        monkeypatch,
    )
    monkeypatch.setattr(viewer, "VIEWER", replace(VIEWER, start_timeout_s=1.0))
    with pytest.raises(RecordingError, match="did not answer within 1 s"):
        screenshot(recorded, tmp_path / "picture.png")
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid_file.read_text()), 0)


_ANSWERS_THEN_ENDS = """
import os, signal, socket, sys
port = int(sys.argv[sys.argv.index("--port") + 1])
server = socket.create_server(("127.0.0.1", port))
open({pid_file!r} + ".new", "w").write(str(os.getpid()))
os.rename({pid_file!r} + ".new", {pid_file!r})
signal.signal(signal.SIGUSR1, lambda *_: sys.exit("Error: No graphics adapter was found"))
while True:
    signal.pause()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a script as a program is POSIX")
@pytest.mark.parametrize("last_answer", ["open", "get_state", "set_time", "save_screenshot"])
def test_a_viewer_that_ends_after_it_has_answered(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last_answer: str
) -> None:
    pid_file = tmp_path / "pid"
    fake_viewer(tmp_path, _ANSWERS_THEN_ENDS.format(pid_file=str(pid_file)), monkeypatch)
    monkeypatch.setattr(viewer, "VIEWER", replace(VIEWER, settle_s=0.0))

    class Client:
        """Answers until it is asked for ``last_answer``, at which the viewer ends."""

        def __init__(self) -> None:
            self.states = 0

        @classmethod
        def connect(cls, _url: str) -> Self:
            return cls()

        def _end_at(self, requested: str) -> None:
            if requested == last_answer:
                os.kill(int(pid_file.read_text()), signal.SIGUSR1)
                raise RuntimeError("transport error")

        def open(self, _path: str) -> None:
            self._end_at("open")

        def get_state(self) -> object:
            self.states += 1
            if self.states > 1:  # the first one is asked while connecting
                self._end_at("get_state")
            timeline = SimpleNamespace(name=layout.TIMELINE, start=0, end=1)
            return SimpleNamespace(loading=False, recordings=[SimpleNamespace(timelines=[timeline])])

        def set_time(self, *_: object, **__: object) -> None:
            self._end_at("set_time")

        def save_screenshot(self, _path: str) -> None:
            self._end_at("save_screenshot")

    monkeypatch.setattr(viewer, "ViewerClient", Client)
    with pytest.raises(RecordingError, match=r"no graphics driver.*mesa-vulkan-drivers"):
        screenshot(recorded, tmp_path / "picture.png")
    assert not (tmp_path / "picture.png").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="a script as a program is POSIX")
def test_the_viewer_binds_here_only_and_sends_no_statistics(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    observed = tmp_path / "seen"
    fake_viewer(
        tmp_path,
        f"import os, sys; open({str(observed)!r}, 'w').write(repr((sys.argv[1:], os.environ['CI'])))",
        monkeypatch,
    )
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.delenv("CI", raising=False)
    open_viewer(recorded)
    assert observed.read_text() == repr((["--bind", "127.0.0.1", str(recorded), "--port", "auto"], "1"))
    assert "CI" not in os.environ
