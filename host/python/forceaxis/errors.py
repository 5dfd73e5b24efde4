"""Exceptions of the library. Each error that a caller has to distinguish has its own exception
type."""

import importlib.util

from forceaxis._core import InputError


class ParameterError(InputError):
    """Error: an argument of a library function has a value that the function does not accept.

    `parameter` is the name of the parameter, and `text` says what was expected of its value. The
    command line prints the option that sets this parameter instead of the name.
    """

    def __init__(self, parameter: str, text: str) -> None:
        super().__init__(f"{parameter}: {text}")
        self.parameter = parameter
        self.text = text

    def __reduce__(self) -> tuple[type["ParameterError"], tuple[str, str]]:
        # Without this method, a worker process could not pass the exception to the main process.
        return type(self), (self.parameter, self.text)


def expect_package(where: str, module: str, package: str, extra: str) -> None:
    """Raises InputError if a Python package is not installed. `module`: a module of the package.
    `where`: start of the error text. `extra`: optional dependency group of forceaxis that contains
    the package."""
    if importlib.util.find_spec(module) is None:
        raise InputError(
            f"{where}: expected the package {package}; install {package} with `pip install "
            f"'forceaxis[{extra}]'`"
        )
