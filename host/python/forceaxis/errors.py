"""Errors of the library that a caller can distinguish by their type."""

from forceaxis._core import InputError


class ParameterError(InputError):
    """A value that a parameter of the library does not accept.

    `parameter` is the name of the parameter, and `text` says what was expected of its value. The
    command line prints the option that sets this parameter instead of the name.
    """

    def __init__(self, parameter: str, text: str) -> None:
        super().__init__(f"{parameter}: {text}")
        self.parameter = parameter
        self.text = text

    def __reduce__(self) -> tuple[type["ParameterError"], tuple[str, str]]:
        # Without this method, an error from a worker process cannot be created again in this
        # process.
        return type(self), (self.parameter, self.text)
