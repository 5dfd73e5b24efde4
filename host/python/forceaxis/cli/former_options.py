"""The options that selected a connection before `--on`: the error for one of them is the command
with `--on`."""

import shlex
from collections.abc import Mapping, Sequence

import click

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


def expect_none(context: click.Context, words: Sequence[str]) -> None:
    """Raise UsageError if `words`, the arguments of a command, contain an option that the command
    no longer has. If the values of the option name an axis, the message shows the same command with
    --on."""
    former = FORMER - {name for option in context.command.params for name in option.opts}
    given: dict[str, list[str]] = {}
    rest: list[str] = []
    place = 0  # of --on among the other words
    remaining = iter(words)
    for word in remaining:
        name, equals, value = word.partition("=")
        if word == "--" or name not in former:
            rest += [word, *remaining] if word == "--" else [word]
            continue
        place = place if given else len(rest)
        given.setdefault(name, []).append(value if equals else next(remaining, ""))
    if not given:
        return
    found = addresses(given)
    on = [word for address in found for word in ("--on", address)]
    example = shlex.join([*rest[:place], *on, *rest[place:]])
    told = f"; write `{context.command_path} {example}`" if found else ", such as --on can0:5"
    raise click.UsageError(f"{', '.join(given)}: expected the option --on ADDRESS instead{told}")


def addresses(given: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the addresses of the axes that earlier options selected, from {option: values}. The
    list is empty if the options select several buses or no bus."""
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
