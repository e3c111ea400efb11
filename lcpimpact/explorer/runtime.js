// The operations of Python and NumPy that translated functions call. A vector is a Float64Array, of truth values a Uint8Array
// and of indices an Int32Array; a matrix is an array of its rows with a `shape`.
class Dict extends Map {}
class InputError extends Error { get inWords() { return true; } }
class UnknownNameError extends InputError {}
class UnsupportedError extends InputError { get unsupported() { return true; } }
class Absent {}  // the elements that a page does not take
const Bar = Absent, HertzSpring = Absent, HuntCrossley = Absent, KelvinVoigtStop = Absent;
const mentions = () => false, _floor = Math.floor, ForceLaw = null, PiecewisePolynomial = class {};
class Int extends Number {}  // a whole number of a file, which Python prints without a point
const isArray = Array.isArray, isVector = (a) => ArrayBuffer.isView(a);
const isMatrix = (a) => isArray(a) && a.shape !== undefined, isTensor = (a) => isVector(a) || isMatrix(a);
const shaped = (rows, ...shape) => Object.assign(rows, {shape});
const matrix = (m, n, entry, Kind = Float64Array) => shaped(Array.from({length: m}, (_, i) => Kind.from({length: n}, (_, j) => entry(i, j))), m, n);
const shape = (a) => isMatrix(a) ? a.shape : [a.length];
const size = (a) => isMatrix(a) ? a.shape.reduce((p, n) => p * n, 1) : a.length;
const kindOf = (a) => isVector(a) ? a.constructor : a.length ? kindOf(a[0]) : Float64Array;
const len = (a) => a instanceof Map || a instanceof Set ? a.size : a.length;
const iter = (a) => a instanceof Map && a instanceof Dict ? a.keys() : a;
const iterator = (a) => iter(a)[Symbol.iterator]();
const transpose = (A) => isVector(A) ? A : matrix(A.shape[1], A.shape[0], (i, j) => A[j][i], kindOf(A));
const square = (x) => x * x;

// Elementwise, with the shapes of NumPy.
function elementwise(f, a, b, truth = false) {
  if (typeof a === "number" && typeof b === "number") return f(a, b);
  const flat = (x) => !isTensor(x);
  if (flat(a) && flat(b)) return f(Number(a), Number(b));
  const Kind = truth ? Uint8Array : Float64Array;
  if (!isMatrix(a) && !isMatrix(b)) {
    const n = flat(a) ? b.length : flat(b) ? a.length : max(a.length, b.length);
    const at = (x) => flat(x) ? () => x : x.length === 1 && n !== 1 ? () => x[0] : (i) => x[i], x = at(a), y = at(b);
    return Kind.from({length: n}, (_, i) => f(x(i), y(i)));
  }
  const sizes = (x) => flat(x) ? [1, 1] : isVector(x) ? [1, x.length] : x.shape, [ma, na] = sizes(a), [mb, nb] = sizes(b);
  const at = (x, [m, n]) => flat(x) ? () => x : isVector(x) ? (i, j) => x[n === 1 ? 0 : j] : (i, j) => x[m === 1 ? 0 : i][n === 1 ? 0 : j];
  const x = at(a, [ma, na]), y = at(b, [mb, nb]), over = (s, t) => s === 1 ? t : s;
  return matrix(over(ma, mb), over(na, nb), (i, j) => f(x(i, j), y(i, j)), Kind);
}
const add = (a, b) => typeof a === "string" ? a + b : isArray(a) && !isMatrix(a) ? [...a, ...b] : elementwise((x, y) => x + y, a, b);
const sub = (a, b) => a instanceof Set ? new Set([...a].filter((x) => !b.has(x))) : elementwise((x, y) => x - y, a, b);
const mul = (a, b) => isArray(a) && !isMatrix(a) ? [].concat(...Array(Number(b)).fill(a)) : elementwise((x, y) => x * y, a, b);
const div = (a, b) => elementwise((x, y) => x / y, a, b);
// The order of numbers, of texts, and of lists by their first entries that differ.
const order = (a, b) => {
  if (!isArray(a)) return a < b ? -1 : a > b ? 1 : 0;
  for (let i = 0; i < a.length && i < b.length; i++) { const found = order(a[i], b[i]); if (found) return found; }
  return a.length - b.length;
};
const compared = (f) => (a, b) => typeof a === "string" ? f(a, b) : isArray(a) && !isMatrix(a) ? f(order(a, b), 0) : elementwise(f, a, b, true);
const lt = compared((x, y) => x < y), le = compared((x, y) => x <= y), gt = compared((x, y) => x > y), ge = compared((x, y) => x >= y);
const both = (a, b) => a instanceof Set ? new Set([...a].filter((x) => b.has(x))) : elementwise((x, y) => x && y, a, b, true);
const either = (a, b) => a instanceof Map ? new Dict([...a, ...b]) : a instanceof Set ? new Set([...a, ...b]) : elementwise((x, y) => x || y, a, b, true);
const invert = (a) => isVector(a) ? a.map((x) => 1 - x) : matrix(...a.shape, (i, j) => 1 - a[i][j], Uint8Array);
const negative = (a) => isTensor(a) ? elementwise((x) => -x, a, 0) : -a;
const same = (a, b) => isArray(a) && isArray(b) ? a.length === b.length && a.every((x, i) => same(x, b[i]))
  : a instanceof Set && b instanceof Set ? a.size === b.size && [...a].every((x) => b.has(x))
  : a instanceof Int || b instanceof Int ? Number(a) === Number(b) && typeof a !== "string" && typeof b !== "string" : a === b;
