"""Earlier spellings of commands and options, from which an error message shows the present
spelling."""

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

# The key in the text of --law for each earlier option of a control law.
LAW_OPTIONS = {
    "--integral-rad-per-s": "integral",
    "--derivative-s": "derivative",
    "--lead-zero-hz": "zero",
    "--lead-pole-hz": "pole",
    "--stiffness-n-per-m": "stiffness",
    "--damping-ns-per-m": "damping",
    "--velocity-gain-vs-per-m": "velocity_gain",
    "--gain": "gain",
    "--firmware-gain": "force_gain",
}

# What a user does without an option that a command no longer has: {(command, option): words}.
GONE = {
    ("design", "--ms-late"): "at latency 1 the design permits 1.1 times --ms",
    ("loop compliance", "--adc-bits"): "give a model with this number of bits",
    ("identify fit", "--scale"): "multiply the column of the file by the factor",
    ("cycle statistics", "--curves"): "the last 20 curves are drawn",
    ("monitor", "--codes"): "the key u shows counts and DAC codes",
    ("bench", "--linear"): "--check measures the linear analysis too",
}


def present_line(arguments: Sequence[str]) -> str:
    """Return the present spelling of a command line. `arguments`: the command line with earlier
    spellings, beginning with the command."""
    command, *rest = arguments
    words = COMMANDS.get(command, command).split()
    if words[0] == "loop":
        rest = _with_one_law(rest)
    return shlex.join(["forceaxis", *words, *rest])


def _with_one_law(arguments: Sequence[str]) -> list[str]:
    """Return `arguments` with one option --law, at the place of the first option of a control law,
    in place of --law and of the earlier options."""
    kept: list[str] = []
    name, pairs, place = "", list[str](), None
    rest = iter(arguments)
    for word in rest:
        option, equals, value = word.partition("=")
        if option != "--law" and option not in LAW_OPTIONS:
            kept.append(word)
            continue
        place = len(kept) if place is None else place
        value = value if equals else next(rest, "")
        if option == "--law":
            name, _, more = value.partition(":")
            pairs += [more] if more else []
        else:
            pairs.append(f"{LAW_OPTIONS[option]}={value}")
    if place is not None:
        kept[place:place] = ["--law", ":".join(filter(None, (name, ",".join(pairs))))]
    return kept
