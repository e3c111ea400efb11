"""The process that runs an answer file: ``python -m lcpimpact.course.process LESSON FILE OUT`` writes the verdict to OUT."""

from __future__ import annotations

import json
import os
import runpy
import sys
from dataclasses import asdict
from pathlib import Path

from lcpimpact.course import LESSONS
from lcpimpact.course.lesson import Answer, Verdict
from lcpimpact.errors import InputError


def verdict_on(lesson: str, file: str) -> Verdict:
    """Run an answer file in this process and judge what it defines.

    Raises
    ------
    InputError
        If the file or one of its functions raises an exception, or a name is missing.
    """
    names = Answer(file, {}).guarded(lambda: runpy.run_path(file, run_name="answer"), "the code")
    return LESSONS[lesson].judge(Answer(file, names))


def main(lesson: str, file: str, out: str) -> None:
    """Write the verdict, or the sentence that refuses the file, and end the process at once."""
    sys.path.append(str(Path(file).parent))  # so that an answer may import what lies beside it
    result: dict[str, str | dict[str, str | bool]]
    try:
        result = {"verdict": asdict(verdict_on(lesson, file))}
    except InputError as error:
        result = {"refusal": str(error)}
    except Exception as error:  # noqa: BLE001 - a defect of the check, which the process that waits reports
        result = {"defect": f"{type(error).__name__}: {error}"}
    Path(out).write_text(json.dumps(result), encoding="utf-8")
    os._exit(0)  # threads of the answer may never end


if __name__ == "__main__":
    main(*sys.argv[1:])
