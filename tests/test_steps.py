# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in steps runs only when it is drained: every call of a `*_steps` function stands where something drives it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.once
PACKAGE = Path(__file__).resolve().parents[1] / "ctmc_addon"
SOURCES = sorted(PACKAGE.rglob("*.py"))
Function = ast.FunctionDef | ast.AsyncFunctionDef


def parents_of(tree: ast.AST) -> dict[ast.AST, ast.AST]:
    return {child: parent for parent in ast.walk(tree) for child in ast.iter_child_nodes(parent)}


def called(node: ast.Call) -> str:
    """The name that is called, without what it belongs to."""
    return getattr(node.func, "id", getattr(node.func, "attr", ""))


def is_driven(call: ast.Call, parents: dict[ast.AST, ast.AST]) -> bool:
    """Whether the generator goes to `yield from`, another call, a loop, a `return` or a name."""
    node: ast.AST = call
    while isinstance(parents[node], ast.IfExp | ast.keyword | ast.Starred | ast.Tuple | ast.List):
        node = parents[node]
    parent = parents[node]
    if isinstance(parent, ast.Call):
        return node is not parent.func
    if isinstance(parent, ast.For | ast.comprehension):
        return node is parent.iter
    return isinstance(parent, ast.YieldFrom | ast.Return | ast.Assign | ast.AnnAssign | ast.NamedExpr | ast.Lambda)


def own_nodes(function: Function) -> Iterator[ast.AST]:
    """What belongs to a function itself and not to one inside it."""
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        yield node
        if not isinstance(node, Function | ast.Lambda | ast.ClassDef):
            waiting.extend(ast.iter_child_nodes(node))


def yields_steps(function: Function) -> bool:
    """Whether a function yields a `Step` or a `PAUSE`, or says that it returns `Steps`."""
    if function.returns is not None and "Steps[" in ast.unparse(function.returns):
        return ast.unparse(function.returns).startswith("Steps[")
    values = (node.value for node in own_nodes(function) if isinstance(node, ast.Yield))
    return any(
        value is not None and (ast.unparse(value) == "PAUSE" or ast.unparse(value).startswith("Step("))
        for value in values
    )


def is_given_steps(function: Function) -> bool:
    """Whether a function only passes steps on that it is given, as `Stages.run` does."""
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    return any(
        argument.annotation is not None and "Steps[" in ast.unparse(argument.annotation) for argument in arguments
    )


def yields_own_steps(function: Function) -> bool:
    """Whether a function is a generator of steps that are its own."""
    is_generator = any(isinstance(node, ast.Yield | ast.YieldFrom) for node in own_nodes(function))
    return is_generator and yields_steps(function) and not is_given_steps(function)


def test_every_call_of_steps_is_driven_and_every_generator_of_steps_is_named_so():
    lost, misnamed = [], []
    for path in SOURCES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        parents, name = parents_of(tree), path.relative_to(PACKAGE).as_posix()
        for node in parents:
            if isinstance(node, ast.Call) and called(node).endswith("steps") and not is_driven(node, parents):
                lost.append(f"{name}, line {node.lineno}: {called(node)}")
            if isinstance(node, Function) and not node.name.endswith("steps") and yields_own_steps(node):
                misnamed.append(f"{name}, line {node.lineno}: {node.name}")
    assert (lost, misnamed) == ([], [])


@pytest.mark.parametrize(
    ("source", "driven"),
    [
        ("def f():\n    work_steps()", False),
        ("def f():\n    yield work_steps()", False),
        ("def f():\n    next(work_steps)\n    work_steps().close()", False),
        ("def f():\n    x = yield from work_steps()", True),
        ("x = finish(work_steps())", True),
        ("x = stages.run('a', steps=work_steps())", True),
        ("x = [step for step in work_steps()]", True),
        ("x = finish(a_steps() if b else work_steps())", True),
        ("for step in work_steps(): pass", True),
    ],
)
def test_the_test_tells_driven_from_forgotten(source, driven):
    tree = ast.parse(source)
    parents = parents_of(tree)
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and called(node) == "work_steps"]
    assert [is_driven(call, parents) for call in calls] == [driven]
