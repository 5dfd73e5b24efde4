"""Options that selected a connection before `--on` replaced them. The error message for such an
option shows the command with `--on`."""

import shlex
from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol, cast

import click

from forceaxis._core import InputError

FORMER = frozenset(
    (
        "--axis",
        "--lcm-url",
        "--can",
        "--node",
        "--own-node",
        "--modbus",
        "--sim",
        "--store",
        "--url",
    )
)


class AddressType(Protocol):
    """The members of the class AxisAddress (type of the option --on) that this module uses."""

    is_repeatable: bool

    def address(self, source: str, text: str) -> object: ...


class Former(NamedTuple):
    """Options of earlier versions that were found among the arguments of a command. `names`: names
    of these options. `words`: the arguments with --on in place of these options, or None if --on
    cannot replace them. `reason`: the reason why --on cannot replace them, as the end of the error
    message, or ""."""

    names: list[str]
    words: list[str] | None = None
    reason: str = ""


def found_in(command: click.Command, words: Sequence[str]) -> Former | None:
    """Find options of earlier versions in `words`, the arguments of a command. Return None if the
    command has no option --on, or if `words` contains no such option."""
    on_type = next((o.type for o in command.params if "--on" in o.opts), None)
    if on_type is None:
        return None
    kind = cast(AddressType, on_type)
    former = FORMER - {name for option in command.params for name in option.opts}
    given: dict[str, list[str]] = {}
    rest: list[str] = []
    place = 0  # index in `rest` at which --on replaces the earlier options
    remaining = deque(words)
    is_whole = True
    while remaining:
        word = remaining.popleft()
        name, equals, value = word.partition("=")
        if word == "--" or name not in former:
            rest += [word, *remaining] if word == "--" else [word]
            if word == "--":
                break
            continue
        place = place if given else len(rest)
        if not equals and remaining and not remaining[0].startswith("--"):
            value = remaining.popleft()
        is_whole = is_whole and value != ""
        given.setdefault(name, []).append(value)
    if not given:
        return None
    on = addresses(given) if is_whole else []
    # If an earlier option was given several times, its last value counted.
    on = on if kind.is_repeatable else on[-1:]
    try:
        for address in on:
            kind.address("--on", address)
    except InputError as error:
        return Former([*given], None, f"; {error}")
    if not on:
        return Former([*given])
    options = [word for address in on for word in ("--on", address)]
    return Former([*given], [*rest[:place], *options, *rest[place:]])


def expect_none(context: click.Context, words: Sequence[str]) -> None:
    """Raise UsageError if `words`, the arguments of a command, contain an option that the command
    no longer has. If the values of this option name an axis, the message shows the same command
    with --on."""
    former = found_in(context.command, words)
    if former is None:
        return
    told = former.reason or ", such as --on can0:5"
    if former.words is not None:
        told = f"; write `{context.command_path} {shlex.join(former.words)}`"
    raise click.UsageError(
        f"{', '.join(former.names)}: expected the option --on ADDRESS instead{told}"
    )


def addresses(given: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the addresses of the axes that the user selected by options of earlier versions.
    `given`: {option: values}. The returned list is empty if these options select several buses or
    no bus."""
    last = {name: values[-1] for name, values in given.items()}
    buses = {"--can", "--modbus", "--sim", "--axis", "--lcm-url", "--url"} & set(given)
    url = last.get("--lcm-url") or last.get("--url")
    if len(buses - {"--lcm-url", "--url"}) > 1 or not buses or (url and buses & {"--can", "--sim"}):
        return []
    nodes = given.get("--node", [])
    if "--can" in given:
        own = f"@{last['--own-node']}" if "--own-node" in given else ""
        return [f"{last['--can']}{number}{own}" for number in _ends(":", nodes)]
    if "--modbus" in given:
        return _modbus(last["--modbus"], nodes)
    if "--sim" in given:
        return [f"sim:{last['--sim']}" + (f"@{last['--store']}" if "--store" in given else "")]
    return [
        f"lcm{number}{f'@{url}' if url else ''}" for number in _ends(":", given.get("--axis", []))
    ]


def _modbus(place: str, nodes: Sequence[str]) -> list[str]:
    if place.startswith("tcp:"):
        return [f"{place.rstrip('/')}{number}" for number in _ends("/", nodes)]
    device, colon, rate = place.partition(":")
    return [f"serial:{device}{f'@{rate}' if colon else ''}{number}" for number in _ends(":", nodes)]


def _ends(separator: str, numbers: Sequence[str]) -> list[str]:
    return [f"{separator}{number}" for number in numbers] or [""]
