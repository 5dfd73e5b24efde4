"""Errors of the library name parameters; the command line prints the options that set these."""

import pickle

import click
import pytest
from forceaxis._core import InputError
from forceaxis.cli import main as cli
from forceaxis.cli.common import Verb, option_of
from forceaxis.errors import ParameterError


def refused(error, *arguments):
    """The message that a verb prints whose code raises `error`."""

    @click.command(cls=Verb)
    @click.argument("model", metavar="MODEL|EXPERIMENT", default="")
    @click.option("-g", "--gain", "gain")
    @click.option("--firmware-gain")
    @click.option("--stiffness-n-per-m")
    @click.option("--from-hz", "low_hz")
    @click.option("--over", "ranges")
    @click.option("--output", "outputs")
    def verb(**_):
        raise error

    with pytest.raises(InputError) as refusal:
        verb(list(arguments), standalone_mode=False)
    return str(refusal.value)


def test_an_error_of_a_parameter_names_it_and_is_an_input_error():
    error = ParameterError("gain", "expected a number > 0, got -1")
    assert isinstance(error, InputError)
    assert str(error) == "gain: expected a number > 0, got -1"
    assert (error.parameter, error.text) == ("gain", "expected a number > 0, got -1")


def test_an_error_of_a_parameter_comes_back_from_a_worker_process():
    error = pickle.loads(pickle.dumps(ParameterError("gain", "expected 1")))
    assert (error.parameter, error.text, str(error)) == ("gain", "expected 1", "gain: expected 1")


@pytest.mark.parametrize(
    ("parameter", "option"),
    [
        ("gain", "--gain"),  # the longest of its names
        ("firmware_gain", "--firmware-gain"),
        ("stiffness_N_per_m", "--stiffness-n-per-m"),  # units keep their letters in the library
        ("from_hz", "--from-hz"),
        ("over", "--over"),
        ("outputs", "--output"),
        ("model", "MODEL|EXPERIMENT"),
        ("span_m", "span_m"),  # no option sets it
    ],
)
def test_a_verb_prints_the_option_of_a_parameter(parameter, option):
    assert refused(ParameterError(parameter, "expected 1, got 2")) == f"{option}: expected 1, got 2"


def test_a_verb_prints_the_options_of_other_parameters_in_the_text():
    error = ParameterError("gain", "expected `gain` or `firmware_gain`, see `man forceaxis` `x`")
    assert refused(error) == ("--gain: expected --gain or --firmware-gain, see `man forceaxis` `x`")


def test_every_verb_maps_parameters():
    """A verb of another class would print the name of the parameter instead of its option."""

    def verbs(command):
        if isinstance(command, click.Group):
            context = click.Context(command)
            for name in command.list_commands(context):
                yield from verbs(command.get_command(context, name))
        else:
            yield command

    found = list(verbs(cli.cli))
    assert len(found) > 40
    assert all(isinstance(verb, Verb) for verb in found)
    limit = next(verb for verb in found if verb.name == "limit")
    asked = ("overrides", "modes", "states", "over", "output", "damping_Ns_per_m")
    assert [option_of(limit, name) for name in asked] == [
        "--set", "--modes", "--mode", "--over", "--output", "--law damping",
    ]  # fmt: skip
