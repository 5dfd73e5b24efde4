"""`forceaxis completion`: install the completion script of a shell."""

import os
import shlex
from pathlib import Path
from typing import cast

import click
from click.shell_completion import ShellComplete, get_completion_class

from forceaxis import paths
from forceaxis.cli.common import Verb, Verbs

SHELLS = click.Choice(["bash", "zsh", "fish"])
# Bash splits command-line words such as sim:contact and NAME=VALUE at the colon or equals sign.
# These lines join the pieces of a word. KEPT_REMOVED then removes the piece that Bash keeps.
JOINED_WORDS = """
    local words=() cword=0 i kept
    for ((i = 0; i < ${#COMP_WORDS[@]}; i++)); do
        if ((i > 0)) && [[ ${COMP_WORDS[i]} == [:=]* || ${COMP_WORDS[i-1]} == *[:=] ]] &&
            [[ ${words[-1]} != -* ]]; then
            words[-1]+=${COMP_WORDS[i]}
        else
            words+=("${COMP_WORDS[i]}")
        fi
        ((i == COMP_CWORD)) && cword=$((${#words[@]} - 1))
    done
    kept=${words[cword]%"${words[cword]##*[:=]}"}
"""
KEPT_REMOVED = """
    COMPREPLY=("${COMPREPLY[@]#"$kept"}")
    [[ ${#COMPREPLY[@]} == 1 && ${COMPREPLY[0]} == *[:=/] ]] && compopt -o nospace
"""


def _script(shell: str) -> str:
    cli = click.get_current_context().find_root().command
    complete = cast(type[ShellComplete], get_completion_class(shell))
    text = complete(cli, {}, "forceaxis", "_FORCEAXIS_COMPLETE").source()
    if shell != "bash":
        return text
    text = text.replace("    local response\n", f"    local response{JOINED_WORDS}", 1)
    text = text.replace("${COMP_WORDS[*]}", "${words[*]}").replace("=$COMP_CWORD", "=$cword")
    return text.replace("\n    return 0\n", f"{KEPT_REMOVED}    return 0\n", 1)


def _places(shell: str) -> tuple[Path, Path | None]:
    """Return the path of the completion script for a shell, and the path of the start-up file of
    the shell that has to load this script. The second path is None for Fish, which needs no such
    file."""
    home = Path.home()
    data = Path(os.environ.get("XDG_DATA_HOME") or home / ".local/share")
    if shell == "fish":
        config = Path(os.environ.get("XDG_CONFIG_HOME") or home / ".config")
        return config / "fish/completions/forceaxis.fish", None
    start = (
        Path(os.environ.get("ZDOTDIR") or home) / ".zshrc" if shell == "zsh" else home / ".bashrc"
    )
    return data / f"forceaxis/completion.{shell}", start


@click.group(cls=Verbs, epilog="forceaxis completion install")
def completion() -> None:
    """Set up a shell so that the Tab key completes the names of commands, options, models,
    experiments and firmware objects."""


@completion.command(
    cls=Verb, epilog="forceaxis completion install\nforceaxis completion install zsh"
)
@click.argument("shell", metavar="[SHELL]", type=SHELLS, required=False)
def install(shell: str | None) -> None:
    """Install the completion script for the shell SHELL, which is bash, zsh or fish.

    Without SHELL the command uses the shell that the environment variable SHELL names. The
    command writes the script and, for bash and zsh, one line at the end of the start-up file of
    the shell. A second call replaces the script and adds no line.
    """
    named = Path(os.environ.get("SHELL", "")).name
    if not shell and named not in SHELLS.choices:
        raise click.UsageError(
            f"SHELL: expected bash, zsh or fish, got {named or 'none'}; give the name of the shell"
        )
    shell = shell or named
    file, start = _places(shell)
    file.parent.mkdir(parents=True, exist_ok=True)
    paths.replace_text(file, _script(shell))
    click.echo(f"script       {paths.quoted(file)}")
    if start:
        line = f"source {shlex.quote(str(file))}"
        text = start.read_text(encoding="utf-8") if start.exists() else ""
        if line not in text.splitlines():
            paths.replace_text(start, f"{text.rstrip(chr(10))}\n{line}\n".lstrip("\n"))
        click.echo(f"read by      {paths.quoted(start)}")
    click.echo(f"next         exec {shell}, and press the tabulator after `forceaxis run `")


@completion.command(cls=Verb, epilog="forceaxis completion show bash")
@click.argument("shell", metavar="SHELL", type=SHELLS)
def show(shell: str) -> None:
    """Print the completion script for the shell SHELL (bash, zsh or fish), for users who install
    this script by hand."""
    click.echo(_script(shell))


VERBS = (completion,)
