"""Commands and options of earlier versions. The error message for one of them shows the command
line of the present version."""

import shlex
from collections.abc import Sequence

import click

from forceaxis.cli import former_options

# Commands that have another name in this version: {earlier name: present name}.
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

# Earlier options of a control law, and the key of each in the text of --law: {option: key}.
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

# What a user does instead of using an option that no longer exists: {(command, option): text}.
GONE = {
    ("design", "--ms-late"): "at latency 1 the design permits 1.1 times --ms",
    ("loop compliance", "--adc-bits"): "give a model with this number of bits",
    ("identify fit", "--scale"): "multiply the column of the file by the factor",
    ("cycle statistics", "--curves"): "the last 20 curves are drawn",
    ("monitor", "--codes"): "the key u shows counts and DAC codes",
    ("bench", "--linear"): "--check measures the linear analysis too",
}


def present_line(arguments: Sequence[str]) -> str:
    """Return the command line of the present version for a command line of an earlier version.
    `arguments`: the earlier command line, beginning with the command."""
    return shlex.join(["forceaxis", *_present_words(arguments)])


def _present_words(arguments: Sequence[str]) -> list[str]:
    command, *rest = arguments
    words = COMMANDS.get(command, command).split()
    return [*words, *(with_one_law(rest) if words[0] == "loop" else rest)]


def told(arguments: Sequence[str], context: click.Context) -> str:
    """Return the error message for a command that was renamed since an earlier version. The message
    shows the complete command line for this version, and says what else is wrong in the typed
    command line. `context`: the click context of the program."""
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
    """Return an error message that says what to do instead of using a removed option. Return None
    if the command did not have the option of `error` in an earlier version."""
    if not isinstance(error, click.exceptions.NoSuchOption) or error.ctx is None:
        return None
    command = error.ctx.command_path.removeprefix("forceaxis ")
    instead = GONE.get((command, error.option_name))
    return instead and f"{error.option_name}: expected {command} without this option; {instead}"


def with_one_law(arguments: Sequence[str]) -> list[str]:
    """Return `arguments` with a single option --law. It replaces all options --law and all options
    of earlier versions that described a control law, and is at the place of the first replaced
    option."""
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
