"""The manual in ``docs/`` says what is true of the program; no Sphinx is needed to see that.

- Every key of a run, a recipe and a sweep is in the generated tables, with its meaning.
- Every command has a section; every package at the front door, and every experiment, is shown.
- Configs on the pages are configs; keys, commands, options, files, links and Python names exist.
- Every page can be reached from the first.
"""

import ast
import importlib
import inspect
import json
import re
import sys
import typing
from pathlib import Path

import pytest
from pydantic import BaseModel
from ruamel.yaml import YAML

import jaxrender
import jaxrender.cli
from jaxrender.catalogue import MODELS
from jaxrender.cli.app import app
from jaxrender.pipelines.config import Parameter, RecipeConfig, RunConfig, json_schema
from jaxrender.pipelines.config.sweep import SweepConfig

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(page for page in DOCS.rglob("*.md") if "_build" not in page.parts)
NAMED = {str(page.relative_to(DOCS)): page for page in PAGES}
ROOTS = {"run": RunConfig, "recipe": RecipeConfig, "sweep": SweepConfig}

_FENCE = re.compile(r"^(`{3,})(.*?)\n(.*?)^\1\s*$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s]+)\)|\{(?:download|doc)\}`[^`<]*<?([^`>]+)>?`")
_CODE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
_OPTION = re.compile(r"(?<=\s)--?[a-z][\w-]*")


def extension(name):
    """Load what generates parts of pages, as Sphinx does."""
    sys.path.insert(0, str(DOCS / "extensions"))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.pop(0)


CONFIG_KEYS = extension("config_keys")
KEYS = {root: CONFIG_KEYS.keys_of(json_schema(kind)) for root, kind in ROOTS.items()}
KNOWN = {re.sub(r"\[\]", "", key.name) for keys in KEYS.values() for key in keys}


def text_of(page):
    return page.read_text(encoding="utf-8")


def blocks(page):
    """List the fenced blocks of a page: what they are, and their text without options."""
    for _, kind, body in _FENCE.findall(text_of(page)):
        yield kind.strip(), re.sub(r"\A(?::.*\n)+", "", body)


def prose(page):
    return _FENCE.sub("", text_of(page))


def of_kind(page, *kinds):
    return [body for kind, body in blocks(page) if kind in kinds]


def shell(page):
    """List what is typed in a terminal, without the files that it writes."""
    cells = [b for b in of_kind(page, "{code-cell} ipython3") if b.startswith("%%bash")]
    for body in [*of_kind(page, "sh", "bash"), *cells]:
        typed = re.sub(r"<< 'END'\n.*?^END$", "", body, flags=re.DOTALL | re.MULTILINE)
        yield from typed.replace("\\\n", " ").splitlines()


def python(page):
    cells = of_kind(page, "{code-cell} ipython3")
    written = [b.partition("\n")[2] for b in cells if b.startswith("%%writefile") and ".py\n" in b]
    return [*of_kind(page, "python"), *(b for b in cells if not b.startswith("%%")), *written]


def fields_of(kind, before=""):
    """Name the fields of a section and of those inside it, from the classes themselves."""
    for name, field in kind.model_fields.items():
        yield before + name
        for inner in sections_in(field.annotation):
            yield from fields_of(inner, f"{before}{name}.")


def sections_in(annotation):
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return [] if annotation is Parameter else [annotation]
    return [inner for part in typing.get_args(annotation) for inner in sections_in(part)]


@pytest.mark.parametrize("root", ROOTS)
def test_every_key_is_documented(root):
    told = {key.name.replace("[]", "") for key in KEYS[root]}
    assert told == {*fields_of(ROOTS[root])}
    assert all(key.meaning and key.kind and key.default for key in KEYS[root])
    table = CONFIG_KEYS.table_of(KEYS[root]).splitlines()
    assert len(table) == len(KEYS[root]) + 2
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in table} == {5}


def test_every_section_is_on_the_page():
    page = text_of(NAMED["reference/config.md"])
    shown = {
        word
        for line in re.findall(r"^:section: (.*)$", page, re.MULTILINE)
        for word in line.split()
    }
    assert shown == {*RunConfig.model_fields}
    assert {*re.findall(r"\{config-keys\} (\w+)", page)} == {*ROOTS}


def options_of(command):
    arguments = app[command].assemble_argument_collection()
    return {name for argument in arguments for name in argument.names if name.startswith("-")}


COMMANDS = {name: options_of(name) for name in app if not name.startswith("-")}


def test_every_command_has_a_section_and_two_examples():
    page = text_of(NAMED["reference/commands.md"])
    for command in COMMANDS:
        section = page.partition(f"\n## {command}\n")[2].partition("\n## ")[0]
        assert f"{{command-help}} {command}\n" in section
        assert len(re.findall(rf"^jaxrender {command}\b", section, re.MULTILINE)) >= 2


def test_every_package_and_experiment_is_shown():
    packages = {n for n in jaxrender.__all__ if hasattr(getattr(jaxrender, n), "__path__")}
    pages = {name.split("/")[1][:-3] for name in NAMED if name.startswith("api/")}
    assert packages - {"pipelines"} == pages - {"index"}
    front = text_of(NAMED["api/index.md"])
    assert all(
        f"`jr.{n}`" in front for n in jaxrender.__all__ if n not in {*packages, "__version__"}
    )
    wanted = re.findall(r"\{experiments\} (.*)", text_of(NAMED["gallery.md"]))
    for script in (ROOT / "experiments").glob("*.py"):
        matching = [pattern for pattern in wanted if re.fullmatch(pattern, script.stem)]
        assert len(matching) == 1, f"{script.name} is in {len(matching)} parts of the gallery"


