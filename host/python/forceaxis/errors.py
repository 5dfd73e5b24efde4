"""Errors of the library, with one exception type for each error that a caller has to
distinguish."""

from forceaxis._core import InputError


class ParameterError(InputError):
    """Error: a parameter of a library function has a value that is not accepted.

    `parameter` is the name of the parameter, and `text` says what was expected of its value. The
    command line prints the option that sets this parameter instead of the name.
    """

    def __init__(self, parameter: str, text: str) -> None:
        super().__init__(f"{parameter}: {text}")
        self.parameter = parameter
        self.text = text

    def __reduce__(self) -> tuple[type["ParameterError"], tuple[str, str]]:
        # Without this method, an error in a worker process could not reach this process.
        return type(self), (self.parameter, self.text)