const eq = (a, b) => isTensor(a) || isTensor(b) ? elementwise((x, y) => x === y, a, b, true) : same(a, b);
const ne = (a, b) => isTensor(a) || isTensor(b) ? elementwise((x, y) => x !== y, a, b, true) : !same(a, b);
const truth = (x) => x instanceof Int ? Number(x) !== 0 : x instanceof Map || x instanceof Set ? x.size > 0
  : isArray(x) || isVector(x) ? x.length > 0 && (!isVector(x) || x.length !== 1 || x[0] !== 0) : Boolean(x);
const and = (a, then) => truth(a) ? then() : a, or = (a, then) => truth(a) ? a : then();
const has = (all, x) => isArray(all) ? all.some((each) => same(each, x)) : typeof all === "string" ? all.includes(x) : all.has ? all.has(x) : [...all].some((each) => same(each, x));

// Products by sums in the order of NumPy's small ones are not needed: these are exact, of matrices of 0 and ±1 alone.
function matmul(A, B) {
  if (isVector(A)) return isVector(B) ? A.reduce((s, a, k) => s + a * B[k], 0) : Float64Array.from({length: B.shape[1]}, (_, j) => A.reduce((s, a, k) => s + a * B[k][j], 0));
  if (isVector(B)) return Float64Array.from(A, (row) => row.reduce((s, a, k) => s + a * B[k], 0));
  return matrix(A.shape[0], B.shape[1], (i, j) => A[i].reduce((s, a, k) => s + a * B[k][j], 0));
}

