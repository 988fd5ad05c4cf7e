"""What an ECMAScript module imports, exports, declares and uses: enough to find a name that nobody declares.

Tokens and brackets, no grammar: it knows the forms in which ``static/`` is written (named imports, exported
declarations, statements that end in a semicolon), and fails at others.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

RESERVED = (
    "await break case catch class const continue default delete do else export extends false finally for function if"
    " import in instanceof let new null return super switch this throw true try typeof var void while yield"
)
KEYWORDS = frozenset(RESERVED.split())
CONTEXTUAL = frozenset({"as", "async", "from", "get", "of", "set", "static"})
"""Keywords in some places, names in others: no fault is looked for in them."""
NAME = re.compile(r"#?[A-Za-z_$][\w$]*")
TOKEN = re.compile(r"\s+|//[^\n]*|/\*.*?\*/|(\.\.\.|=>|\?\.(?!\d)|\d[\w.]*|#?[A-Za-z_$][\w$]*|[^\w\s])", re.DOTALL)
STRING = re.compile(r"\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'")
PATTERN = re.compile(r"/(?![/*])(?:\\.|\[(?:\\.|[^\]\\\n])*\]|[^/\\\[\n])+/[a-z]*")
PARTNERS = {"(": ")", "{": "}", "[": "]"}
ENDS = (")", "}", "]", ",", ";", "")
HEADS = ("if", "for", "while", "switch", "await")


@dataclass(frozen=True, slots=True)
class Module:
    """The names of a module."""

    imports: dict[str, tuple[str, ...]]
    """Names by the module that they come from."""
    exports: frozenset[str]
    unused: frozenset[str]
    """Imported or declared, not exported, and used nowhere."""
    undeclared: frozenset[str]
    """Used where nothing of that name is declared; those of the browser are among them."""


def read(source: str) -> Module:
    """Read a module. Raises AssertionError where it is written in a form that this does not know."""
    reader = _Reader(source)
    reader.declare()
    used = {at for at in range(len(reader.tokens) - 1) if reader.is_use(at)}
    names = {reader.tokens[at] for at in used}
    undeclared = {
        reader.tokens[at] for at in used
        if not any(name == reader.tokens[at] and begin <= at <= end for name, begin, end in reader.bound)
    }  # fmt: skip
    unused = reader.declared - names - reader.exports
    return Module(reader.imports, frozenset(reader.exports), frozenset(unused), frozenset(undeclared - CONTEXTUAL))


def _read_tokens(source: str, at: int, out: list[str], *, is_in_template: bool = False) -> int:
    """Add the tokens from a place on: of a template what is in its braces, of a regular expression ``//``."""
    depth = 0
    while at < len(source) and not (is_in_template and depth == 0 and source[at] == "}"):
        if source[at] == "`":
            out.append('""')
            at += 1
            while source[at] != "`":
                if source.startswith("${", at):
                    out += ["+", "("]
                    at = _read_tokens(source, at + 2, out, is_in_template=True)
                    out.append(")")
                at += 2 if source[at] == "\\" else 1
            at += 1
            continue
        last = out[-1] if out else ""
        is_operand = last[-1:] in (")", "]", "}", '"', "'") or (last[-1:].isalnum() and last not in KEYWORDS)
        found = STRING.match(source, at) or (None if is_operand else PATTERN.match(source, at))
        token = None if found is None else "//" if found[0][0] == "/" else found[0]
        if found is None:
            found = TOKEN.match(source, at)
            assert found is not None
            token = found[1]
        at = found.end()
        depth += {"{": 1, "}": -1}.get(token or "", 0)
        out += [token] if token else []
    return at


