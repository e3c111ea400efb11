const by = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg", SYMBOL_WIDTH = LIMITS.symbol, EXACT_SAMPLES = 400, TICKS = 1000, QUICK = 4;
const MARGIN = {left: 46, right: 6, top: 5, bottom: 16};  // of a panel in pixels, for the numbers of its axes
const FAR = 8;  // the farthest way of a node in a drawing, of which a mass is 1.1 high
const state = {problem: "", method: "", values: {}, tEnd: 1, steps: LIMITS.steps, k: 0};
let cost = 0, following = 0;
let problems = {}, problem = null, run = null, exact = null, panels = [], drawing = null, playing = 0;

const short = (x) => Number.isFinite(x) ? String(Number(x.toPrecision(5))).replace("-", "−") : "–";
const color = (i) => getComputedStyle(document.documentElement).getPropertyValue(`--c${i % 5}`);
const shade = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);

function element(kind, attributes = {}, parent = null, text = "") {
  const made = kind.startsWith("svg:") ? document.createElementNS(SVG, kind.slice(4)) : document.createElement(kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text) made.textContent = text;
  if (parent) parent.append(made);
  return made;
}

// The problems, from their source.
function evaluated(source) {
  return new Function("abs", "sqrt", "floor", "finite", "min", "max", "solveRows", "solveHolding", `"use strict";return ${source}`)(
    abs, sqrt, floor, finite, min, max, solveRows, solveHolding);
}

// Choices.

function choose(name) {
  problem = problems[name];
  state.problem = name;
  state.values = {theta: 0.5, ...problem.numbers};
  state.tEnd = problem.tEnd;
  state.steps = LIMITS.steps;
  state.k = Math.round(state.steps / 3);
  const methods = Object.keys(problem.methods);
  by("method").replaceChildren(...methods.map((each) => new Option(each, each)));
  if (!methods.includes(state.method)) state.method = methods[0];
}

function show() {
  by("problem").value = state.problem;
  by("method").value = state.method;
  by("about").textContent = problem.about;
  lay(by("sliders"));
  layPanels();
  layScheme();
  measure();
  compute();
}

const isLog = (low, high) => low > 0 && high / low > 3;
const place = (x, low, high) => TICKS * (isLog(low, high) ? Math.log(x / low) / Math.log(high / low) : (x - low) / (high - low));
const at = (tick, low, high) =>
  isLog(low, high) ? low * (high / low) ** (tick / TICKS) : low + (high - low) * tick / TICKS;

function lay(section) {
  section.replaceChildren();
  const used = problem.methods[state.method].names;
  for (const [name, value, low, high] of problem.sliders) {
    if (name === "theta" && !used.includes(name)) continue;
    const unit = problem.units[name] ? ` in ${problem.units[name]}` : "", label = name === "theta" && !("theta" in problem.numbers) ? "θ" : name + unit;
    number(section, label, low, high, () => state.values[name], (x) => { state.values[name] = x; }, used.includes(name));
  }
  number(section, "steps", 10, LIMITS.most, () => state.steps, (x) => { state.steps = Math.min(max(Math.round(x), 1), LIMITS.most); });
  number(section, "t_end in s", problem.tEnd / 4, problem.tEnd * 2, () => state.tEnd, (x) => { state.tEnd = x; });
  const fixed = Object.entries(problem.numbers).filter(([name]) => !problem.sliders.some((each) => each[0] === name));
  if (fixed.length) element("p", {}, section, `fixed here: ${fixed.map(([name, x]) => `${name} = ${short(x)}`).join(", ")}`);
  element("button", {type: "button"}, section, "As given").addEventListener("click", () => { choose(state.problem); show(); });
}

function number(section, label, low, high, read, write, used = true) {
  const row = element("div", {class: used ? "number" : "number off"}, section), id = `number-${section.children.length}`;
  element("label", {for: id}, row, label);
  const box = element("input", {type: "number", step: "any", id}, row);
  const range = element("input", {type: "range", min: 0, max: TICKS, step: 1, "aria-label": label}, row);
  const refresh = (where) => {
    if (where !== box) box.value = read();
    if (where !== range) range.value = place(read(), low, high);
  };
  refresh();
  if (!used) { box.disabled = range.disabled = true; row.title = `${state.method} keeps it here`; }
  range.addEventListener("input", () => {
    const x = at(Number(range.value), low, high);
    write(Number(x.toPrecision(4)));
    refresh(range);
    compute();
  });
  box.addEventListener("change", () => { if (box.value !== "") write(Number(box.value)); refresh(box); compute(); });
}