class Slice { constructor(first, last) { this.first = first; this.last = last; } }
const slice = (first, last) => new Slice(first, last);
const subarray = (a, first, last) => a.subarray(first ?? 0, last ?? a.length);
const take = (a, rows) => isVector(rows) ? Float64Array.from(rows, (i) => a[i]) : a[rows];
// The indices of an axis that a key selects; null for one index.
function indicesOf(key, n) {
  const place = (x, other) => x === null || x === undefined ? other : x < 0 ? n + x : Math.min(Number(x), n);
  if (key instanceof Slice) { const found = []; for (let i = place(key.first, 0); i < place(key.last, n); i++) found.push(i); return found; }
  if (key instanceof Uint8Array || (isArray(key) && typeof key[0] === "boolean")) return [...key.keys()].filter((i) => key[i]);
  return isVector(key) || isArray(key) ? [...key] : null;
}
const index = (i, n) => i < 0 ? n + Number(i) : Number(i);
function get(a, key, other) {
  if (a instanceof Map) { if (!a.has(key)) throw a.missing ? a.missing(key) : new Error(`no key ${key}`); return a.get(key); }
  if (a.getitem) return a.getitem(key);
  if (isTensor(a) && key === null) return matrix(1, a.length, (_, j) => a[j], kindOf(a));
  if (isVector(a)) {
    if (other === null) return matrix(a.length, 1, (i) => a[i], a.constructor);
    const found = indicesOf(key, a.length);
    return found ? a.constructor.from(found, (i) => a[i]) : a[index(key, a.length)];
  }
  if (!isMatrix(a)) {
    if (!(key instanceof Slice)) return a[index(key, a.length)];
    const found = indicesOf(key, a.length).map((i) => a[i]);
    return typeof a === "string" ? found.join("") : found;
  }
  if (key.grid) return matrix(key.grid[0].length, key.grid[1].length, (i, j) => a[key.grid[0][i]][key.grid[1][j]], kindOf(a));
  const rows = indicesOf(key, a.shape[0]), Kind = kindOf(a), n = a.shape[1];
  if (other === undefined) {
    if (!rows) return a[index(key, a.length)];
    return a.shape.length > 2 ? shaped(rows.map((i) => a[i]), rows.length, ...a.shape.slice(1)) : matrix(rows.length, n, (i, j) => a[rows[i]][j], Kind);
  }
  const columns = indicesOf(other, n);
  if (rows && columns) return matrix(rows.length, columns.length, (i, j) => a[rows[i]][columns[j]], Kind);
  if (rows) return Kind.from(rows, (i) => a[i][index(other, n)]);
  return columns ? Kind.from(columns, (j) => a[index(key, a.length)][j]) : a[index(key, a.length)][index(other, n)];
}
function put(a, value, key) {
  if (a instanceof Map) { a.set(key, value); return; }
  const rows = indicesOf(key, a.length);
  if (!rows) { if (isMatrix(a)) a[key].set(value); else a[key] = value; return; }
  rows.forEach((i, k) => {
    const part = isTensor(value) ? value[value.length === 1 ? 0 : k] : value;
    if (isMatrix(a)) { if (isVector(part)) a[i].set(part); else a[i].fill(part); } else a[i] = part;
  });
}

const any_of = (a, {axis} = {}) => axis !== undefined ? Uint8Array.from(axis ? a : transpose(a), (line) => line.some((x) => x !== 0))
  : isMatrix(a) ? a.some((row) => any_of(row)) : a.some((x) => x !== 0);
