// Schemes of a page's own: the elements of a file, their equations, and runs by the package's translated steps.

// What the translated code leaves to the page.
const kernel_at = (f) => f, kept_at = kernel_at, featured_at = kernel_at, springs_at = kernel_at;
const examine = () => [-2, Infinity];  // a solution in doubt is left to Python
const none = () => { throw new UnsupportedError("the step is left to lcpimpact simulate"); };
const balance_together = none, find_rows = none, solve_lcp = none;
const is_real = (x) => (typeof x === "number" || x instanceof Int) && Number.isFinite(Number(x));
const is_name = (x) => typeof x === "string" && x !== "" && !/[\p{Cc}\p{Cf}\p{Cs}]/u.test(x);
const checked = (_, f) => f;
const _shared_step = () => 0;  // without non-linear springs
const _as_tuple = (x) => isArray(x) ? [...x] : null;
const no_rows = (n) => shaped([], 0, n);
const no_paths = () => ({lines: no_rows(0)}), impulse_paths = no_paths;
// The product of two matrices, or all pairs of two lists.
function product(A, B) {
  if (!isMatrix(A)) return [...A].flatMap((a) => [...B].map((b) => [a, b]));
  const C = matrix(A.shape[0], B.shape[1], () => 0);
  add_product(A, B, C);
  return C;
}
function solve(A, B) {
  const n = A.length, columns = isVector(B) ? 1 : B.shape[1];
  const rows = matrix(n, n + columns, (i, j) => j < n ? A[i][j] : isVector(B) ? B[i] : B[i][j - n]);
  if (!eliminate(rows, 0)) throw new RangeError("Singular matrix");
  return isVector(B) ? Float64Array.from(rows, (row) => row[n]) : matrix(n, columns, (i, j) => rows[i][n + j]);
}
// A letter with or without a subscript, and the operators between them, as math text; other text as it is.
function math_text(symbol) {
  const text = symbol.replaceAll("$", "\\$"), letter = "[\\p{L}\\p{N}]", word = "[\\p{L}\\p{N}_]";
  if (!new RegExp(`^(?:${letter}(?:_${letter}+)?|[ ()+=,.'-])+$`, "u").test(text)) return text;
  const indexed = text.replace(new RegExp(`(?<!${word})((?!\\p{Nd})${letter})(\\p{Nd}+)(?!${word})`, "gu"), "$1_$2");
  return `$${indexed.replace(new RegExp(`_(${word}{2,})`, "gu"), "_{$1}").replaceAll(" ", "\\ ")}$`;
}
function _locate_errors(where, run) {
  try { return run(); } catch (error) {
    if (error instanceof InputError && where) error.message = `${where}: ${error.message}`;
    throw error;
  }
}

class Terms {
  constructor(nodes) {
    const sum = () => ({value: matrix(nodes.length, nodes.length, () => 0), add(term, [i, j]) { this.value[i][j] += Number(term); }});
    Object.assign(this, {index: new Dict(nodes.map((each, i) => [each, i])), M: sum(), C: sum(), K: sum(), loads: [], rows: [], springs: [], force_laws: [], motions: new Dict()});
  }
  direction(a, b) {
    const row = new Float64Array(this.index.size);
    for (const [end, sign] of [[b, 1], [a, -1]]) {
      for (const [node, coefficient] of isinstance(end, str) ? [[end, 1]] : [...end]) if (node !== "ground") row[this.index.get(node)] += sign * Number(coefficient);
    }
    return row;
  }
  link(sum, a, b, value) {
    const ends = [a, b].filter((node) => node !== "ground").map((node) => this.index.get(node));
    for (const i of ends) for (const j of ends) sum.add(value * (i === j ? 1 : -1), [i, j]);
  }
}

