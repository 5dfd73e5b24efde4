"""The templates of the HTML pages. A page that is made from a template needs no further files."""

from importlib import resources

import jinja2

from forceaxis import drawing, words
from forceaxis.pages.commands import with_commands


def _text(name: str) -> str:
    """Returns the text of a file in the folder of the templates, or of the common style sheet
    page.css."""
    if name == "page.css":
        return drawing.page_style()
    return resources.files("forceaxis.pages").joinpath(name).read_text(encoding="utf-8")


def _for_reader(value: object) -> object:
    """Prepares a value for its insertion into a page. In a text, commands of `forceaxis` replace
    the names of actions. Other values do not change."""
    is_html = hasattr(value, "__html__")
    return with_commands(value) if isinstance(value, str) and not is_html else value


def template(name: str) -> jinja2.Template:
    """Returns the page template in the file `name`.html.jinja. The template escapes all inserted
    texts for HTML."""
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_text),
        autoescape=True,
        finalize=_for_reader,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["plain"] = words.plain
    return environment.get_template(f"{name}.html.jinja")
