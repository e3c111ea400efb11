r"""Formulas that docstrings hold as plain text, in TeX for the pages that are generated from them.

``tex`` translates one formula, ``with_tex`` those of a text, ``spelled`` the Greek letters of what is TeX already. A
docstring keeps its plain formulas, so that ``help`` reads well.

>>> print(tex("ω t_m = (3 acos ζ - π)/sqrt(1 - ζ²)"))
\omega t_m = (3 \arccos \zeta - \pi)/\sqrt{1 - \zeta^2}
>>> print(with_tex("The force jumps to ``R(0+) = c v0`` at first touch, for θ >= 1/2 too; see ``load_problem``."))
The force jumps to $R(0^+) = c v_0$ at first touch, for $\theta \ge 1/2$ too; see ``load_problem``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

LETTERS = "alpha beta gamma delta varepsilon zeta eta theta kappa lambda mu nu xi pi rho sigma tau varphi chi psi omega"
CAPITALS = "Gamma Delta Theta Lambda Xi Pi Sigma Phi Psi Omega"
GREEK = dict(zip("αβγδεζηθκλμνξπρστφχψωΓΔΘΛΞΠΣΦΨΩ∞", f"{LETTERS} {CAPITALS} infty".split(), strict=True))
RAISED = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ⁿᵀᴺ", "0123456789+-nTN", strict=True))
FUNCTIONS = {
    **{name: f"\\{name}" for name in ("exp", "ln", "log", "sin", "cos", "tan", "cot", "sinh", "cosh", "tanh")},
    **{name: f"\\{name}" for name in ("max", "min", "sup")},
    **{f"a{name}": f"\\arc{name}" for name in ("sin", "cos", "tan")},
    **{f"a{name}h": f"\\operatorname{{ar{name}h}}" for name in ("sin", "cos", "tan")},
    "acosh": "\\operatorname{arcosh}",
    "sign": "\\operatorname{sign}",
    "Sgn": "\\operatorname{Sgn}",
    "Im": "\\operatorname{Im}",
    "∫": "\\int",
    "Σ": "\\sum",
}
OPERATORS = {
    "<=": "\\le",
    ">=": "\\ge",
    "!=": "\\ne",
    ":=": ":=",
    "⟂": "\\perp",
    "→": "\\to",
    "·": "\\cdot",
    "±": "\\pm",
    "∓": "\\mp",
    **{each: each for each in "=<>+-/"},
}
GROUPS = {
    "(": ("(", ")", ")"),
    "[": ("[", "]", "]"),
    "⌈": ("\\lceil ", "⌉", "\\rceil"),
    "sqrt(": ("\\sqrt{", ")", "}"),
    "abs(": ("\\lvert ", ")", "\\rvert"),
    "ceil(": ("\\lceil ", ")", "\\rceil"),
    "floor(": ("\\lfloor ", ")", "\\rfloor"),
    "^(": ("^{", ")", "}"),
    "_(": ("_{", ")", "}"),
    "_{": ("_{", "}", "}"),
    "|": ("\\lvert ", "|", "\\rvert"),
}
"""How a group opens and closes in TeX, and by what it closes in the text."""

TOKEN = re.compile(
    rf"""(?P<group>(?:sqrt|abs|ceil|floor)\(|\^\(|_[({{]|[(\[⌈])
    |(?P<raised>[{"".join(RAISED)}]+|\^[\w+]|(?<=[A-Za-z])\*(?=[ )]|$)|(?<=\(0)\+(?=\)))
    |(?P<prime>'+)
    |(?P<lowered>_∞|_·j|_[A-Za-z\d{"".join(GREEK)}]+|∞)
    |(?P<close>[)\]⌉}}])
    |(?P<bar>\|)
    |(?P<comma>,[ ]|,(?=[\d{"".join(GREEK)}]))
    |(?P<function>[∫Σ]|(?:{"|".join(FUNCTIONS)})(?![A-Za-z]))
    |(?P<operator>{"|".join(map(re.escape, OPERATORS))})
    |(?P<number>\d+(?:\.\d+)?(?:e-?\d+)?(?!\.\d)|½|√\d+|\.\.\.(?=[ ][=+]))
    |(?P<differential>d[stx](?!\w))
    |(?P<word>(?:lower|upper|gap|slack|inf)(?:_i)?(?!\w))
    |(?P<symbol>[{"".join(GREEK)}](?=[a-z](?!\w))|[A-Za-z{"".join(GREEK)}]\d*(?![A-Za-zÀ-ÿ]))""",
    re.VERBOSE,
)
BLANK = re.compile(r"[ \n]*")
UNIT = re.compile(
    r"(?:N s\^α/m|N/mⁿ|1/s|kg m²|N [sm]|mm|ms|µs|kg|Pa|rad|Hz|[mskNJVFHΩ])(?:/[a-z]+)?[²³]?(?![\w'⁺⁻]| [=<>+⟂]| - \d)"
)
PROTECTED = re.compile(
    r"(?P<literal>``(?P<plain>[^`]+)``)|`[^`]*`|\$\$.*?\$\$|\$[^$]*\$|!?\[[^\]]*\]\([^)]*\)"
    rf"|\b[Ii]n {UNIT.pattern}|(?<=\b(?:and|.or) ){UNIT.pattern}|\bN/mⁿ|\d[\d.e-]* {UNIT.pattern}|\b(?:L1|D1⁻)(?!\w)"
    rf"|\({UNIT.pattern}(?=[,);:])(?!, \w\))|\bEqs?\. \([^)]*\)|\b\w*(?:NAME|NODE)[\w.]*|\"[^\"\s]*\"",
    re.DOTALL,
)
NAMES = {"L1": "L^1", "D1⁻": "\\mathrm{D1}^-"}
"""Of a norm and a method, whose digits are no subscripts."""

ENDS = {"close", "raised", "prime", "lowered", "number", "symbol", "word", "differential"}
Token = tuple[str, str, int, int]
"""Kind, text, and where it begins and ends."""


def tex(formula: str) -> str:
    """Return a plain formula in TeX, or raise ValueError where it is none."""
    tokens = longest(formula, 0)
    if not tokens or tokens[-1][3] != len(formula):
        raise ValueError(f"no formula: {formula!r}")
    return written(tokens)


def spelled(formula: str) -> str:
    r"""Return TeX in which Greek letters and a half have been typed as such, with commands for them.

    >>> print(spelled("v_½ = θ h"))
    v_{1/2} = \theta h
    """
    letters = re.sub(f"[{''.join(GREEK)}](?=([A-Za-z])?)", lambda m: f"\\{GREEK[m[0]]}{' ' if m[1] else ''}", formula)
    return letters.replace("_½", "_{1/2}").replace("½", "\\tfrac12")


def with_tex(text: str) -> str:
    """Return a text with its formulas in TeX; code, links and what is TeX already stay."""
    return "".join(f"${part}$" if formula else part for part, formula in parts(text))


def parts(text: str) -> Iterator[tuple[str, bool]]:
    """Yield the parts of a text, each with whether it is a formula, which is in TeX."""
    at = 0
    while at < len(text):
        if match := PROTECTED.match(text, at):
            yield protected(match)
            at = match.end()
        elif tokens := prose(text, at):
            yield written(tokens), True
            at = tokens[-1][3]
        else:
            match = re.compile(r"\w+(?:['-][A-Za-z]\w*)*|.", re.DOTALL).match(text, at)
            assert match is not None
            yield match[0], False
            at = match.end()


def protected(match: re.Match[str]) -> tuple[str, bool]:
    """Return a literal that is a formula in TeX, and everything else that is protected as it is."""
    if match[0] in NAMES:
        return NAMES[match[0]], True
    try:
        return (tex(match["plain"]), True) if match["literal"] else (match[0], False)
    except ValueError:
        return match[0], False


def prose(text: str, at: int) -> list[Token]:
    """Return the tokens of a formula in running text; articles, units, names and hyphens are no symbols."""
    if text[at] == "-" and text[at - 1 : at].isalnum():
        return []
    tokens = longest(text, at, running=True)
    if tokens and tokens[0][1] == "(" and closing(tokens) == len(tokens) - 1:
        return []
    return tokens if any(kind in ("symbol", "raised", "differential") for kind, *_ in tokens) else []


def longest(text: str, at: int, running: bool = False) -> list[Token]:
    """Return the tokens of the longest formula that begins at a place."""
    tokens: list[Token] = []
    while True:
        begin = BLANK.match(text, at).end() if tokens else at  # type: ignore[union-attr]
        match = TOKEN.match(text, begin)
        if not match or not fits(tokens, match, begin > at) or (running and not reads(tokens, match, begin > at)):
            break
        kind = str(match.lastgroup)
        if match[0] == "∞" and (begin > at or not tokens or tokens[-1][0] not in ENDS):
            kind = "symbol"
        if kind == "bar":
            kind = "close" if "|" in opened(tokens) and tokens[-1][0] in ENDS else "group"
        tokens.append((kind, match[0], match.start(), match.end()))
        at = match.end()
    while tokens and not balanced(tokens):
        tokens.pop()
    return tokens


def fits(tokens: list[Token], match: re.Match[str], gap: bool) -> bool:
    """Whether a token may follow."""
    kind, text, before = match.lastgroup, match[0], tokens[-1][0] if tokens else ""
    if text == "∞":
        return True
    if kind in ("raised", "prime", "lowered") or text in ("^(", "_(", "_{"):
        return (
            before in ENDS or (before == "function" and (kind == "raised" or tokens[-1][1] == "Σ" or len(text) == 2))
        ) and not gap
    if kind == "close":
        return before in ENDS and bool(opened(tokens)) and GROUPS[opened(tokens)[-1]][1] == text
    if kind == "comma":
        return before in ENDS and bool(opened(tokens))
    if kind == "operator":
        return before in ENDS or (
            (text in "-±∓" or (text == "+" and before == "operator"))
            and before in ("", "group", "operator", "comma", "function")
        )
    if kind == "number":
        return before not in ENDS or (before == "close" and gap)
    if kind == "differential":
        return any(each[1] == "∫" for each in tokens) or (text == "dt" and bool(tokens))
    return True


def reads(tokens: list[Token], match: re.Match[str], gap: bool) -> bool:
    """Whether a token in running text is meant as a part of a formula."""
    text, end, whole = match[0], match.end(), match.string
    before = tokens[-1] if tokens else ("", "", 0, 0)
    if before[0] == "number" and before[1] != "½" and gap and UNIT.match(whole, match.start()):
        return False
    if match.lastgroup == "symbol" and re.match(r"-(?!th\b)[A-Za-z]", whole[end:]) and (text.isascii() or not tokens):
        return not text.isascii()
    if match.lastgroup == "word":
        return before[0] == "operator" or bool(re.match(r" (?:[<>]=?|:?=) ", whole[end:]))
    if text in ("a", "A", "I"):
        ahead = re.match(r"['_⁺⁻ᵀ²/]|[ \n](?:(?:[-=<>+⟂]|[<>]=) |(?:cos|sin|sign|exp)\b)", whole[end:])
        if text == "A" and re.search(r"[a-z]\s$", whole[: match.start()][-2:]):
            return True
        return bool(ahead) or before[0] in ("operator", "group", "comma") or (before[0] in ENDS and text != "a")
    if text == "/" and before[0] == "number" and UNIT.match(whole, end):
        return False
    if match.lastgroup == "operator":
        spaced = whole[end : end + 1] in (" ", "\n")
        return spaced == gap if before[0] in ENDS and text != "/" else not spaced
    if match.lastgroup == "group" and text == "(" and gap and before[0] in ENDS:
        return not re.match(rf"\d+(, \d+)*\)|[^()]*[=<>⟂]|{UNIT.pattern}[,)]", whole[end:]) and (
            before[0] != "number" or whole[end : end + 1].isalpha()
        )
    return match.lastgroup != "function" or text in "∫Σ" or bool(re.match(r"[ \n(|²]", whole[end:]))


def opened(tokens: list[Token]) -> list[str]:
    """Return the groups that are open."""
    stack: list[str] = []
    for kind, text, *_ in tokens:
        if kind == "group":
            stack.append(text)
        elif kind == "close":
            stack.pop()
    return stack


def balanced(tokens: list[Token]) -> bool:
    """Whether a formula is complete: it ends with an operand, and all groups are closed."""
    return not opened(tokens) and tokens[-1][0] in ENDS


def closing(tokens: list[Token]) -> int:
    """Return the number of the token that closes the first group."""
    return next(number for number in range(1, len(tokens)) if not opened(tokens[: number + 1]))


def written(tokens: list[Token]) -> str:
    """Return the TeX of the tokens of a formula."""
    done, stack = "", list[str]()
    for number, (kind, text, begin, _) in enumerate(tokens):
        if (number and tokens[number - 1][3] < begin) or (re.search(r"\\[A-Za-z]+$", done) and kind == "symbol"):
            done += " "
        if kind == "group":
            stack.append(text)
            done += GROUPS[text][0]
        elif kind == "close":
            done = done.rstrip() + GROUPS[stack.pop()][2]
        else:
            done += symbol(kind, text)
    return re.sub(r" +", " ", done)


def symbol(kind: str, text: str) -> str:
    """Return one token in TeX."""
    if kind == "raised":
        if text == "*" or text.removeprefix("^") in GREEK:
            return "^\\" + GREEK.get(text.removeprefix("^"), "ast")
        body = "".join(RAISED.get(each, each) for each in text.removeprefix("^"))
        return "^" + (body if len(body) == 1 else f"{{{body}}}")
    if kind == "lowered":
        return "_" + lowered(text.removeprefix("_"))
    if kind == "function":
        return FUNCTIONS[text]
    if kind == "operator":
        return OPERATORS[text] if text != "·" else " \\cdot "
    if kind == "differential":
        return f"\\, \\mathrm{{d}}{text[1]}"
    if kind == "word":
        name, _, index = text.partition("_")
        return "\\infty" if name == "inf" else f"\\mathrm{{{name}}}" + (f"_{index}" if index else "")
    if kind == "number":
        return number_in_tex(text)
    if kind == "symbol":
        letter, digits = text[0], text[1:]
        return (f"\\{GREEK[letter]}" if letter in GREEK else letter) + (f"_{lowered(digits)}" if digits else "")
    return text


def lowered(text: str) -> str:
    """Return a subscript in TeX: one letter or number as it is, words upright."""
    if text in ("max", "min", *LETTERS.split()):
        return f"{{\\{text}}}"
    if text in ("inf", "·j"):
        return {"inf": "\\infty", "·j": "{\\cdot j}"}[text]
    if text in GREEK:
        return f"\\{GREEK[text]}"
    if text.isdigit() or len(text) == 1 or text in ("ij", "ii", "tt", "xx"):
        return text if len(text) == 1 else f"{{{text}}}"
    return f"{{\\mathrm{{{text}}}}}"


def number_in_tex(text: str) -> str:
    """Return a number in TeX: 2.5e-3 as 2.5 times a power of ten."""
    if text in ("½", "..."):
        return {"½": "\\tfrac12", "...": "\\dots"}[text]
    if text.startswith("√"):
        return f"\\sqrt{{{text[1:]}}}"
    mantissa, _, exponent = text.partition("e")
    if not exponent:
        return mantissa
    power = f"10^{{{exponent}}}"
    return power if mantissa == "1" else f"{mantissa} \\cdot {power}"