// The run, and what is drawn of it.

function compute() {
  const {values, tEnd, steps} = state, method = problem.methods[state.method];
  const used = Object.fromEntries(Object.entries(values).map(([name, x]) => [name, method.names.includes(name) || !(name in problem.numbers) ? x : problem.numbers[name]]));
  run = tEnd > 0 && steps >= 1 ? simulate(problem, state.method, used, tEnd, steps) : {taken: -1};
  run.at = method.names.includes("theta") && !("theta" in problem.numbers) ? values.theta : method.at;
  run.values = used;
  exact = null;
  clearTimeout(following);
  if (run.taken >= 0 && !problem.inexact && cost < QUICK) follow();
  else if (run.taken >= 0 && !problem.inexact) following = setTimeout(() => { follow(); say(); drawCurves(); }, 0);
  state.k = Math.min(state.k, Math.max(run.taken, 0));
  by("cursor").max = Math.max(run.taken, 0);
  say();
  drawCurves();
  moveTo(state.k);
}

// The exact motion at some of the instants; a slow one is drawn after what a slider changes first.
function follow() {
  const {steps} = state, stride = Math.ceil(steps / EXACT_SAMPLES), numbers = [], since = performance.now();
  for (let k = 0; k < steps; k += stride) numbers.push(k);
  numbers.push(steps);
  exact = exactMotion(problem, run.values, numbers.map(run.t));
  exact.steps = numbers.slice(0, exact.q.length);
  cost = performance.now() - since;
}

function say() {
  const status = by("status"), h = state.tEnd / state.steps;
  const given = {theta: 0.5, ...problem.numbers}, used = problem.methods[state.method].names;
  const changed = used.filter((name) => state.values[name] !== given[name]).map((name) => [name, python(state.values[name])]);
  const numbers = changed.filter(([name]) => name in problem.numbers).map(([name, x]) => `"${name}": ${x}`).join(", ");
  const options = changed.filter(([name]) => !(name in problem.numbers)).map(([name, x]) => `, ${name}=${x}`).join("");
  const loaded = problem.registered ? `li.load_problem("${state.problem}")` : "problem";
  const command = `li.simulate(${numbers ? `li.with_values(${loaded}, {${numbers}})` : loaded}, "${state.method}", `
    + `dt=${python(state.tEnd)}/${state.steps}, t_end=${python(state.tEnd)}${options})`;
  by("command").textContent = command;
  status.className = run.taken === state.steps ? "" : "alarm";
  if (run.taken < 0) {
    status.textContent = refusal() || "These values are refused, or need formulas that this page does not hold: the call below says which, or runs them.";
  } else if (run.taken < state.steps) {
    status.textContent = `The step at t = ${short(run.t(run.taken))} s is out of the ordinary: it is left to the call below.`;
  } else {
    let text = `h = ${short(h)} s`;
    if (!exact && !problem.inexact) text += "; the exact motion follows";
    else if (problem.inexact) text += `; ${problem.inexact}`;
    else {
      const worst = Math.max(...errors().map((each) => each[1]), 0);
      text += `; largest error of q ${worst.toExponential(2)} m`;
      if (exact.until < state.tEnd) text += `; the exact motion is followed up to ${short(exact.until)} s, where several contacts act at once`;
    }
    status.textContent = text;
  }
}

// What Python says of a number that it refuses.
function refusal() {
  if (!(state.tEnd > 0)) return `t_end = ${python(state.tEnd)} must be a positive finite number in s`;
  for (const name of problem.methods[state.method].names) {
    const x = state.values[name];
    for (const [comparison, bound, text] of problem.refusals[name] || []) {
      if (comparison === "<" ? x < bound : comparison === ">" ? x > bound : x === bound) return text.replace("{value}", python(x));
    }
  }
  return "";
}

const python = (x) => Number.isInteger(x) ? `${x}.0` : String(x);

