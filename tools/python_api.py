"""The public Python API as Markdown: signatures, fields and docstrings, read from the source text.

`filled(page)` writes the entries of a page between lines of this form:

    <!-- api forceaxis.linear.loops: LoopSpec, force_loop -->
    <!-- end of api -->
"""

import ast
import re
from pathlib import Path

import forceaxis._core as core

PACKAGE = Path(__file__).resolve().parents[1] / "host/python"
BLOCK = re.compile(
    r"(?P<head><!-- api (?P<module>[\w.]+): (?P<names>[\w, ]+) -->\n)"
    r".*?(?P<end><!-- end of api -->)",
    re.S,
)
NOT_CONSTRUCTED = {"Axis", "Result"}  # a program gets these from other functions
COMPILED = "forceaxis._core"  # its signatures are in _core.pyi, its docstrings in the module itself


def source(module):
    """Source text of a module of the package."""
    path = PACKAGE / module.replace(".", "/")
    candidates = (path.with_suffix(".pyi"), path.with_suffix(".py"), path / "__init__.py")
    return next(p for p in candidates if p.exists()).read_text(encoding="utf-8")


def prose(text):
    """A docstring as Markdown, in which no character outside of backticks is a command."""
    paragraphs = []
    for paragraph in text.split("\n\n"):
        pieces = " ".join(paragraph.split()).split("`")
        pieces[::2] = [
            re.sub(r"([*_\[\]])", r"\\\1", piece).replace("<", "&lt;") for piece in pieces[::2]
        ]
        paragraphs.append("`".join(pieces))
    return "\n\n".join(paragraphs)


def decorators(node):
    """The names of the decorators of a function."""
    return {d.id for d in node.decorator_list if isinstance(d, ast.Name)}


def signature(name, node):
    """NAME(parameters) -> type, without self and cls."""
    arguments = node.args
    for listed in (arguments.posonlyargs, arguments.args):
        if listed and listed[0].arg in ("self", "cls"):
            listed.pop(0)
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"{name}({ast.unparse(arguments)}){returns}".replace("'", '"')


def entry(heading, text):
    """A list item: the signature, and the docstring below it."""
    about = prose(text or "").replace("\n\n", "\n\n    ")
    return f"- `{heading}`\n\n    {about}\n\n"


def fields(node, lines):
    """The fields of a dataclass or NamedTuple: (name: type = default, comment on its line)."""
    for item in node.body:
        if not isinstance(item, ast.AnnAssign) or item.target.id.startswith("_"):
            continue
        if ast.unparse(item).partition("= ")[2].startswith("json_field("):
            item.value = None  # describes the form of JSON
        text = ast.unparse(item)
        comment = re.search(r"\s#:? ?(.*)$", lines[item.end_lineno - 1])
        yield text.replace("'", '"'), comment[1] if comment else ""


def definition(module, name):
    """(node, its module) of a class or function that a module defines or imports; else None."""
    for node in ast.parse(source(module)).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == name:
            return node, module
        if (
            isinstance(node, ast.ImportFrom)
            and (node.module or "").startswith("forceaxis.")
            and name in {alias.name for alias in node.names}
        ):
            return definition(node.module, name)
    return None


def members(node, module):
    """The functions of a class of a module and of its bases in the package."""
    own = [item for item in node.body if isinstance(item, ast.FunctionDef)]
    names = {item.name for item in own}
    for base in node.bases:
        if isinstance(base, ast.Name) and (found := definition(module, base.id)):
            own += [item for item in members(*found) if item.name not in names]
    return own


def class_text(node, module):
    """A class: its docstring, its fields and its public methods and properties."""
    text = f"### {node.name}\n\n{prose(ast.get_docstring(node) or '')}\n\n"
    rows = list(fields(node, source(module).splitlines()))
    if rows and not any(note for _, note in rows):
        text += f"Fields: {', '.join(f'`{field}`' for field, _ in rows)}.\n\n"
    elif rows:
        text += "| field | meaning |\n| --- | --- |\n"
        cells = [(field.replace("|", "\\|"), prose(note)) for field, note in rows]
        text += "".join(f"| `{field}` | {note} |\n" for field, note in cells) + "\n"
    variable = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", node.name).lower()
    for item in members(node, module):
        if item.name == "__init__" and node.name not in NOT_CONSTRUCTED:
            heading = signature(node.name, item).removesuffix(" -> None")
            text += entry(heading, ast.get_docstring(item))
        elif not item.name.startswith("_"):
            marks = decorators(item)
            owner = node.name if marks & {"classmethod", "staticmethod"} else variable
            if marks & {"property", "cached_property"}:
                heading = f"{owner}.{item.name}: {ast.unparse(item.returns)}".replace("'", '"')
            else:
                heading = signature(f"{owner}.{item.name}", item)
            text += entry(heading, ast.get_docstring(item))
    return text


def api(module, names):
    """The entries of the named classes and functions of a module."""
    text = ""
    for name in names:
        node, owner = definition(module, name)
        if isinstance(node, ast.ClassDef):
            text += class_text(node, owner)
            continue
        about = ast.get_docstring(node)
        if owner == COMPILED:
            about = getattr(core, name).__doc__.partition("\n\n")[2]
        text += entry(signature(name, node), about)
    return text


def filled(page):
    """The text of a page with the entries between its marks."""
    return BLOCK.sub(
        lambda m: (
            f"{m['head']}\n{api(m['module'], re.split(', *', m['names'])).rstrip()}\n\n{m['end']}"
        ),
        page,
    )
