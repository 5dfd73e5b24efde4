"""Earlier spellings of commands and options, so that an error message can show the present one."""

import shlex
from collections.abc import Sequence

# The present words of each command that has moved, by its earlier words.
COMMANDS = {
    **{
        name: f"loop {name}"
        for name in (
            "advise", "bode", "compliance", "limit", "linearise", "modes", "nyquist", "poles",
            "rlocus", "step",
        )
    },
    **{name: f"thesis {name}" for name in ("beam", "session", "tables")},
    "check-thesis": "thesis check",
    "incident": "axis incident",
    "bringup": "axis bringup",
    "log": "recording",
    "replay": "recording replay",
}  # fmt: skip


def present_line(arguments: Sequence[str]) -> str:
    """Return the command line of today for `arguments`, which begin with the command."""
    command, *rest = arguments
    return shlex.join(["forceaxis", *COMMANDS.get(command, command).split(), *rest])
