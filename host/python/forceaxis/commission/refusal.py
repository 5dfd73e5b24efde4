"""Why a step of commissioning ended without a result."""


class Refusal(Exception):
    """A step's refusal; `name` is one word for programs, the text says what was found, what was
    expected and what to do."""

    def __init__(self, name, text):
        super().__init__(f"{name}: {text}")
        self.name, self.text = name, text
