"""Compiled Python functions as C++ for Warp's native functions.

What numba compiles for the processor (``pipes.compiled``) is plain Python on numbers, tuples and
pointers. A ``Translation`` writes such a function, and all that it calls, as members of one C++
structure, so that a wall's formula is stated once for both. Types follow from those of the
arguments: a number is ``int``, ``bool`` or ``real``, which the structure's user defines as
``float`` or ``double``.

Only that part of Python is known which such functions use. What is not known raises
``TranslationError`` with its place in the source.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from types import FunctionType
from typing import Any, NamedTuple

REAL, INT, BOOL, VOID, REALS, INTS = "real", "int", "bool", "void", "real*", "int*"
"""Types in C++ that an expression may have; a tuple of them is that of a Python tuple."""
Kind = Any
"""A type: one of the words above, of ``Translation.structures``, or a tuple of types."""


class TranslationError(Exception):
    """A function that cannot be translated, with the line that is in the way."""


class Code(NamedTuple):
    """An expression in C++.

    Attributes:
        text: of the expression.
        kind: its type.
        writes: whether it may write to memory, so that its order among others counts.
    """

    text: str
    kind: Kind
    writes: bool = False


_PRELUDE = """
CUDA_CALLABLE static real square(real x) { return x * x; }
CUDA_CALLABLE static real least(real x, real y) { return y < x ? y : x; }
CUDA_CALLABLE static real most(real x, real y) { return x < y ? y : x; }
CUDA_CALLABLE static int least_int(int x, int y) { return y < x ? y : x; }
CUDA_CALLABLE static int most_int(int x, int y) { return x < y ? y : x; }
CUDA_CALLABLE static real positive(real x) { return x < real(0) ? -x : x; }
CUDA_CALLABLE static real with_sign(real x, real y) {
  const bool below = y < real(0) || (y == real(0) && real(1) / y < real(0));
  return below ? -positive(x) : positive(x);
}
CUDA_CALLABLE static real length(real x, real y) { return wp::sqrt(x * x + y * y); }
CUDA_CALLABLE static int rest_int(int x, int y) { const int z = x % y; return z < 0 ? z + y : z; }
CUDA_CALLABLE static real rest(real x, real y) { return x - y * wp::floor(x / y); }
"""
_MATH = {
    **{name: f"wp::{name}" for name in ("sqrt", "sin", "cos", "tan", "atan", "atan2", "acos")},
    **{name: f"wp::{name}" for name in ("asin", "exp", "log", "floor", "ceil")},
    "hypot": "length",
    "copysign": "with_sign",
    "fabs": "positive",
}
"""Functions of ``math`` in C++."""
_OPERATORS = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.BitAnd: "&",
    ast.BitOr: "|",
    ast.LShift: "<<",
    ast.RShift: ">>",
}
_COMPARISONS = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}


class Translation:
    """Python functions, and all that they call, as members of one C++ structure.

    Args:
        intrinsics: how calls of functions are written that have no Python of their own: from the
            function to one that takes the ``_Body``, and the call, and returns its ``Code``.
        constants: numbers of modules, by name, that are others than in Python.
        absent: functions that are never reached, whose calls are 0.
        structures: types of C++ beyond those of this module, passed by reference.
    """

    def __init__(
        self,
        intrinsics: Mapping[Any, Callable[[_Body, ast.Call], Code]],
        constants: Mapping[str, float] | None = None,
        absent: Sequence[Any] = (),
        structures: Sequence[str] = (),
    ) -> None:
        self.intrinsics = dict(intrinsics)
        self.constants = dict(constants or {})
        self.absent = list(absent)
        self.structures = set(structures)
        self._tuples: dict[tuple[Kind, ...], str] = {}
        self._functions: dict[tuple[Any, tuple[Kind, ...]], _Function] = {}
        self._texts: dict[str, str] = {}
        self._called: dict[str, set[str]] = {}

    def function(self, python: FunctionType, kinds: Sequence[Kind]) -> _Function:
        """Return a function in C++ for arguments of some types, translated once."""
        key = python, tuple(kinds)
        if key not in self._functions:
            taken = {each.name for each in self._functions.values()}
            base = f"{python.__module__.rpartition('.')[2]}_{python.__name__.lstrip('_')}"
            name, number = base, 1
            while name in taken:
                number += 1
                name = f"{base}_{number}"
            # Held from the beginning, so that the names of what it calls are others.
            self._functions[key] = _Function(name, VOID, False)
            self._functions[key] = self._translated(name, python, tuple(kinds))
        return self._functions[key]

    def members(self, *roots: str) -> str:
        """Return the members of the structure: types, then the functions that some roots need."""
        needed, pending = set(), list(roots)
        while pending:
            name = pending.pop()
            if name not in needed:
                needed.add(name)
                pending += self._called[name]
        types = [
            f"struct {name} {{ "
            + " ".join(f"{self.type_name(kind)} a{i};" for i, kind in enumerate(kinds))
            + " };"
            for kinds, name in self._tuples.items()
        ]
        texts = [text for name, text in self._texts.items() if name in needed]
        return "\n".join([_PRELUDE.strip(), *types, *texts])

    def dispatcher(
        self, name: str, wanted: Mapping[int, FunctionType], kinds: Sequence[Kind]
    ) -> str:
        """Add a function that calls one of several by the number that is its first argument.

        It is never copied into those that call it, which would take minutes to compile.

        Args:
            name: of the function.
            wanted: functions that return a real number, by their numbers.
            kinds: types of their arguments.

        Returns:
            The name.
        """
        functions = {number: self.function(each, kinds) for number, each in wanted.items()}
        names = [f"x{i}" for i in range(len(kinds))]
        given = ", ".join(
            f"{self.type_name(kind)} {x}" for kind, x in zip(kinds, names, strict=True)
        )
        cases = "\n".join(
            f"    case {number}: return {each.name}({', '.join(names)});"
            for number, each in functions.items()
        )
        head = f"CUDA_CALLABLE WP_NOINLINE static real {name}(int number, {given})"
        self._texts[name] = f"{head} {{\n  switch (number) {{\n{cases}\n  }}\n  return real(0);\n}}"
        self._called[name] = {each.name for each in functions.values()}
        return name

    def type_name(self, kind: Kind) -> str:
        """Return the name of a type in C++."""
        if isinstance(kind, tuple):
            if kind not in self._tuples:
                # Types of parts come before.
                for part in kind:
                    self.type_name(part)
                self._tuples[kind] = f"Tuple{len(self._tuples)}"
            return self._tuples[kind]
        return kind

    def _translated(self, name: str, python: FunctionType, kinds: tuple[Kind, ...]) -> _Function:
        body = _Body(self, python, kinds)
        for _ in range(9):
            before = dict(body.kinds), body.returned
            text = body.text()
            if (dict(body.kinds), body.returned) == before:
                break
        arguments = ", ".join(
            f"const {kind}& {each}_"
            if kind in self.structures
            else f"{self.type_name(kind)} {each}_"
            for each, kind in ((each, body.kinds[each]) for each in body.arguments)
        )
        head = f"CUDA_CALLABLE static {self.type_name(body.returned)} {name}({arguments})"
        self._texts[name] = f"{head} {{\n{textwrap.indent(text, '  ')}\n}}"
        self._called[name] = body.called
        return _Function(name, body.returned, body.writes)


class _Function(NamedTuple):
    """A function in C++: its name, what it returns, and whether it may write to memory."""

    name: str
    returned: Kind
    writes: bool


@cache
def _tree(python: FunctionType) -> ast.FunctionDef:
    """Return the source of a function as a tree."""
    try:
        text = inspect.getsource(python)
    except OSError as error:
        raise TranslationError(f"{python.__qualname__}: {error}") from error
    tree = ast.parse(textwrap.dedent(text)).body[0]
    assert isinstance(tree, ast.FunctionDef)
    return tree


def _join(one: Kind, other: Kind) -> Kind:
    """Return the type that holds values of two types."""
    if one == other or other is None:
        return one
    if one is None:
        return other
    if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
        return tuple(map(_join, one, other))
    order = (BOOL, INT, REAL)
    if one in order and other in order:
        return order[max(order.index(one), order.index(other))]
    raise TranslationError(f"a value is {one} and {other}")


def _in_parentheses(text: str) -> str:
    """Return an expression in one pair of parentheses: with two, compilers warn of a comparison."""
    depth = 0
    for i, sign in enumerate(text):
        depth += (sign == "(") - (sign == ")")
        if depth == 0:
            return text if sign == ")" and i == len(text) - 1 else f"({text})"
    return f"({text})"


class _Body:
    """Statements of one function for arguments of some types.

    Attributes:
        arguments: names.
        kinds: of variables, as far as they are known.
        returned: type of what the function returns.
        writes: whether it may write to memory.
        called: names of the functions in C++ that it calls.
    """

    def __init__(self, whole: Translation, python: FunctionType, kinds: tuple[Kind, ...]) -> None:
        self.whole, self.python = whole, python
        self._tree = _tree(python)
        self.arguments = [each.arg for each in self._tree.args.args]
        if len(self.arguments) != len(kinds):
            raise TranslationError(f"{python.__qualname__} takes {len(self.arguments)} arguments")
        self.kinds: dict[str, Kind] = dict(zip(self.arguments, kinds, strict=True))
        self.returned: Kind = None
        self.writes = False
        self.called: set[str] = set()
        self._lines: list[str] = []
        self._rooms: list[str] = []
        self._own: dict[str, Code] = {}
        self._count = 0

    def text(self) -> str:
        """Return the statements, with declarations before them, by the types known so far."""
        self._lines, self._rooms, self._count, self.called = [], [], 0, set()
        self.statements(self._tree.body)
        if self.returned is None:
            self.returned = VOID
        names = [name for name in self.kinds if name not in self.arguments]
        declared = [f"{self.whole.type_name(self.kinds[name])} {name}_;" for name in names]
        return "\n".join([*declared, *self._rooms, *self._lines])

    def fault(self, node: ast.AST, problem: str) -> TranslationError:
        """Return the error of a node, with its place."""
        line = getattr(node, "lineno", 1) + self.python.__code__.co_firstlineno - 1
        place = f"{self.python.__code__.co_filename}:{line}"
        return TranslationError(f"{place}: {problem}: {ast.unparse(node)[:80]}")

    def temporary(self, code: Code) -> Code:
        """Keep a value in a variable of its own."""
        name = f"t{self._count}"
        self._count += 1
        self._lines.append(f"{self.whole.type_name(code.kind)} const {name} = {code.text};")
        return Code(name, code.kind)

    def room(self, count: int) -> Code:
        """Return room for numbers on the stack of the function."""
        name = f"room{self._count}"
        self._count += 1
        # At the head of the function, so that it lasts where a block would end.
        self._rooms.append(f"real {name}[{count}];")
        return Code(name, REALS)

    # Statements

    def statements(self, nodes: Sequence[ast.stmt]) -> None:
        for node in nodes:
            handler = getattr(self, f"_do_{type(node).__name__.lower()}", None)
            if handler is None:
                raise self.fault(node, "no such statement is known")
            try:
                handler(node)
            except TranslationError as error:
                if "\n" in str(error) or ".py:" in str(error):
                    raise
                raise self.fault(node, str(error)) from error

    def _block(self, nodes: Sequence[ast.stmt]) -> None:
        self._lines.append("{")
        self.statements(nodes)
        self._lines.append("}")

    def _do_expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self._lines.append(f"{self.value(node.value).text};")

    def _do_pass(self, node: ast.Pass) -> None:
        pass

    def _do_break(self, _node: ast.Break) -> None:
        self._lines.append("break;")

    def _do_continue(self, _node: ast.Continue) -> None:
        self._lines.append("continue;")

    def _do_return(self, node: ast.Return) -> None:
        if node.value is None:
            self._lines.append("return;")
            self.returned = self.returned or VOID
            return
        code = self.value(node.value)
        self.returned = _join(self.returned, code.kind)
        self._lines.append(f"return {self.as_kind(code, self.returned).text};")

    def _do_if(self, node: ast.If) -> None:
        self._lines.append(f"if {_in_parentheses(self.value(node.test).text)}")
        self._block(node.body)
        if node.orelse:
            self._lines.append("else")
            self._block(node.orelse)

    def _do_while(self, node: ast.While) -> None:
        before = len(self._lines)
        test = self.value(node.test).text
        if len(self._lines) != before:
            raise self.fault(node.test, "needs a statement before each round")
        self._lines.append(f"while {_in_parentheses(test)}")
        self._block(node.body)

    def _do_for(self, node: ast.For) -> None:
        number = self._count
        self._count += 1
        if isinstance(node.iter, ast.Call) and ast.unparse(node.iter.func) == "range":
            bounds = [self.value(each) for each in node.iter.args]
            first, last = ([Code("0", INT), *bounds])[-2:]
            item, head = Code(f"k{number}", INT), f"int k{number} = {first.text}, n{number} = "
            head += f"{last.text}; k{number} < n{number}; ++k{number}"
        elif isinstance(node.iter, ast.Tuple):
            items = [self.value(each) for each in node.iter.elts]
            kind: Kind = None
            for each in items:
                kind = _join(kind, each.kind)
            texts = ", ".join(self.as_kind(each, kind).text for each in items)
            self._lines.append(f"const {self.whole.type_name(kind)} each{number}[] = {{{texts}}};")
            item = Code(f"each{number}[k{number}]", kind)
            head = f"int k{number} = 0; k{number} < {len(items)}; ++k{number}"
        else:
            raise self.fault(node.iter, "a loop is over a range or a tuple")
        self._lines.append(f"for ({head}) {{")
        name = node.target.id if isinstance(node.target, ast.Name) else ""
        if name != "_" and self._is_assigned_beside(name, node):
            # A variable of its own: what has this name elsewhere may have another type.
            self._lines.append(
                f"{self.whole.type_name(item.kind)} const own{number} = {item.text};"
            )
            outer = self._own.get(name)
            self._own[name] = Code(f"own{number}", item.kind)
            self.statements(node.body)
            self._own.pop(name)
            if outer is not None:
                self._own[name] = outer
        else:
            self._assign(node.target, item)
            self.statements(node.body)
        self._lines.append("}")

    def _is_assigned_beside(self, name: str, loop: ast.For) -> bool:
        """Return whether a loop's variable is that of other statements, too, but not of its own."""
        stores = [
            node
            for node in ast.walk(self._tree)
            if isinstance(node, ast.Name) and node.id == name and isinstance(node.ctx, ast.Store)
        ]
        within = {id(node) for each in loop.body for node in ast.walk(each)}
        return len(stores) > 1 and not any(id(node) in within for node in stores)

    def _do_assign(self, node: ast.Assign) -> None:
        self._assign_all(node.targets, node.value)

    def _assign_all(self, targets: Sequence[ast.expr], value: ast.expr) -> None:
        target = targets[0]
        plain = len(targets) == 1 and isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
        if plain and not any(isinstance(each, ast.Starred) for each in value.elts):
            # All values come before any variable changes.
            codes = [self.temporary(self.value(each)) for each in value.elts]
            for each, code in zip(target.elts, codes, strict=True):
                self._assign(each, code)
            return
        code = self.value(value)
        if len(targets) > 1 or isinstance(target, ast.Tuple):
            code = self.temporary(code)
        for each in reversed(targets):
            self._assign(each, code)

    def _do_augassign(self, node: ast.AugAssign) -> None:
        read = ast.parse(ast.unparse(node.target), mode="eval").body
        whole = ast.copy_location(ast.BinOp(read, node.op, node.value), node)
        self._assign(node.target, self.value(ast.fix_missing_locations(whole)))

    def _assign(self, target: ast.expr, code: Code) -> None:
        if isinstance(target, ast.Tuple):
            if not isinstance(code.kind, tuple) or len(code.kind) != len(target.elts):
                raise self.fault(target, f"has no {len(target.elts)} values")
            for i, (each, kind) in enumerate(zip(target.elts, code.kind, strict=True)):
                self._assign(each, Code(f"{code.text}.a{i}", kind))
        elif isinstance(target, ast.Name):
            if target.id == "_":
                return
            kind = self.kinds[target.id] = _join(self.kinds.get(target.id), code.kind)
            self._lines.append(f"{target.id}_ = {self.as_kind(code, kind).text};")
        elif isinstance(target, ast.Subscript):
            place = self.value(target)
            self.writes = True
            self._lines.append(f"{place.text} = {self.as_kind(code, place.kind).text};")
        else:
            raise self.fault(target, "cannot be assigned to")

    # Expressions

    def value(self, node: ast.expr) -> Code:
        """Return an expression in C++."""
        handler = getattr(self, f"_of_{type(node).__name__.lower()}", None)
        if handler is None:
            raise self.fault(node, "no such expression is known")
        code = handler(node)
        self.writes = self.writes or code.writes
        return code

    def in_order(self, nodes: Sequence[ast.expr]) -> list[Code]:
        """Return expressions that C++ may evaluate in any order."""
        codes = [self.value(node) for node in nodes]
        if sum(code.writes for code in codes) > 1:
            raise self.fault(nodes[-1], "two values of one expression write to memory")
        return codes

    def as_kind(self, code: Code, kind: Kind) -> Code:
        """Return a value as one of another type."""
        if code.kind == kind:
            return code
        if isinstance(kind, tuple) and isinstance(code.kind, tuple):
            whole = self.temporary(code)
            parts = [
                self.as_kind(Code(f"{whole.text}.a{i}", part), wanted).text
                for i, (part, wanted) in enumerate(zip(code.kind, kind, strict=True))
            ]
            return Code(f"{self.whole.type_name(kind)}{{{', '.join(parts)}}}", kind)
        return Code(f"({kind})({code.text})", kind, code.writes)

    def _of_constant(self, node: ast.Constant) -> Code:
        return self._number(node, node.value)

    def _number(self, node: ast.expr, value: Any) -> Code:
        if isinstance(value, bool):
            return Code("true" if value else "false", BOOL)
        if isinstance(value, int):
            return Code(str(value), INT)
        if isinstance(value, float):
            if math.isinf(value):
                return Code("real(INFINITY)" if value > 0 else "-real(INFINITY)", REAL)
            return Code("real(NAN)" if math.isnan(value) else f"real({value!r})", REAL)
        raise self.fault(node, "is no number")

    def _of_name(self, node: ast.Name) -> Code:
        if node.id in self._own:
            return self._own[node.id]
        if node.id in self.kinds:
            return Code(f"{node.id}_", self.kinds[node.id])
        if node.id in self.whole.constants:
            return self._number(node, self.whole.constants[node.id])
        return self._number(node, self.python.__globals__.get(node.id))

    def _of_attribute(self, node: ast.Attribute) -> Code:
        if not isinstance(node.value, ast.Name) or node.value.id != "math":
            raise self.fault(node, "only numbers of math are known")
        return self._number(node, getattr(math, node.attr))

    def _of_tuple(self, node: ast.Tuple) -> Code:
        parts: list[Code] = []
        for each in node.elts:
            if isinstance(each, ast.Starred):
                whole = self.temporary(self.value(each.value))
                parts += [Code(f"{whole.text}.a{i}", kind) for i, kind in enumerate(whole.kind)]
            else:
                parts.append(self.value(each))
        kind = tuple(part.kind for part in parts)
        # Within braces C++ keeps the order.
        texts = ", ".join(part.text for part in parts)
        writes = any(part.writes for part in parts)
        return Code(f"{self.whole.type_name(kind)}{{{texts}}}", kind, writes)

    def _of_unaryop(self, node: ast.UnaryOp) -> Code:
        code = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return Code(f"(!{code.text})", BOOL, code.writes)
        if isinstance(node.op, ast.USub):
            return Code(f"(-{code.text})", INT if code.kind == BOOL else code.kind, code.writes)
        raise self.fault(node, "no such operator is known")

    def _of_binop(self, node: ast.BinOp) -> Code:
        left, right = self.in_order([node.left, node.right])
        kind, writes = _join(_join(left.kind, right.kind), INT), left.writes or right.writes
        if isinstance(node.op, ast.Pow):
            return self._power(node, left, right)
        if isinstance(node.op, ast.Div):
            return Code(f"(real({left.text}) / real({right.text}))", REAL, writes)
        if isinstance(node.op, ast.FloorDiv):
            if kind == INT:  # of numbers from 0 on
                return Code(f"({left.text} / {right.text})", INT, writes)
            return Code(f"wp::floor({left.text} / {right.text})", REAL, writes)
        if isinstance(node.op, ast.Mod):
            if kind == INT:
                return Code(f"rest_int({left.text}, {right.text})", INT, writes)
            return Code(f"rest({left.text}, {right.text})", REAL, writes)
        sign = _OPERATORS.get(type(node.op))
        if sign is None:
            raise self.fault(node, "no such operator is known")
        return Code(f"({left.text} {sign} {right.text})", kind, writes)

    def _power(self, node: ast.BinOp, left: Code, right: Code) -> Code:
        if left.kind == right.kind == INT:
            numbers = {**self.python.__globals__, **self.whole.constants}
            value = eval(compile(ast.Expression(node), "<power>", "eval"), numbers)
            return self._number(node, value)
        if right.text != "2":
            raise self.fault(node, "only squares are known")
        return Code(f"square({left.text})", REAL, left.writes)

    def _of_boolop(self, node: ast.BoolOp) -> Code:
        # C++ evaluates them in order, and only as far as needed.
        before = len(self._lines)
        codes = [self.value(each) for each in node.values]
        if len(self._lines) != before:
            raise self.fault(node, "needs a statement before it")
        sign = " && " if isinstance(node.op, ast.And) else " || "
        text = f"({sign.join(code.text for code in codes)})"
        return Code(text, BOOL, any(code.writes for code in codes))

    def _of_compare(self, node: ast.Compare) -> Code:
        if len(node.ops) == 1 and isinstance(node.ops[0], ast.In):
            left, choices = self.value(node.left), node.comparators[0]
            if not isinstance(choices, ast.Tuple):
                raise self.fault(node, "only tuples are searched")
            tests = [f"{left.text} == {self.value(each).text}" for each in choices.elts]
            return Code(f"({' || '.join(tests)})", BOOL, left.writes)
        codes = self.in_order([node.left, *node.comparators])
        if len(codes) > 2 and any(code.writes for code in codes[1:-1]):
            raise self.fault(node, "a value is needed twice")
        tests = []
        for operation, one, other in zip(node.ops, codes, codes[1:], strict=False):
            sign = _COMPARISONS.get(type(operation))
            if sign is None:
                raise self.fault(node, "no such comparison is known")
            tests.append(f"{one.text} {sign} {other.text}")
        return Code(f"({' && '.join(tests)})", BOOL, any(code.writes for code in codes))

    def _of_ifexp(self, node: ast.IfExp) -> Code:
        test = self.value(node.test)
        before = len(self._lines)
        one, other = self.value(node.body), self.value(node.orelse)
        kind = _join(one.kind, other.kind)
        one, other = self.as_kind(one, kind), self.as_kind(other, kind)
        if len(self._lines) != before:
            raise self.fault(node, "needs a statement before it")
        writes = test.writes or one.writes or other.writes
        return Code(f"({test.text} ? {one.text} : {other.text})", kind, writes)

    def _of_subscript(self, node: ast.Subscript) -> Code:
        base = self.value(node.value)
        if isinstance(base.kind, tuple):
            return self._part(node, base)
        if base.kind in (REALS, INTS):
            index = self.value(node.slice)
            writes = base.writes or index.writes
            return Code(f"{base.text}[{index.text}]", base.kind[:-1], writes)
        handler = self.whole.intrinsics.get(base.kind)
        if handler is None:
            raise self.fault(node, f"a {base.kind} has no parts")
        return handler(self, node)

    def _part(self, node: ast.Subscript, base: Code) -> Code:
        """Return a part of a tuple; by a number that changes, if all are of one type.

        A slice up to a number is a tuple of the first parts.
        """
        if isinstance(node.slice, ast.Slice):
            whole, upper = self.temporary(base), node.slice.upper
            if node.slice.lower or node.slice.step or not isinstance(upper, ast.Constant):
                raise self.fault(node, "of slices those of the first parts are known")
            kind = base.kind[: upper.value]
            texts = ", ".join(f"{whole.text}.a{i}" for i in range(len(kind)))
            return Code(f"{self.whole.type_name(kind)}{{{texts}}}", kind)
        index = self.value(node.slice)
        if index.text.isdigit():
            number = int(index.text)
            return Code(f"{base.text}.a{number}", base.kind[number], base.writes)
        if len(set(base.kind)) > 1:
            raise self.fault(node, "parts of several types have no number that changes")
        return Code(f"(&{self.temporary(base).text}.a0)[{index.text}]", base.kind[0])

    def _of_call(self, node: ast.Call) -> Code:
        if node.keywords:
            raise self.fault(node, "arguments have no names")
        if isinstance(node.func, ast.Attribute):
            codes = self.in_order(node.args)
            if ast.unparse(node.func) == "math.isnan":
                return Code(f"wp::isnan({codes[0].text})", BOOL, codes[0].writes)
            name = _MATH.get(node.func.attr) if ast.unparse(node.func.value) == "math" else None
            if name is None:
                raise self.fault(node, "no such function of math is known")
            text = f"{name}({', '.join(self.as_kind(code, REAL).text for code in codes)})"
            if node.func.attr in ("ceil", "floor"):
                return Code(f"(int)({text})", INT)
            return Code(text, REAL, any(code.writes for code in codes))
        assert isinstance(node.func, ast.Name)
        name = node.func.id
        python = self.python.__globals__.get(name)
        if python in self.whole.intrinsics:
            return self.whole.intrinsics[python](self, node)
        if python is None:
            return self._builtin(node, name)
        if not isinstance(python, FunctionType) or not hasattr(python, "numba"):
            raise self.fault(node, "is no compiled function")
        return self.call(python, node.args)

    def call(self, python: FunctionType, nodes: Sequence[ast.expr]) -> Code:
        """Return the call of a function that is translated, too."""
        nodes = list(nodes)
        codes: list[Code] = []
        for node in nodes:
            if isinstance(node, ast.Starred):
                whole = self.temporary(self.value(node.value))
                codes += [Code(f"{whole.text}.a{i}", kind) for i, kind in enumerate(whole.kind)]
            else:
                codes.append(self.value(node))
        if sum(code.writes for code in codes) > 1:
            raise self.fault(nodes[-1], "two values of one call write to memory")
        if python in self.whole.absent:
            return Code("0", INT)
        function = self.whole.function(python, [code.kind for code in codes])
        self.called.add(function.name)
        text = f"{function.name}({', '.join(code.text for code in codes)})"
        return Code(text, function.returned, function.writes or any(c.writes for c in codes))

    def _builtin(self, node: ast.Call, name: str) -> Code:
        codes = self.in_order(node.args)
        writes = any(code.writes for code in codes)
        if name == "abs":
            if codes[0].kind == INT:
                raise self.fault(node, "only real numbers have an absolute value")
            return Code(f"positive({codes[0].text})", REAL, writes)
        if name in ("float", "int", "bool"):
            kind = REAL if name == "float" else name
            return Code(f"({kind})({codes[0].text})", kind, writes)
        if name in ("min", "max"):
            kind: Kind = None
            for code in codes:
                kind = _join(kind, code.kind)
            function = ("least" if name == "min" else "most") + ("_int" if kind == INT else "")
            text = self.as_kind(codes[0], kind).text
            for code in codes[1:]:
                text = f"{function}({text}, {self.as_kind(code, kind).text})"
            return Code(text, kind, writes)
        raise self.fault(node, "no such function is known")
