"""Shows the progress of a long computation. On a terminal, a command shows it continuously. Without
a terminal, the command prints one line for each phase of the computation."""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sized
from typing import TypeVar

T = TypeVar("T")

shown = ""  # text about the present progress of a computation, such as "34/98 experiments"
# function to call at the beginning of each phase of a computation; told() sets it
_tell: Callable[[str], None] | None = None


@contextlib.contextmanager
def told(tell: Callable[[str], None]) -> Iterator[None]:
    """Context manager within which the library calls tell(phase) at the beginning of each phase of
    a computation."""
    global _tell
    before, _tell = _tell, tell
    try:
        yield
    finally:
        _tell = before


@contextlib.contextmanager
def phase(text: str) -> Iterator[None]:
    """Context manager for one phase of a computation, such as "designing the bank". A phase usually
    takes some seconds."""
    global shown
    if _tell is not None:
        _tell(text)
    before, shown = shown, text
    try:
        yield
    finally:
        shown = before


def each(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """Yields the items one by one, and writes the number of finished items to `shown`. `what`:
    plural name of the items. `total`: number of the items, which is necessary if `items` has no
    length."""
    global shown
    if total is None and isinstance(items, Sized):
        total = len(items)
    before = shown
    try:
        for done, item in enumerate(items):
            shown = ", ".join(filter(None, (before, f"{done}/{total} {what}")))
            yield item
    finally:
        shown = before


@contextlib.contextmanager
def bar(title: str, total: int) -> Iterator[Callable[[int, int], None]]:
    """Context of a progress bar on standard error, which only a terminal shows. Yields a function
    that sets the number of finished steps. The second argument of this function, the total, has no
    effect."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal, transient=True) as shown_bar:
        task = shown_bar.add_task(title, total=total)
        yield lambda done, _: shown_bar.update(task, completed=done)
