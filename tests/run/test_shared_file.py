"""What workers of this machine need lies in a file without a name, and large arrays are mapped, not copied."""

import errno
import os

import numpy as np
import pytest

from uavcover.errors import UavcoverError
from uavcover.run import scheduling
from uavcover.run.scheduling import can_share_files, read_shared, share

pytestmark = pytest.mark.skipif(not can_share_files(), reason="needs /proc")


def frozen(values: np.ndarray) -> np.ndarray:
    values.flags.writeable = False
    return values


def test_what_is_read_is_what_was_shared_and_large_arrays_are_the_file_itself() -> None:
    rng = np.random.default_rng(1)
    large = frozen(rng.normal(size=(300, 71)))
    other = frozen(rng.integers(0, 200, 70_001).astype(np.uint8))
    value = {"large": large, "other": other, "small": frozen(np.arange(3.0)), "mine": np.zeros((200, 100)), "text": "ü"}
    shared = share(value)
    with shared.file:
        read, again = read_shared(shared.path), read_shared(shared.path)
        assert shared.size == os.fstat(shared.file.fileno()).st_size
    # The file is closed, and nobody else has a name for it.
    for name in ("large", "other", "small", "mine"):
        assert np.array_equal(read[name], value[name])
        assert read[name].dtype == value[name].dtype
        # Compiled code is made for one kind: read-only or not, aligned or not.
        assert read[name].flags.writeable == value[name].flags.writeable
        assert read[name].flags.aligned
    assert read["text"] == "ü"
    assert not read["large"].flags.owndata
    assert read["large"].ctypes.data % 64 == read["other"].ctypes.data % 64 == 0
    read["mine"][0, 0] = 1.0
    assert again["mine"][0, 0] == value["mine"][0, 0] == 0.0


def test_equal_objects_have_equal_hashes_and_others_do_not() -> None:
    found = []
    for values in (np.zeros(9_000), np.zeros(9_000), np.ones(9_000)):
        shared = share(("site", frozen(values)))
        shared.file.close()
        found.append(shared.sha256)
    assert found[0] == found[1] != found[2]


def test_a_full_disk_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        closed = False

        def write(self, _: object) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        def close(self) -> None:
            self.closed = True

    full = Full()
    monkeypatch.setattr(scheduling.tempfile, "TemporaryFile", lambda: full)
    with pytest.raises(UavcoverError, match=r"^--scheduler: cannot write .*No space left on device.*TMPDIR"):
        share("site")
    assert full.closed
