"""Entry points of the programs of this package: `forceaxis`, and the compiled programs axis_linux,
axis_node, plant_node and gateway.

Ctrl-C ends `forceaxis` at any time, also while modules are loaded, with status 130 and one line.
"""

import os
import signal
import sys


def main() -> None:
    """Runs the program `forceaxis`, the command line of this package."""
    interrupted = False

    def interrupt(*_: object) -> None:
        nonlocal interrupted
        interrupted = True
        raise KeyboardInterrupt

    def unraisable(what: "sys.UnraisableHookArgs") -> None:
        # Python ignores an interrupt (Ctrl-C) that occurs in a destructor.
        # This function raises an interrupt again if it occurred in a destructor.
        if issubclass(what.exc_type, KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        else:
            sys.__unraisablehook__(what)

    try:
        sys.unraisablehook = unraisable
        # If the shell has started this program in the background, SIGINT stays ignored.
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, interrupt)
        from forceaxis.cli.main import main as command_line

        command_line()
    except SystemExit:
        raise
    except BaseException:  # An interrupt during the import of a module may cause any exception.
        if not interrupted:
            raise
        sys.stderr.write("forceaxis: interrupted\n")
        sys.exit(130)
    finally:
        if signal.getsignal(signal.SIGINT) is interrupt:
            signal.signal(signal.SIGINT, lambda *_: os._exit(130))


def axis_linux() -> None:
    """Runs the program `axis_linux`, the firmware as a real-time process of Linux that controls a
    drive over CANopen."""
    _become("axis_linux")


def axis_node() -> None:
    """Runs the program `axis_node`, the firmware as a process that is connected to a bus."""
    _become("axis_node")


def plant_node() -> None:
    """Runs the program `plant_node`, the simulated plant as a process that is connected to a
    bus."""
    _become("plant_node")


def gateway() -> None:
    """Runs the program `gateway`, which connects axes on CANopen with LCM and Modbus TCP."""
    _become("gateway")


def _become(name: str) -> None:
    from forceaxis.cli.common import fail
    from forceaxis.experiments import link

    try:
        program = link.program(name)
    except link.LinkError as error:
        fail(str(error), status=1)
    os.execv(program, [name, *sys.argv[1:]])


if __name__ == "__main__":
    main()
