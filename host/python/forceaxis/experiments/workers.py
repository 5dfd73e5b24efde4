"""Work on the workers of a Dask scheduler."""

import re
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Any, NoReturn, Self

from forceaxis._core import InputError, SimulationError
from forceaxis.errors import ParameterError


class WorkerDiffers(Exception):
    """Error: a worker has another version of forceaxis, or other files, than this process."""


class Workers:
    """The workers of a Dask scheduler, for use in a `with` statement. If a worker is lost, another
    worker repeats its work."""

    def __init__(self, address: str) -> None:
        """`address`: tcp://HOST:PORT of the Dask scheduler. Raises ParameterError."""
        try:
            import distributed
        except ImportError:
            raise ParameterError(
                "scheduler",
                "expected the package distributed; install distributed with `pip install "
                "'forceaxis[cluster]'`",
            ) from None

        def fail(error: str | Exception) -> NoReturn:
            raise ParameterError(
                "scheduler",
                f"{address}: expected the address tcp://HOST:PORT of a running Dask scheduler; "
                f"{error}",
            ) from None

        if not re.fullmatch(r"(tcp|tls|ws|wss)://.+:\d+", address):
            fail("start one with `dask scheduler`")
        self.distributed = distributed
        self.address = address
        try:
            self.client = distributed.Client(address, timeout=10, set_as_default=False)
        except (OSError, ValueError) as error:
            fail(error)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.client.close()

    def cores(self) -> int:
        """Returns the number of threads of all workers. Raises ParameterError if there is none."""
        cores = sum(self.client.nthreads().values())
        if cores == 0:
            raise ParameterError(
                "scheduler",
                f"{self.address}: expected a Dask scheduler with at least one worker, got "
                "none; start workers with `dask worker`",
            )
        return int(cores)

    def results(
        self, function: Callable[..., Any], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Any]]:
        """Calls a function on the workers, once with each of the arguments `calls`. Yields (number
        of the call, its result) as soon as a call ends. Raises InputError, ParameterError,
        SimulationError."""
        futures = {
            self.client.submit(function, *call, pure=False): i for i, call in enumerate(calls)
        }
        try:
            for future in self.distributed.as_completed(futures, loop=self.client.loop):
                yield futures[future], future.result()
        except WorkerDiffers as error:
            raise ParameterError("scheduler", f"{self.address}: {error}") from None
        except (InputError, KeyboardInterrupt, GeneratorExit):
            raise
        except Exception as error:
            raise SimulationError(
                f"{self.address}: expected a result of each call on the workers, got: {error}; "
                "repeat the command, which keeps what an earlier run has written"
            ) from error
        finally:
            self.client.cancel(list(futures))
