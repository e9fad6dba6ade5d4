"""Faults of one line, drawn from the program's syntax trees.

Nothing is changed that no test could see: docstrings, annotations and decorators, whatever stands
in a ``raise``, an ``assert`` or an f-string, what is printed or warned of, texts, numbers up to
``TOLERANCE``, conversions between kinds of numbers and sequences, the ``axis`` of a call, of which
-1 is as good as 1 where there are two.
"""

from __future__ import annotations

import ast
import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

PACKAGE = "omnitrack_sim"
TOLERANCE = 1e-6
"""Numbers up to it keep divisors from zero, or end an iteration."""
MANY = 10
"""From this number on, integers are doubled and halved."""
SWAPPED = {
    "min": "max",
    "minimum": "maximum",
    "nanmin": "nanmax",
    "argmin": "argmax",
    "sin": "cos",
    "arcsin": "arccos",
    "floor": "ceil",
    "any": "all",
    "zeros": "ones",
    "append": "extend",
    "cumsum": "cumprod",
    "mean": "median",
    "sum": "mean",
    "abs": "square",
}
SWAPPED |= {new: old for old, new in reversed(SWAPPED.items()) if new not in SWAPPED}
"""Functions and methods, and those that are called instead of them."""
OPERATORS = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.Mod: ("%", "*"),
    ast.FloorDiv: ("//", "*"),
    ast.Pow: ("**", "*"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
}
COMPARISONS = {
    ast.Lt: (r"<", "<=", ">"),
    ast.LtE: (r"<=", "<", ">="),
    ast.Gt: (r">", ">=", "<"),
    ast.GtE: (r">=", ">", "<="),
    ast.Eq: (r"==", "!="),
    ast.NotEq: (r"!=", "=="),
    ast.Is: (r"is", "is not"),
    ast.IsNot: (r"is\s+not", "is"),
    ast.In: (r"in", "not in"),
    ast.NotIn: (r"not\s+in", "in"),
}
DEFAULTS = {
    "float": ["0.0"],
    "int": ["0"],
    "bool": ["True", "False"],
    "str": ['""'],
    "list": ["[]"],
    "dict": ["{}"],
    "set": ["set()"],
}
"""What a function of this type returns instead."""
SHOWING = "__repr__", "__str__", "__rich_repr__"
"""Functions that only show a value."""
TELLING = {"print", "warn", "echo", "secho", "debug", "info", "warning", "error", "exception"}
CONVERSIONS = {"list", "tuple", "float", "int", "str", "Path", "asarray", "array", "set", "cast"}
CONVERSIONS |= {"frozenset", "ascontiguousarray", "iter", "repr", "bool", "dict", "super", "type"}
SYMMETRIC = {"min", "max", "minimum", "maximum", "hypot", "isclose", "allclose", "array_equal"}
SYMMETRIC |= {"logical_and", "logical_or", "isinstance", "issubclass", "hasattr", "Literal"}


@dataclass(frozen=True)
class Fault:
    """One change of one line.

    Attributes:
        file: below the checkout.
        scope: function or class in which it is, "" in the body of the module.
        kind: of fault.
        begin: first octet of the file that changes.
        end: octet after the last.
        new: what stands there instead.
        lines: first and last line of the statement.
    """

    file: str
    scope: str
    kind: str
    begin: int
    end: int
    new: str
    lines: tuple[int, int]

    @property
    def room(self) -> str:
        """Room of the package."""
        return Path(self.file).parts[1]

    def apply(self, text: bytes) -> bytes:
        """Return the file's text with the fault in it."""
        return text[: self.begin] + self.new.encode() + text[self.end :]


@dataclass(frozen=True)
class Scope:
    """A function, or the body of a class or module outside its functions.

    Attributes:
        name: qualified; "" of a module.
        node: its syntax.
        statements: that belong to it and to none within it.
    """

    name: str
    node: ast.AST
    statements: tuple[ast.stmt, ...]

    @property
    def is_function(self) -> bool:
        """Whether it is a function."""
        return isinstance(self.node, ast.FunctionDef | ast.AsyncFunctionDef)

    @property
    def is_compiled(self) -> bool:
        """Whether it is machine code where it runs, which measures of coverage do not see."""
        marks = getattr(self.node, "decorator_list", [])
        return any(name_of(mark) in ("compiled", "intrinsic", "njit", "cfunc") for mark in marks)

    @cached_property
    def names(self) -> frozenset[str]:
        """Names and attributes that its statements use."""
        nodes = [node for statement in self.statements for node in ast.walk(statement)]
        return frozenset(filter(None, map(name_of, nodes)))


