"""Tasks of a lesson: functions of parameters, compared with an independent truth, and the mistakes that are known."""

from __future__ import annotations

import inspect
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError

T = TypeVar("T")


@dataclass(frozen=True)
class Verdict:
    """The verdict on an answer: whether it is right, and if not, where it is wrong.

    Attributes
    ----------
    right : bool
    message : str           one sentence
    found, expected : str   the value of the answer and the one expected, where it is that of a function; else ""
    """

    right: bool
    message: str
    found: str = ""
    expected: str = ""


class Answer:
    """The names that an answer file defines, and calls of its functions.

    Parameters
    ----------
    file : str
        The file.
    names : mapping
        What the file has defined.
    """

    def __init__(self, file: str, names: Mapping[str, Any]) -> None:
        self.file, self._names = file, names

    def get(self, name: str, remedy: str) -> Any:
        """Return the object that the file calls ``name``.

        Raises
        ------
        InputError
            If there is none; the message ends with the remedy.
        """
        if name not in self._names:
            raise InputError(f"{self.file!r} does not define {name}: {remedy}")
        return self._names[name]

    def call(self, name: str, symbols: tuple[str, ...], values: Mapping[str, ArrayLike]) -> Any:
        """Call a function of the file with arguments by their names.

        Raises
        ------
        InputError
            If the file has no such function, it takes other arguments, or raises an exception.
        """
        stated = f"def {name}({', '.join(symbols)})"
        function = self.get(name, f"write {stated}")
        if not callable(function):
            raise InputError(f"{name} of {self.file!r} is no function: write {stated}")
        try:
            inspect.signature(function).bind(**values)
        except (TypeError, ValueError):
            raise InputError(
                f"{name} of {self.file!r} takes other arguments than are asked for: write {stated}"
            ) from None
        return self.guarded(lambda: function(**values), f"{name}({described(values)})")

    def guarded(self, action: Callable[[], T], what: str) -> T:
        """Run code of the file; what it raises becomes an `InputError` that names the line."""
        try:
            with np.errstate(all="ignore"):
                return action()
        except (Exception, SystemExit) as error:  # noqa: BLE001 - an answer may raise anything
            lines = [each.lineno for each in traceback.extract_tb(error.__traceback__) if each.filename == self.file]
            if isinstance(error, SyntaxError) and error.filename == self.file:
                lines.append(error.lineno)
            place = f", line {lines[-1]}" if lines else ""
            text = " ".join(str(error.msg if isinstance(error, SyntaxError) else error).split())
            said = f"{type(error).__name__}: {text}" if text else type(error).__name__
            raise InputError(f"{what} of {self.file!r} raises {said}{place}: repair the file") from None


@dataclass(frozen=True)
class Mistake:
    """A line of thought that leads to a wrong answer.

    Attributes
    ----------
    hint : str              what is wrong with it, without giving the answer away
    value : callable        the wrong answer, of the same parameters
    """

    hint: str
    value: Callable[..., ArrayLike]


class Task(ABC):
    """One name that the answer to a lesson must define.

    Attributes
    ----------
    name : str
    stated : str        how the name is defined: the first line of its definition
    """

    name: str

    @property
    @abstractmethod
    def stated(self) -> str:
        """First line of the definition."""

    @abstractmethod
    def judge(self, answer: Answer) -> Verdict:
        """Judge what the answer defines; ``right`` only if it is right for all parameters."""