const any = (a) => { for (const x of iter(a)) if (truth(x)) return true; return false; };
const all_of = (a) => isMatrix(a) ? a.every((row) => all_of(row)) : a.every((x) => x !== 0);
const all = (a) => { for (const x of iter(a)) if (!truth(x)) return false; return true; };
const along = (f) => (a, given = {}) => {
  if (given.axis === undefined) return f(isMatrix(a) ? a.flatMap((row) => [...row]) : [...a], given);
  const lines = given.axis === 0 ? transpose(a) : a, found = Array.from(lines, (line) => f([...line], given));
  return given.keepdims ? matrix(found.length, 1, (i) => found[i]) : Float64Array.from(found);
};
const sum_of = along((a) => a.reduce((s, x) => s + x, 0)), max_of = along((a, {initial = -Infinity}) => a.reduce((m, x) => max(m, x), initial));
const sum = (a) => [...iter(a)].reduce((s, x) => isTensor(x) ? add(s, x) : s + Number(x), 0);
const copy_of = (a) => isMatrix(a) ? shaped(a.map((row) => row.slice()), ...a.shape) : a.slice();
const tolist_of = (a) => [...a];
const astype_of = (a) => isMatrix(a) ? matrix(...a.shape, (i, j) => a[i][j]) : Float64Array.from(a);
const append_of = (a, x) => { a.push(x); }, extend_of = (a, more) => { a.push(...iter(more)); };
const items_of = (a) => a.entries(), keys_of = (a) => a.keys(), values_of = (a) => a.values();
const get_of = (a, key, other = null) => a.has(key) ? a.get(key) : other;
const setdefault_of = (a, key, other) => { if (!a.has(key)) a.set(key, other); return a.get(key); };
const join_of = (glue, parts) => [...iter(parts)].join(glue);
const startswith_of = (text, part) => text.startsWith(part);
const removeprefix_of = (text, part) => text.startsWith(part) ? text.slice(part.length) : text;
const tuple = (a = []) => [...iter(a)], list = tuple, float = (x) => Number(x), number = float;
const map = (f, ...lists) => { const [first, ...others] = lists.map((each) => [...iter(each)]); return first.map((x, i) => f(x, ...others.map((each) => each[i]))); };
const zip = (...lists) => { const all = lists.filter((each) => each[Symbol.iterator] || each instanceof Map).map((each) => [...iter(each)]); return all[0].map((x, i) => all.map((each) => each[i])); };
const enumerate = (a, first = 0) => [...iter(a)].map((x, i) => [i + first, x]);
const parted = (a, n, m) => [...a.slice(0, n), a.slice(n, a.length - m), ...a.slice(a.length - m)];
const range = (a, b) => Array.from({length: max((b ?? a) - (b === undefined ? 0 : a), 0)}, (_, i) => (b === undefined ? 0 : a) + i);
const sorted = (a, {key = (x) => x} = {}) => [...iter(a)].map((x) => [key(x), x]).sort(([x], [y]) => order(x, y)).map(([, x]) => x);
const reversed = (a) => [...a].reverse();
const extreme = (sign) => (a, {key = (x) => x, default: other} = {}) => {
  const all = [...iter(a)];
  if (!all.length) { if (other === undefined) throw new RangeError("the extreme of nothing"); return other; }
  return all.map((x) => [key(x), x]).reduce((best, each) => sign * order(each[0], best[0]) > 0 ? each : best)[1];
};
const largest = extreme(1), smallest = extreme(-1), id = (x) => x;
// A number of n decimals; one in the middle between two, which is a multiple of 2 ** -(n + 1), goes to the even one.
const round = (x, n) => {
  if (abs(x * 2 ** (n + 1)) % 2 !== 1) return Number(x.toFixed(n));
  const below = floor(x * 10 ** n);
  return (below + abs(below % 2)) / 10 ** n;
};
const pairwise = (a) => a.slice(1).map((x, i) => [a[i], x]);
const next = (a, other) => { const found = a.next(); return found.done ? other : found.value; };
const cast = (_, x) => x, int = (x) => Number(x), bool = (x) => truth(x), set = (a = []) => new Set(iter(a));
const Mapping = Map, callable = (x) => x instanceof Harmonic || typeof x === "function";
const isinstance = (x, kind) => kind === str ? typeof x === "string" : kind === tuple || kind === list ? isArray(x) : kind === dict ? x instanceof Map
  : isArray(kind) ? kind.some((each) => isinstance(x, each)) : x instanceof kind;
class Named extends Dict { constructor(_, symbols) { super(symbols); } }
const dict = Object.assign((a) => new Dict(a instanceof Map ? a : [...a]), {fromkeys: (a, x = null) => new Dict([...iter(a)].map((key) => [key, x]))});

