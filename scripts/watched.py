"""The memory and the processor time of a command and of all processes that it starts, seen from outside (Linux)."""

import os
import re
import threading
from pathlib import Path

_PAGES = re.compile(r"^Rss(Anon|File|Shmem):\s+(\d+) kB", re.MULTILINE)


class Watch:
    """Samples a process and its family until it is ended.

    Memory is what each process has of its own, and once what they have of files, such as libraries: the most that one of them
    has.

    Attributes:
        peak_mib: the largest sum so far.
        peak_first_mib: the largest of the process itself.
        first_cpu_s: processor time of the process itself, at the last sample.
        first_main_cpu_s: of it that of its main thread.
        cpu_s: of each process at the last sample of it, together.
    """

    def __init__(self, pid: int, *, every_s: float = 0.25) -> None:
        self.peak_mib = self.peak_first_mib = self.first_cpu_s = self.first_main_cpu_s = 0.0
        self._pid, self._every_s = pid, every_s
        self._over = threading.Event()
        self._cpu_s: dict[int, float] = {}
        self._thread = threading.Thread(target=self._sample, daemon=True)
        self._thread.start()

    @property
    def cpu_s(self) -> float:
        """See above."""
        return sum(self._cpu_s.values())

    def end(self) -> None:
        """No more samples."""
        self._over.set()
        self._thread.join()

    def _sample(self) -> None:
        while not self._over.wait(self._every_s):
            family = _family(self._pid)
            sizes = [_mib(each) for each in family]
            self.peak_mib = max(self.peak_mib, sum(own for own, _ in sizes) + max(of_files for _, of_files in sizes))
            self.peak_first_mib = max(self.peak_first_mib, sum(sizes[0]))
            for each in family:
                self._cpu_s[each] = _cpu_s(each) or self._cpu_s.get(each, 0.0)
            self.first_cpu_s = self._cpu_s[family[0]]
            self.first_main_cpu_s = _cpu_s(f"{family[0]}/task/{family[0]}") or self.first_main_cpu_s


def _mib(pid: int) -> tuple[float, float]:
    """What a process has of its own, and of files."""
    try:
        pages = {
            name: float(kib) / 1024.0
            for name, kib in _PAGES.findall(Path(f"/proc/{pid}/status").read_text(encoding="utf-8"))
        }
    except OSError:
        pages = {}
    return pages.get("Anon", 0.0) + pages.get("Shmem", 0.0), pages.get("File", 0.0)


def _cpu_s(pid: int | str) -> float:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _family(pid: int) -> list[int]:
    """A process, its children and theirs, whichever of its threads started them."""
    found = [pid]
    for each in found:
        for children in Path(f"/proc/{each}/task").glob("*/children"):
            try:
                found += [int(word) for word in children.read_text(encoding="ascii").split()]
            except OSError:
                continue
    return found
