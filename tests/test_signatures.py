"""Signatures of the package's functions, read from its source.

- No parameter is a bundle: a tuple of a fixed number of unlike things, which nobody can name at the
  place of the call.  Name the parts as parameters, or their whole as a ``NamedTuple``.
- Pairs of numbers of one kind, such as bounds, sizes and shapes, may be tuples.
- Local functions may take tuples: JAX's loops hand them all that they carry as one.
"""

import ast
from collections.abc import Collection, Iterator
from pathlib import Path

import pytest

HERE = Path(__file__).parents[1]
# Every module and package of the first level.
CHECKED = sorted(
    path.name
    for path in (HERE / "jaxrender").iterdir()
    if path.suffix == ".py" or (path / "__init__.py").exists()
)
# Plain numbers, and those of a config.
NUMBERS = ("float", "int", "Number", "Positive")
Function = ast.FunctionDef | ast.AsyncFunctionDef

BUNDLES = {
    "two arrays": ("def f(pair: tuple[Array, Array]): ...", "f: pair"),
    "number and text": ("def f(a: int, line: tuple[int, str]): ...", "f: line"),
    "two kinds of numbers": ("def f(*, both: tuple[int, float]): ...", "f: both"),
    "only by position": ("def f(a: tuple[A, B], /): ...", "f: a"),
    "in a list": ("def f(lines: list[tuple[int, str]]): ...", "f: lines"),
    "in a union": ("def f(a: tuple[A, B] | None = None): ...", "f: a"),
    "in quotes": ('def f(a: "tuple[A, B]"): ...', "f: a"),
    "within a tuple": ("def f(a: tuple[tuple[A, B], ...]): ...", "f: a"),
    "any number of them": ("def f(*pairs: tuple[A, B]): ...", "f: pairs"),
    "by name": ("def f(**pairs: tuple[A, B]): ...", "f: pairs"),
    "of a method": ("class C:\n    def f(self, a: tuple[A, B]): ...", "f: a"),
    "of a local class": (
        "def f():\n    class C:\n        def g(self, a: tuple[A, B]): ...",
        "g: a",
    ),
    "of an asynchronous function": ("async def f(a: tuple[A, B]): ...", "f: a"),
    "under a condition": ("if True:\n    def f(a: tuple[A, B]): ...", "f: a"),
    "by an alias": ("Pair = tuple[A, B]\ndef f(a: list[Pair]): ...", "f: a"),
    "by an annotated alias": ("P: TypeAlias = tuple[A, B]\ndef f(a: P): ...", "f: a"),
    "by an alias of an alias": ("P = tuple[A, B]\nQ = list[P]\ndef f(a: Q): ...", "f: a"),
    "by an imported alias": ("from m import Imported as P\ndef f(a: P): ...", "f: a"),
    "anything": ("def f(a: tuple): ...", "f: a"),
    "as typing writes it": ("def f(a: typing.Tuple[A, B]): ...", "f: a"),
}
NO_BUNDLES = {
    "numbers of one kind": "def f(size: tuple[int, int], range: tuple[float, float]): ...",
    "as many as there are": "def f(shape: tuple[int, ...], parts: tuple[Array, ...] = ()): ...",
    "one": "def f(a: tuple[Array]): ...",
    "nothing": "def f(a: tuple[()]): ...",
    "an alias of numbers": "Size = tuple[int, int]\ndef f(size: Size): ...",
    "a class of an alias's name": "class Imported: ...\ndef f(a: Imported): ...",
    "a value": "Names = tuple(NAMES)\ndef f(a: Names): ...",
    "a named tuple": "class P(NamedTuple):\n    a: A\n    b: B\ndef f(pair: P): ...",
    "a result": "def f(a: A) -> tuple[A, B]: ...",
    "what a function returns": "def f(a: Callable[[A], tuple[A, B]]): ...",
    "what a loop carries": "def f():\n    def g(carry: tuple[A, B]): ...",
    "no annotation": "def f(a): ...",
}