const np = {
  asarray: (a) => a, array: (a) => isArray(a) && !isMatrix(a) ? (a.length && (isTensor(a[0]) || isArray(a[0])) ? stacked(a) : Float64Array.from(a)) : copy_of(a),
  where,
  eye: (n) => matrix(n, n, (i, j) => i === j ? 1 : 0), ones: (n) => new Float64Array(n).fill(1),
  zeros: (n, Kind = Float64Array) => isArray(n) ? matrix(...n, () => 0, Kind) : new Kind(n), empty: (n, Kind) => np.zeros(n, Kind),
  float64: Float64Array, int64: Int32Array, bool_: Uint8Array,
  diag: (A) => Float64Array.from({length: Math.min(...A.shape)}, (_, i) => A[i][i]),
  abs: (a) => elementwise((x) => abs(x), a, 0), flatnonzero: (a) => Int32Array.from([...a.keys()].filter((i) => a[i])),
  vstack: (parts) => { const rows = parts.flatMap((each) => isVector(each) ? [each] : [...each]); return shaped(rows, rows.length, isMatrix(parts[0]) ? parts[0].shape[1] : parts[0].length); },
  column_stack: (parts) => matrix(parts[0].shape[0], parts.reduce((n, each) => n + each.shape[1], 0), (i, j) => { for (const each of parts) { if (j < each.shape[1]) return each[i][j]; j -= each.shape[1]; } return 0; }),
  split: (A, ends) => [0, ...ends].map((first, k) => get(A, slice(first, k < ends.length ? ends[k] : null))),
  cumsum: (a) => { let s = 0; return Int32Array.from(a, (x) => s += Number(x)); },
  count_nonzero: (A, {axis} = {}) => axis === undefined ? A.reduce((s, x) => s + (x !== 0), 0) : Int32Array.from(A, (row) => row.reduce((s, x) => s + (x !== 0), 0)),
  argmax: (a) => a.indexOf(a.reduce((m, x) => x > m ? x : m)), ix_: (...grid) => ({grid: grid.map((each) => indicesOf(each, each.length))}),
  concatenate: (parts) => Float64Array.from(parts.flatMap((each) => [...each])), isfinite: (a) => elementwise((x) => Number.isFinite(x), a, 0, true),
  pad: (A, [[top, bottom]]) => matrix(A.shape[0] + top + bottom, A.shape[1], (i, j) => i >= top && i < top + A.shape[0] ? A[i - top][j] : 0),
  triu: (A, k) => matrix(...A.shape, (i, j) => j - i >= k ? A[i][j] : 0, kindOf(A)),
  argwhere: (A) => A.flatMap((row, i) => [...row.keys()].filter((j) => row[j]).map((j) => [i, j])),
  arange: (n) => Int32Array.from({length: n}, (_, i) => i), isin: (a, some) => Uint8Array.from(a, (x) => some.includes(x)),
  finfo: () => ({eps: 2 ** -52}), inf: Infinity,
};
const stacked = (list) => !isTensor(list[0]) ? stacked(list.map((row) => np.array(row))) : isVector(list[0]) ? shaped(list, list.length, list[0].length) : shaped(list, list.length, ...list[0].shape);
function where(c, a, b) {
  const like = elementwise(() => 0, elementwise(() => 0, a, b), c);
  const read = (x) => !isTensor(x) ? () => x : isVector(x) ? (i, j) => x[x.length === 1 ? 0 : j] : (i, j) => x[x.shape[0] === 1 ? 0 : i][x.shape[1] === 1 ? 0 : j];
  const [is, then, other] = [c, a, b].map(read), pick = (i, j) => is(i, j) ? then(i, j) : other(i, j);
  return isMatrix(like) ? matrix(...like.shape, pick) : Float64Array.from(like, (_, j) => pick(0, j));
}

// Text.
const repr = (x) => typeof x === "string" ? quoted(x) : x instanceof Int ? String(Number(x)) : typeof x === "number" ? float_repr(x)
  : x === true ? "True" : x === false ? "False" : x == null ? "None" : x instanceof Map ? `{${[...x].map(([k, v]) => `${repr(k)}: ${repr(v)}`).join(", ")}}`
  : isArray(x) ? (x.list ? `[${x.map(repr).join(", ")}]` : x.length === 1 ? `(${repr(x[0])},)` : `(${x.map(repr).join(", ")})`) : str(x);
const str = (x) => typeof x === "string" ? x : typeof x === "number" ? String(x) : x && x.__str__ ? x.__str__()
  : x && x.constructor.fields ? `${x.constructor.name}(${x.constructor.fields.map(([name]) => `${name}=${repr(x[name])}`).join(", ")})` : repr(x);