// The equations of motion, with the checks of lcpimpact.scheme.assembly in their order.
function assemble(elements) {
  const nodes = [...new Set(elements.flatMap((each) => each.nodes).filter((node) => node !== "ground"))], n = nodes.length;
  _refuse_shared_inner_nodes(elements);
  const terms = new Terms(nodes);
  for (const each of elements) each.contribute(terms);
  const {motions} = terms, driven = Uint8Array.from(nodes, (_, i) => motions.has(i)), movers = [...driven.keys()].filter((i) => driven[i]).map((i) => motions.get(i));
  const {rows} = terms, nc = rows.length, M = terms.M.value, C = terms.C.value, K = terms.K.value;
  _refuse_ambiguous_names(nodes, rows);
  _refuse_driven_masses(terms, nodes);
  _refuse_loose_nodes(terms, nodes, driven);
  const H = shaped(rows.map((row) => terms.direction(row.upper, row.lower)), nc, n), u0 = Float64Array.from(rows, (row) => row.gap);
  refuse_parallel_contacts(rows);
  const parts = decompose(M, C, driven), with_ = (law) => Uint8Array.from(rows, (row) => row.law === law);
  _refuse_levers(H, rows, invert(either(any_of(parts.massive, {axis: 1}), driven)), nodes);
  const degrees = relative_degrees(H, parts);
  const contacts = rows.map((row, i) => ({name: row.name, upper: name_of(row.upper), lower: name_of(row.lower), gap: row.gap, e: row.e ?? 0, relative_degree: degrees[i], law: row.law, bounds: row.bounds}));
  const unilateral = with_("contact"), B = transpose(H).length ? matrix(n, nc, (i, j) => H[j][i]) : no_rows(nc);
  const paths = (rays) => matrix(rays.length, nc, (a, i) => { let k = -1; for (let j = 0; j <= i; j++) k += unilateral[j]; return unilateral[i] ? rays[a][k] : 0; });
  const Bu = matrix(n, unilateral.reduce((s, x) => s + x, 0), (i, j) => B[i][[...unilateral.keys()].filter((k) => unilateral[k])[j]]);
  const on = (basis) => matmul(transposedOf(basis, n), Bu);
  const impulse = size(parts.massive) ? paths(impulse_paths_(on(parts.massive), on(np.column_stack([parts.damped, parts.static])))) : no_rows(nc);
  const d = {
    nodes, M, C, K, H, B, u0, contacts, unilateral, loads: terms.loads, D: matrix(nc, nc, () => 0), elimination: np.eye(nc), stores_energy: true,
    decomposition: parts, driven, massive: Uint8Array.from(nodes, (_, i) => M[i][i] > 0 && !driven[i]), relative_degree: Int32Array.from(degrees),
    restitution: Float64Array.from(contacts, (each) => each.e), r_min: Float64Array.from(rows, (row) => row.bounds[0]), r_max: Float64Array.from(rows, (row) => row.bounds[1]),
    slides: with_("slider"), relays: new Uint8Array(nc), joints: new Uint8Array(nc), frictional: new Uint8Array(nc), springs: [], force_laws: [], motions,
    power_laws: no_rows(5), acted_on: new Int32Array(0), pushes: no_rows(n), directions: no_rows(n), impulse_paths: impulse,
    impulse_lines: shaped(impulse.filter((row) => row.filter((x) => x).length > 1), 0, nc), gap_paths: paths(extreme_rays(on(parts.static))),
    motion: (t) => [movers.map((each) => each.at(t)), movers.map((each) => each.rate(t))],
    force(t) {
      const f = new Float64Array(n);
      for (const [i, load] of terms.loads) f[i] += callable(load) ? load.at(t) : Number(load);
      return f;
    },
    gap: (q) => add(matmul(H, q), u0), gap_rate: (v) => matmul(H, v), applied: (t) => d.force(t), spring_force: () => new Float64Array(n),
  };
  d.impulse_lines.shape[0] = d.impulse_lines.length;
  _check_restitution(d, rows);
  return d;
}
const jumping_nodes = (d) => new Uint8Array(d.nodes.length);  // a page takes no load that jumps
const transposedOf = (A, n) => A.shape[1] ? transpose(A) : no_rows(n);
Harmonic.prototype.at = function (t) { return this.amplitude * cosine(this.omega * t + this.phase); };