// The largest distance of a coordinate from the exact motion, at the instants at which that is known.
function errors() {
  const n = problem.nodes.length;
  return exact.q.map((q, j) => {
    let worst = 0;
    for (let i = 0; i < n; i++) worst = Math.max(worst, abs(run.q[exact.steps[j] * n + i] - q[i]));
    return [run.t(exact.steps[j]), worst];
  }).filter((_, j) => exact.steps[j] <= run.taken);
}

function energies() {
  const {M, K, f} = equationsOf(problem, run.values), n = problem.nodes.length, found = new Float64Array(run.taken + 1);
  const {q, v, taken} = run;
  for (const [i, j, m] of M) for (let k = 0; k <= taken; k++) found[k] += 0.5 * m * v[k * n + i] * v[k * n + j];
  const size = found.reduce((most, E) => E > most ? E : most, 0);
  for (const [i, j, c] of K) for (let k = 0; k <= taken; k++) found[k] += 0.5 * c * q[k * n + i] * q[k * n + j];
  for (const [i, load] of f) for (let k = 0; k <= taken; k++) found[k] -= load * q[k * n + i];
  return {values: found, size};
}

function layPanels() {
  const {nodes, contacts, inexact} = problem, massive = problem.parts.massive.flatMap((unit) => unit.indexOf(1));
  const names = (list) => list.map((i) => [nodes[i], i]), system = !problem.drawing;
  const wanted = problem.axes.map(([list, unit, rate, down, surfaces]) => ({
    what: "q", title: system ? "states x" : `coordinates q in ${unit}${down ? ", downwards" : ""}`, keys: names(list), down, surfaces}));
  for (const [list, , rate, down] of problem.axes) {
    const moving = list.filter((i) => massive.includes(i));
    if (moving.length) wanted.push({what: "v", title: `velocities v in ${rate}${down ? ", downwards" : ""}`, keys: names(moving), down});
  }
  if (contacts.length) wanted.push({what: "r", title: system ? "multipliers r" : "reactions r in N, impulses as strokes", keys: contacts.map((each, i) => [each.name, i])});
  if (!system) wanted.push({what: "E", title: "energy in J: kinetic, of springs and of constant loads", keys: []});
  if (!inexact) wanted.push({what: "error", title: "error of q in m, logarithmic", keys: []});
  by("curves").replaceChildren();
  panels = wanted.map((each) => {
    const box = element("div", {class: "panel"}, by("curves")), line = element("p", {}, box);
    element("b", {}, line, each.title);
    each.keys.forEach(([name, i]) => { element("span", {class: "key"}, line, `— ${name}`).style.color = `var(--c${i % 5})`; });
    if (!inexact && each.what !== "error" && each.what !== "E") element("span", {class: "key"}, line, "— wide and pale: exact").style.color = "var(--grey)";
    const canvas = element("canvas", {}, box), mark = element("i", {}, box);
    const point = (event) => {
      const {left, width} = canvas.getBoundingClientRect();
      moveTo(Math.round(state.steps * (event.clientX - left - MARGIN.left) / (width - MARGIN.left - MARGIN.right)));
    };
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); point(event); });
    canvas.addEventListener("pointermove", (event) => { if (event.buttons) point(event); });
    return {...each, canvas, mark};
  });
}

function measure() {
  for (const panel of panels) Object.assign(panel, {width: panel.canvas.clientWidth, height: panel.canvas.clientHeight});
}

