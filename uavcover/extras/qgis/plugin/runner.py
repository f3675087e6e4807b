"""Runs the program uavcover and shows its progress. It uses no QGIS, so that it is tested without."""

import json
import os
import shutil
import signal
import subprocess
import threading


class UavcoverError(Exception):
    """The program is missing, or it ended with an error; the text is for the user."""


def find_program(own, setting=None):
    """The command that runs uavcover: the environment variable UAVCOVER, the plugin's own, or the one on PATH."""
    for command in ([setting] if setting else [], own):
        if command and (os.path.isfile(command[0]) or shutil.which(command[0])):
            return list(command)
    on_path = shutil.which("uavcover")
    if on_path:
        return [on_path]
    raise UavcoverError(
        "uavcover was not found. Install it in a Python environment of its own, write the plugin again with "
        "'uavcover qgis-plugin -o uavcover.zip', or set the environment variable UAVCOVER to its path."
    )


def run(command, arguments, feedback, accepted=(0, 1)):
    """Run a command of uavcover and return its JSON answer.

    Args:
        command: from find_program.
        arguments: words of its command line, without --json and --events.
        feedback: has setProgress, pushInfo, pushWarning and isCanceled, as a QgsProcessingFeedback.
        accepted: exit codes that are no error; 1 is a verdict or a requirement that is not met.

    Raises:
        UavcoverError: it ended with another code; the text says why.
    """
    words = [*command, *map(str, arguments), "--json", "--events"]
    feedback.pushInfo(" ".join(words[:-2]))
    # An environment of QGIS must not leak into another Python.
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONHOME", "PYTHONPATH")}
    process = subprocess.Popen(
        words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace",
        env=environment,
    )  # fmt: skip
    answer = []
    reader = threading.Thread(target=lambda: answer.append(process.stdout.read()), daemon=True)
    reader.start()
    error = ""
    stopped = threading.Event()

    def watch():
        while process.poll() is None:
            if feedback.isCanceled() and not stopped.is_set():
                stopped.set()
                process.send_signal(signal.SIGINT)
            stopped.wait(0.2) if not stopped.is_set() else threading.Event().wait(0.2)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    for line in process.stderr:
        text = show(line.rstrip("\n"), feedback)
        error = text or error
    code = process.wait()
    reader.join()
    watcher.join()
    process.stdout.close()
    process.stderr.close()
    try:
        document = json.loads(answer[0]) if answer and answer[0].strip() else {}
    except ValueError:
        document = {}
    if stopped.is_set():
        feedback.pushWarning("stopped; the best result so far was written, if there is one")
    elif code not in accepted:
        raise UavcoverError(str(document.get("error") or error or f"uavcover ended with exit code {code}"))
    return document


def show(line, feedback):
    """Show one line of events; returns the text of an error."""
    try:
        event = json.loads(line)
    except ValueError:
        event = None
    if not isinstance(event, dict):
        if line.startswith("error: "):
            return line[7:]
        if line.strip():
            feedback.pushInfo(line)
        return ""
    if "error" in event:
        return str(event["error"])
    if "progress" in event:
        progress = event["progress"]
        if progress.get("total"):
            feedback.setProgress(min(100.0, 100.0 * progress["done"] / progress["total"]))
    elif "warn" in event:
        feedback.pushWarning(str(event["warn"]))
    elif event.get("say"):
        text = str(event["say"])
        if text.startswith("error: "):
            return text[7:]
        feedback.pushInfo(text)
    return ""
