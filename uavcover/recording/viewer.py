"""The rerun viewer: opened on screen, or used without one for a screenshot.

The viewer listens on 127.0.0.1 only and sends no usage statistics.
"""

import contextlib
import importlib.util
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, TypeVar

from rerun.experimental import ViewerClient

from uavcover.errors import OutputError
from uavcover.recording import layout
from uavcover.recording.layout import VIEWER, RecordingError, check_finished

LOCAL_HOST = "127.0.0.1"
IMAGE_SIZE = (1600, 1000)
"""Width and height of a screenshot, pixels."""


Answer = TypeVar("Answer")
_NO_DRIVER = (
    "no graphics driver found; a screenshot requires Vulkan, and a software driver is sufficient (Debian and Ubuntu: "
    "apt-get install mesa-vulkan-drivers libvulkan1)"
)


def open_viewer(path: str | Path) -> None:
    """Open a recording in the rerun viewer, a separate process that outlives this one.

    Raises:
        RecordingError: an unreadable recording, no screen, or a viewer that does not start.
    """
    path = Path(path)
    check_finished(path)
    _require_screen(str(path))
    with tempfile.TemporaryFile() as log:
        process = _start_viewer([str(path), "--port", "auto"], log)
        # A viewer without a window system or driver exits within a second.
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=3.0)
            if process.returncode != 0:
                raise RecordingError(f"{path}: {_failure(log, process.returncode)}")


def open_live_viewer() -> str:
    """Open an empty viewer, a separate process that outlives this one; returns the URL to send a flight to.

    Raises:
        RecordingError: no screen, or a viewer that does not start.
    """
    _require_screen("--live")
    port = _free_port()
    with tempfile.TemporaryFile() as log:
        process = _start_viewer(["--port", str(port), "--hide-welcome-screen"], log)
        try:
            return _when_it_answers(process, port, log, "--live", lambda url: url)
        except RecordingError:
            process.terminate()
            raise


def _require_screen(what: str) -> None:
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RecordingError(
            f"{what}: no display available (neither DISPLAY nor WAYLAND_DISPLAY is set); take a screenshot with "
            "`uavcover inspect RUN --screenshot FILE.png`, or copy the file to a machine with a display and open it "
            "there with `rerun flight.rrd`"
        )


def screenshot(path: str | Path, png: str | Path, *, at_share: float = 1.0) -> None:
    """Make a screenshot of a recording in the viewer, without a screen.

    Args:
        path: the recording.
        png: the picture, replaced when it exists.
        at_share: the moment to show: 0 is the start of the flight, 1 its end.

    Raises:
        RecordingError: an unreadable recording, no graphics driver, or a viewer that does not answer.
        OutputError: the screenshot cannot be written.
    """
    path, png = Path(path), Path(png)
    if not 0.0 <= at_share <= 1.0:
        raise RecordingError(f"at_share: must be between 0 and 1, not {at_share}")
    check_finished(path)
    unfinished = png.with_name(f".{os.getpid()}.{png.stem}.png")
    try:
        unfinished.touch()
        with headless_viewer(path) as client:
            start_ns, end_ns = _load(client, path)
            moment_s = (start_ns + at_share * (end_ns - start_ns)) / 1e9
            _save_image(client, path, unfinished, moment_s)
        os.replace(unfinished, png)
    except OSError as error:
        raise OutputError(f"{png}: the screenshot cannot be written ({error.strerror or error})") from error
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink(missing_ok=True)


