import errno
import os
import shutil
from pathlib import Path

import pytest

from tests.run.test_track_file import sample
from uavcover.errors import OutputError
from uavcover.run.track_file import SpaceReserve, TrackWriter, read_track, record_bytes


def test_it_takes_room_and_leaves_no_file(tmp_path: Path) -> None:
    with SpaceReserve(tmp_path, 3_000_000) as reserve:
        assert reserve.held
        assert list(tmp_path.iterdir()) == []
    assert not reserve.held
    reserve.release()


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_no_room_is_an_error_that_says_how_much_it_takes(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(
        OutputError, match=r"not enough disk space for the flight record, which may need 3 MB .*free some space"
    ):
        SpaceReserve(tmp_path, 3_000_000)


@pytest.mark.parametrize("room", [2_000_000, 4_000_000])
def test_where_nothing_can_be_reserved_the_free_space_counts(
    room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "posix_fallocate")
    usage = shutil.disk_usage(tmp_path)._replace(free=room)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    if room < 3_000_000:
        with pytest.raises(OutputError, match="not enough disk space"):
            SpaceReserve(tmp_path, 3_000_000)
    else:
        assert not SpaceReserve(tmp_path, 3_000_000).held


def test_a_file_system_that_cannot_reserve_is_no_obstacle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unsupported(*_: object) -> None:
        raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))

    monkeypatch.setattr(os, "posix_fallocate", unsupported)
    assert not SpaceReserve(tmp_path, 3_000).held


def test_the_room_grows_with_the_flight() -> None:
    assert record_bytes(0.0) > 1_000_000
    assert record_bytes(1475.0) > 10 * 14_000_000 / 2, "the demo's record of 1,475 s has 14 MB"


class FullDisk:
    """A file on a disk that is full until the reserve is given free; then it takes a few bytes at a time."""

    def __init__(self, path: Path, reserve: SpaceReserve) -> None:
        self._file, self._reserve = path.open("ab", buffering=0), reserve

    def write(self, data: bytes) -> int:
        if self._reserve.held:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self._file.write(data[:7])

    def close(self) -> None:
        self._file.close()


def test_the_track_goes_on_in_the_room_that_was_kept_for_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reserve = SpaceReserve(tmp_path, 100_000)
    writer = TrackWriter(tmp_path / "track.csv", reserve=reserve)
    writer.write(sample(0))
    writer.close()
    monkeypatch.setattr(writer, "_file", FullDisk(tmp_path / "track.csv", reserve))
    for number in range(1, 20):
        writer.write(sample(number))
    writer.close()
    assert not reserve.held
    assert len(read_track(tmp_path / "track.csv")) == 20