function drawCurves() {
  for (const panel of panels) {
    const {canvas, width, height} = panel, ratio = window.devicePixelRatio || 1;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    if (run.taken < 0) continue;
    const curves = curvesOf(panel);
    let low = Infinity, high = -Infinity;
    for (const {values} of curves) for (let k = 0; k < values.length; k++) {
      if (values[k] < low && values[k] > -Infinity) low = values[k];
      if (values[k] > high && values[k] < Infinity) high = values[k];
    }
    if (!(low < Infinity)) continue;
    const logarithmic = panel.what === "error";
    if (logarithmic) low = Math.max(low, high - 12);
    if (!(high - low > 1e-12 * (abs(low) + abs(high) + (curves[0].size || 0)))) { low -= 1 + abs(low) * 0.1; high += 1 + abs(high) * 0.1; }
    const spare = 0.04 * (high - low), right = width - MARGIN.right, bottom = height - MARGIN.bottom;
    low -= spare;
    high += spare;
    const share = (y) => (y - low) / (high - low), X = (t) => MARGIN.left + (right - MARGIN.left) * t / state.tEnd;
    const Y = (y) => MARGIN.top + (bottom - MARGIN.top) * (panel.down ? share(y) : 1 - share(y));
    pen.strokeStyle = shade("--faint");
    pen.fillStyle = shade("--grey");
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "right";
    for (const y of ticks(low, high, 4, logarithmic)) {
      line(pen, [[MARGIN.left, Y(y)], [right, Y(y)]], 1);
      pen.fillText(logarithmic ? (10 ** y).toExponential(0).replace("-", "−") : short(y), MARGIN.left - 5, Y(y) + 4);
    }
    pen.textAlign = "center";
    for (const t of ticks(0, state.tEnd, width / 110)) {
      line(pen, [[X(t), MARGIN.top], [X(t), bottom]], 1);
      pen.fillText(t > 0 ? short(t) : "t in s", X(t), height - 4);
    }
    pen.save();
    pen.beginPath();
    pen.rect(MARGIN.left, 0, right - MARGIN.left, bottom + 2);
    pen.clip();
    for (const [y, side] of surfacesOf(panel)) {
      pen.strokeStyle = shade("--grey");
      line(pen, [[MARGIN.left, Y(y)], [right, Y(y)]], 1.2);
      for (let x = MARGIN.left; x < right; x += 9) line(pen, [[x, Y(y)], [x - 6, Y(y) + 6 * side]], 1);
    }
    for (const each of curves) {
      pen.strokeStyle = each.color;
      pen.globalAlpha = each.broad ? 0.3 : 1;
      polyline(pen, each, X, Y, width);
    }
    pen.globalAlpha = 1;
    if (panel.what === "r") for (const {step, contact} of run.impulses) {
      pen.strokeStyle = color(contact);
      line(pen, [[X(run.t(step + 1)), 0], [X(run.t(step + 1)), 9]], 2);
    }
    pen.restore();
  }
}

// Round numbers between two, about ``most`` of them; of logarithms whole ones.
function ticks(low, high, most, whole = false) {
  const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
  let step = [1, 2, 5, 10].find((each) => each * power >= 0.6 * rough) * power;
  if (whole) step = Math.max(1, Math.ceil(step));
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(Number((k * step).toPrecision(12)));
  return found;
}

// The places of the resting surfaces of a panel, with the side on which no body can be: 1 below as drawn, or -1.
function surfacesOf({surfaces, down}) {
  if (!surfaces) return [];
  const {u0} = equationsOf(problem, run.values);
  return surfaces.map(([contact, node]) => {
    const a = problem.H[contact][node];
    return [-u0[contact] / a, (a < 0) === Boolean(down) ? 1 : -1];
  });
}

function curvesOf({what, keys}) {
  const n = problem.nodes.length, nc = problem.contacts.length, found = [], {taken} = run;
  if (what === "E") return [{t: run.t, ...energies(), color: color(0)}];
  if (what === "error") {
    const known = exact ? errors() : [];
    return [{t: (j) => known[j][0], values: known.map((each) => Math.log10(each[1])), color: color(1)}];
  }
  const size = what === "r" ? nc : n, h = state.tEnd / state.steps;
  for (const [, i] of keys) {
    if (exact && exact.q.length) {
      found.push({t: (j) => run.t(exact.steps[j]), values: exact[what].map((each) => each[i]), color: color(i), broad: true});
    }
    const values = new Float64Array(what === "r" ? taken : taken + 1);
    for (let k = 0; k < values.length; k++) values[k] = run[what][k * size + i];
    found.push({t: what === "r" ? (k) => run.t(k) + run.at * h : run.t, values, color: color(i)});
  }
  return found;
}

function line(pen, points, width) {
  pen.lineWidth = width;
  pen.beginPath();
  points.forEach(([x, y], i) => i ? pen.lineTo(x, y) : pen.moveTo(x, y));
  pen.stroke();
}

