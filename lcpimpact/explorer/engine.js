// What printed runs call. min and max return the first of equal arguments, as Python's.
const {abs, sqrt, floor} = Math;
const finite = (...x) => x.every(Number.isFinite);
const min = (a, b) => b < a ? b : a, max = (a, b) => b > a ? b : a;

// Arrays for a run of N steps of a problem with so many laws in a step.
function room(problem, laws, N) {
  const n = problem.nodes.length, nc = problem.contacts.length, zeros = (size) => new Float64Array(size);
  return {q: zeros((N + 1) * n), v: zeros((N + 1) * n), r: zeros(N * nc), L: zeros(N * nc * laws),
          z: zeros(N * nc * laws), W: zeros(laws * nc * nc)};
}

// A run by a method: the arrays, and how many steps were taken; -1 if no case of the formulas holds for the values.
function simulate(problem, name, values, tEnd, N) {
  const method = problem.methods[name], out = room(problem, method.laws, N);
  const p = [...method.names.map((each) => values[each]), tEnd];
  out.taken = -1;
  for (const run of method.cases) if (out.taken < 0) out.taken = run(p, N, out);
  out.t = (k) => k === N ? tEnd : k * tEnd / N;
  out.impulses = out.taken > 0 ? takeImpulses(problem, method, out, values) : [];
  return out;
}

const equationsOf = (problem, values) => problem.equations(problem.names.map((each) => values[each]));

// The rows between masses: contacts, and friction whose normal row is one; the velocities that unit impulses of theirs give, W
// of their rates, and the nodes that have mass or move as prescribed.
function impactRows(problem, e) {
  const n = problem.nodes.length, {massive: Em, driven: Ep} = problem.parts, M = zeros(n, n), nc = problem.contacts.length;
  for (const [i, j, a] of e.M) M[i][j] = a;
  const moves = Em.concat(Ep || []).reduce((sum, unit) => sum.map((x, i) => x + abs(unit[i])), new Array(n).fill(0));
  const push = Em.length ? times(transposed(Em, n), solved(times(times(Em, M), transposed(Em, n)), times(Em, transposed(problem.H, n)))) : zeros(n, nc);
  const rigid = problem.contacts.map(({law, degree}) => law === "contact" && degree === 2);
  const own = problem.contacts.map(({law, degree, normal}, i) => rigid[i] || (law === "friction" && degree === 2 && rigid[normal]));
  return {rigid, own, push, W: times(problem.H, push), moves};
}

