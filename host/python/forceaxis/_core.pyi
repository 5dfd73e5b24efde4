# What the public modules use of the compiled module; the rest of it is not typed.
from collections.abc import Sequence
from pathlib import Path
from typing import Any

class InputError(ValueError): ...
class SimulationError(RuntimeError): ...

TICKS_PER_SECOND: int

class Result:
    """A finished run with its trace."""
    def __getattr__(self, name: str) -> Any: ...

def inputs(
    experiment: str | Path, overrides: Sequence[str] = ..., text: str | None = ...
) -> dict[str, Any]: ...
def run(
    experiment: str | Path,
    overrides: Sequence[str] = ...,
    firmware_hash: bool = ...,
    text: str | None = ...,
) -> Result: ...
def run_many(
    jobs: Sequence[tuple[str, Sequence[str]]], threads: int = ..., *more: Any, **options: Any
) -> list[dict[str, Any]]: ...
def judge(
    criterion: dict[str, Any], metrics: dict[str, Any], fault: str
) -> tuple[str, list[dict[str, Any]]]: ...
def __getattr__(name: str) -> Any: ...
