"""The templates of this folder. The page of a template is one HTML file that needs no other
file."""

from importlib import resources

import jinja2

from forceaxis import drawing, words


def _text(name: str) -> str:
    """Returns the text of a file in this folder, or of the common style sheet page.css."""
    if name == "page.css":
        return drawing.page_style()
    return resources.files("forceaxis.pages").joinpath(name).read_text(encoding="utf-8")


def template(name: str) -> jinja2.Template:
    """Returns the template `name`.html.jinja, in which the characters of each text are escaped for
    HTML."""
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_text),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["plain"] = words.plain
    return environment.get_template(f"{name}.html.jinja")