// Where both sides of a contact have mass, the steps that close it hold an impact: their force is its impulse over h, and so is
// that of its friction. So do those in which bodies meet that touched just before. Of contacts that stay closed the impulse is
// separated from the force.
function takeImpulses(problem, method, out, values) {
  const {contacts, H} = problem, nc = contacts.length, n = problem.nodes.length, N = out.taken, e = equationsOf(problem, values);
  const {rigid, own, push, W, moves} = impactRows(problem, e), rows = contacts.map((_, i) => i).filter((i) => rigid[i]);
  if (!rows.length) return [];
  const h = new Float64Array(N), r = (k, i) => out.r[k * nc + i];
  for (let k = 0; k < N; k++) h[k] = out.t(k + 1) - out.t(k);
  const rate = (k) => apply(H, out.v.subarray(k * n, (k + 1) * n)), fastest = new Array(n).fill(0), last = (k) => min(k + method.impactSteps, N);
  for (let k = 0; k <= N; k++) for (let j = 0; j < n; j++) fastest[j] = max(fastest[j], abs(out.v[k * n + j]));
  const pushes = contacts.map((_, i) => {
    const found = new Uint8Array(N);
    let most = rigid[i] && W[i][i] > 0 ? dot(H[i].map(abs), fastest) / W[i][i] : 0;
    if (rigid[i]) for (let k = 0; k < N; k++) most = max(most, h[k] * r(k, i));
    if (rigid[i]) for (let k = 0; k < N; k++) if (h[k] * r(k, i) > 64 * Number.EPSILON * most) found[k] = 1;
    return found;
  });
  const totals = (k, end) => contacts.map((_, i) => { let sum = 0; for (let j = k; j < end; j++) sum += h[j] * r(j, i); return sum; });
  // What forces and motions alone change in steps with impulses of the rows between masses, as rates of the gaps.
  const smooth = (k, end, total) => apply(H, moves.map((on, j) => on
    ? out.v[end * n + j] - out.v[k * n + j] - dot(push[j], total.map((y, i) => own[i] ? y : 0)) : 0));
  const again = (k, i) => {
    const approach = -rate(k)[i];
    if (method.impactSteps > 1 || !(k && pushes[i][k] && pushes[i][k - 1] && approach > 0.25 * W[i][i] * h[k] * r(k, i))) return false;
    return approach > abs(smooth(k, k + 1, totals(k, k + 1))[i]);
  };
  const gap = (i, x, start) => H[i].reduce((sum, each, j) => sum + each * x[j], start), struck = contacts.map(() => new Uint8Array(N));
  const found = [];
  const strike = (k, i) => {
    let force = 0;
    for (let j = k; j < last(k); j++) { force += r(j, i); struck[i][j] = 1; }
    if (force !== 0) found.push({step: k, contact: i, p: force * h[k]});
  };
  for (const i of rows) {
    let before = pushes[i][0] && gap(i, out.q, e.u0[i]) <= 0 && gap(i, out.v, 0) >= 0;
    for (let k = 0; k < N; k++) {
      if (pushes[i][k] && (!before || again(k, i))) {
        strike(k, i);
        contacts.forEach(({normal}, t) => { if (normal === i && !struck[t][k]) strike(k, t); });
      }
      before = pushes[i][k];
    }
  }
  for (const k of [...new Set(found.map((each) => each.step))].sort((a, b) => a - b)) {
    const within = Array.from({length: last(k) - k}, (_, j) => k + j);
    const closed = rigid.map((is, i) => is && within.some((j) => pushes[i][j] && !struck[i][j]));
    if (!closed.includes(true)) continue;
    const total = totals(k, last(k)), chosen = contacts.map(({normal}, i) => own[i] && total[rigid[i] ? i : normal] > 0);
    const parts = separated(problem, e, W, chosen, rate(k), smooth(k, last(k), total.map((y, i) => chosen[i] ? y : 0)), total);
    parts.forEach((p, i) => {
      if (!p || within.some((j) => struck[i][j]) || !(closed[i] || contacts[i].law === "friction")) return;
      found.push({step: k, contact: i, p});
      for (const j of within) out.r[j * nc + i] = (total[i] - p) / (out.t(last(k)) - out.t(k));
    });
  }
  for (let i = 0; i < nc; i++) for (let k = 0; k < N; k++) if (struck[i][k]) out.r[k * nc + i] = 0;
  return found;
}