// A curve: of many points in one column of pixels, the lowest and the highest.
function polyline(pen, {t, values, broad}, X, Y, width) {
  pen.lineWidth = broad ? 5 : 1.4;
  pen.beginPath();
  let down = false;
  const go = (k) => {
    if (!Number.isFinite(values[k])) { down = false; return; }
    if (down) pen.lineTo(X(t(k)), Y(values[k])); else pen.moveTo(X(t(k)), Y(values[k]));
    down = true;
  };
  const group = Math.max(Math.floor(values.length / width), 1);
  for (let k = 0; k < values.length; k += group) {
    let low = k, high = k;
    const end = Math.min(k + group, values.length);
    for (let j = k; j < end; j++) { if (values[j] < values[low]) low = j; if (values[j] > values[high]) high = j; }
    go(Math.min(low, high));
    if (low !== high) go(Math.max(low, high));
  }
  pen.stroke();
}

// The scheme.

function layScheme() {
  const svg = by("scheme");
  svg.replaceChildren();
  drawing = problem.drawing;
  svg.parentElement.style.display = drawing ? "" : "none";
  if (!drawing) return;
  drawing.moving = [];
  drawing.left = -1.5;
  drawing.right = 0;
  const keep = (left, right) => { drawing.left = Math.min(drawing.left, left); drawing.right = Math.max(drawing.right, right); };
  for (const [moves, y, left, right, half, text, name] of drawing.nodes) {
    const group = element("svg:g", {}, svg), fixed = !moves.length;
    keep(left - 0.9, right + Math.max(1.1, 0.3 + breadth(name)));
    if (half) element("svg:rect", {x: left, y: -y - half, width: right - left, height: 2 * half, fill: "var(--faint)", stroke: "var(--ink)", "stroke-width": 0.05}, group);
    else if (fixed) for (let x = left - 0.6; x < right + 0.6; x += 0.25) element("svg:line", {x1: x, y1: 0.3 - y, x2: x + 0.25, y2: -y, stroke: "var(--grey)", "stroke-width": 0.03}, group);
    if (!half) element("svg:line", {x1: fixed ? left - 0.6 : left - 0.1, x2: fixed ? right + 0.85 : right + 0.1, y1: -y, y2: -y, stroke: "var(--ink)", "stroke-width": 0.08}, group);
    if (name) element("svg:text", {x: right + 0.15, y: 0.15 - y, style: "font-size:0.5px;fill:var(--c0)"}, group, name);
    if (text) element("svg:text", {x: (left + right) / 2, y: 0.18 - y, "text-anchor": "middle", style: "font-size:0.5px"}, group, plain(text));
    drawing.moving.push((shift) => group.setAttribute("transform", `translate(0 ${shift(moves)})`));
  }
  for (const [shape, [top, above], [bottom, below], [x, lead, tail, height], split, down, side, text, reaction] of drawing.links) {
    const group = element("svg:g", {stroke: "var(--ink)", "stroke-width": 0.06, fill: "none"}, svg);
    const strokes = STROKES[shape].map((points) => [element("svg:polyline", {}, group), points]);
    const beside = 0.2 + SYMBOL_WIDTH * Math.max(...strokes.flatMap(([, points]) => points.map(([, t]) => abs(t)))), far = beside + 0.1 + breadth(text);
    keep(x - (side < 0 ? far : 0), x + (side < 0 ? 0 : Math.max(far, 1.9)));
    const words = element("svg:text", {x: x + beside * side, "text-anchor": side > 0 ? "start" : "end", stroke: "none", style: "font-size:0.5px"}, group, plain(text));
    const contact = problem.contacts.findIndex((each) => each.name === reaction);
    drawing.moving.push((shift) => {
      const first = -top + shift(above), last = -bottom + shift(below), length = last - first;
      const room = split === null ? 1 : Math.max(Math.min(1, length / (top - bottom)), 0);  // a pressed symbol is smaller
      for (const [line, points] of strokes) {
        const most = Math.max(...points.map(([s]) => s), 0), body = split === null ? length - lead - tail : room * height;
        const placed = points.map(([s, t]) => {
          let d = split !== null && most > split ? length - room * tail - (1 - s) * body : room * lead + s * body;
          d = s === 0 ? 0 : s === 1 ? length : d;
          return `${x + SYMBOL_WIDTH * t},${down ? first + d : last - d}`;
        });
        line.setAttribute("points", placed.join(" "));
      }
      words.setAttribute("y", (first + last) / 2 + 0.15);
      group.setAttribute("stroke", contact >= 0 && acts(contact) ? "var(--force)" : "var(--ink)");
    });
  }
}

