"""Earlier spellings of commands and options, from which an error message shows the present
spelling."""

import shlex
from collections.abc import Sequence

import click

from forceaxis.cli import former_options

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
    return shlex.join(["forceaxis", *_present_words(arguments)])


def _present_words(arguments: Sequence[str]) -> list[str]:
    command, *rest = arguments
    words = COMMANDS.get(command, command).split()
    return [*words, *(with_one_law(rest) if words[0] == "loop" else rest)]


def told(arguments: Sequence[str], context: click.Context) -> str:
    """Return the error message about a command that has moved: the whole present command line, and
    what else is wrong with it. `context` is that of the program."""
    words = _present_words(arguments)
    count, command, parent = 0, context.command, context
    while isinstance(command, click.Group) and count < len(words):
        found = command.get_command(parent, words[count])
        if found is None:
            break
        command, parent = found, click.Context(found, info_name=words[count], parent=parent)
        count += 1
    former = former_options.found_in(command, words[count:])
    if former and former.words is not None:
        words[count:] = former.words
    more = ""
    try:
        former_options.expect_none(parent, words[count:])
        command.make_parser(parent).parse_args(words[count:])
    except click.UsageError as error:
        more = f"; {gone(error) or error.format_message()}"
    line = shlex.join(["forceaxis", *words])
    return (
        f"{arguments[0]}: expected the present name of this command, `{line}`, got its earlier "
        f"name{more}"
    )


def gone(error: click.UsageError) -> str | None:
    """Return what a user does without the option of a usage error, if its command had this option
    earlier. Otherwise return None."""
    if not isinstance(error, click.exceptions.NoSuchOption) or error.ctx is None:
        return None
    command = error.ctx.command_path.removeprefix("forceaxis ")
    instead = GONE.get((command, error.option_name))
    return instead and f"{error.option_name}: expected {command} without this option; {instead}"


def with_one_law(arguments: Sequence[str]) -> list[str]:
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
            first, colon, more = value.partition(":")
            if not colon and "=" in value:
                first, more = "", value
            name = first or name
            pairs += [more] if more else []
        else:
            pairs.append(f"{LAW_OPTIONS[option]}={value}")
    if place is not None:
        kept[place:place] = ["--law", ":".join(filter(None, (name, ",".join(pairs))))]
    return kept