// The impulses of the chosen rows in steps whose recorded impulses are Y: first the law of impact, then a step of the forces.
function separated(problem, e, W, chosen, U, smooth, Y) {
  const {contacts} = problem, friction = (i) => contacts[i].law === "friction", none = Y.map(() => 0);
  const impacts = (q, rate, target) => {
    const rows = Y.map((_, i) => i).filter((i) => chosen[i]), more = redundant(rows.map((i) => rows.map((j) => W[i][j]))) ? 1e-10 : 0;
    const sticks = 1e-9 * Math.max(...rows.map((i) => abs(rate[i]))), mu = rate.map((x, i) => abs(x) <= sticks ? e.mus[i] : e.mu[i]);
    const law = {W: W.map((row, i) => row.map((a, j) => i === j ? a + more * a : a)), low: none, high: Y.map(() => Infinity), mu, normals: contacts.map((each) => each.normal)};
    return solveRows(law, q.map((x, i) => x - more * W[i][i] * target[i]), chosen, null);
  };
  const P = impacts(U.map((u, i) => u + e.e[i] * (friction(i) ? u : min(u, 0))), U, Y);
  if (!P) return none;
  const after = U.map((u, i) => u + dot(W[i], P)), most = Math.max(...Y.map((y, i) => chosen[i] ? abs(y) : 0));
  const forces = impacts(after.map((u, i) => u + smooth[i]), after, Y.map((y, i) => y - P[i]));
  if (!forces) return none;
  const least = 1e-8 * Math.max(most, ...P.map(abs));
  const found = Y.map((y, i) => {
    if (!chosen[i] || friction(i)) return 0;
    const force = min(max(forces[i], 0), max(y, 0)), taken = y - (force <= 1e-12 * most ? 0 : force);
    return min(abs(P[i]), abs(taken)) <= least ? 0 : min(taken, y);
  });
  // Friction follows its law in the impact, as far as the rest obeys that of the force.
  contacts.forEach(({normal}, i) => {
    if (!chosen[i] || !friction(i)) return;
    const mu = abs(Y[i]) > e.mu[i] * Y[normal] ? e.mus[i] : e.mu[i], slips = mu * found[normal], loaded = mu * (Y[normal] - found[normal]);
    const wanted = P[normal] > 0 ? P[i] * found[normal] / P[normal] : 0;
    const lowest = max(-slips, Y[i] - loaded);
    found[i] = min(max(wanted, lowest), max(min(slips, Y[i] + loaded), lowest));
  });
  return found;
}

// Whether a symmetric matrix is singular to rounding: its pivots, the largest first.
function redundant(A) {
  const rows = A.map((row) => [...row]), left = new Set(rows.keys()), least = 1e-10 * Math.max(...A.flat().map(abs));
  while (left.size) {
    const p = [...left].reduce((a, b) => rows[b][b] > rows[a][a] ? b : a);
    if (!(rows[p][p] > least)) return A.length > 1;
    left.delete(p);
    for (const i of left) { const factor = rows[i][p] / rows[p][p]; for (const j of left) rows[i][j] -= factor * rows[p][j]; }
  }
  return false;
}

// A row at its lower bound, between its bounds, or at its upper one.
const LOW = -1, FREE = 0, HIGH = 1;

// Rows of a law: w = W z + q with z between its bounds, w >= 0 at the lower one, w <= 0 at the upper one, and else w = 0.
// Friction has the bounds -μ z and μ z of its normal row. Each active row is low, free or high; these cases are tried one after
// the other, that of a guess of z first, until the inequalities of one hold to rounding. null where none does.
function solveRows(law, q, on, guess) {
  const {low, high, mu, normals} = law, active = [], rubs = (i) => normals[i] >= 0;
  for (let i = 0; i < q.length; i++) if (on[i]) active.push(i);
  if (!active.length) return new Array(q.length).fill(0);
  let best = null, smallest = 1e-10;
  const consider = (state) => {
    const found = solveCase(law, q, active, state);
    if (found && found.wrong < smallest) { smallest = found.wrong; best = found.z; }
  };
  if (guess) consider(q.map((_, i) => {
    const most = rubs(i) ? mu[i] * guess[normals[i]] * (1 - 1e-9) : high[i];
    return guess[i] <= (rubs(i) ? -most : low[i]) ? LOW : guess[i] < most ? FREE : HIGH;
  }));
  const state = new Array(q.length).fill(LOW);
  const kinds = active.map((i) => rubs(i) ? [LOW, FREE, HIGH] : [LOW, FREE, HIGH].filter((each) => each === FREE || abs(each < 0 ? low[i] : high[i]) < Infinity));
  const count = kinds.reduce((product, each) => product * each.length, 1);
  for (let number = 0; number < count && smallest > 1e-14; number++) {
    let rest = number;
    active.forEach((i, a) => { state[i] = kinds[a][rest % kinds[a].length]; rest = floor(rest / kinds[a].length); });
    // An open contact has no friction, high or low.
    if (!active.some((i) => rubs(i) && state[normals[i]] === LOW && state[i] !== LOW)) consider(state);
  }
  return best;
}