const plain = (text) => text.replace(/[${}\\]/g, "");
const breadth = (text) => 0.29 * plain(text).length;  // as the layout has it
const acts = (i) => { const laws = problem.methods[state.method].laws, nc = problem.contacts.length, k = state.k - 1;
  for (let law = 0; law < laws; law++) if (k >= 0 && run.z[(k * laws + law) * nc + i] !== 0) return true;
  return false; };

function drawScheme() {
  if (!drawing || run.taken < 0) return;
  const n = problem.nodes.length, relative = drawing.links.map(([, [, a], [, b]]) => [a, b]);
  let most = 0, shifts = [0, 0];
  const q = (k, moves) => { let sum = 0; for (const [i, c] of moves) sum += c * run.q[k * n + i]; return sum; }, stride = Math.max(Math.floor(run.taken / 200), 1);
  for (let k = 0; k <= run.taken; k += stride) for (const [a, b] of relative) most = Math.max(most, abs(q(k, a) - q(k, b)));
  for (let k = 0; k <= run.taken; k += stride) for (const [moves] of drawing.nodes) shifts = [Math.min(shifts[0], q(k, moves)), Math.max(shifts[1], q(k, moves))];
  const scale = most > 0 ? Math.min(1.4 / most, FAR / (shifts[1] - shifts[0])) : 0, {left, right} = drawing;
  const high = drawing.nodes.reduce((m, [, y, , , half]) => Math.max(m, y + half), 0) - scale * shifts[0] + 0.4;
  const low = drawing.nodes.reduce((m, [, y, , , half]) => Math.min(m, y - half), 0) - Math.max(scale * shifts[1], 0) - 0.5;
  by("scheme").setAttribute("viewBox", `${left} ${-high} ${right - left} ${high - low}`);
  for (const move of drawing.moving) move((moves) => scale * q(state.k, moves));
}

// The LCP w = q + W z, 0 <= z ⟂ w >= 0.

function drawLaw() {
  const svg = by("lcp"), text = by("law"), nc = problem.contacts.length, {laws} = problem.methods[state.method], k = state.k - 1;
  svg.replaceChildren();
  svg.parentElement.style.display = nc ? "" : "none";
  if (!nc || run.taken < 0) return;
  if (k < 0) { text.textContent = "The first step leads to step 1."; return; }
  const lines = [], all = [];
  for (let law = 0; law < laws; law++) {
    const q = [], z = [], w = [], W = [];
    for (let i = 0; i < nc; i++) { q.push(run.L[(k * laws + law) * nc + i]); z.push(run.z[(k * laws + law) * nc + i]); }
    for (let i = 0; i < nc; i++) W.push(Array.from(run.W.slice((law * nc + i) * nc, (law * nc + i + 1) * nc)));
    for (let i = 0; i < nc; i++) w.push(q[i] + dot(W[i], z));
    all.push({q, z, w, W});
    for (let i = 0; i < nc; i++) {
      const name = `${problem.contacts[i].name}${laws > 1 ? `, law ${law + 1}` : ""}`;
      lines.push(Number.isNaN(q[i]) ? `${name}: open, takes no part` : `${name}: q = ${short(q[i])}, z = ${short(z[i])}, w = q + W z = ${short(abs(w[i]) < 1e-9 * abs(q[i]) ? 0 : w[i])}`);
    }
  }
  text.textContent = lines.join("\n");
  svg.setAttribute("viewBox", "-150 -110 300 220");
  const acting = (law) => law.q.map((_, i) => i).filter((i) => !Number.isNaN(law.q[i]));
  const law = all.reduce((best, each) => acting(each).length > acting(best).length ? each : best);
  if (nc === 2 && acting(law).length !== 1 && problem.contacts.every((each) => each.law === "contact")) drawCones(svg, law);
  else drawLine(svg, law, acting(law).at(-1) ?? 0);
}

// The bounds of z of a row: those of friction follow its normal row, with μ_s where it holds more than μ can.
function boundsOf({z}, i) {
  const {law, normal} = problem.contacts[i], e = equationsOf(problem, run.values), h = state.tEnd / state.steps;
  if (law === "friction") {
    const most = (abs(z[i]) > (1 + 1e-9) * e.mu[i] * z[normal] ? e.mus[i] : e.mu[i]) * z[normal];
    return [-most, most];
  }
  return law === "contact" ? [0, Infinity] : [e.lo[i] * h, e.hi[i] * h];
}