class _Reader:
    def __init__(self, source: str) -> None:
        self.tokens: list[str] = []
        _read_tokens(source, 0, self.tokens)
        self.tokens += ["", "", ""]
        self.partner: dict[int, int] = {}
        self.parent: list[int] = []
        self.bound: list[tuple[str, int, int]] = []
        self.imports: dict[str, tuple[str, ...]] = {}
        self.exports: set[str] = set()
        self.declared: set[str] = set()
        self.no_use: set[int] = set()
        opened: list[int] = []
        for at, token in enumerate(self.tokens):
            if token in PARTNERS.values():
                begin = opened.pop()
                assert PARTNERS[self.tokens[begin]] == token, f"{self.tokens[begin]} is closed by {token}"
                self.partner |= {begin: at, at: begin}
            self.parent.append(opened[-1] if opened else -1)
            if token in PARTNERS:
                opened.append(at)
        assert not opened, "a bracket is not closed"

    def declare(self) -> None:
        for at, token in enumerate(self.tokens):
            if token == "import":
                self._import(at)
            elif token in ("const", "let", "var"):
                self._variables(at)
            elif token in ("function", "class") and NAME.fullmatch(self.tokens[at + 1]):
                self._bind(at + 1, *self._block(at))
                self._declare(at, len(self.bound) - 1)
            elif token == "=>":
                begin = self.partner.get(at - 1, at - 1)
                self._parameters(begin, at - 1, self._statement_end(at + 1))
            elif token == "(" and self.tokens[self.partner[at] + 1] == "{" and self.tokens[at - 1] not in HEADS:
                self._parameters(at, self.partner[at], self.partner[self.partner[at] + 1])
                self.no_use.add(at - 1)  # of a method

    def is_use(self, at: int) -> bool:
        token, before, after = self.tokens[at], self.tokens[at - 1], self.tokens[at + 1]
        is_key = after == ":" and before in ("{", ",") and self.tokens[self.parent[at]] == "{"
        is_name = NAME.fullmatch(token) and token not in KEYWORDS and before not in (".", "?.") and token[0] != "#"
        return bool(is_name) and not is_key and at not in self.no_use

    def _import(self, at: int) -> None:
        if self.tokens[at + 1] in ("(", "."):
            return
        end = self.tokens.index(";", at)
        names = [each for each in self.tokens[at + 2 : end - 3] if each != ","] if self.tokens[at + 1] == "{" else []
        assert "as" not in names, "an import has another name"
        assert names or end == at + 2, "not all imports are named"
        self.imports[self.tokens[end - 1][1:-1]] = tuple(names)
        self.declared |= set(names)
        self.bound += [(name, 0, len(self.tokens)) for name in names]
        self.no_use |= set(range(at, end))

    def _variables(self, at: int) -> None:
        head = self.parent[at]
        is_loop = head >= 0 and self.tokens[head] == "(" and self.tokens[head - 1] in ("for", "await")
        where = (head, self._statement_end(self.partner[head] + 1)) if is_loop else self._block(at)
        begin, first = at, len(self.bound)
        while at == begin or self.tokens[at] == ",":
            at = self._bind(at + 1, *where)
        self._declare(begin, first)

    def _declare(self, at: int, first: int) -> None:
        """Note what the declaration at a token has bound, from the place ``first`` on, and whether it is exported."""
        names = {name for name, *_ in self.bound[first:]}
        before = self.tokens[at - 2 : at] if self.tokens[at - 1] == "async" else self.tokens[at - 1 : at]
        self.declared |= names
        self.exports |= names if before[:1] == ["export"] else set()

    def _parameters(self, begin: int, end: int, until: int) -> None:
        at = begin + 1 if self.tokens[begin] == "(" else begin
        while at < end or at == begin == end:
            at = self._bind(at, begin, until) if self.tokens[at] != "," else at + 1

    def _bind(self, at: int, begin: int, end: int) -> int:
        """Bind the names of the pattern at a token where they can be used; return where it, and its default, ends."""
        if self.tokens[at] == "...":
            at += 1
        if self.tokens[at] in ("{", "["):
            inner, close = at + 1, self.partner[at]
            while inner < close:
                key_end = self.partner.get(inner, inner)
                inner = key_end + 2 if self.tokens[at] == "{" and self.tokens[key_end + 1] == ":" else inner
                inner = self._bind(inner, begin, end) if self.tokens[inner] != "," else inner + 1
            at = close
        else:
            assert NAME.fullmatch(self.tokens[at]), f"no name: {self.tokens[at - 4 : at + 4]}"
            self.bound.append((self.tokens[at], begin, end))
            self.no_use.add(at)
        return self._skip(at + 2) if self.tokens[at + 1] == "=" else at + 1

    def _block(self, at: int) -> tuple[int, int]:
        """Return where the block around a token begins and ends."""
        while at >= 0 and self.tokens[at] != "{":
            at = self.parent[at]
        return (at, self.partner[at]) if at >= 0 else (0, len(self.tokens))

    def _skip(self, at: int) -> int:
        """Return where the expression at a token ends."""
        while self.tokens[at] not in ENDS:
            at = self.partner.get(at, at) + 1
        return at

    def _statement_end(self, at: int) -> int:
        """Return where the block, statement or expression at a token ends."""
        if self.tokens[at] in HEADS[:3]:
            at = self._statement_end(self.partner[at + 1] + 1)
            return self._statement_end(at + 2) if self.tokens[at + 1] == "else" else at
        return self.partner[at] if self.tokens[at] == "{" else self._skip(at)