// z of the active rows in one case, and by how much an inequality is violated, relative to the terms of its row.
function solveCase({W, low, high, mu, normals}, q, active, state) {
  const z = new Array(q.length).fill(0), slope = new Array(q.length).fill(0), free = [];
  for (const i of active) {
    if (normals[i] >= 0 && state[normals[i]] === LOW) continue;
    if (state[i] === FREE) free.push(i);
    else if (normals[i] >= 0) slope[i] = state[i] * mu[i];  // friction that slips follows its normal row
    else z[i] = state[i] === LOW ? low[i] : high[i];
  }
  const rows = free.map((i) => {
    const row = free.map((j) => W[i][j]);
    let right = -q[i];
    for (const k of active) {
      right -= W[i][k] * z[k];
      if (slope[k]) row[free.indexOf(normals[k])] += slope[k] * W[i][k];
    }
    row.push(right);
    return row;
  });
  const found = eliminated(rows);
  if (!found) return null;
  free.forEach((i, a) => { z[i] = found[a][0]; });
  for (const i of active) if (slope[i]) z[i] = slope[i] * z[normals[i]];
  let wrong = 0;
  for (const i of active) {
    const rubs = normals[i] >= 0, most = rubs ? mu[i] * z[normals[i]] : high[i], least = rubs ? -most : low[i];
    if (rubs && state[normals[i]] === LOW) continue;
    let w = q[i], terms = abs(q[i]);
    for (const k of active) { w += W[i][k] * z[k]; terms += abs(W[i][k] * z[k]); }
    const beyond = state[i] === FREE ? max(abs(w) - 1e-14 * terms, max(max(least - z[i], z[i] - most), 0) * W[i][i]) : state[i] * w;
    if (!(beyond <= wrong * terms)) wrong = beyond / terms;
    if (state[i] === FREE && !rubs) z[i] = min(max(z[i], low[i]), high[i]);
  }
  return {z, wrong};
}

// The same with static friction: a row sticks with μ_s until it slips, and slip that turns back holds first. y is q and v at the
// start of the step.
function solveHolding({H, h, mus, ...law}, q, on, guess, y) {
  const mu = [...law.mu], n = y.length / 2, rows = q.map((_, i) => i).filter((i) => on[i] && law.normals[i] >= 0);
  const reach = (i, z) => mu[i] * abs(law.W[i][i]) * max(z[law.normals[i]], 0), turned = {}, U = {}, near = {};
  for (const i of rows) {
    const rate = H[i].reduce((sum, a, j) => sum + a * y[n + j], 0);
    near[i] = 16 * Number.EPSILON * H[i].reduce((sum, a, j) => sum + abs(a) * (abs(y[n + j]) + abs(y[j]) / h), 0);
    mu[i] = mus[i];
    U[i] = abs(rate) <= near[i] + 1e-9 * reach(i, guess) ? 0 : rate;
    if (U[i]) mu[i] = law.mu[i];
  }
  for (;;) {
    const z = solveRows({...law, mu}, q, on, guess);
    if (!z) return null;
    let again = false;
    for (const i of rows) {
      const w = z.reduce((sum, x, j) => sum + law.W[i][j] * x, q[i]), moves = abs(w) > near[i] + 1e-9 * reach(i, z);
      if (moves && mu[i] > law.mu[i] && (!U[i] || turned[i])) { mu[i] = law.mu[i]; again = true; }
      else if (moves && U[i] * w < 0 && !turned[i]) { mu[i] = mus[i]; turned[i] = again = true; }
    }
    if (!again) return z;
    guess = z;
  }
}

