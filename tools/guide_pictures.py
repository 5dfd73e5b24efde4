"""Renders the pictures of the guide: a hook of mkdocs (mkdocs.yml).

Each Graphviz file NAME.dot below docs/ becomes NAME.svg beside it in the built site; nothing is
written into docs/.
"""

import shutil
import subprocess
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files


def rendered(source: Path) -> bytes:
    """The SVG of a Graphviz file; PluginError names the file where dot refuses it."""
    done = subprocess.run(["dot", "-Tsvg", source], capture_output=True)
    if done.returncode or done.stderr:
        raise PluginError(f"{source}: {done.stderr.decode(errors='replace').strip()}")
    return done.stdout


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds a picture for each .dot file below the folder of the pages."""
    if shutil.which("dot") is None:
        raise PluginError("expected the program dot of Graphviz; tools/setup installs it")
    folder = Path(config.docs_dir)
    for source in sorted(folder.rglob("*.dot")):
        name = source.relative_to(folder).with_suffix(".svg").as_posix()
        files.append(File.generated(config, name, content=rendered(source)))
    return files