// What a page takes of the schemes that lcpimpact takes.
function refuseOthers(d) {
  const reasons = [
    [d.nodes.length > FILES.nodes, `more than ${FILES.nodes} nodes`],
    [d.contacts.length > 2, `${d.contacts.length} rows with a law, and its steps have two at most`],
    [d.slides.reduce((s, x) => s + x, 0) > 1, "two sliders"],
    [d.decomposition.static.shape[1] > 1, "several quasi-static nodes"],
    [d.impulse_lines.length > 0, "contacts that pass impulses on over nodes without mass"],
  ];
  for (const [is, what] of reasons) if (is) throw new UnsupportedError(`the page does not take a scheme with ${what}: lcpimpact simulate does`);
}

function checkSignals(d, tEnd) {
  for (const each of [...d.loads.map(([, load]) => load), ...d.motions.values()]) if (callable(each)) each.check_until(tEnd);
}

// A run of a scheme by a method, with its options by name: what engine.js calls for the numbers p, of which the end is last.
// Whether dashpots may need steps of their own without contacts, as strong_dashpots.may_damp says: the page has none.
function mayDamp(d, h, θ) {
  const sum = (terms) => terms.reduce((total, x) => total + x, 0), masses = [...d.massive.keys()].filter((j) => d.massive[j]);
  const E = d.decomposition.damped, C = E[0].length ? product(transpose(E), d.C) : [], given = C.length ? solve(product(C, E), C) : [];
  const C_m = (i, j) => d.C[i][j] - sum([...given.keys()].map((k) => C[k][i] * given[k][j]));
  return masses.some((i) => h * sum(masses.map((j) => Math.abs(C_m(i, j)) / d.M[i][i])) * (1 - θ) > 1);
}

// M; of strong dashpots, for which strong_dashpots.starting_mass has another, the page has none.
function starting_mass(d, h) {
  if (mayDamp(d, h, 0.5)) throw new RangeError("a dashpot stops a mass within a step");
  return d.M;
}

// Whether closed contacts on dashpots may, as strong_dashpots.may_stop says.
function mayStop(d, h, θ) {
  const rows = [...d.contacts.keys()].filter((i) => d.contacts[i].relative_degree === 1 && d.contacts[i].law === "contact");
  if (!rows.length) return false;
  const E = d.decomposition.damped, C = product(transpose(E), d.C), H = product(d.H, E), T = transpose(solve(product(C, E), transpose(H)));
  const sum = (terms) => terms.reduce((total, x) => total + x, 0), masses = [...d.massive.keys()].filter((j) => d.massive[j]);
  const acting = rows.map((i) => masses.map((j) => d.H[i][j] - sum([...T[i]].map((x, k) => x * C[k][j]))));
  const Y = rows.map((i) => sum([...T[i]].map((x, k) => x * H[i][k])));
  const G = (a, b) => sum(masses.map((j, k) => acting[a][k] * acting[b][k] / d.M[j][j]));
  return rows.some((_, a) => h * sum(rows.map((_, b) => Math.abs(G(a, b)) / Y[b])) * (1 - θ) > 1);
}

