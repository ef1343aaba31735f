"""The physics reads records by name, and the page on it names its functions."""

import ast
import importlib
import re
from pathlib import Path

import numpy as np
import pytest

import auvbench
from auvbench.dynamics import layout

FOLDER = Path(auvbench.__file__).parent / "dynamics"
PAGE = Path(__file__).parents[3] / "docs" / "physics.md"


def is_number(node: ast.expr) -> bool:
    """Whether an index is a number, a named constant, or a sum of such."""
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    return (isinstance(node, ast.Constant) and isinstance(node.value, int)) or (
        isinstance(node, ast.Name) and node.id.isupper() and len(node.id) > 1
    )


def reads_by_number(source: str) -> list[str]:
    """Return the subscripts of compiled functions that have a number or a named constant as an index."""
    found = []
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef) or not function.decorator_list:
            continue
        for node in ast.walk(ast.Module(function.body, [])):
            if not isinstance(node, ast.Subscript) or ast.unparse(node.value).endswith((".shape", ")")):
                continue
            indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
            found += [f"{function.name}: {ast.unparse(node)}" for index in indices if is_number(index)]
    return found


# `lanes` reads the records; `vectors` computes with tuples; `random` has the words of a Philox counter.
@pytest.mark.parametrize("name", ["actuation", "appendages", "equations", "kernel", "water", "waves"])
def test_no_array_is_read_by_a_number(name: str) -> None:
    assert reads_by_number((FOLDER / f"{name}.py").read_text(encoding="utf-8")) == []


def test_a_read_by_a_number_is_seen() -> None:
    source = "@inline\ndef f(ws, lane, MASS):\n    return ws[MASS + 1, lane] + ws[lane, 2] + ws.shape[0] + ws[lane + 1]\n"
    assert reads_by_number(source) == ["f: ws[MASS + 1, lane]", "f: ws[lane, 2]"]


def test_the_page_names_a_function_for_each_term() -> None:
    rows = re.findall(r"^\| .* \| (`.*`) \|$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    named = [name for row in rows for name in re.findall(r"`(\w+)\.(\w+)`", row)]
    assert len(rows) == 8  # of the equations
    for module, function in named:
        assert callable(getattr(importlib.import_module(f"auvbench.dynamics.{module}"), function))


def test_vehicles_lie_side_by_side() -> None:
    """Each number of a record becomes a row of LANES, in the same order."""
    one, block = layout.VEHICLE, layout.side_by_side(layout.VEHICLE)
    assert block.itemsize == layout.LANES * one.itemsize
    assert block["M_inverse"]["M12"].shape == (3, 3, layout.LANES)
    numbers = np.arange(layout.PARAMETER_ROWS, dtype=np.float64)
    rows = np.repeat(numbers, layout.LANES).view(block)
    np.testing.assert_array_equal(rows["M_A"]["M12"][0, ..., 5], numbers.view(one)["M_A"]["M12"][0])
