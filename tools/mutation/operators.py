"""The chosen mutations of a Python source: each a small wrong step that a programmer could have made.

Comparisons turned round or moved to the border, conditions negated, answers of yes or no made always yes and always no,
arithmetic swapped, signs dropped, extremes exchanged, flags and small numbers changed, limits and counts one off.
Texts, messages, annotations, progress, drawings and declarations of arguments are left out: no figure depends on them.
So are guards against rounding, numbers below :data:`ROUNDING`: ten times as large, or with or without the border, they
do the same; so are ``strict`` of a zip, which tells a programmer's mistake alone, and what fills an array without
elements.
"""

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass, field

SWAPPED_CALLS = {
    "argmin": "argmax",
    "argmax": "argmin",
    "min": "max",
    "max": "min",
    "minimum": "maximum",
    "maximum": "minimum",
    "nanmin": "nanmax",
    "nanmax": "nanmin",
    "any": "all",
    "all": "any",
    "zeros_like": "ones_like",
    "zeros": "ones",
    "floor": "ceil",
    "ceil": "floor",
    "cos": "sin",
    "sin": "cos",
    "median": "max",
    "mean": "max",
}
TURNED = {
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
AT_BORDER = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
ARITHMETIC = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult}
ROUNDING = 1e-5
# No figure depends on what these do.
LEFT_OUT = ("draw", "plot", "add_arguments", "picture", "__repr__")
LEFT_OUT_CALLS = (
    "progress",
    "print",
    "draw_",
    "plot_",
    "write_tiles",
    "new_figure",
    "bar.",
    "panel.",
    "axes.",
    "parser.",
)


@dataclass(frozen=True)
class Mutant:
    """One mutation.

    Attributes:
        line: where it stands, counted from 1.
        function: that it stands in; empty at the module's level, where defaults of arguments count too.
        before, after: the expression.
        place: of the expression among those that may be mutated.
        replacement: of its syntax tree.
    """

    line: int
    function: str
    before: str
    after: str
    place: int
    replacement: ast.expr = field(compare=False)

    def mutated(self, source: str) -> ast.Module:
        """The module with the mutation in it."""
        tree = ast.parse(source)
        target, _ = _nodes(tree)[self.place]
        _replace(tree, target, self.replacement)
        return ast.fix_missing_locations(tree)


def mutants(source: str) -> Iterator[Mutant]:
    """All mutations of a module, in the order of its syntax tree."""
    tree = ast.parse(source)
    for place, (node, function) in enumerate(_nodes(tree)):
        for replacement in (*_replacements(node), *_answers(node), *_one_off(node)):
            yield Mutant(node.lineno, function, ast.unparse(node), ast.unparse(replacement), place, replacement)


def _nodes(tree: ast.Module) -> list[tuple[ast.expr, str]]:
    """Expressions that may be mutated, each with its function."""
    found: list[tuple[ast.expr, str]] = []

    def visit(node: ast.AST, function: str) -> None:
        if isinstance(node, (ast.Raise, ast.JoinedStr, ast.Assert, ast.Import, ast.ImportFrom)):
            return
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            if any(part in node.name for part in LEFT_OUT) or any("wp." in ast.unparse(d) for d in node.decorator_list):
                return
            for default in [*node.args.defaults, *node.args.kw_defaults]:
                if default is not None:
                    visit(default, function)
            for statement in node.body:
                visit(statement, node.name)
            return
        if isinstance(node, ast.ClassDef):
            for statement in node.body:
                visit(statement, function)
            return
        if isinstance(node, ast.AnnAssign):
            if node.value is not None:
                node.value.named = True
                visit(node.value, function)
            return
        if isinstance(node, ast.Assign):
            node.value.named = True
        if isinstance(node, ast.Return) and node.value is not None:
            node.value.returned = True
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return
        if isinstance(node, ast.Call) and ast.unparse(node.func).startswith(LEFT_OUT_CALLS):
            return
        if isinstance(node, ast.keyword) and node.arg == "strict":
            return
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            return
        if isinstance(node, ast.expr):
            found.append((node, function))
        for child in ast.iter_child_nodes(node):
            visit(child, function)

    visit(tree, "")
    return found