function runOf(build, Method, options) {
  return (p, N, out) => {
    const {d, q, v} = build(p), tEnd = p[p.length - 1], h = tEnd / N, n = d.nodes.length, nc = d.contacts.length;
    const method = make(Method, [], options(p));
    checkSignals(d, tEnd);
    if (method.theta !== undefined && (mayStop(d, h, method.theta) || mayDamp(d, h, method.theta))) return -1;
    const places = [...d.driven.keys()].filter((i) => d.driven[i]), y = method._symbols(d), step = method.equations(y, d, h), [table, springs] = tabulate(y, step, method.remembers ?? [], h);
    const laws = table.W.length, state = {y: method.begin(d, q, v, h), P: matrix(laws, nc, () => 0), kept: {T: []}};
    if (!finite(...state.y, ...table.W.flatMap((W) => W.flatMap((row) => [...row])))) return -1;
    table.W.forEach((W, law) => W.forEach((row, i) => out.W.set(row, (law * nc + i) * nc)));
    const instants = method.instants ?? [1], varying = [...varying_loads(d).keys()].filter((i) => varying_loads(d)[i]);
    const rows = table.known.shape[1], path = {q: matrix(2, n, () => 0), v: matrix(2, n, () => 0), r: matrix(1, nc, () => 0)};
    const ns = shaped([], 0, 0), room = {sums: new Float64Array(rows), active: new Int32Array(nc), z: new Float64Array(nc), s: [], springs: ns, x: [], right: []};
    const features = [springs, {lines: []}, step.static, {rows: []}, {}], banded = {factors: []}, ways = {plain: closed_form};
    const at = (k) => k === N ? tEnd : k * tEnd / N, keep = (k) => {
      for (let i = 0; i < n; i++) { out.q[k * n + i] = state.y[i]; out.v[k * n + i] = state.y[n + i]; }
    };
    keep(0);
    const block = {first: 0, last: 1, loads: shaped([new Float64Array(0)], 1, 0), tol: FILES.tol, max_iter: 9, stops: false, keeps: false, watched: []};
    const before = matrix(laws, nc, () => 0);
    for (let k = 0; k < N; k++) {
      for (let law = 0; law < laws; law++) before[law].set(state.P[law]);
      if (varying.length || places.length) {
        const forces = instants.map((c) => d.force((1 - c) * at(k) + c * at(k + 1))), [y0] = d.motion(at(k)), [y1, rate] = d.motion(at(k + 1));
        const loads = Float64Array.from([...forces.flatMap((f) => varying.map((i) => f[i])), ...y1, ...rate, ...y1.map((x, j) => (x - y0[j]) / h)]);
        block.loads = shaped([loads], 1, loads.length);
      }
      const [status] = steps(block, table, banded, features, state, path, room, ways);
      if (status !== 0) return k;
      keep(k + 1);
      for (let i = 0; i < nc; i++) out.r[k * nc + i] = path.r[0][i];
      for (let law = 0; law < laws; law++) for (let i = 0; i < nc; i++) {
        const touching = room.sums[2 * law * nc + i], on = touching < table.near[law][i] * max(before[law][i], 0) || (touching === 0 && !table.strictly[law]);
        out.L[(k * laws + law) * nc + i] = on ? room.sums[(2 * law + 1) * nc + i] : NaN;
        out.z[(k * laws + law) * nc + i] = state.P[law][i];
      }
    }
    return N;
  };
}

// Scheme files, as lcpimpact.schemefile reads them.

const KINDS = {Mass, Spring, Dashpot, KelvinVoigt, Maxwell, Zener, GeneralizedMaxwell, Jenkins, Slider, Bumper, Rope, Load, PrescribedMotion};
const Run = class Run {
  static fields = Object.keys(FILES.hints.Run).map((name) => [name, null]);
  __post_init__() {
    const {method, options, solver} = this;
    if (method !== null && !(method in FILES.methods)) throw new InputError(nearest(method, Object.keys(FILES.methods), "method"));
    const known = FILES.methods[method ?? "moreau-jean"].options;
    for (const key of options ? options.keys() : []) if (!known.includes(key)) throw new InputError(nearest(key, known, `option of ${method ?? "moreau-jean"}`));
    if (solver !== null && !FILES.solvers.includes(solver)) throw new InputError(nearest(solver, FILES.solvers, "solver"));
    for (const [key, value] of options ?? []) {
      if (key !== "theta") throw new UnsupportedError(`the page has no option ${key} of a method: lcpimpact simulate has`);
      if (!(is_real(value) && value >= 0.5 && value <= 1)) throw new InputError(FILES.theta.replace("{value}", repr(value)));
    }
    for (const name of ["dt", "t_end"]) if (this[name] !== null) _check_time(name, this[name]);
  }
};