function stroke(svg, x1, y1, x2, y2, paint, width) {
  return element("svg:line", {x1, y1: -y1, x2, y2: -y2, stroke: paint, "stroke-width": width}, svg);
}

// One row, the others as they are solved: the line w = q + W z meets the graph of the law.
function drawLine(svg, law, i) {
  const z = law.z[i], w = law.w[i], W = law.W[i][i], q = Number.isNaN(law.q[i]) ? NaN : w - W * z, [lo, hi] = boundsOf(law, i);
  const free = Number.isNaN(q), bounded = Number.isFinite(hi);
  const zs = 90 / (Math.max(abs(z), bounded ? Math.max(abs(lo), abs(hi)) : 0, free ? 1 : abs(q) / W, 1e-300) * 1.15);
  const ws = 80 / Math.max(free ? 1 : abs(q), abs(w), 1e-300), bottom = bounded ? -100 : 0;
  stroke(svg, -140, 0, 140, 0, "var(--faint)", 1);
  stroke(svg, 0, -105, 0, 105, "var(--faint)", 1);
  stroke(svg, Math.max(lo * zs, -140), 0, Math.min(hi * zs, 140), 0, "var(--c0)", 4);
  if (lo > -Infinity) stroke(svg, lo * zs, 0, lo * zs, 105, "var(--c0)", 4);
  if (bounded) stroke(svg, hi * zs, 0, hi * zs, bottom, "var(--c0)", 4);
  element("svg:text", {x: 128, y: 16}, svg, "z");
  element("svg:text", {x: 8, y: -96}, svg, "w");
  if (problem.contacts.length > 1) element("svg:text", {x: -140, y: -94}, svg, problem.contacts[i].name);
  if (free) { element("svg:text", {x: -140, y: 100}, svg, "open: no LCP in this step"); return; }
  stroke(svg, -140, (q + W * (-140 / zs)) * ws, 140, (q + W * (140 / zs)) * ws, "var(--force)", 1.5);
  element("svg:circle", {cx: z * zs, cy: -(abs(w) < 1e-9 * abs(q) ? 0 : w) * ws, r: 5, fill: "var(--force)"}, svg);
}

// Two rows: q lies in the cone that the columns of I and -W of its complementary basis span.
function drawCones(svg, {q, z, W}) {
  const angle = ([x, y]) => Math.atan2(y, x), R = 95, ray = (a) => [R * Math.cos(a), -R * Math.sin(a)];
  const units = [[1, 0], [0, 1]], columns = [[-W[0][0], -W[1][0]], [-W[0][1], -W[1][1]]];
  for (const a of [0, 1]) for (const b of [0, 1]) {
    const from = angle(a ? columns[0] : units[0]), to = angle(b ? columns[1] : units[1]);
    let turn = (to - from) % (2 * Math.PI);
    if (turn > Math.PI) turn -= 2 * Math.PI;
    if (turn < -Math.PI) turn += 2 * Math.PI;
    const here = !q.some(Number.isNaN) && (z[0] > 0) === Boolean(a) && (z[1] > 0) === Boolean(b);
    const [x1, y1] = ray(from), [x2, y2] = ray(from + turn);
    element("svg:path", {d: `M0 0L${x1} ${y1}A${R} ${R} 0 0 ${turn < 0 ? 1 : 0} ${x2} ${y2}Z`, fill: `var(--c${2 * a + b})`, "fill-opacity": here ? 0.55 : 0.15}, svg);
  }
  for (const [name, direction] of [["e₁", units[0]], ["e₂", units[1]], ["−W₁", columns[0]], ["−W₂", columns[1]]]) {
    const [x, y] = ray(angle(direction));
    stroke(svg, 0, 0, x, -y, "var(--grey)", 1);
    element("svg:text", {x: 1.08 * x - 8, y: 1.08 * y + 4}, svg, name);
  }
  if (q.some(Number.isNaN)) { element("svg:text", {x: -145, y: 106}, svg, "both are open: no LCP in this step"); return; }
  const size = Math.hypot(...q) || 1;
  stroke(svg, 0, 0, 78 * q[0] / size, 78 * q[1] / size, "var(--force)", 3);
  element("svg:circle", {cx: 78 * q[0] / size, cy: -78 * q[1] / size, r: 5, fill: "var(--force)"}, svg);
}