def test_doors_list_every_public_name():
    doors = extension("public_doors")
    for package in ("brdf", "inverse"):
        listed = [name for names in doors.door_of(package).values() for name in names]
        assert sorted(listed) == sorted(getattr(jaxrender, package).__all__)


def test_every_page_is_reached():
    reached, waiting = set(), ["index.md"]
    while waiting:
        name = waiting.pop()
        reached.add(name)
        for body in of_kind(NAMED[name], "{toctree}"):
            for line in filter(None, map(str.strip, body.splitlines())):
                target = (NAMED[name].parent / f"{line}.md").resolve().relative_to(DOCS)
                assert str(target) in NAMED, f"{name}: no page {line}"
                waiting.append(str(target))
    assert reached == {*NAMED}


def anchors_of(page):
    heads = re.findall(r"^#+ (.*)$", _FENCE.sub("", text_of(page)), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("name", NAMED)
def test_links_lead_somewhere(name):
    page = NAMED[name]
    for link in (a or b for a, b in _LINK.findall(prose(page))):
        if link.startswith("http"):
            continue
        target, _, anchor = link.partition("#")
        place = (page.parent / target).resolve() if target else page
        assert place.is_file(), f"{name}: {link} leads nowhere"
        if anchor:
            assert anchor in anchors_of(place), f"{name}: no heading for {link}"


@pytest.mark.parametrize("name", NAMED)
def test_files_and_keys_in_the_text_exist(name):
    for code in _CODE.findall(prose(NAMED[name])):
        if re.fullmatch(r"(experiments|configs|data_synth|tests|docs)/[\w./]+", code):
            made = code.startswith("experiments/out")
            assert made or (ROOT / code).exists(), f"{name}: no file {code}"
        if re.fullmatch(r"(brdf|io|inverse|lighting|pipelines|geometry)/[\w./]+\.py", code):
            assert (ROOT / "jaxrender" / code).exists(), f"{name}: no file {code}"
        words = re.match(r"([a-z_]+(?:\.\w+)+)(?=$|[:=(])", code)
        is_file = re.search(r"\.(yaml|json|exr|nc|csv|html|py|md)$", code)
        if words is None or is_file or name.startswith("extend/") or "/" in code:
            continue
        section = words[1].split(".")[0]
        if section in {*RunConfig.model_fields, *jaxrender.__all__, "jr", "jaxrender"}:
            assert is_key(words[1]) or is_python(words[1]), f"{name}: {words[1]} is nothing"


def is_key(words):
    inner = words.rpartition(".")
    return words in KNOWN or (
        inner[2] in ("bounds", "prior", "start", "fixed") and inner[0] in KNOWN
    )


def is_python(words):
    """Whether a dotted name is a public one, such as ``inverse.fit`` or ``jr.fit``."""
    first, *rest = words.removeprefix("jaxrender.").removeprefix("jr.").split(".")
    found = getattr(jaxrender, first, None)
    for at, word in enumerate(rest):
        if hasattr(found, "__path__") and not hasattr(found, word):
            path = ".".join(["jaxrender", first, *rest[: at + 1]])
            if importlib.util.find_spec(path) is None:
                return False
            found = importlib.import_module(path)
        else:
            found = getattr(found, word, None)
    return found is not None


@pytest.mark.parametrize("name", NAMED)
def test_python_names_exist(name):
    page = NAMED[name]
    for target in re.findall(r"\{py:\w+\}`([\w.]+)`", prose(page)):
        assert is_python(target), f"{name}: no {target}"
    for body in python(page):
        for node in ast.walk(ast.parse(body)):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("jaxrender"):
                for alias in node.names:
                    assert is_python(f"{node.module}.{alias.name}"), f"{name}: {alias.name}"
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "jr":
                assert node.attr in jaxrender.__all__, f"{name}: no jr.{node.attr}"


@pytest.mark.parametrize("name", NAMED)
def test_commands_and_options_exist(name):
    page = NAMED[name]
    inline = [code for code in _CODE.findall(prose(page)) if code.startswith("jaxrender ")]
    for line in [*shell(page), *inline]:
        found = re.search(r"(?:^|[\s/])jaxrender (\S+)(.*)", line)
        if found is None or found[1].startswith(("--", "COMMAND")):
            continue
        command, rest = found[1], found[2].partition(" || ")[0]
        assert command in COMMANDS, f"{name}: no command {command}"
        for option in _OPTION.findall(rest):
            assert option in COMMANDS[command], f"{name}: {command} has no {option}"
        for key in re.findall(r"(?<=[\s\"])([a-z_.]+)=", rest):
            is_number = command in ("analyze", "compress", "measure", "prefilter")
            assert is_number or key in KNOWN, f"{name}: no key {key}"


def configs():
    for name, page in NAMED.items():
        bodies = of_kind(page, "yaml")
        for body in of_kind(page, "{code-cell} ipython3"):
            bodies += re.findall(r"<< 'END'\n(.*?)^END$", body, re.DOTALL | re.MULTILINE)
        for number, body in enumerate(bodies):
            yield pytest.param(body, id=f"{name}-{number}")


@pytest.mark.parametrize("body", [*configs()])
def test_configs_are_configs(body):
    given = json.loads(json.dumps(YAML(typ="safe").load(body)))
    if given.get("task") not in (None, "albedo"):
        RunConfig.model_validate(given)
    elif "base" in given:
        SweepConfig.model_validate(given)
    elif "views" in given:
        RecipeConfig.model_validate(given)
    else:
        assert given["task"] == "albedo", "no kind of config; name its task"


def test_models_that_are_named_exist():
    for name, page in NAMED.items():
        for model in re.findall(r"`brdf\.model: ([\w-]+)`", prose(page)):
            assert model in {*MODELS, "satin"}, f"{name}: no model {model}"
