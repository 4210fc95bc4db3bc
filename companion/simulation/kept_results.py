"""Results of finished jobs in a folder: what a study has computed once is not computed again."""

import hashlib
import io
import os
import pickle
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

from companion.core.interfaces import CompanionError
from companion.simulation.build import this_build

Task = TypeVar("Task")
Result = TypeVar("Result")

_DIGEST_BYTES = 32


class KeptResults:
    """Files of a folder, one a result, whole or not there.

    A name is a digest of all that the result depends on: function, task by content, and build. What is of another
    configuration is never taken. `fresh` takes nothing.
    """

    def __init__(self, folder: Path, fresh: bool = False) -> None:
        self._folder, self._fresh = folder, fresh

    def path(self, work: Callable[[Task], Result], task: Task) -> Path:
        """Return the file of a task's result."""
        whole = content((this_build(), work.__module__, work.__qualname__, task))
        return self._folder / f"{hashlib.sha256(whole).hexdigest()[:24]}.part"

    def read(self, work: Callable[[Task], Result], task: Task) -> Result | None:
        """Return a kept result; None if it is not there or damaged."""
        if self._fresh:
            return None
        try:
            raw = self.path(work, task).read_bytes()
        except OSError:
            return None
        digest, data = raw[:_DIGEST_BYTES], raw[_DIGEST_BYTES:]
        whole = hashlib.sha256(data).digest() == digest
        return pickle.loads(data) if whole else None  # noqa: S301

    def found(self, work: Callable[[Task], Result], tasks: Sequence[Task]) -> dict[int, Result]:
        """Return what is kept, by the tasks' numbers."""
        results = ((number, self.read(work, task)) for number, task in enumerate(tasks))
        return {number: result for number, result in results if result is not None}

    def write(self, work: Callable[[Task], Result], task: Task, result: Result) -> None:
        """Keep a result: the file gets its name when it is finished. Raises CompanionError when it cannot be."""
        path = self.path(work, task)
        data = pickle.dumps(result)
        unfinished = path.with_suffix(f".{os.getpid()}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            unfinished.write_bytes(hashlib.sha256(data).digest() + data)
            unfinished.replace(path)
        except OSError as error:
            raise CompanionError(f"cannot write to {path.parent}: {error.strerror}") from None


def content(value: object) -> bytes:
    """Return bytes that depend on the content of a value alone: dataclasses count by their fields, sets in order."""
    out = io.BytesIO()
    _ByContent(out, protocol=5).dump(value)
    return out.getvalue()


class _ByContent(pickle._Pickler):  # that of Python: C's takes sets as they lie
    """Pickler that writes equal values alike, in any process."""

    def __init__(self, file: io.BytesIO, protocol: int) -> None:
        super().__init__(file, protocol)
        self.fast = True  # no references to what came before: whether two equal texts are one object is chance

    def reducer_override(self, value: Any) -> Any:
        """Reduce a dataclass to its fields, without what it has cached, and a set to a sorted list."""
        if is_dataclass(value) and not isinstance(value, type):
            return type(value), tuple(getattr(value, field.name) for field in fields(value))
        if isinstance(value, set | frozenset):
            return list, (sorted(value, key=repr),)
        return NotImplemented