// Steps.

function moveTo(k) {
  state.k = Math.min(max(k, 0), Math.max(run.taken, 0));
  by("cursor").value = state.k;
  by("time").textContent = run.taken < 0 ? "" : `step ${state.k}, t = ${short(run.t(state.k))} s`;
  for (const {mark, width} of panels) {
    mark.style.transform = `translateX(${MARGIN.left + (width - MARGIN.left - MARGIN.right) * state.k / state.steps}px)`;
  }
  drawScheme();
  drawLaw();
  remember();
}

function step(by) { play(false); moveTo(state.k + by); }

function play(on) {
  clearInterval(playing);
  playing = on ? setInterval(() => state.k < run.taken ? moveTo(state.k + Math.max(Math.round(state.steps / 300), 1)) : play(false), 33) : 0;
  by("play").textContent = on ? "Pause" : "Play";
}

// The address says what is shown.

let waiting = 0;
function remember() {
  clearTimeout(waiting);
  waiting = setTimeout(() => {
    const given = {theta: 0.5, ...problem.numbers}, changed = Object.entries(state.values).filter(([name, x]) => given[name] !== x);
    const parts = [...changed, ["steps", state.steps], ["t_end", state.tEnd], ["at", state.k]];
    history.replaceState(null, "", `#${[encodeURIComponent(state.problem), state.method, ...parts.map(([name, x]) => `${encodeURIComponent(name)}=${x}`)].join("&")}`);
  }, 200);
}

// What an address says that this page cannot show is said, and the first problem is shown.
function recall() {
  wrong("");
  try {
    recallAddress(location.hash.slice(1));
  } catch (error) {
    choose(Object.keys(problems)[0]);
    wrong(`The address cannot be read after its # (${error.message}): ${state.problem} is shown.`);
  }
}

function recallAddress(address) {
  const [name, method, ...parts] = address.split("&").map(decodeURIComponent);
  choose(Object.hasOwn(problems, name) ? name : Object.keys(problems)[0]);
  if (name && !Object.hasOwn(problems, name)) wrong(`This page has no problem '${name}': ${state.problem} is shown.`);
  if (Object.hasOwn(problem.methods, method ?? "")) state.method = method;
  else if (method && state.problem === name) wrong(`This page does not run ${name} by '${method}': ${state.method} is taken.`);
  for (const [key, value] of parts.map((each) => each.split("=")).filter((each) => Number.isFinite(Number(each[1])))) {
    const x = Number(value);
    if (key === "steps") state.steps = Math.min(max(Math.round(x), 1), LIMITS.most);
    else if (key === "t_end") state.tEnd = x;
    else if (key === "at") state.k = x;
    else if (Object.hasOwn(state.values, key)) state.values[key] = x;
  }
}

function listen() {
  by("problem").addEventListener("change", (event) => { play(false); choose(event.target.value); show(); });
  by("method").addEventListener("change", (event) => { state.method = event.target.value; show(); });
  by("cursor").addEventListener("input", (event) => { play(false); moveTo(Number(event.target.value)); });
  by("first").addEventListener("click", () => step(-Infinity));
  by("back").addEventListener("click", () => step(-1));
  by("forward").addEventListener("click", () => step(1));
  by("play").addEventListener("click", () => { if (!playing && state.k >= run.taken) state.k = 0; play(!playing); });
  document.addEventListener("keydown", (event) => {
    if (/INPUT|SELECT|BUTTON|SUMMARY/.test(event.target.tagName) || event.ctrlKey || event.altKey || event.metaKey) return;
    const by = {ArrowLeft: -1, ArrowRight: 1, Home: -Infinity, End: Infinity}[event.key];
    if (by) step(by); else if (event.key === " ") play(!playing); else return;
    event.preventDefault();
  });
  window.addEventListener("hashchange", () => { recall(); show(); });
  window.addEventListener("resize", () => { measure(); drawCurves(); moveTo(state.k); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawCurves);
}

function begin(source) {
  problems = evaluated(source);
  by("problem").replaceChildren(...Object.keys(problems).map((each) => new Option(each, each)));
  for (const [name, why] of Object.entries(REFUSED)) element("li", {}, by("refused"), `${name}: ${why}`);
  listen();
  recall();
  show();
}