function quoted(text) {
  const quote = text.includes("'") && !text.includes('"') ? '"' : "'";
  const inner = [...text].map((c) => {
    if (c === "\\" || c === quote) return `\\${c}`;
    const named = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}[c], code = c.codePointAt(0), hex = (n) => code.toString(16).padStart(n, "0");
    return named || (/[\p{C}\p{Zl}\p{Zp}]|(?! )\p{Zs}/u.test(c) ? (code < 256 ? `\\x${hex(2)}` : code < 65536 ? `\\u${hex(4)}` : `\\U${hex(8)}`) : c);
  });
  return quote + inner.join("") + quote;
}
function float_repr(x) {
  if (!Number.isFinite(x)) return Number.isNaN(x) ? "nan" : x > 0 ? "inf" : "-inf";
  const [digits, power] = x.toExponential().split("e"), p = Number(power);
  if (x !== 0 && (p < -4 || p >= 16)) return `${digits}e${p < 0 ? "-" : "+"}${String(abs(p)).padStart(2, "0")}`;
  const text = p >= 21 ? BigInt(x).toString() : p < -6 ? x.toFixed(20).replace(/0+$/, "") : String(x);
  return Object.is(x, -0) ? "-0.0" : /[.]/.test(text) ? text : `${text}.0`;
}
// The formats of messages: "g", ".1e", and ",".
function format(x, spec) {
  const value = Number(x);
  if (spec === ",") return value.toLocaleString("en-US");
  if (!Number.isFinite(value)) return float_repr(value);
  const short = (text) => text.replace(/e([+-])(\d)$/, "e$10$2");
  if (/^\.\d+e$/.test(spec)) return short(value.toExponential(Number(spec.slice(1, -1))));
  const p = spec === "g" ? 6 : Number(spec.slice(1, -1)), power = value === 0 ? 0 : Number(value.toExponential(p - 1).split("e")[1]);
  if (power < -4 || power >= p) return short(value.toExponential(p - 1).replace(/\.?0+e/, "e"));
  const text = value.toFixed(p - 1 - power);
  return text.includes(".") ? text.replace(/\.?0+$/, "") : text;
}

// The word of some that is nearest to another, as Python's difflib finds it.
function get_close_matches(word, words, {cutoff}) {
  const ratio = (a, b) => a.length + b.length ? 2 * matching(a, b) / (a.length + b.length) : 1;
  const scored = [...words].map((each) => [ratio([...each], [...word]), each]).filter(([score]) => score >= cutoff);
  scored.sort(([r, x], [s, y]) => s - r || (x < y ? 1 : -1));
  return scored.slice(0, 1).map(([, each]) => each);
}
function matching(a, b) {
  let best = 0, at = 0, other = 0, before = new Map();
  a.forEach((c, i) => {
    const now = new Map();
    b.forEach((d, j) => {
      if (c !== d) return;
      const k = (before.get(j - 1) || 0) + 1;
      now.set(j, k);
      if (k > best) { best = k; at = i - k + 1; other = j - k + 1; }
    });
    before = now;
  });
  return best && best + matching(a.slice(0, at), b.slice(0, other)) + matching(a.slice(at + best), b.slice(other + best));
}

// Classes with fields, as Python's dataclasses.
function make(Kind, given, named = {}) {
  const made = new Kind();
  Kind.fields.forEach(([name, other], i) => { made[name] = i < given.length ? given[i] : name in named ? named[name] : typeof other === "function" ? other() : other; });
  if (made.__post_init__) made.__post_init__();
  return made;
}
// Properties that are computed once, as Python's cached properties.
function keep(Kind, names) {
  for (const name of names) {
    const {get} = Object.getOwnPropertyDescriptor(Kind.prototype, name);
    Object.defineProperty(Kind.prototype, name, {get() {
      const value = get.call(this);
      Object.defineProperty(this, name, {value});
      return value;
    }});
  }
}
const replace = (thing, named) => make(thing.constructor, [], {...thing, ...named});
const getattr = (thing, name, other) => thing.fields ? (thing.fields.find((each) => each[0] === name) || [name, other])[1] ?? other : name in thing && thing[name] !== undefined ? thing[name] : other;
const fields = (kind) => kind.fields.map(([name]) => ({name}));
const name_of_type = (kind) => kind.name;
const type = (x) => typeof x === "string" ? str : x instanceof Int ? int : typeof x === "number" ? float : typeof x === "boolean" ? bool
  : x instanceof Map ? dict : isArray(x) ? list : x.constructor;
const count = function* (first) { for (let i = first; ; i++) yield i; };