class Module:
    """A file of the program."""

    def __init__(self, root: Path, file: str) -> None:
        self.file = file
        self.text = (root / file).read_bytes()
        self._starts = [0]
        for line in self.text.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))
        self.tree = ast.parse(self.text)

    @cached_property
    def scopes(self) -> list[Scope]:
        """Its functions and bodies, in their order."""
        return list(_scopes(self.tree, ""))

    @cached_property
    def code_lines(self) -> int:
        """Lines on which something of the code begins."""
        nodes = [node for scope in self.scopes for s in scope.statements for node in ast.walk(s)]
        return len({node.lineno for node in nodes if hasattr(node, "lineno")})

    def faults(self, scope: Scope) -> dict[str, list[Fault]]:
        """Return all faults of one of its scopes by their kind."""
        found: dict[str, list[Fault]] = {}
        for statement in scope.statements:
            for kind, begin, end, new in _Finder(self, scope).of(statement):
                if self.text[begin:end].decode() == new:  # as of arguments that are alike
                    continue
                fault = Fault(self.file, scope.name, kind, begin, end, new, _lines(statement))
                found.setdefault(kind, []).append(fault)
        return found

    def span(self, node: ast.AST) -> tuple[int, int]:
        """Return where a node begins and ends, in octets."""
        begin, end = node.lineno - 1, node.end_lineno - 1  # type: ignore[attr-defined]
        return (
            self._starts[begin] + node.col_offset,  # type: ignore[attr-defined]
            self._starts[end] + node.end_col_offset,  # type: ignore[attr-defined]
        )

    def token(self, pattern: str, begin: int, end: int) -> tuple[int, int] | None:
        """Return where a token stands between two operands; None beside a comment."""
        between = self.text[begin:end].decode()
        found = None if "#" in between else re.search(pattern, between)
        return found and (begin + found.start(), begin + found.end())


def _scopes(node: ast.AST, name: str) -> Iterator[Scope]:
    """Yield what a node is, and what lies within it."""
    within: list[ast.AST] = []
    yield Scope(name, node, tuple(_own_statements(node, within)))
    for child in within:
        yield from _scopes(child, f"{name}.{child.name}".lstrip("."))  # type: ignore[attr-defined]