def _replacements(node: ast.expr) -> Iterator[ast.expr]:
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        for table in (TURNED,) if _guard(node) else (TURNED, AT_BORDER):
            if type(node.ops[0]) in table:
                yield ast.Compare(node.left, [table[type(node.ops[0])]()], node.comparators)
    elif isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC and not _text(node) and not _noise_added(node):
        yield ast.BinOp(node.left, ARITHMETIC[type(node.op)](), node.right)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not, ast.Invert)):
        yield node.operand
    elif isinstance(node, ast.Call):
        yield from _calls(node)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield ast.Constant(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, float) and abs(node.value) not in (0.0, 1.0):
        if abs(node.value) >= ROUNDING:
            yield ast.Constant(node.value * 10)
    elif isinstance(node, ast.Constant) and isinstance(node.value, float):
        yield ast.Constant(1.0 - node.value)
    elif isinstance(node, ast.IfExp) and not (_is_words(node.body) and _is_words(node.orelse)):
        yield ast.IfExp(node.test, node.orelse, node.body)


def _guard(node: ast.Compare) -> bool:
    """Whether something is compared with a number that only guards against rounding."""
    numbers = [one.value for one in ast.walk(node.comparators[0]) if isinstance(one, ast.Constant)]
    return any(isinstance(number, float) and 0 < abs(number) < ROUNDING for number in numbers)


def _answers(node: ast.expr) -> Iterator[ast.expr]:
    """Always yes and always no, of what can only be one of them."""
    if isinstance(node, (ast.Compare, ast.BoolOp)) and getattr(node, "returned", False):
        yield ast.Constant(True)
        yield ast.Constant(False)


def _one_off(node: ast.expr) -> Iterator[ast.expr]:
    """A whole number that something is compared with, or that is given a name, one larger."""
    numbers: list[ast.expr] = []
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        numbers = node.comparators
    for number in numbers:
        if isinstance(number, ast.Constant) and type(number.value) is int:
            yield ast.Compare(node.left, node.ops, [ast.Constant(number.value + 1)])
    if getattr(node, "named", False) and isinstance(node, ast.Constant) and type(node.value) is int:
        yield ast.Constant(node.value + 1)


def _calls(node: ast.Call) -> Iterator[ast.expr]:
    function = copy.deepcopy(node.func)
    if isinstance(function, ast.Name) and function.id in SWAPPED_CALLS:
        function.id = SWAPPED_CALLS[function.id]
        if function.id in ("max", "min", "any", "all"):
            yield ast.Call(function, node.args, node.keywords)
    elif isinstance(function, ast.Attribute) and function.attr in SWAPPED_CALLS:
        if _is_empty(node):
            return
        function.attr = SWAPPED_CALLS[function.attr]
        yield ast.Call(function, node.args, node.keywords)
    elif node.args and ast.unparse(function) in ("abs", "np.abs"):
        yield node.args[0]


def _is_empty(node: ast.Call) -> bool:
    """Whether an array of a shape that begins with 0 is made: it has no elements."""
    shape = node.args[0] if node.args and ast.unparse(node.func).endswith(".zeros") else None
    first = shape.elts[0] if isinstance(shape, ast.Tuple) and shape.elts else shape
    return isinstance(first, ast.Constant) and type(first.value) is int and first.value == 0


def _text(node: ast.BinOp) -> bool:
    return any(isinstance(part, (ast.JoinedStr, ast.List)) or _is_text(part) for part in (node.left, node.right))


def _noise_added(node: ast.BinOp) -> bool:
    """Whether noise of zero mean is added: taken away, it would be of the same distribution."""
    return isinstance(node.op, (ast.Add, ast.Sub)) and "rng.normal(" in ast.unparse(node.right)


def _is_words(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (_is_text(node) and " " in ast.literal_eval(node))


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _replace(tree: ast.Module, target: ast.expr, replacement: ast.expr) -> None:
    fresh = ast.copy_location(copy.deepcopy(replacement), target)
    for parent in ast.walk(tree):
        for name, value in ast.iter_fields(parent):
            if value is target:
                setattr(parent, name, fresh)
                return
            if isinstance(value, list):
                for place, one in enumerate(value):
                    if one is target:
                        value[place] = fresh
                        return
