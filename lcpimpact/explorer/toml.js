// TOML 1.0 without dates: a Dict; whole numbers are Int. What is wrong is said as Python's tomllib says it.
class TomlError extends Error {}
function parseToml(text) {
  const src = text.replaceAll("\r\n", "\n"), data = new Dict(), root = {kind: "", nested: new Map()};
  const BARE = /[A-Za-z0-9_-]/, CONTROL = /[\0-\x08\x0a-\x1f\x7f]/, BREAKING = /[\0-\x08\x0b-\x1f\x7f]/;
  const ESCAPES = {b: "\b", t: "\t", n: "\n", f: "\f", r: "\r", '"': '"', "\\": "\\"};
  const NUMBER = /0(?:x[0-9A-Fa-f](?:_?[0-9A-Fa-f])*|b[01](?:_?[01])*|o[0-7](?:_?[0-7])*)|[+-]?(?:0|[1-9](?:_?[0-9])*)((?:\.[0-9](?:_?[0-9])*)?(?:[eE][+-]?[0-9](?:_?[0-9])*)?)/y;
  const DATE = /\d{4}-(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])|([01]\d|2[0-3]):[0-5]\d:[0-5]\d/y;
  let pos = 0, header = [], pending = [];

  function fail(what, at = pos) {
    const before = src.slice(0, at), line = before.split("\n").length, column = [...before.slice(before.lastIndexOf("\n") + 1)].length + 1;
    throw new TomlError(`${what} (${at >= src.length ? "at end of document" : `at line ${line}, column ${column}`})`);
  }
  const skip = (set) => { while (pos < src.length && set.includes(src[pos])) pos++; };
  const names = (key) => repr([...key]);

  // What has been said of a key: "frozen" values and tables that are written out, with all below them, and "explicit" tables.
  function stateOf(states, key) {
    let at = states;
    for (const part of key) { if (at.kind === "frozen") return "frozen"; at = at.nested.get(part); if (!at) return ""; }
    return key.length ? at.kind : "";
  }
  function mark(states, key, kind) {
    let at = states;
    for (const part of key) { if (!at.nested.has(part)) at.nested.set(part, {kind: "", nested: new Map()}); at = at.nested.get(part); }
    if (at.kind !== "frozen") at.kind = kind;
  }
  function forget(states, key) {
    let at = states;
    for (const part of key.slice(0, -1)) { at = at.nested.get(part); if (!at) return; }
    at.nested.delete(key[key.length - 1]);
  }
  function nest(from, key, lists = true) {
    let at = from;
    for (const part of key) {
      if (!at.has(part)) at.set(part, new Dict());
      at = at.get(part);
      if (lists && isArray(at)) at = at[at.length - 1];
      if (!(at instanceof Map)) fail("Cannot overwrite a value");
    }
    return at;
  }

  function comment() {
    if (src[pos] !== "#") return;
    let end = src.indexOf("\n", pos);
    if (end < 0) end = src.length;
    for (pos++; pos < end; pos++) if (CONTROL.test(src[pos])) fail(`Found invalid character ${repr(src[pos])}`);
  }
  function spaces() { for (let before = -1; before !== pos;) { before = pos; skip(" \t\n"); comment(); } }

  function literalText(end, illegal) {
    const first = pos, last = src.indexOf(end, pos);
    if (last < 0) fail(`Expected ${repr(end)}`, src.length);
    for (; pos < last; pos++) if (illegal.test(src[pos])) fail(`Found invalid character ${repr(src[pos])}`);
    pos += end.length;
    return src.slice(first, last);
  }
  function escape(multiline) {
    const c = src[pos + 1];
    pos += 2;
    if (multiline && " \t\n".includes(c || "-")) {
      if (c !== "\n") { skip(" \t"); if (pos >= src.length) return ""; if (src[pos] !== "\n") fail("Unescaped '\\' in a string"); pos++; }
      skip(" \t\n");
      return "";
    }
    if (c === "u" || c === "U") {
      const n = c === "u" ? 4 : 8, digits = src.slice(pos, pos + n);
      if (digits.length !== n || /[^0-9a-fA-F]/.test(digits)) fail("Invalid hex value");
      pos += n;
      const code = parseInt(digits, 16);
      if (code > 0x10ffff || (code >= 0xd800 && code < 0xe000)) fail("Escaped character is not a Unicode scalar value");
      return String.fromCodePoint(code);
    }
    if (!(c in ESCAPES)) fail("Unescaped '\\' in a string");
    return ESCAPES[c];
  }
  function basicText(multiline) {
    const illegal = multiline ? BREAKING : CONTROL;
    for (let found = ""; ;) {
      if (pos >= src.length) fail("Unterminated string");
      const c = src[pos];
      if (c === '"' && (!multiline || src.startsWith('"""', pos))) { pos += multiline ? 3 : 1; return found; }
      if (c === "\\") { found += escape(multiline); continue; }
      if (illegal.test(c)) fail(`Illegal character ${repr(c)}`);
      found += c;
      pos++;
    }
  }
  function text_() {
    const quote = src[pos], many = src.startsWith(quote.repeat(3), pos);
    pos += many ? 3 : 1;
    if (!many) return quote === '"' ? basicText(false) : literalText("'", CONTROL);
    if (src[pos] === "\n") pos++;
    let found = quote === '"' ? basicText(true) : literalText("'''", BREAKING);
    for (let k = 0; k < 2 && src[pos] === quote; k++) { found += quote; pos++; }
    return found;
  }
  function keyPart() {
    const first = pos;
    if (src[pos] === '"' || src[pos] === "'") { const quote = src[pos++]; return quote === '"' ? basicText(false) : literalText("'", CONTROL); }
    while (pos < src.length && BARE.test(src[pos])) pos++;
    if (pos === first) fail("Invalid initial character for a key part");
    return src.slice(first, pos);
  }
  function key() {
    const parts = [keyPart()];
    for (skip(" \t"); src[pos] === "."; skip(" \t")) { pos++; skip(" \t"); parts.push(keyPart()); }
    return parts;
  }
  function pair() {
    const name = key();
    if (src[pos] !== "=") fail("Expected '=' after a key in a key/value pair");
    pos++;
    skip(" \t");
    return [name, value()];
  }
  function array() {
    const found = Object.assign([], {list: true});
    pos++;
    for (spaces(); src[pos] !== "]";) {
      found.push(value());
      spaces();
      if (src[pos] === "]") break;
      if (src[pos] !== ",") fail("Unclosed array");
      pos++;
      spaces();
    }
    pos++;
    return found;
  }
  function inlineTable() {
    const found = new Dict(), states = {kind: "", nested: new Map()};
    pos++;
    skip(" \t");
    if (src[pos] === "}") { pos++; return found; }
    for (;;) {
      const [name, given] = pair();
      if (stateOf(states, name) === "frozen") fail(`Cannot mutate immutable namespace ${names(name)}`);
      const into = nest(found, name.slice(0, -1), false), last = name[name.length - 1];
      if (into.has(last)) fail(`Duplicate inline table key ${repr(last)}`);
      into.set(last, given);
      skip(" \t");
      if (src[pos] === "}") { pos++; return found; }
      if (src[pos] !== ",") fail("Unclosed inline table");
      if (given instanceof Map || isArray(given)) mark(states, name, "frozen");
      pos++;
      skip(" \t");
    }
  }
  function value() {
    const c = src[pos];
    if (c === '"' || c === "'") return text_();
    for (const [word, meant] of [["true", true], ["false", false]]) if (src.startsWith(word, pos)) { pos += word.length; return meant; }
    if (c === "[") return array();
    if (c === "{") return inlineTable();
    DATE.lastIndex = NUMBER.lastIndex = pos;
    if (DATE.test(src)) throw new UnsupportedError("the page reads no dates and times: leave them out, or name the file in lcpimpact explore");
    const match = NUMBER.exec(src);
    if (match) {
      pos += match[0].length;
      const plain = match[0].replaceAll("_", "");
      return match[1] ? Number(plain) : Object.assign(new Int(plain.replace(/^\+/, "")), {digits: plain});
    }
    const special = /^[+-]?(?:inf|nan)/.exec(src.slice(pos, pos + 4));
    if (!special) fail("Invalid value");
    pos += special[0].length;
    return special[0].endsWith("nan") ? NaN : special[0][0] === "-" ? -Infinity : Infinity;
  }

  function declareTable() {
    pos++;
    skip(" \t");
    const name = key();
    if (stateOf(root, name)) fail(`Cannot declare ${names(name)} twice`);
    mark(root, name, "explicit");
    nest(data, name);
    if (src[pos] !== "]") fail("Expected ']' at the end of a table declaration");
    pos++;
    header = name;
  }
  function declareArray() {
    pos += 2;
    skip(" \t");
    const name = key(), last = name[name.length - 1];
    if (stateOf(root, name) === "frozen") fail(`Cannot mutate immutable namespace ${names(name)}`);
    forget(root, name);
    mark(root, name, "explicit");
    const into = nest(data, name.slice(0, -1));
    if (!into.has(last)) into.set(last, Object.assign([], {list: true}));
    if (!isArray(into.get(last))) fail("Cannot overwrite a value");
    into.get(last).push(new Dict());
    if (!src.startsWith("]]", pos)) fail("Expected ']]' at the end of an array declaration");
    pos += 2;
    header = name;
  }
  function assign() {
    const [name, given] = pair(), parent = [...header, ...name.slice(0, -1)], last = name[name.length - 1];
    for (let i = 1; i < name.length; i++) {
      const part = [...header, ...name.slice(0, i)];
      if (stateOf(root, part) === "explicit") fail(`Cannot redefine namespace ${names(part)}`);
      pending.push(part);
    }
    if (stateOf(root, parent) === "frozen") fail(`Cannot mutate immutable namespace ${names(parent)}`);
    const into = nest(data, parent);
    if (into.has(last)) fail("Cannot overwrite a value");
    if (given instanceof Map || isArray(given)) mark(root, [...header, ...name], "frozen");
    into.set(last, given);
  }

  for (;;) {
    skip(" \t");
    if (pos >= src.length) return data;
    if (src[pos] === "\n") { pos++; continue; }
    if (BARE.test(src[pos]) || src[pos] === '"' || src[pos] === "'") assign();
    else if (src[pos] === "[") {
      for (const part of pending) mark(root, part, "explicit");
      pending = [];
      if (src[pos + 1] === "[") declareArray(); else declareTable();
    } else if (src[pos] !== "#") fail("Invalid statement");
    skip(" \t");
    comment();
    if (pos >= src.length) return data;
    if (src[pos] !== "\n") fail("Expected newline or end of document after a statement");
    pos++;
  }
}
