"""The check of an answer file, in a process of its own with a limit of time."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from lcpimpact.arguments import checked
from lcpimpact.course import LESSONS
from lcpimpact.course.lesson import Verdict
from lcpimpact.errors import InputError
from lcpimpact.numbers import positive

SECONDS = 60.0
"""Default limit of time of a check [s]; the longest of a right answer takes a few."""


@checked
def check_answer(lesson: str, file: str | Path, seconds: float = SECONDS) -> Verdict:
    r"""Run an answer file and judge what it defines.

    The file runs in a process of its own, in a temporary folder, without a terminal; what it prints is dropped.

    Parameters
    ----------
    lesson : str
        A name of ``lcpimpact list lessons``.
    file : str or Path
        A Python file with the names that the lesson asks for.
    seconds : float
        Limit of time in s.

    Returns
    -------
    Verdict
        ``right``, and a sentence that says where the answer is wrong.

    Raises
    ------
    InputError
        For an unknown lesson, a file that is missing, lacks a name, raises an exception or does not end in time.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "answer.py")
    ...     _ = file.write_text("def impact_time(n, g, H, e):\n    return n * (2 * H / g) ** 0.5")
    ...     check_answer("lesson-1", file).right
    False
    """
    LESSONS[lesson]
    positive("seconds", seconds, "s")
    path = Path(file)
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise InputError(f"cannot check {str(path)!r}: it {what}; name the Python file with your answer")
    with tempfile.TemporaryDirectory(prefix="lcpimpact-", ignore_cleanup_errors=True) as folder:
        out = Path(folder, "verdict.json")
        place = Path(folder, "run")
        place.mkdir()
        _run([lesson, str(path.resolve()), str(out)], place, seconds, str(path))
        if not out.exists():
            raise InputError(f"{str(path)!r} ends the process that checks it: take out what does, as os._exit")
        result = json.loads(out.read_text(encoding="utf-8"))
    if "defect" in result:
        raise RuntimeError(f"the check of {lesson} failed: {result['defect']}")
    if "refusal" in result:
        raise InputError(result["refusal"].replace(repr(str(path.resolve())), repr(str(path))))
    return Verdict(**result["verdict"])


def _run(arguments: list[str], folder: Path, seconds: float, file: str) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "lcpimpact.course.process", *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        raise InputError(
            f"{file!r} does not end within {seconds:g} s: look for a loop without an end, or raise --seconds"
        ) from None
    finally:
        _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the process, and the processes that the answer has started."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError, PermissionError):  # where all of them have ended
            os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()
