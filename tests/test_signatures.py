"""Values without a name: long lists of fields, arguments and parameters, and constants of the vehicle."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MOST = 6
"""Values that a reader can still tell apart by their order."""

VEHICLE = {4.85, 9.8, 9.80665}
"""Mass (kg) and gravity (m/s^2), the paper's and the mock's."""
HOMES = {"companion/core/paper_vehicle.py", "mock_autopilot/physics/plant.py"}

Found = dict[str, list[str]]


def keyword_only(node: ast.ClassDef) -> bool:
    """Return True if it is no dataclass, or takes its fields by keyword alone."""
    for decorator in node.decorator_list:
        call = decorator if isinstance(decorator, ast.Call) else ast.Call(decorator, [], [])
        if isinstance(call.func, ast.Name) and call.func.id in {"dataclass", "value"}:
            return "kw_only" in {keyword.arg for keyword in call.keywords}
    return True


def fields(node: ast.ClassDef) -> int:
    """Return the number of annotated fields that the constructor takes."""
    declared = [line for line in node.body if isinstance(line, ast.AnnAssign)]
    texts = [ast.unparse(line) for line in declared]
    return sum("ClassVar" not in text and "init=False" not in text for text in texts)


def parameters(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the number of parameters, those by keyword among them, without self and cls."""
    listed = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
    return sum(one is not None and one.arg not in {"self", "cls"} for one in listed)


def look(tree: ast.Module, where: str, found: Found) -> None:
    """Add what a module has too much of; parameters of the command line are its options."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            if len(node.args) > MOST:
                found["calls"].append(f"{where}:{node.lineno}")
        elif isinstance(node, ast.Constant):
            if type(node.value) is float and node.value in VEHICLE and where not in HOMES:
                found["constants"].append(f"{where}:{node.lineno}")
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            if parameters(node) > MOST and not where.startswith("companion/cli/"):
                found["functions"].append(f"{where}:{node.lineno} {node.name}")
        elif isinstance(node, ast.ClassDef) and not keyword_only(node) and fields(node) > MOST:
            found["dataclasses"].append(f"{where}:{node.lineno} {node.name}")


@pytest.fixture(scope="module")
def too_long() -> Found:
    found: Found = {"calls": [], "functions": [], "dataclasses": [], "constants": []}
    for root in ("companion", "mock_autopilot"):
        for path in sorted((ROOT / root).rglob("*.py")):
            look(ast.parse(path.read_text(encoding="utf-8")), path.relative_to(ROOT).as_posix(), found)
    return found


def test_a_dataclass_of_many_fields_takes_them_by_keyword(too_long: Found) -> None:
    assert too_long["dataclasses"] == []


def test_no_call_passes_many_arguments_by_position(too_long: Found) -> None:
    assert too_long["calls"] == []


def test_no_function_has_many_parameters(too_long: Found) -> None:
    assert too_long["functions"] == []


def test_mass_and_gravity_have_one_home(too_long: Found) -> None:
    assert too_long["constants"] == []


def test_what_is_too_long_is_found() -> None:
    many = "a, b, c, d, e, f, g"
    annotated = "".join(f"    {name}: int\n" for name in many.split(", "))
    source = f"@value\nclass V:\n{annotated}\ndef make(self, {many}):\n    return V({many}) * 9.8\n"
    found: Found = {"calls": [], "functions": [], "dataclasses": [], "constants": []}
    look(ast.parse(source), "module.py", found)
    look(ast.parse(source.replace("@value", "@dataclass(kw_only=True)")), "companion/cli/module.py", found)
    assert found == {
        "calls": ["module.py:12", "companion/cli/module.py:12"],
        "functions": ["module.py:11 make"],
        "dataclasses": ["module.py:2 V"],
        "constants": ["module.py:12", "companion/cli/module.py:12"],
    }
