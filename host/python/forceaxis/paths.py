"""Where models and experiments are: the checkout's sim/, or the copy inside an installed wheel."""

from pathlib import Path

_package = Path(__file__).resolve().parent
_checkout = _package.parents[2] / "sim"

SIM = _checkout if (_checkout / "experiments").is_dir() else _package / "sim"
EXPERIMENTS = SIM / "experiments"
MODELS = SIM / "models"
MEASUREMENTS = SIM / "measurements"


def display(path: Path | str) -> str:
    """The path as a reader would type it: relative to the current folder where it lies below."""
    path = Path(path).resolve()
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