@contextlib.contextmanager
def headless_viewer(path: Path) -> Iterator[ViewerClient]:
    """A headless viewer that ends with the ``with`` block.

    Args:
        path: the recording named in errors; it is not opened.

    Raises:
        RecordingError: no graphics driver, or a viewer that does not answer.
    """
    port = _free_port()
    width, height = IMAGE_SIZE
    with tempfile.TemporaryFile() as log:
        process = _start_viewer(
            ["--headless", "--port", str(port), "--hide-welcome-screen", "--window-size", f"{width}x{height}"], log
        )
        try:
            yield _when_it_answers(process, port, log, path, _client)
        except Exception as error:
            # A viewer's own exit message is better than the broken connection. On a busy machine it may
            # answer for a while before it notices that there is no graphics driver.
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=VIEWER.ending_s)
                raise RecordingError(f"{path}: {_failure(log, process.returncode)}") from error
            raise
        finally:
            process.terminate()
            try:
                process.wait(timeout=5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _when_it_answers(
    process: subprocess.Popen[bytes], port: int, log: IO[bytes], what: object, connected: Callable[[str], Answer | None]
) -> Answer:
    """The first answer of ``connected`` for the URL of a viewer."""
    deadline = time.monotonic() + VIEWER.start_timeout_s
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise RecordingError(f"{what}: {_failure(log, process.returncode)}")
        with contextlib.suppress(OSError), socket.create_connection((LOCAL_HOST, port), timeout=VIEWER.poll_s):
            answer = connected(f"rerun+http://{LOCAL_HOST}:{port}/proxy")
            if answer is not None:
                return answer
        time.sleep(VIEWER.poll_s)
    raise RecordingError(f"{what}: the viewer did not answer within {VIEWER.start_timeout_s:.0f} s")


def _client(url: str) -> ViewerClient | None:
    client = ViewerClient.connect(url)
    # The server answers before the window exists; only then does a missing driver show.
    with contextlib.suppress(Exception):
        client.get_state()
        return client
    return None


def _load(client: ViewerClient, path: Path) -> tuple[int, int]:
    """Open the recording and wait until it is loaded; returns start and end of its timeline in nanoseconds."""
    try:
        client.open(str(path.resolve()))
        deadline = time.monotonic() + VIEWER.load_timeout_s
        while time.monotonic() < deadline:
            state = client.get_state()
            for recording in state.recordings:
                for timeline in recording.timelines:
                    if not state.loading and timeline.name == layout.TIMELINE and timeline.start is not None:
                        return timeline.start, timeline.end if timeline.end is not None else timeline.start
            time.sleep(VIEWER.poll_s)
    except Exception as error:
        raise RecordingError(f"{path}: the viewer could not show the recording ({_first_line(error)})") from error
    raise RecordingError(f"{path}: the viewer did not load the recording within {VIEWER.load_timeout_s:.0f} s")


def _save_image(client: ViewerClient, path: Path, png: Path, moment_s: float) -> None:
    try:
        client.set_time(layout.TIMELINE, duration=moment_s, play_state="paused")
        # The viewer draws what has arrived; cells and meshes of a new moment take a few frames.
        time.sleep(VIEWER.settle_s)
        client.save_screenshot(str(png.resolve()))
    except Exception as error:
        raise RecordingError(f"{path}: the viewer could not take the screenshot ({_first_line(error)})") from error
    if png.stat().st_size == 0:
        raise RecordingError(f"{path}: the viewer took an empty screenshot")


def _start_viewer(arguments: list[str], log: IO[bytes]) -> subprocess.Popen[bytes]:
    # CI turns rerun's usage statistics off for this process, without touching the user's settings.
    environment = {**os.environ, "CI": "1", "RERUN_APP_ONLY": "true"}
    try:
        return subprocess.Popen(
            [str(_viewer_program()), "--bind", LOCAL_HOST, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            env=environment,
            start_new_session=True,
        )
    except OSError as error:
        raise RecordingError(f"cannot start the rerun viewer ({error.strerror or error})") from error


def _viewer_program() -> Path:
    """The viewer of rerun-sdk, started without its Python wrapper so that killing it works."""
    package = importlib.util.find_spec("rerun_cli")
    if package is None or package.origin is None:
        raise RecordingError("the rerun viewer is not installed; install it with `pip install rerun-sdk`")
    folder = Path(package.origin).parent
    bundled = folder / "Rerun.app" / "Contents" / "MacOS" / "Rerun"
    if sys.platform == "darwin" and bundled.exists():
        return bundled
    return folder / ("rerun.exe" if sys.platform.startswith("win") else "rerun")


def _failure(log: IO[bytes], code: int) -> str:
    """The reason for a viewer's exit, by its output."""
    log.seek(0)
    lines = [line.strip() for line in log.read().decode(errors="replace").splitlines() if line.strip()]
    if any("graphics adapter" in line or "render context" in line for line in lines):
        return _NO_DRIVER
    telling = [line for line in lines if "panicked" in line or "error" in line.lower()] or lines[-1:]
    return f"the viewer ended with exit code {code}" + (f" ({telling[0]})" if telling else "")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOCAL_HOST, 0))
        return int(probe.getsockname()[1])


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
