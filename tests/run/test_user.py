"""What people are told."""

import shlex
from pathlib import Path

from uavcover.run.user import to_paste


def test_commands_can_be_pasted_whatever_files_are_called() -> None:
    run = Path("o'clock flights/north $HOME")
    text = to_paste("plan-upload", run, "--to", "udp:127.0.0.1:14550", "--sortie", 1)
    assert shlex.split(text) == ["uavcover", "plan-upload", str(run), "--to", "udp:127.0.0.1:14550", "--sortie", "1"]
    assert to_paste("gaps", Path("run")) == "uavcover gaps run"