@dataclass(frozen=True)
class FunctionTask(Task):
    """A function whose values are compared with an independent truth for several sets of parameters.

    Attributes
    ----------
    name : str                  the function
    truth : callable            the value expected, a number or an array; its parameters are those of the function
    cases : tuple of mappings   the sets of parameters; a constant is right for no two of them
    unit : str
    hint : str                  said where no mistake is recognised
    mistakes : tuple of Mistake
    rtol : float                largest error relative to the largest number expected
    """

    name: str
    truth: Callable[..., ArrayLike]
    cases: tuple[Mapping[str, float], ...]
    unit: str
    hint: str
    mistakes: tuple[Mistake, ...] = ()
    rtol: float = 1e-6

    @property
    def symbols(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(inspect.signature(self.truth).parameters)

    @property
    def stated(self) -> str:
        """First line of the definition."""
        return f"def {self.name}({', '.join(self.symbols)})"

    def judge(self, answer: Answer) -> Verdict:
        """Compare the function with the truth; a value that is no number is wrong."""
        found: list[Array] = []
        expected = [numbers(self.truth(**case)) for case in self.cases]
        for case, right in zip(self.cases, expected, strict=True):
            value = answer.call(self.name, self.symbols, case)
            array = numbers(value)
            if array.shape != right.shape:
                what = f"a {right.shape[0]} x {right.shape[1]} matrix" if right.ndim == 2 else f"{right.size} numbers"
                asked = "one number" if right.ndim == 0 else what
                return Verdict(
                    False, f"{self.name}({described(case)}) returns {shown(value)}, and {asked} is asked for",
                    shown(value), asked,
                )  # fmt: skip
            found.append(array)
        wrong = [not close(*pair, self.rtol) for pair in zip(found, expected, strict=True)]
        if not any(wrong):
            return Verdict(True, f"{self.name} is right for {len(self.cases)} sets of parameters")
        first = wrong.index(True)
        said, right_one = (f"{written(each[first])} {self.unit}".rstrip() for each in (found, expected))
        call = f"{self.name}({described(self.cases[first])})"
        return Verdict(False, f"{call} is {said}, and {right_one} is expected: {self._hint(found)}", said, right_one)

    def _hint(self, found: list[Array]) -> str:
        for mistake in self.mistakes:
            values = (numbers(mistake.value(**case)) for case in self.cases)
            if all(close(value, other, self.rtol) for value, other in zip(found, values, strict=True)):
                return mistake.hint
        if all(close(value, found[0], self.rtol) for value in found):
            return "it is the same for all parameters; compute it from them"
        return self.hint


@dataclass(frozen=True)
class Lesson:
    """One lesson's exercise.

    Attributes
    ----------
    title : str
    tasks : tuple of Task       judged in turn; the first that is wrong is the verdict
    """

    title: str
    tasks: tuple[Task, ...]

    def judge(self, answer: Answer) -> Verdict:
        """Return the verdict on an answer."""
        for task in self.tasks:
            verdict = task.judge(answer)
            if not verdict.right:
                return verdict
        names = [task.name for task in self.tasks]
        listed = f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]
        return Verdict(True, f"{listed} {'are' if len(names) > 1 else 'is'} right")


def numbers(value: ArrayLike) -> Array:
    """Return a value as an array of floats; if it is no number, an array whose shape no task asks for."""
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty((0, 0, 0))


def close(a: Array, b: Array, rtol: float) -> bool:
    """Return whether two arrays agree to ``rtol`` of the largest finite number of the second; nan agrees with nothing."""
    if a.shape != b.shape:
        return False
    scale = np.abs(b[np.isfinite(b)]).max(initial=0.0)
    return bool(np.allclose(a, b, rtol=0.0, atol=rtol * float(scale)))


def described(values: Mapping[str, ArrayLike]) -> str:
    """Return parameters as ``m=2, g=9.81``."""
    return ", ".join(f"{name}={written(numbers(value))}" for name, value in values.items())


def written(array: Array) -> str:
    """Return a number or an array with six digits."""
    if array.ndim == 0:
        return f"{float(array):.6g}"
    return f"[{', '.join(written(each) for each in array)}]"


def shown(value: ArrayLike, *, max_repr_length: int = 60) -> str:
    """Return the value that a function returned as a text, shortened.

    ``max_repr_length``: maximum number of characters of a value in a message.
    """
    text = " ".join(repr(value).split())
    return text if len(text) <= max_repr_length else text[: max_repr_length - 4] + " ..."
