"""``docs/errors.md`` lists every error code that the source can raise, and no other."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
CODE = re.compile(r"[a-z_]+(\.[a-z_0-9]+)*")
#: Codes are first arguments of calls named like these (``MeshError(...)``, ``gltf_error(...)``, ``_bad(...)``).
RAISERS = re.compile(r".*error|_bad\w*|_missing\w*", re.IGNORECASE)
LONE = {"internal", "interrupted"}


def codes_in_source() -> set[str]:
    found: set[str] = set()
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            first: ast.expr | None = None
            if isinstance(node, ast.Call) and node.args:
                name = getattr(node.func, "attr", None) or getattr(node.func, "id", "")
                first = node.args[0] if RAISERS.fullmatch(name) else None
            elif isinstance(node, ast.Tuple) and len(node.elts) == 3 and path.name == "files.py":
                first = node.elts[0]
            text = first.value if isinstance(first, ast.Constant) else None
            if isinstance(text, str) and CODE.fullmatch(text) and ("." in text or text in LONE):
                found.add(text)
    return found


def codes_in_docs() -> list[str]:
    text = (ROOT / "docs" / "errors.md").read_text("utf-8")
    return re.findall(r"^\| `([a-z_0-9.]+)` \|", text, re.MULTILINE)


def test_the_table_is_complete_and_holds_nothing_else() -> None:
    listed = codes_in_docs()
    assert len(listed) == len(set(listed))
    source = codes_in_source()
    assert len(source) > 40
    assert sorted(source - set(listed)) == [], "codes without a row in docs/errors.md"
    assert sorted(set(listed) - source) == [], "rows in docs/errors.md without a code in the source"
