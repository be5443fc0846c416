"""What the manual generates as it is built: keys of configs, help of commands, public doors."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any, ClassVar

from config_keys import keys_of, table_of
from docutils import nodes
from docutils.parsers.rst import directives
from public_doors import guarded, map_of, page_of, signature_of
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from jaxrender.catalogue import MODELS, Model
from jaxrender.pipelines.config import RecipeConfig, RunConfig, json_schema
from jaxrender.pipelines.config.sweep import SweepConfig

_ROOTS = {"run": RunConfig, "recipe": RecipeConfig, "sweep": SweepConfig}
# The folder in which a page is executed.
_WORKPLACE = re.compile(r"/tmp/\w+/")
_SOURCES = Path(__file__).parents[2]


class _Generated(SphinxDirective):
    """A directive whose content is written in MyST."""

    required_arguments = 1

    def parsed(self, text: str) -> list[nodes.Node]:
        return self.parse_text_to_nodes(text, allow_section_headings=True)


class ConfigKeys(_Generated):
    """``{config-keys} run``: the table of all keys, or of one ``section``."""

    option_spec: ClassVar[dict[str, Any]] = {"section": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        """Make the table."""
        keys = keys_of(json_schema(_ROOTS[self.arguments[0]]))
        section = self.options.get("section")
        wanted = [key for key in keys if section is None or _top(key.name) in section.split()]
        return self.parsed(table_of(wanted))


class CommandHelp(_Generated):
    """``{command-help} fit``: what ``jaxrender fit --help`` prints."""

    def run(self) -> list[nodes.Node]:
        """Ask the command line itself."""
        command = [] if self.arguments[0] == "jaxrender" else [self.arguments[0]]
        help_of = [sys.executable, "-m", "jaxrender", *command, "--help"]
        done = subprocess.run(help_of, capture_output=True, text=True, check=True)
        return self.parsed(f"```{{code-block}} text\n{done.stdout.rstrip()}\n```")


class PackageMap(_Generated):
    """``{package-map} brdf``: what lives in a package, as it says itself."""

    def run(self) -> list[nodes.Node]:
        """Ask the package."""
        return self.parsed(f"````{{code-block}} text\n{map_of(self.arguments[0])}\n````")


class PackageDoor(_Generated):
    """``{package-door} brdf``: the public names of a package, by noun."""

    def run(self) -> list[nodes.Node]:
        """Ask the package."""
        return self.parsed(page_of(self.arguments[0]))


class ModelTables(_Generated):
    """``{model-tables} all``: every model of the catalogue, with its numbers."""

    def run(self) -> list[nodes.Node]:
        """Ask the catalogue."""
        return self.parsed("\n".join(map(_model, MODELS.values())))


def _model(model: Model) -> str:
    lines = [f"### {model.name}", "", f"{model.surface[0].upper()}{model.surface[1:]}.", ""]
    lines += [
        "| number | symbol | meaning | where | found or stated | else |",
        "|---|---|---|---|---|---|",
    ]
    words = {"amplitude": "found", "searched": "found", "stated": "stated", "sum": "told"}
    for one in model.numbers:
        settled = "" if one.settled is None else f"{one.settled:g}"
        meaning = _guarded(one.meaning)
        lines.append(
            f"| `{one.name}` | {_guarded(one.symbol)} | {meaning} | `{one.domain.text}` "
            f"| {words[one.part]} | {settled} |"
        )
    for name, chosen in model.options.items():
        lines.append(f"| `{name}` | | a choice | | stated | `{chosen}` |")
    return "\n".join([*lines, ""])


class Experiments(_Generated):
    """``{experiments} figure_6``: the scripts whose names match, with their pictures and code."""

    def run(self) -> list[nodes.Node]:
        """Read what stands at the top of each script."""
        pattern, text = re.compile(self.arguments[0]), []
        for script in sorted((_SOURCES / "experiments").glob("*.py")):
            if pattern.fullmatch(script.stem):
                text.append(self._entry(script))
        if not text:
            raise self.error(f"no script in experiments/ matches {self.arguments[0]!r}")
        return self.parsed("\n".join(text))

    def _entry(self, script: Path) -> str:
        self.env.note_dependency(str(script))
        quoted = re.search(r'"""(.*?)"""', script.read_text(encoding="utf-8"), re.DOTALL)
        assert quoted is not None
        title, _, rest = quoted.group(1).partition("\n\n")
        lines = [f"### {script.stem}", "", _guarded(title), ""]
        if rest.strip():
            lines += ["````{dropdown-text}", rest.strip(), "````", ""]
        picture = next(
            (
                path
                for folder in ("experiments", "docs/gallery", "experiments/out")
                for path in [_SOURCES / folder / f"{script.stem}.png"]
                if path.exists()
            ),
            None,
        )
        if picture is not None:
            lines += [f"```{{image}} /../{picture.relative_to(_SOURCES)}", f":alt: {script.stem}"]
            lines += ["```", ""]
        lines += [f"{{download}}`the code </../experiments/{script.name}>`", ""]
        return "\n".join(lines)


class DropdownText(SphinxDirective):
    """Text as it stands in a script, folded away."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Fold it."""
        text = nodes.literal_block("\n".join(self.content), "\n".join(self.content))
        text["language"] = "text"
        opened = nodes.raw("", "<details><summary>what it says of itself</summary>", format="html")
        return [opened, text, nodes.raw("", "</details>", format="html")]


def _guarded(text: str) -> str:
    return re.sub(r"([_*<$|])", r"\\\1", " ".join(text.split()))


def _top(name: str) -> str:
    return re.split(r"[.\[]", name)[0]


def _as_it_is_read(app: Sphinx, tree: nodes.document) -> None:
    """Show cells as a reader types them, and leave out where the manual was built."""
    for block in tree.findall(nodes.literal_block):
        text = block.astext()
        shown = _WORKPLACE.sub("", text)
        if text.startswith("%%bash\n"):
            shown, block["language"] = shown.removeprefix("%%bash\n"), "bash"
        elif text.startswith("%%writefile "):
            name, _, shown = shown.removeprefix("%%writefile ").partition("\n")
            shown = f"# {name.removeprefix('changed/')}\n{shown}"
            block["language"] = "python" if name.endswith(".py") else "jinja"
        if shown != text:
            block.rawsource, block.children = shown, []
            block += nodes.Text(shown)


def _signature(app: Sphinx, what: str, name: str, value: Any, *rest: Any) -> Any:
    if what not in ("function", "class", "method"):
        return None
    signature = signature_of(value)
    if signature is None:
        return ("", None) if what == "class" else None
    arguments, arrow, returned = signature.partition(" -> ")
    return arguments, returned if arrow else None


def _docstring(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list) -> None:
    lines[:] = guarded(lines)


def setup(app: Sphinx) -> dict[str, Any]:
    """Make the directives known."""
    app.add_directive("config-keys", ConfigKeys)
    app.add_directive("command-help", CommandHelp)
    app.add_directive("package-map", PackageMap)
    app.add_directive("package-door", PackageDoor)
    app.add_directive("model-tables", ModelTables)
    app.add_directive("experiments", Experiments)
    app.add_directive("dropdown-text", DropdownText)
    app.connect("doctree-read", _as_it_is_read)
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-process-docstring", _docstring)
    return {"version": "1", "parallel_read_safe": True}