function _convert(value, kind, where) {
  const hint = kind === float ? FILES.number : kind;
  if (isArray(value) && hint.array) return value.map((each, i) => _convert(each, hint.array, `${where}[${i}]`));
  if (value instanceof Map && hint.signal) return _read_signal(value, where);
  if (value instanceof Map && hint.table) return value;
  const name = value instanceof Int ? "int" : {number: "float", string: "str", boolean: "bool"}[typeof value];
  const real = ["int", "float"].includes(name) && (hint.types.includes("int") || hint.types.includes("float"));
  if (real || hint.types.includes(name)) return value;
  throw new InputError(`${where} = ${_short(value)} must be ${hint.what}`);
}
function _read_signal(table, where) {
  const name = table.has("type") ? _convert(table.get("type"), FILES.text, `${where}.type`) : "Harmonic";
  if (!FILES.signals.includes(name)) throw new InputError(`${where}: ${nearest(name, FILES.signals, "signal")}`);
  if (name !== "Harmonic") throw new UnsupportedError(`${where}: the page takes numbers and harmonic signals: lcpimpact simulate takes a ${name}`);
  return _build(Harmonic, new Dict([...table].filter(([key]) => key !== "type")), where);
}
function _build(kind, table, where) {
  const known = kind.fields.map(([name]) => name), hints = FILES.hints[kind.name], values = {};
  for (const key of table.keys()) if (!known.includes(key)) throw new InputError(nearest(key, known, `key of ${where}`));
  for (const each of kind.fields) if (!table.has(each[0]) && each.length < 2) throw new InputError(`${where}: ${each[0]} is missing: add it`);
  for (const [key, value] of table) values[key] = _convert(value, hints[key], `${where}.${key}`);
  return _locate_errors(kind.prototype instanceof Element ? "" : where, () => make(kind, [], values));
}
function readElement(table, where) {
  if (!table.has("type")) throw new InputError(`${where}: type is missing: give one of ${FILES.elements.join(", ")}`);
  return _locate_errors(where, () => {
    const name = _convert(table.get("type"), FILES.text, "type");
    if (!FILES.elements.includes(name)) throw new InputError(nearest(name, FILES.elements, "element"));
    if (!KINDS[name]) throw new UnsupportedError(`the page does not take a ${name}: name the file in lcpimpact explore or lcpimpact simulate`);
    return _build(KINDS[name], new Dict([...table].filter(([key]) => key !== "type")), name);
  });
}
function readScheme(tables, text) {
  if (!isArray(tables) || !tables.length || !tables.every((each) => each instanceof Map)) {
    throw new InputError("elements must be an array of tables: begin each element with [[elements]]");
  }
  const lines = text.split("\n").flatMap((line, i) => /^\s*\[\[\s*(elements|'elements'|"elements")\s*\]\]/.test(line) ? [i + 1] : []);
  return tables.map((table, i) => readElement(table, `elements[${i}]${lines.length === tables.length ? ` (line ${lines[i]})` : ""}`));
}
function readRun(value) {
  const table = _check_table(value, "run"), known = Run.fields.map(([name]) => name);
  for (const key of table.keys()) if (!known.includes(key)) throw new InputError(`${nearest(key, known, "key of run")}; write options of the method under [run.options]`);
  return _build(Run, table, "run");
}
// The elements, initial values and run settings of a file.
function readFile(text, stem) {
  if (/(?<![\w"'-])(?:[\w"'-]+\s*\.\s*){50}/.test(text)) throw new InputError("a key has more than 50 dots; a scheme needs two");
  let data;
  try { data = parseToml(text); } catch (error) {
    if (!(error instanceof TomlError)) throw error;
    throw new InputError(`it is not TOML: ${error.message}; check the quotes, the brackets, and that no key is repeated`);
  }
  _check_size(data);
  const way = _statement_kind(data), run = data.has("run") ? readRun(data.get("run")) : make(Run, []);
  if (way !== "elements") throw new UnsupportedError(`the page takes schemes of elements: name a file with ${way === "problem" ? "problem = NAME" : "[system]"} in lcpimpact explore`);
  const elements = [..._named([], readScheme(data.get("elements"), text))];
  const nodes = [...new Set(elements.flatMap((each) => each.nodes).filter((node) => node !== "ground"))];
  const [q0, v0] = _read_initial(_check_table(data.has("initial") ? data.get("initial") : new Dict(), "initial"), nodes);
  const name = _convert(data.has("name") ? data.get("name") : stem, FILES.text, "name");
  const tEnd = _check_time("t_end", data.has("t_end") ? data.get("t_end") : 1);
  _read_numbers(data.has("built_from") ? data.get("built_from") : new Dict(), "built_from");
  _convert(data.has("source") ? data.get("source") : "-", FILES.text, "source");
  const units = _check_table(data.has("units") ? data.get("units") : new Dict(), "units");
  for (const node of units.keys()) if (!nodes.includes(node)) throw new InputError(`units: ${nearest(node, nodes, "node")}`);
  for (const [node, unit] of units) _convert(unit, FILES.text, `units.${node}`);
  if (!is_name(name)) throw new InputError(`name = ${repr(name)} of a problem must be a string that is not empty and has no hidden characters`);
  return {name, elements, q0, v0, run, tEnd: Number(run.t_end ?? tEnd)};
}

// The constants and initial values of a file by address, as lcpimpact.problems.parameters; and the place of each.
function numbersOf({elements, q0, v0}) {
  const known = elements.flatMap((each, i) => each.constructor.fields.filter(([name]) => is_real(each[name])).map(([name]) => ({i, name, names: [String(i), each.constructor.name, each.name]})));
  const found = new Map();
  for (const {i, name} of known) {
    const kind = elements[i].constructor.name, alone = known.filter((each) => each.name === name && each.names.includes(kind)).length === 1;
    if (Number(elements[i][name]) !== 0) found.set(`${alone ? kind : i}.${name}`, {element: i, name, value: Number(elements[i][name])});
  }
  for (const [what, values] of [["q0", q0], ["v0", v0]]) for (const [node, x] of values) if (Number(x) !== 0) found.set(`${what}.${node}`, {initial: what, node, value: Number(x)});
  return found;
}

// A problem of the page from the text of a scheme file; throws an InputError in the words of lcpimpact.
function ownProblem(text, stem) {
  const file = readFile(text, stem), found = numbersOf(file), names = [...found.keys()], places = [...found.values()];
  const build = (p) => {
    const elements = file.elements.slice(), initial = {q0: new Map(file.q0), v0: new Map(file.v0)};
    places.forEach((each, k) => {
      if (each.initial) initial[each.initial].set(each.node, p[k]);
      else elements[each.element] = replace(elements[each.element], {[each.name]: p[k]});
    });
    const d = assemble(elements), vector_ = (values) => Float64Array.from(d.nodes, (node) => Number(values.get(node) ?? 0));
    const problem = {name: file.name, dynamics: d, initial_coordinates: vector_(initial.q0), initial_velocities: vector_(initial.v0)};
    for (const [kind, values] of Object.entries(initial)) for (const [node, x] of values) {
      if (!is_real(x)) throw new InputError(`problem ${repr(file.name)}: ${kind}[${repr(node)}] = ${repr(x)} must be a finite number`);
      if (d.motions.has(d.nodes.indexOf(node))) throw new InputError(`${kind}[${repr(node)}] of problem ${repr(file.name)}: the motion of that node is given, and begins as it says; leave the value out`);
    }
    const [place, rate] = d.motion(0);
    [...d.driven.keys()].filter((i) => d.driven[i]).forEach((i, k) => { problem.initial_coordinates[i] = place[k]; problem.initial_velocities[i] = rate[k]; });
    Problem.prototype._refuse_penetration.call(problem);
    return {d, q: problem.initial_coordinates, v: problem.initial_velocities};
  };
  const given = places.map((each) => each.value), {d} = build(given);
  refuseOthers(d);
  const n = d.nodes.length, units = (E) => Array.from({length: E.shape[1]}, (_, j) => Array.from({length: n}, (_, i) => E[i][j])), parts = d.decomposition;
  const features = [["SLIDERS", any_of(d.slides)], ["MASSLESS", !all_of(either(d.massive, d.driven))], ["MOTIONS", any_of(d.driven)], ["RESTITUTION", d.contacts.some((each) => each.e > 0)]];
  const methods = {};
  for (const name of FILES.first) {
    const {degrees, handles, kind, summary, steps, at, laws} = FILES.methods[name];
    if (!d.contacts.every((each) => degrees.includes(each.relative_degree)) || features.some(([what, is]) => is && !handles.includes(what))) continue;
    const θ = name === "moreau-jean", Method = KINDS_OF_METHODS[kind];
    const safely = (run) => (p, N, out) => { try { return run(p, N, out); } catch (error) { if (error instanceof InputError || error instanceof RangeError) return -1; throw error; } };
    methods[name] = {names: θ ? [...names, "theta"] : names, laws, impactSteps: steps, at, summary,
                     cases: [safely(runOf(build, Method, (p) => θ ? {theta: p[names.length]} : {}))]};
  }
  const works = (p) => { try { return build(p) !== null; } catch { return false; } };
  const sliders = names.flatMap((name, k) => {
    const value = given[k], fits = (x) => works(given.map((each, i) => i === k ? x : each));
    const ends = [FILES.lower, FILES.upper].map((factors) => factors.map((f) => f * value).find(fits) ?? value).sort((a, b) => a - b);
    return ends[0] < ends[1] ? [[name, value, ...ends]] : [];
  });
  if ("moreau-jean" in methods) sliders.push(["theta", Number(file.run.options?.get("theta") ?? 0.5), 0.5, 1]);
  const triples = (A) => A.flatMap((row, i) => [...row.keys()].filter((j) => row[j] !== 0).map((j) => [i, j, row[j]]));
  const [nodes, links] = drawing(file.elements, d.nodes), step = file.run.dt === null ? 0 : Math.round(file.tEnd / file.run.dt);
  return {
    about: `${file.name}: ${file.elements.length} elements of a file`, registered: false, own: true, tEnd: file.tEnd, nodes: d.nodes,
    contacts: d.contacts.map((each) => ({name: each.name, law: each.law, degree: each.relative_degree})), H: d.H.map((row) => [...row]),
    parts: {massive: units(parts.massive), damped: units(parts.damped), static: units(parts.static), driven: units(parts.driven)},
    inexact: d.contacts.every((each) => each.law !== "slider" || each.relative_degree) ? "" : FILES.inexact,
    names, numbers: Object.fromEntries(names.map((name, k) => [name, given[k]])), sliders,
    units: Object.fromEntries(names.map((name, k) => [name, FILES.units[places[k].initial ?? file.elements[places[k].element].constructor.name]]).map(([name, unit], k) => [name, typeof unit === "string" ? unit : unit[places[k].name]])), refusals: {}, drawing: {nodes, links}, methods,
    method: file.run.method, theta: Number(file.run.options?.get("theta") ?? 0.5), steps: step >= 1 && step <= LIMITS.most ? step : null,
    equations: (p) => {
      const {d: e, q, v} = build(p), constant = e.loads.filter(([, f]) => !callable(f)), waves = e.loads.filter(([, f]) => callable(f));
      return {M: triples(e.M), C: triples(e.C), K: triples(e.K), f: constant.map(([i, f]) => [i, Number(f)]), waves: waves.map(([i, f]) => [i, f.amplitude, f.omega, f.phase].map(Number)),
              motions: [...e.motions].sort(([i], [j]) => i - j).map(([i, f]) => [i, f.amplitude, f.omega, f.phase].map(Number)), u0: [...e.u0], e: [...e.restitution], lo: [...e.r_min], hi: [...e.r_max], q: [...q], v: [...v]};
    },
    refusal: (p, tEnd) => {
      try {
        checkSignals(build(p).d, tEnd);
        return "";
      } catch (error) { if (error instanceof InputError) return error.message; throw error; }
    },
  };
}