// Small matrices, as arrays of rows.
const zeros = (m, n) => Array.from({length: m}, () => new Array(n).fill(0));
const times = (A, B) => A.map((row) => (B[0] || []).map((_, j) => row.reduce((s, a, k) => s + a * B[k][j], 0)));
const plus = (A, B, factor = 1) => A.map((row, i) => row.map((a, j) => a + factor * B[i][j]));
const transposed = (A, n) => Array.from({length: n}, (_, j) => A.map((row) => row[j]));
const dot = (a, x) => { let s = 0; for (let k = 0; k < a.length; k++) s += a[k] * x[k]; return s; };
const apply = (A, x) => A.map((row) => dot(row, x));

// X with A X = B, by elimination with partial pivoting; null if A is singular.
const solved = (A, B) => eliminated(A.map((row, i) => [...row, ...B[i]]));

// The same of rows (A, B), which are overwritten.
function eliminated(rows) {
  const n = rows.length;
  for (let k = 0; k < n; k++) {
    let p = k;
    for (let i = k + 1; i < n; i++) if (abs(rows[i][k]) > abs(rows[p][k])) p = i;
    if (!(abs(rows[p][k]) > 0)) return null;
    [rows[k], rows[p]] = [rows[p], rows[k]];
    for (let i = 0; i < n; i++) {
      if (i === k) continue;
      const factor = rows[i][k] / rows[k][k];
      if (factor) for (let j = k; j < rows[i].length; j++) rows[i][j] -= factor * rows[k][j];
    }
  }
  return rows.map((row, i) => row.slice(n).map((each) => each / row[i]));
}

// The matrix exponential of A t, by Taylor's series of A t / 2^s, squared s times.
function exponential(A, t) {
  const n = A.length, norm = A.reduce((m, row) => max(m, row.reduce((s, a) => s + abs(a), 0)), 0) * abs(t);
  const s = norm > 0.25 ? Math.ceil(Math.log2(norm / 0.25)) : 0, B = A.map((row) => row.map((a) => a * t / 2 ** s));
  const unit = zeros(n, n).map((row, i) => (row[i] = 1, row));
  let sum = zeros(n, n), term = unit;  // exp - 1, whose squares lose no digits of small entries
  for (let k = 1; k < 16; k++) {
    term = times(term, B).map((row) => row.map((a) => a / k));
    sum = plus(sum, term);
  }
  for (let k = 0; k < s; k++) sum = plus(times(sum, sum), sum, 2);
  return plus(sum, unit);
}