def _own_statements(node: ast.AST, within: list[ast.AST]) -> Iterator[ast.stmt]:
    """Yield simple statements and compound ones of a scope; scopes in it go to ``within``."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            within.append(child)
        elif isinstance(child, ast.stmt | ast.ExceptHandler | ast.match_case):
            if _is_typing(child):
                continue
            if isinstance(child, ast.stmt):
                yield child
            yield from _own_statements(child, within)


def _is_typing(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and name_of(node.test) == "TYPE_CHECKING"


def _lines(statement: ast.stmt) -> tuple[int, int]:
    """Return first and last line of a statement, of a compound one those of its head."""
    body = getattr(statement, "body", None) or getattr(statement, "cases", None)
    last = statement.end_lineno or statement.lineno
    if body:
        first = getattr(body[0], "lineno", None) or body[0].pattern.lineno
        last = max(statement.lineno, first - 1)
    return statement.lineno, last


def name_of(node: ast.AST) -> str:
    """Return the last name of a name, attribute or call; "" of anything else."""
    if isinstance(node, ast.Call):
        return name_of(node.func)
    return getattr(node, "id", "") or getattr(node, "attr", "")


_Change = tuple[str, int, int, str]
"""Kind, begin, end, new text."""


class _Finder:
    """The faults of one statement of a module."""

    def __init__(self, module: Module, scope: Scope) -> None:
        self.module = module
        self.scope = scope
        self._indices: set[ast.AST] = set()
        self.returns = ast.unparse(getattr(scope.node, "returns", None) or ast.Constant(value=None))

    def of(self, statement: ast.stmt) -> Iterator[_Change]:
        """Yield the faults of a statement, but for those of statements within it."""
        if isinstance(statement, ast.Raise | ast.Assert | ast.Import | ast.ImportFrom):
            return
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            return
        yield from self._of_node(statement)

    def _of_node(self, node: ast.AST) -> Iterator[_Change]:
        if isinstance(node, ast.JoinedStr) or self._is_telling(node) or name_of(node) == "Literal":
            return
        find = getattr(self, f"_{type(node).__name__.lower()}", None)
        if find is not None:
            yield from find(node)
        if isinstance(node, ast.keyword) and node.arg == "axis":
            return
        for field, value in ast.iter_fields(node):
            if field in ("annotation", "returns", "decorator_list", "type_params"):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.expr | ast.keyword | ast.Slice | ast.comprehension):
                    yield from self._of_node(child)
                elif isinstance(child, ast.withitem):
                    yield from self._of_node(child.context_expr)

    @staticmethod
    def _is_telling(node: ast.AST) -> bool:
        return isinstance(node, ast.Call) and name_of(node) in TELLING

    def _text(self, node: ast.AST) -> str:
        begin, end = self.module.span(node)
        return self.module.text[begin:end].decode()

    def _whole(self, kind: str, node: ast.AST, new: str) -> Iterator[_Change]:
        """Yield a fault that replaces a node of one line."""
        if node.lineno == node.end_lineno:  # type: ignore[attr-defined]
            yield kind, *self.module.span(node), new

    def _binop(self, node: ast.BinOp) -> Iterator[_Change]:
        sides = node.left, node.right
        is_text = any(
            isinstance(s, ast.JoinedStr) or isinstance(getattr(s, "value", 0), str) for s in sides
        )
        is_type = isinstance(node.op, ast.BitOr) and not self.scope.is_function
        if is_text or is_type or type(node.op) not in OPERATORS:
            return
        old, new = OPERATORS[type(node.op)]
        (_, left), (right, _) = map(self.module.span, sides)
        found = self.module.token(re.escape(old), left, right)
        if found is None:
            return
        yield "operator", *found, new
        kept = [self.module.text[self.module.span(node)[0] : found[0]]]
        if old in ("+", "*", "&", "|"):
            kept.append(self.module.text[found[1] : self.module.span(node)[1]])
        for part in kept:
            yield from self._whole("dropped term", node, part.decode().strip())

    def _augassign(self, node: ast.AugAssign) -> Iterator[_Change]:
        if type(node.op) in OPERATORS:
            old, new = OPERATORS[type(node.op)]
            left, right = self.module.span(node.target)[1], self.module.span(node.value)[0]
            found = self.module.token(re.escape(old) + "=", left, right)
            if found is not None:
                yield "operator", *found, f"{new}="

    def _compare(self, node: ast.Compare) -> Iterator[_Change]:
        sides = [node.left, *node.comparators]
        for op, (left, right) in zip(node.ops, pairwise(sides), strict=True):
            old, *new = COMPARISONS[type(op)]
            begin, end = self.module.span(left)[1], self.module.span(right)[0]
            found = self.module.token(old, begin, end)
            for each in new:
                if found is not None:
                    yield "comparison", *found, each

    def _constant(self, node: ast.Constant, kind: str = "constant") -> Iterator[_Change]:
        value = node.value
        if node in self._indices and kind != "index":
            return
        if isinstance(value, bool):
            yield from self._whole(kind, node, str(not value))
        elif isinstance(value, int):
            few = value + 1, *((value - 1,) if value > 1 else ())
            for new in few if value < MANY else (2 * value, value // 2):
                yield from self._whole(kind, node, str(new))
        elif isinstance(value, float) and not 0 < abs(value) <= TOLERANCE:
            for new in (value * 2, value / 2) if value else (1.0,):
                yield from self._whole(kind, node, repr(new))

    def _subscript(self, node: ast.Subscript) -> Iterator[_Change]:
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        for index in indices:
            parts = [index.lower, index.upper] if isinstance(index, ast.Slice) else [index]
            for part in parts:
                inner = part.operand if isinstance(part, ast.UnaryOp) else part
                if isinstance(inner, ast.Constant):
                    self._indices.add(inner)
                    yield from self._constant(inner, "index")

    def _unaryop(self, node: ast.UnaryOp) -> Iterator[_Change]:
        kind = {ast.USub: "sign", ast.Not: "not"}.get(type(node.op))
        if kind:
            word = {"sign": "-", "not": "not"}[kind]
            yield from self._whole(kind, node, self._text(node).removeprefix(word).strip())

    def _boolop(self, node: ast.BoolOp) -> Iterator[_Change]:
        old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        begin, end = self.module.span(node)
        for left, right in pairwise(node.values):
            gap = self.module.span(left)[1], self.module.span(right)[0]
            found = self.module.token(rf"\b{old}\b", *gap)
            if found is None:
                continue
            yield "and/or", *found, new
            if len(node.values) == 2:
                for part in (self.module.text[begin : found[0]], self.module.text[found[1] : end]):
                    yield from self._whole("dropped term", node, part.decode().strip())

    def _if(self, node: ast.If | ast.While | ast.IfExp) -> Iterator[_Change]:
        if not isinstance(node.test, ast.UnaryOp | ast.Compare | ast.Constant):
            yield from self._whole("not", node.test, f"not ({self._text(node.test)})")

    _while = _ifexp = _if

    def _swapped(self, node: ast.Call) -> Iterator[_Change]:
        old, end = name_of(node), self.module.span(node.func)[1]
        if old in SWAPPED:
            yield "other function", end - len(old), end, SWAPPED[old]

    def _call(self, node: ast.Call) -> Iterator[_Change]:
        yield from self._swapped(node)
        name = name_of(node)
        plain = [a for a in node.args if not isinstance(a, ast.Starred)]
        if len(plain) < len(node.args):
            return
        if len(plain) == 1 and not node.keywords and name not in CONVERSIONS:
            yield from self._whole("dropped call", node, f"({self._text(plain[0])})")
        if name not in SYMMETRIC:
            for one, two in pairwise(plain):
                begin, end = self.module.span(one)[0], self.module.span(two)[1]
                texts = self._text(one), self._text(two)
                if one.lineno == two.end_lineno and texts[0] != texts[1]:
                    between = self.module.text[self.module.span(one)[1] : self.module.span(two)[0]]
                    new = f"{texts[1]}{between.decode()}{texts[0]}"
                    yield "argument order", begin, end, new

    def _expr(self, node: ast.Expr) -> Iterator[_Change]:
        if isinstance(node.value, ast.Call) and not self._is_telling(node.value):
            yield from self._whole("dropped call", node, "pass")

    def _return(self, node: ast.Return) -> Iterator[_Change]:
        if node.value is None or isinstance(node.value, ast.Constant):
            return
        new = list(DEFAULTS.get(self.returns.partition("[")[0], []))
        # What is zero already cannot be told from it.
        is_zero = re.match(r"np\.zeros(_like)?\(", self._text(node.value))
        if self.returns == "Array" and not is_zero:
            new = [f"0 * ({self._text(node.value)})"]
        if self.returns.endswith("| None"):
            new.append("None")
        for each in new:
            yield from self._whole("returned default", node.value, each)


class Program:
    """The modules of a checkout, from which faults are drawn."""

    def __init__(self, root: Path) -> None:
        files = sorted(p.relative_to(root).as_posix() for p in (root / PACKAGE).rglob("*.py"))
        self.modules = {file: Module(root, file) for file in files if file.count("/") > 1}

    @cached_property
    def rooms(self) -> dict[str, list[Module]]:
        """Its modules by their rooms."""
        found: dict[str, list[Module]] = {}
        for file, module in self.modules.items():
            found.setdefault(Path(file).parts[1], []).append(module)
        return found

    @cached_property
    def lines(self) -> dict[str, int]:
        """Lines of code of each room."""
        return {r: sum(module.code_lines for module in each) for r, each in self.rooms.items()}

    @cached_property
    def _places(self) -> dict[str, list[tuple[Module, Scope]]]:
        """Functions and bodies of each room."""
        return {
            room: [(m, s) for m in modules for s in m.scopes]
            for room, modules in self.rooms.items()
        }

    def draw(self, seed: int, number: int, room: str | None = None) -> Fault:
        """Return a fault: the same for the same seed and number, of the same program.

        A room is drawn by its lines of code; of it a function or body, of that a kind of fault, of
        these one.
        """
        lot = random.Random(f"{seed} {number}")
        drawn = lot.choices(list(self.lines), list(self.lines.values()))[0]
        while True:
            module, scope = lot.choice(self._places[room or drawn])
            of_kind = {} if scope.name.endswith(SHOWING) else module.faults(scope)
            if not of_kind:
                continue
            fault = lot.choice(of_kind[lot.choice(sorted(of_kind))])
            if _is_python(fault.apply(module.text)):
                return fault

    def scope(self, fault: Fault) -> Scope:
        """Return the function or body that a fault lies in."""
        scopes = self.modules[fault.file].scopes
        return next(scope for scope in scopes if _has_line(scope, fault.lines[0]))

    def importers(self, file: str) -> list[str]:
        """Return the modules that import one."""
        name = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        folder, _, last = name.rpartition(".")
        found = []
        for other, module in self.modules.items():
            for node in ast.walk(module.tree):
                if isinstance(node, ast.ImportFrom) and (
                    node.module == name
                    or (node.module == folder and last in {each.name for each in node.names})
                ):
                    found.append(other)
                    break
        return found

    def users(self, fault: Fault) -> Iterator[tuple[str, Scope]]:
        """Yield the functions that use what a statement outside of functions assigns."""
        names = assigned_names(self.modules[fault.file], fault.lines[0])
        for file, module in self.modules.items():
            for scope in module.scopes:
                if scope.is_function and names & scope.names:
                    yield file, scope


def _has_line(scope: Scope, line: int) -> bool:
    return any(statement.lineno == line for statement in scope.statements)


def assigned_names(module: Module, line: int) -> frozenset[str]:
    """Return the names that the statement at a line assigns."""
    for scope in module.scopes:
        for statement in scope.statements:
            if statement.lineno == line:
                targets = getattr(statement, "targets", [getattr(statement, "target", None)])
                nodes = [node for t in targets if t is not None for node in ast.walk(t)]
                return frozenset(filter(None, map(name_of, nodes)))
    return frozenset()


def _is_python(text: bytes) -> bool:
    try:
        ast.parse(text)
    except SyntaxError:
        return False
    return True