def bundles(source: str, elsewhere: Collection[str] = ()) -> Iterator[str]:
    """Say line, function and parameter of every bundle in the signatures of a module.

    ``elsewhere`` are the names that other modules give to bundles: they count where imported.
    """
    module = ast.parse(source)
    aliases = aliases_of(module, elsewhere)
    for function in not_local(module):
        names = function.args
        every = [*names.posonlyargs, *names.args, names.vararg, *names.kwonlyargs, names.kwarg]
        for parameter in every:
            if parameter is not None and is_bundle(parameter.annotation, aliases):
                yield f"{function.lineno}: {function.name}: {parameter.arg}"


def aliases_of(module: ast.Module, elsewhere: Collection[str] = ()) -> set[str]:
    """List the names of bundles that a module imports or defines."""
    aliases: set[str] = set()
    for line in module.body:
        # In the order of the lines, so that an alias of an alias is one too.
        if isinstance(line, ast.ImportFrom):
            aliases |= {n.asname or n.name for n in line.names if n.name in elsewhere}
        elif isinstance(line, ast.Assign | ast.AnnAssign) and is_alias(line.value, aliases):
            targets = line.targets if isinstance(line, ast.Assign) else [line.target]
            aliases |= {target.id for target in targets if isinstance(target, ast.Name)}
    return aliases


def is_alias(value: ast.AST | None, aliases: set[str]) -> bool:
    """Whether a value is a bundle's type and no call or display that makes something."""
    is_type = isinstance(value, ast.Subscript | ast.BinOp | ast.Name | ast.Constant)
    return is_type and is_bundle(value, aliases)


def not_local(node: ast.AST, inside: bool = False) -> Iterator[Function]:
    """Go through the functions of a module and the methods of all its classes."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, Function) and not inside:
            yield child
        within = isinstance(child, Function) or (inside and not isinstance(child, ast.ClassDef))
        yield from not_local(child, within)


def is_bundle(annotation: ast.AST | None, aliases: set[str]) -> bool:
    """Whether an annotation has a tuple of unlike things in it, or a tuple of anything."""
    match annotation:
        case None:
            return False
        case ast.Constant(value=str(text)):
            return is_name_of_types(text) and is_bundle(ast.parse(text, mode="eval").body, aliases)
        case ast.Name(id=name):
            return name == "tuple" or name in aliases
        case ast.Subscript(
            value=ast.Name(id="Callable") | ast.Attribute(attr="Callable"),
            slice=ast.Tuple(elts=[parameters, _]),
        ):
            return is_bundle(parameters, aliases)
        case ast.Subscript(
            value=ast.Name(id="tuple" | "Tuple") | ast.Attribute(attr="Tuple"), slice=held
        ):
            kinds = held.elts if isinstance(held, ast.Tuple) else [held]
            named = {ast.unparse(kind) for kind in kinds}
            alike = len(kinds) < 2 or "..." in named or named in [{number} for number in NUMBERS]
            return not alike or any(is_bundle(kind, aliases) for kind in kinds)
    return any(is_bundle(child, aliases) for child in ast.iter_child_nodes(annotation))


def is_name_of_types(text: str) -> bool:
    """Tell an annotation in quotes from the axes of an array."""
    try:
        ast.parse(text, mode="eval")
    except SyntaxError:
        return False
    return True


@pytest.fixture(scope="module")
def elsewhere() -> set[str]:
    """Names of bundles in any module of the package."""
    sources = (path.read_text(encoding="utf-8") for path in HERE.glob("jaxrender/**/*.py"))
    return {alias for source in sources for alias in aliases_of(ast.parse(source))}


@pytest.mark.parametrize("name", CHECKED)
def test_no_parameter_is_a_bundle(name, elsewhere):
    place = HERE / "jaxrender" / name
    paths = sorted(place.rglob("*.py")) if place.is_dir() else [place]
    assert paths
    found = [
        f"{path.relative_to(HERE)}:{said}"
        for path in paths
        for said in bundles(path.read_text(encoding="utf-8"), elsewhere)
    ]
    assert not found, "name these parameters' parts:\n" + "\n".join(found)


@pytest.mark.parametrize(("source", "expected"), BUNDLES.values(), ids=BUNDLES)
def test_planted_bundles_are_found(source, expected):
    found = [said.partition(": ")[2] for said in bundles(source, {"Imported"})]
    assert found == [expected]


@pytest.mark.parametrize("source", NO_BUNDLES.values(), ids=NO_BUNDLES)
def test_what_is_no_bundle_passes(source):
    assert list(bundles(source, {"Imported"})) == []