// X' = A X + B r, u = C X + D r, q = Q X + Qr r without massless coordinates; X = (q_m, q_d, v_m, 1, cosines and sines).
function firstOrder(problem, e) {
  const n = problem.nodes.length, {massive: Em, damped: Ed, static: Es, driven: Ep} = problem.parts;
  const nm = Em.length, nd = Ed.length, waves = [...e.waves.map((w) => ["f", ...w]), ...e.motions.map((w) => ["y", ...w])];
  const nl = 1 + 2 * waves.length, N = 2 * nm + nd + nl, one = 2 * nm + nd, nc = problem.contacts.length;
  const dense = (triples) => { const A = zeros(n, n); for (const [i, j, a] of triples) A[i][j] = a; return A; };
  const M = dense(e.M), C = dense(e.C), K = dense(e.K), H = problem.H, push = transposed(H, n);
  const load = zeros(n, N), place = zeros(n, N), known = zeros(n, N), generator = zeros(nl, N), start = [1];
  for (const [i, f] of e.f) load[i][one] += f;
  waves.forEach(([what, i, a, ω, φ], k) => {
    const at = one + 1 + 2 * k;
    if (what === "f") load[i][at] += a;
    else { place[i][at] = a; known[i][at + 1] = -a * ω; }
    generator[1 + 2 * k][at + 1] = -ω; generator[2 + 2 * k][at] = ω;
    start.push(Math.cos(φ), Math.sin(φ));
  });
  Em.forEach((unit, j) => unit.forEach((a, i) => { place[i][j] += a; known[i][nm + nd + j] += a; }));
  Ed.forEach((unit, j) => unit.forEach((a, i) => { place[i][nm + j] += a; }));
  const block = (E, A, F) => times(times(E, A), transposed(F, n));
  const add = (E, x, base) => E.length ? plus(base, times(transposed(E, n), x)) : base;
  const answer = (A, B) => A.length ? solved(A, B) : [];
  const Kss = block(Es, K, Es), none = zeros(n, nc);
  const Qs = answer(Kss, times(Es, plus(load, times(K, place), -1))), Qsr = answer(Kss, times(Es, push));
  const Q = add(Es, Qs, place), Qr = add(Es, Qsr, none), Cdd = block(Ed, C, Ed);
  const rest = plus(plus(load, times(K, Q), -1), times(C, known), -1), restR = plus(push, times(K, Qr), -1);
  const Vd = answer(Cdd, times(Ed, rest)), Vdr = answer(Cdd, times(Ed, restR));
  const rate = add(Ed, Vd, known), rateR = add(Ed, Vdr, none), Mm = block(Em, M, Em);
  const Am = answer(Mm, times(Em, plus(plus(load, times(K, Q), -1), times(C, rate), -1)));
  const Amr = answer(Mm, times(Em, plus(restR, times(C, rateR), -1)));
  const vm = zeros(nm, N).map((row, j) => (row[nm + nd + j] = 1, row));
  const Cu = times(H, Q), X = [...Em, ...Ed].map((unit) => dot(unit, e.q));
  Cu.forEach((row, i) => { row[one] += e.u0[i]; });
  return {A: [...vm, ...Vd, ...Am, ...generator], B: [...zeros(nm, nc), ...Vdr, ...Amr, ...zeros(nl, nc)], C: Cu,
          D: times(H, Qr), Q, Qr, V: rate, X: [...X, ...Em.map((unit) => dot(unit, e.v)), ...start], one, N, nc};
}

// The exact motion at the instants t, from event to event by matrix exponentials: q and v of each node, r, and the events.
// It is followed while one contact or slider at a time changes; what comes after `until` is not known.
function exactMotion(problem, values, instants) {
  const e = equationsOf(problem, values), found = {q: [], v: [], r: [], events: [], until: 0};
  const S = firstOrder(problem, e), {A, B, C, D, N, nc, one} = S, modes = new Map();
  if (A.some((row) => !finite(...row))) return found;
  const rows = problem.contacts.map((contact, i) => {
    const levels = [C[i]];
    for (let k = 0; k < contact.degree; k++) levels.push(apply(transposed(A, N), levels[k]));
    const W = contact.degree ? times([levels[contact.degree - 1]], B)[0] : D[i];
    return {...contact, levels, G: levels[contact.degree], W, lo: e.lo[i], hi: e.hi[i], e: e.e[i]};
  });
  const slider = (row) => row.law === "slider";
  // A mode says for each row: "open" or "closed", or "stick", "hi" or "lo".
  function mode(state) {
    const key = state.join();
    if (modes.has(key)) return modes.get(key);
    const R = zeros(nc, N), held = rows.map((_, i) => i).filter((i) => state[i] === "closed" || state[i] === "stick");
    state.forEach((each, i) => { if (each === "hi" || each === "lo") R[i][one] = rows[i][each]; });
    if (held.length) {
      const right = held.map((i) => rows[i].G.map((g, j) => -g - rows[i].W.reduce((s, w, k) => s + w * R[k][j], 0)));
      const r = solved(held.map((i) => held.map((j) => rows[i].W[j])), right);
      if (!r) return null;
      held.forEach((i, k) => { R[i] = r[k]; });
    }
    const flow = nc ? plus(A, times(B, R)) : A, watch = [];
    state.forEach((each, i) => {
      const u = rows[i].levels[0].map((c, j) => c + D[i].reduce((s, d, k) => s + d * R[k][j], 0));
      const U = apply(transposed(flow, N), u), gap = (row, sign) => watch.push({i, g: row.map((a) => sign * a)});
      if (each === "open") gap(u, 1);
      if (each === "closed") gap(R[i], 1);
      if (each === "hi") gap(U, -1);
      if (each === "lo") gap(U, 1);
      if (each === "stick") for (const [bound, sign] of [["hi", -1], ["lo", 1]]) {
        watch.push({i, bound, g: R[i].map((a, j) => sign * (a - (j === one ? rows[i][bound] : 0)))});
      }
    });
    for (const each of watch) each.rate = apply(transposed(flow, N), each.g);
    let power = flow;
    for (let k = 0; k < 3; k++) power = times(power, power);
    const rate = Math.max(...power.map((row) => row.reduce((s, a) => s + abs(a), 0))) ** 0.125;  // a bound of all |λ|
    const made = {state, R, flow, longest: 1 / rate, watch, steps: new Map()};
    modes.set(key, made);
    return made;
  }
  // Taylor's coefficients of the motion from X, which converge fast up to τ; none if they do not.
  function series(m, X, τ) {
    if (!(τ <= m.longest)) return null;
    const found = [X];
    for (let k = 1; k < 22; k++) found.push(apply(m.flow, found[k - 1]).map((a) => a / k));
    return found;
  }
  const summed = (terms, t) => terms.reduceRight((sum, a) => sum * t + a, 0);
  const moved = (m, X, t, terms = null) => {
    if (terms) return X.map((_, i) => summed(terms.map((each) => each[i]), t));
    if (!m.steps.has(t)) { if (m.steps.size > 64) m.steps.clear(); m.steps.set(t, exponential(m.flow, t)); }
    return apply(m.steps.get(t), X);
  };
  const size = (g, X) => g.reduce((s, a, k) => s + abs(a * X[k]), 0);
  // Whether a held row is held indeed: its force in the mode with it held.
  function settle(state, i, X) {
    const held = slider(rows[i]) ? "stick" : "closed", m = mode(state.map((each, k) => k === i ? held : each));
    if (!m) return null;
    let r = dot(m.R[i], X);
    if (abs(r) <= 1e-12 * size(m.R[i], X) && !slider(rows[i])) r = dot(m.watch.find((each) => each.i === i).rate, X);
    const next = slider(rows[i])
      ? (r > rows[i].hi ? "hi" : r < rows[i].lo ? "lo" : "stick") : (r > 0 ? "closed" : "open");
    return state.map((each, k) => k === i ? next : each);
  }
  let X = S.X.slice(), t = 0, fastest = 0, farthest = 0;
  const touching = (i) => dot(C[i], X) <= 1e-13 * size(C[i], X);
  // A closing: an impact where both sides have mass, and then rest where the body would rise by less than rounding.
  function close(state, i) {
    const row = rows[i];
    if (row.degree === 2) {
      const U = dot(row.levels[1], X);
      if (state.some((each, k) => k !== i && row.W[k] && (each === "closed" || touching(k)))) return null;  // a common impact
      if (U < 0) {
        const p = -(1 + row.e) * U / row.W[i];
        X = X.map((x, k) => x + B[k][i] * p);
        found.events.push({t, contact: row.name, p});
        fastest = max(fastest, -U);
        const held = mode(state.map((each, k) => k === i ? "closed" : each)), a = held ? dot(held.R[i], X) * row.W[i] : 0;
        const rises = a > 0 ? (row.e * U) ** 2 / (2 * a) : Infinity;
        if (rises > 1e-14 * farthest && -row.e * U > 1e-11 * fastest) return state;
        const fast = dot(row.levels[1], X), push = B.map((b) => b[i] * -fast / row.W[i]);
        X = X.map((x, k) => x + push[k]);
      } else if (U > 0) return state;
    }
    return settle(state, i, X);
  }
  let state = rows.map((row) => slider(row) ? "stick" : "open");
  rows.forEach((row, i) => {
    if (!state) return;
    if (slider(row)) {
      const U = row.degree === 2 ? dot(row.levels[1], X) : 0;
      state = U > 0 ? state.with(i, "lo") : U < 0 ? state.with(i, "hi") : settle(state, i, X);
    } else if (touching(i)) state = close(state, i);
  });
  const keep = (m) => {
    const r = apply(m.R, X), q = apply(S.Q, X), v = apply(S.V, X);
    found.q.push(S.Qr.map((row, i) => q[i] + dot(row, r)));
    found.v.push(v); found.r.push(r); found.until = t;
    for (const c of C) farthest = max(farthest, size(c, X));
  };
  // The first instant in (0, τ] at which something watched falls below zero; a motion of the mode ends at `end`.
  function firstCrossing(m, τ, end, taylor) {
    let first = null;
    for (const each of m.watch) {
      const small = 1e-14 * size(each.g, X), g0 = dot(each.g, X), g1 = dot(each.g, end), least = Math.min(g0, 0) - small;
      const s0 = dot(each.rate, X), s1 = dot(each.rate, end), turns = s0 < 0 && s1 > 0;
      if (g1 >= least && !turns) continue;
      const along = (row) => {
        const terms = taylor();
        if (!terms) return (s) => dot(row, moved(m, X, s));
        const a = terms.map((term) => dot(row, term));
        return (s) => summed(a, s);
      };
      const g = along(each.g), slope = along(each.rate), high = g1 < least ? τ : root(slope, 0, τ);
      if (g1 >= least && g(high) >= least) continue;
      const low = g0 <= small && s0 > 0 ? root(slope, 0, high, true) : 0;
      const s = g0 <= small && s0 <= 0 ? 0 : root((x) => -g(x), low, high);
      if (!first || s < first.s) first = {s, ...each};
    }
    return first;
  }
  // The zero of a rising f (falling, if `falls`) between a and b, by bisection and secants.
  function root(f, a, b, falls = false) {
    const sign = falls ? -1 : 1;
    let fa = sign * f(a), fb = sign * f(b);
    for (let k = 0; k < 100 && b - a > 4e-16 * b; k++) {
      let c = k % 3 < 2 && fb > fa ? a - fa * (b - a) / (fb - fa) : a + (b - a) / 2;
      if (!(c > a && c < b)) c = a + (b - a) / 2;
      const fc = sign * f(c);
      if (fc > 0) { b = c; fb = fc; } else { a = c; fa = fc; }
    }
    return b;
  }
  const h = instants[1] - instants[0];
  let m = state && mode(state), changes = 0;
  if (m) keep(m);
  for (let k = 1; k < instants.length && m; k++) {
    let left = t === instants[k - 1] && abs(instants[k] - t - h) < 1e-9 * h ? h : instants[k] - t;
    while (m && left > 0) {
      // In so short a part what is watched turns once at most.
      const part = Math.min(left, Math.max(m.longest, h / 100));
      let terms;
      const taylor = () => terms === undefined ? terms = series(m, X, part) : terms;
      const end = moved(m, X, part, part === h ? null : taylor()), crossing = firstCrossing(m, part, end, taylor);
      if (!crossing) { X = end; t = part === left ? instants[k] : t + part; left -= part; continue; }
      if (++changes > 3000) { m = null; break; }
      X = moved(m, X, crossing.s, taylor());
      t += crossing.s; left -= crossing.s;
      const {i, bound} = crossing, was = m.state[i];
      if (was === "open") state = close(m.state, i);
      else if (was === "closed") state = m.state.with(i, "open");
      else if (was === "stick") state = m.state.with(i, bound);
      else state = settle(m.state, i, X);
      if (state && state[i] !== was) found.events.push({t, contact: rows[i].name, to: state[i]});
      m = state && mode(state);
    }
    if (m) keep(m);
  }
  return found;
}
