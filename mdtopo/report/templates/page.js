"use strict";
(() => {
const data = JSON.parse(document.getElementById("mdtopo-data").textContent);
const OKABE = ["#56B4E9", "#009E73", "#E69F00", "#999999"];
const CURVE = "#CC79A7";
const MARKS = ["#D55E00", "#0072B2"];
// plotly reads tags in labels; labels come from files, so they are shown as text
const plain = (s) => String(s).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
const unpack = (text, Type) => {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Type(bytes.buffer);
};
const FONT = { family: "system-ui, sans-serif", size: 13, color: "#1d2430" };
// on a narrow screen the buttons would lie on the legend
const NARROW = window.innerWidth <= 760;
const CONFIG = { displaylogo: false, responsive: true, displayModeBar: !NARROW, modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"] };
const wrap = (text, width) => {
  const lines = [""];
  for (const word of String(text).split(" ")) {
    if ((lines[lines.length - 1] + " " + word).length > width) lines.push(word);
    else lines[lines.length - 1] += (lines[lines.length - 1] ? " " : "") + word;
  }
  return lines.map(plain).join("<br>");
};

function timePlot(element) {
  const x = unpack(data.x, Float64Array);
  const states = unpack(data.states, Int8Array);
  const series = {};
  for (const [name, s] of Object.entries(data.series)) {
    series[name] = { least: unpack(s.least, Float64Array), leastStep: unpack(s.least_step, Int32Array),
      greatest: unpack(s.greatest, Float64Array), greatestStep: unpack(s.greatest_step, Int32Array) };
  }
  // infinity has no place on an axis: it is drawn above everything else, and says so
  const top = (s) => { let m = 0; for (const v of s.greatest) if (isFinite(v) && v > m) m = v; return 1.1 * (m || 1); };
  const median = (s) => { const v = Array.from(s.greatest).filter(isFinite).sort((a, b) => a - b); return v[Math.floor(v.length / 2)] || 1; };
  const tops = Object.fromEntries(Object.entries(series).map(([name, s]) => [name, top(s)]));

  // pixels: the bins between two x values, gathered so that at most `most` are left; extremes are kept, never skipped
  const gather = (from, to, most) => {
    let low = 0, high = x.length;
    while (low < x.length && x[low] < from) low += 1;
    while (high > low && x[high - 1] > to) high -= 1;
    low = Math.max(0, low - 1); high = Math.min(x.length, high + 1);
    const size = Math.max(1, Math.ceil((high - low) / most)), groups = [];
    for (let k = low; k < high; k += size) groups.push([k, Math.min(high, k + size)]);
    return groups;
  };
  const band = (name, groups) => {
    const s = series[name], xs = [], ys = [], texts = [];
    let up = [], down = [];
    const close = () => {
      for (const p of up.concat(down.reverse())) { xs.push(p[0]); ys.push(p[1]); texts.push(p[2]); }
      if (up.length) { xs.push(null); ys.push(null); texts.push(""); }
      up = []; down = [];
    };
    for (const [start, stop] of groups) {
      let lo = Infinity, loStep = -1, hi = -Infinity, hiStep = -1;
      for (let k = start; k < stop; k += 1) {
        if (s.least[k] < lo || (loStep < 0 && s.least[k] === Infinity)) { lo = s.least[k]; loStep = s.leastStep[k]; }
        if (s.greatest[k] > hi) { hi = s.greatest[k]; hiStep = s.greatestStep[k]; }
      }
      if (loStep < 0) { close(); continue; }
      const middle = (x[start] + x[stop - 1]) / 2, shown = (v) => (isFinite(v) ? v.toPrecision(5) : "no bound (∞)");
      up.push([middle, Math.min(hi, tops[name]), `greatest ${shown(hi)}, step ${hiStep}`]);
      down.push([middle, Math.min(lo, tops[name]), `least ${shown(lo)}, step ${loStep}`]);
    }
    close();
    return { x: xs, y: ys, text: texts };
  };
  const strip = (groups) => ({
    x: groups.map(([a, b]) => (x[a] + x[b - 1]) / 2),
    z: [groups.map(([a, b]) => { let w = 0; for (let k = a; k < b; k += 1) w = Math.max(w, states[k]); return w; })],
    text: [groups.map(([a, b]) => { let w = 0; for (let k = a; k < b; k += 1) w = Math.max(w, states[k]); return data.state_names[w]; })],
  });
  const pixels = () => Math.max(200, Math.round(element.clientWidth - 160));
  const all = gather(-Infinity, Infinity, pixels());
  const bandTrace = (name, title, colour, axis, visible) => ({ type: "scatter", mode: "lines", fill: "toself", name: title,
    line: { color: colour, width: 1 }, fillcolor: colour + "55", yaxis: axis, visible, hoveron: "points",
    hovertemplate: "%{text}<extra>" + title + "</extra>", ...band(name, all) });
  const names = Object.keys(series);
  const n = data.state_colours.length;
  const scale = data.state_colours.flatMap((c, k) => [[k / n, c], [(k + 1) / n, c]]);
  const kinds = [...new Set(data.alerts.map((a) => a.lane))];
  const SYMBOLS = { crossing: "x", fracture: "cross", "bad-data": "square", unresolved: "diamond", "near-limit": "triangle-up",
    stretch: "triangle-right", "image-jump": "circle-open", gap: "line-ew" };
  const COLOURS = { critical: "#D55E00", warning: "#E69F00", info: "#0072B2" };
  const traces = [
    bandTrace("clearance", "clearance (Å)", "#0072B2", "y", true),
    bandTrace("pair_ratio", "pair ratio", "#009E73", "y2", true),
    bandTrace("nu_ratio", "2m/ν (the paper's)", "#E69F00", "y2", "legendonly"),
    { type: "heatmap", yaxis: "y3", y: [0], colorscale: scale, zmin: -0.5, zmax: n - 0.5, showscale: false, name: "steps",
      hovertemplate: "%{text}<extra>worst step</extra>", ...strip(all) },
    ...kinds.map((kind) => {
      const rows = data.alerts.filter((a) => a.lane === kind);
      return { type: "scatter", mode: "markers", yaxis: "y4", name: kind, showlegend: false, x: rows.map((a) => a.x), y: rows.map(() => kind),
        marker: { symbol: rows.map((a) => SYMBOLS[a.kind] || "circle"), size: 9, color: rows.map((a) => COLOURS[a.severity]) },
        text: rows.map((a) => wrap(a.text, 70) + (a.n > 1 ? `<br>and ${a.n - 1} more here` : "")), hovertemplate: "%{text}<extra></extra>" };
    }),
  ];
  const line = (axis, y, dash) => ({ type: "line", xref: "paper", x0: 0, x1: 1, yref: axis, y0: y, y1: y, line: { color: "#5c6675", width: 1, dash } });
  // one step of a hundred times the limit must not flatten all others
  const ratioAxis = tops.pair_ratio > 20 * median(series.pair_ratio) ? { type: "log", dtick: 1 } : { rangemode: "tozero" };
  const limits = [line("y2", 1, "solid")];
  if (data.criterion !== "clearance") limits.push(line("y2", data.near_limit, "dot"));
  else limits.push(line("y", data.near_limit, "dot"));
  const lanes = Math.min(0.24, 0.05 * kinds.length + 0.01), floor = kinds.length ? lanes + 0.02 : 0;
  const upper = floor + 0.09, middle = (1 + upper) / 2;
  const layout = { font: FONT, margin: { l: 96, r: 16, t: 44, b: 48 }, hovermode: "closest", dragmode: "zoom",
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" }, shapes: limits, paper_bgcolor: "#fff", plot_bgcolor: "#fff",
    xaxis: { title: { text: data.x_title }, anchor: kinds.length ? "y4" : "y3", gridcolor: "#eef0f3", zeroline: false },
    yaxis: { title: { text: "clearance (Å)" }, domain: [middle + 0.02, 1], rangemode: "tozero", gridcolor: "#eef0f3", zeroline: false },
    yaxis2: { title: { text: "motion / limit" }, domain: [upper, middle - 0.02], ...ratioAxis, gridcolor: "#eef0f3", zeroline: false },
    yaxis3: { domain: [floor, floor + 0.045], tickvals: [0], ticktext: ["steps"], fixedrange: true, showgrid: false },
    yaxis4: { domain: [0, Math.max(lanes, 0.01)], type: "category", fixedrange: true, gridcolor: "#eef0f3", visible: kinds.length > 0 } };
  Plotly.newPlot(element, traces, layout, CONFIG);
  const refresh = () => {
    const range = element.layout.xaxis.range || [-Infinity, Infinity];
    const groups = gather(Number(range[0]), Number(range[1]), pixels());
    const made = names.map((name) => band(name, groups)), states3 = strip(groups);
    Plotly.restyle(element, { x: made.map((m) => m.x), y: made.map((m) => m.y), text: made.map((m) => m.text) }, names.map((_, k) => k));
    Plotly.restyle(element, { x: [states3.x], z: [states3.z], text: [states3.text] }, [names.length]);
  };
  element.on("plotly_relayout", (change) => {
    if (Object.keys(change).some((key) => key.startsWith("xaxis"))) refresh();
  });
}

// full numbers at 1, 2, 5 of every decade (few decades) or at the decades: plotly's own minor ticks are bare digits
function logTicks(low, high) {
  const digits = Math.log10(high / low) > 3 ? [1] : [1, 2, 5], values = [];
  for (let k = Math.floor(Math.log10(low)); k <= Math.ceil(Math.log10(high)); k += 1) for (const d of digits) values.push(d * 10 ** k);
  return { tickmode: "array", tickvals: values, ticktext: values.map((v) => String(Number(v.toPrecision(3)))) };
}

function intervalPlot(element) {
  const d = data.interval;
  const trace = (y, name, colour, dash) => ({ type: "scatter", mode: "lines", x: d.x, y, name, line: { color: colour, width: 2, dash },
    hovertemplate: "%{y:.1f} % at %{x:.3g} ps<extra>" + name + "</extra>" });
  Plotly.newPlot(element, [trace(d.pairs, "by pairs", "#009E73", "solid"), trace(d.ball, "by the paper's bound", "#CC79A7", "dash")],
    { font: FONT, margin: { l: 96, r: 16, t: 40, b: 48 }, legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" },
      xaxis: { title: { text: "spacing of the frames (ps)" }, type: "log", ...logTicks(d.x[0], d.x[d.x.length - 1]), gridcolor: "#eef0f3" },
      yaxis: { title: { text: "steps proved (%), estimate" }, range: [-3, 103], gridcolor: "#eef0f3", zeroline: false },
      shapes: [{ type: "line", x0: d.spacing, x1: d.spacing, yref: "paper", y0: 0, y1: 1, line: { color: "#1d2430", width: 1, dash: "dot" } }],
      annotations: [{ x: Math.log10(d.spacing), yref: "paper", y: 0.04, yanchor: "bottom", xanchor: "left", text: "this run", showarrow: false }] }, CONFIG);
}

function heatPlot(element) {
  const d = data.heat, x = unpack(d.x, Float64Array), y = unpack(d.y, Int32Array), values = unpack(d.clearance, Float32Array);
  const steps = unpack(d.step, Int32Array), offsets = unpack(d.offset, Uint16Array), rows = y.length - 1, columns = x.length - 1;
  const strip = { clearance: unpack(d.strip.clearance, Float32Array), step: unpack(d.strip.step, Int32Array), vertex: unpack(d.strip.vertex, Int32Array) };
  const owner = (v) => { let k = 0; while (k + 2 < d.offsets.length && d.offsets[k + 1] <= v) k += 1; return d.strands.length ? ` of ${plain(d.strands[k])}` : ""; };
  const names = new Map(); // many cells are of one vertex
  const name = (v) => { if (!names.has(v)) names.set(v, plain(d.labels[v] || `vertex ${v}`) + owner(v)); return names.get(v); };
  const said = (value, v, step) => `${name(v)}<br>${value.toPrecision(4)} Å${value === 0 ? ": a crossing, or not proved" : ""}, step ${step}`;
  const z = [], crossed = [], text = [];
  let most = 0, hits = 0;
  for (let r = 0; r < rows; r += 1) {
    const line = [], zero = [], words = [];
    for (let c = 0; c < columns; c += 1) {
      const k = r * columns + c, v = values[k], known = !isNaN(v);
      line.push(known ? v : null); zero.push(v === 0 ? 0 : null);
      words.push(known ? said(v, y[r] + offsets[k], steps[k]) : "not measured, or no pair");
      if (v > most) most = v;
      if (v === 0) hits += 1;
    }
    z.push(line); crossed.push(zero); text.push(words);
  }
  const edges = Array.from(y, (v) => v - 0.5), middles = edges.slice(1).map((v, r) => (v + edges[r]) / 2), all = [...strip.clearance.keys()];
  const NEAR_FAR = ["#081d58", "#253494", "#225ea8", "#1d91c0", "#41b6c4", "#7fcdbb", "#c7e9b4", "#edf8b1", "#ffffd9"]; // ColorBrewer's YlGnBu
  const common = { type: "heatmap", x: Array.from(x), y: edges, text, hovertemplate: "%{text}<extra></extra>", hoverongaps: true };
  const known = all.filter((r) => strip.vertex[r] >= 0), hit = known.filter((r) => strip.clearance[r] === 0);
  const words = (r) => said(strip.clearance[r], strip.vertex[r], strip.step[r]);
  // on a narrow screen the scale of colours lies above the map, where it takes no width
  const narrow = element.parentElement.clientWidth < 640, n = y[rows], ends = narrow ? [0, 0.74, 0.8] : [0, 0.75, 0.88];
  const bar = narrow ? { orientation: "h", title: { text: "clearance (Å)", side: "top" }, x: 0, xanchor: "left", y: 1.01, yanchor: "bottom", len: 0.74, nticks: 5 }
    : { title: { text: "Å", side: "top" }, x: ends[1] + 0.01, xanchor: "left" }; // short: on paper the page is narrower
  const traces = [
    { ...common, z, zmin: 0, zmax: most || 1, colorscale: NEAR_FAR.map((c, k) => [k / 8, c]),
      colorbar: { ...bar, thickness: 12, outlinewidth: 0 } },
    ...(hits ? [{ ...common, z: crossed, zmin: 0, zmax: 1, colorscale: [[0, "#D55E00"], [1, "#D55E00"]], showscale: false, hoverongaps: false }] : []),
    { type: "scatter", mode: "lines", xaxis: "x2", x: all.map((r) => (strip.vertex[r] < 0 ? null : strip.clearance[r])), y: middles, line: { color: "#0072B2", width: 1.2 },
      fill: "tozerox", fillcolor: "#0072B222", text: all.map((r) => (strip.vertex[r] < 0 ? "" : words(r))), hovertemplate: "%{text}<extra>least of the run</extra>" },
    { type: "scatter", mode: "markers", xaxis: "x2", x: hit.map(() => 0), y: hit.map((r) => middles[r]), marker: { symbol: "x", size: 6, color: "#D55E00" }, cliponaxis: false,
      text: hit.map(words), hovertemplate: "%{text}<extra>least of the run</extra>" },
  ];
  const lines = ["x domain", "x2 domain"].flatMap((axis) => d.offsets.slice(1, -1).map((v) => (
    { type: "line", xref: axis, x0: 0, x1: 1, yref: "y", y0: v - 0.5, y1: v - 0.5, line: { color: "#1d2430", width: 0.7 } })));
  // what no cell covers is grey, and the strip beside the map is not
  lines.push({ type: "rect", xref: "x domain", yref: "y domain", x0: 0, x1: 1, y0: 0, y1: 1, layer: "below", fillcolor: "#d4d7dc", line: { width: 0 } });
  // names where they have room, else numbers of vertices
  const short = (s) => plain(String(s).length > 14 ? String(s).slice(0, 13) + "…" : s);
  const even = Array.from({ length: Math.min(n, 12) }, (_, k) => Math.round((k * (n - 1)) / Math.max(1, Math.min(n, 12) - 1)));
  const ticks = d.strands.length > 1 && d.strands.length <= 24
    ? { tickvals: d.strands.map((_, k) => (d.offsets[k] + d.offsets[k + 1] - 1) / 2), ticktext: d.strands.map(short) }
    : { tickvals: even, ticktext: even.map((v) => short(d.labels[v] || v)) };
  element.hidden = false;
  Plotly.newPlot(element, traces, { font: FONT, margin: { l: narrow ? 92 : 110, r: 16, t: narrow ? 64 : 36, b: 48 }, showlegend: false, shapes: lines, hovermode: "closest", dragmode: "zoom",
    paper_bgcolor: "#fff", plot_bgcolor: "#fff",
    xaxis: { title: { text: data.x_title }, domain: ends.slice(0, 2), showgrid: false, zeroline: false },
    yaxis: { range: [n - 0.5, -0.5], showgrid: false, zeroline: false, ...ticks },
    xaxis2: { title: { text: narrow ? "least" : "least (Å)" }, domain: [ends[2], 1], range: [0, 1.05 * (most || 1)], nticks: narrow ? 2 : 4, tickangle: 0, zeroline: false, showgrid: false } }, CONFIG);
  for (const picture of element.parentElement.querySelectorAll(".stand-in")) picture.hidden = true;
}

const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const clamp = (v) => Math.min(1, Math.max(0, v));
function nearest(p, q) {
  const d1 = sub(p[1], p[0]), d2 = sub(q[1], q[0]), r = sub(p[0], q[0]);
  const a = dot(d1, d1), e = dot(d2, d2), f = dot(d2, r), c = dot(d1, r), b = dot(d1, d2), bottom = a * e - b * b, tries = [];
  if (bottom > 1e-12 * Math.max(a * e, 1e-300)) {
    const u = clamp((b * clamp((b * f - c * e) / bottom) + f) / e);
    tries.push([clamp((b * u - c) / a), u]);
  }
  for (const s of [0, 1]) tries.push([s, e ? clamp((b * s + f) / e) : 0]);
  for (const u of [0, 1]) tries.push([a ? clamp((b * u - c) / a) : 0, u]);
  let best = null;
  for (const [s, u] of tries) {
    const m = p[0].map((v, k) => v + s * d1[k]), w = q[0].map((v, k) => v + u * d2[k]), d = Math.sqrt(dot(sub(m, w), sub(m, w)));
    if (!best || d < best.d) best = { d, m, w };
  }
  return best;
}

// of two paths of many points: near the two points that are nearest
function nearestPaths(p, q) {
  let least = Infinity, i = 0, j = 0;
  p.forEach((a, k) => q.forEach((b, l) => { const d = dot(sub(a, b), sub(a, b)); if (d < least) { least = d; i = k; j = l; } }));
  let best = null;
  for (const k of [i - 1, i]) for (const l of [j - 1, j]) if (k >= 0 && l >= 0 && k < p.length - 1 && l < q.length - 1) {
    const found = nearest([p[k], p[k + 1]], [q[l], q[l + 1]]);
    if (!best || found.d < best.d) best = found;
  }
  return best;
}

const open = [];
const MOST_OPEN = 8; // browsers hold about a dozen WebGL scenes, and plotly takes one for each
const hasWebGL = (() => { try { const c = document.createElement("canvas"); return Boolean(c.getContext("webgl") || c.getContext("experimental-webgl")); } catch { return false; } })();

function openView(view) {
  if (view.dataset.live || !hasWebGL) return;
  while (open.length >= MOST_OPEN) closeView(open[0]);
  open.push(view); view.dataset.live = "1";
  const d = data.scenes[view.dataset.scene], stage = view.querySelector(".stage"), controls = view.querySelector(".controls");
  const slider = controls.querySelector("input"), output = controls.querySelector("output");
  stage.hidden = controls.hidden = false; view.querySelector(".still").hidden = view.querySelector(".open3d").hidden = true;
  const pieces = d.pieces.map((p) => ({ ...p, x0: unpack(p.x0, Float32Array), x1: unpack(p.x1, Float32Array) }));
  const strands = [...new Set(pieces.map((p) => p.strand))];
  // of many strands those of one colour are one trace: each trace costs time, and a long legend says nothing
  const few = strands.length <= 8, colour = (k) => OKABE[k % OKABE.length];
  const groups = few ? strands.map((name) => [name]) : OKABE.map((_, c) => strands.filter((_, k) => k % OKABE.length === c));
  let radius = d.radius;
  const at = (t) => groups.map((names) => {
    const x = [], y = [], z = [], text = [];
    for (const p of pieces) if (names.includes(p.strand)) {
      for (let k = 0; k < p.labels.length; k += 1) {
        const v = [0, 1, 2].map((c) => (1 - t) * p.x0[3 * k + c] + t * p.x1[3 * k + c]);
        x.push(v[0]); y.push(v[1]); z.push(v[2]); text.push(plain(few ? p.labels[k] : `${p.labels[k]} of ${p.strand}`));
      }
      x.push(null); y.push(null); z.push(null); text.push("");
    }
    return { x, y, z, text };
  });
  // places on the smooth curve move straight, because its control points are linear in the vertices
  const curves = d.curve.lines.map((p) => ({ strand: plain(p.strand), x0: unpack(p.x0, Int16Array), x1: unpack(p.x1, Int16Array) }));
  const smooth = (t) => {
    const x = [], y = [], z = [], text = [];
    for (const p of curves) {
      for (let k = 0; k < p.x0.length; k += 3) {
        const v = [0, 1, 2].map((c) => d.curve.unit * ((1 - t) * p.x0[k + c] + t * p.x1[k + c]));
        x.push(v[0]); y.push(v[1]); z.push(v[2]); text.push(p.strand);
      }
      x.push(null); y.push(null); z.push(null); text.push("");
    }
    return { x, y, z, text };
  };
  const marks = (t) => d.marked.map(([x0, x1]) => x0.map((p, k) => p.map((v, c) => (1 - t) * v + t * x1[k][c])));
  const column = (points, c) => points.map((p) => p[c]);
  const moving = (t) => {
    const pair = marks(t), near = pair.length === 2 ? nearestPaths(pair[0], pair[1]) : null;
    const lines = pair.map((p) => ({ x: column(p, 0), y: column(p, 1), z: column(p, 2) }));
    const link = near ? [near.m, near.w] : pair[0];
    lines.push({ x: column(link, 0), y: column(link, 1), z: column(link, 2) });
    const length = pair[0].slice(1).reduce((sum, p, k) => sum + Math.sqrt(dot(sub(p, pair[0][k]), sub(p, pair[0][k]))), 0);
    output.textContent = `t = ${t.toFixed(4)}   ` + (near ? `distance ${near.d.toFixed(4)} Å` : `length ${length.toFixed(4)} Å`);
    return lines;
  };
  const t0 = d.t, line3 = (extra) => ({ type: "scatter3d", mode: "lines+markers", hoverinfo: "text+name", ...extra });
  const traces = [
    ...at(t0).map((s, k) => line3({ ...s, name: few ? plain(strands[k]) : "strands", line: { color: colour(k), width: 4 }, marker: { size: 2.5, color: colour(k) }, opacity: 0.75, showlegend: few })),
    line3({ ...smooth(t0), name: plain(data.curve_name), mode: "lines", line: { color: CURVE, width: 3 }, visible: curves.length > 0 }),
    ...moving(t0).map((s, k) => line3(k < d.marked.length
      ? { ...s, name: `${d.marked.length === 2 ? (k ? "second " : "first ") : ""}${d.arcs ? "arc" : "edge"}${few ? "" : ` of ${plain(d.marked_strands[k])}`}`, mode: d.arcs ? "lines" : "lines+markers", line: { color: MARKS[k], width: 12 }, marker: { size: 5, color: MARKS[k] } }
      : { ...s, name: "distance", mode: "lines+markers", line: { color: "#000", width: 4 }, marker: { size: 4, color: "#000", symbol: "diamond" }, visible: d.marked.length === 2 })),
  ];
  const axis = () => ({ range: [-radius, radius], visible: false, showspikes: false });
  const eye = d.eye.map((v) => 1.6 * v);
  const layout = { font: FONT, margin: { l: 0, r: 0, t: 0, b: 0 }, legend: { x: 0, y: 1, bgcolor: "rgba(255,255,255,.85)" }, uirevision: "keep",
    scene: { domain: { x: [0, 1], y: [0, NARROW ? 0.7 : 1] }, aspectmode: "cube", xaxis: axis(), yaxis: axis(), zaxis: axis(), camera: { eye: { x: eye[0], y: eye[1], z: eye[2] }, center: { x: 0, y: 0, z: 0 } } } };
  Plotly.newPlot(stage, traces, layout, { ...CONFIG, modeBarButtonsToRemove: ["tableRotation", "resetCameraLastSave3d"] });
  const every = traces.map((_, k) => k);
  const move = (t) => {
    const now = [...at(t), smooth(t), ...moving(t)];
    Plotly.restyle(stage, { x: now.map((s) => s.x), y: now.map((s) => s.y), z: now.map((s) => s.z) }, every);
  };
  slider.value = t0;
  slider.oninput = () => move(Number(slider.value));
  const zoom = () => Plotly.relayout(stage, { "scene.xaxis.range": [-radius, radius], "scene.yaxis.range": [-radius, radius], "scene.zaxis.range": [-radius, radius] });
  for (const b of controls.querySelectorAll("[data-zoom]")) b.onclick = () => { radius *= Number(b.dataset.zoom); zoom(); };
  controls.querySelector("[data-reset]").onclick = () => { radius = d.radius; slider.value = t0; move(t0); zoom(); };
}
function closeView(view) {
  open.splice(open.indexOf(view), 1); delete view.dataset.live;
  Plotly.purge(view.querySelector(".stage"));
  view.querySelector(".stage").hidden = view.querySelector(".controls").hidden = true;
  view.querySelector(".still").hidden = view.querySelector(".open3d").hidden = false;
}

const first = (id, draw) => { const element = document.getElementById(id); if (element) draw(element); };
first("time-plot", timePlot);
if (data.heat) first("heat-plot", heatPlot);
if (data.interval) first("interval-plot", intervalPlot);
for (const view of document.querySelectorAll(".view")) {
  const button = view.querySelector(".open3d");
  if (!hasWebGL) button.hidden = true;
  button.onclick = () => openView(view);
}
for (const button of document.querySelectorAll(".copy")) button.onclick = async () => {
  const text = button.previousElementSibling.textContent;
  try { await navigator.clipboard.writeText(text); } catch {
    const area = document.createElement("textarea"); area.value = text; document.body.append(area); area.select(); document.execCommand("copy"); area.remove();
  }
  button.textContent = "copied"; setTimeout(() => { button.textContent = "copy"; }, 1500);
};
first("more-events", (button) => { button.onclick = () => { for (const e of document.querySelectorAll(".event[hidden]")) e.hidden = false; button.remove(); }; });
// on paper nobody can open an event: those with a picture are open while the page is printed
let unfolded = [];
window.addEventListener("beforeprint", () => {
  unfolded = [...document.querySelectorAll(".event:not([open])")].filter((e) => e.querySelector(".still"));
  for (const e of unfolded) e.open = true;
});
window.addEventListener("afterprint", () => { for (const e of unfolded) e.open = false; });
// the first view last: where graphics are slow, everything else can be read meanwhile, and its picture is there
setTimeout(() => {
  for (const view of document.querySelectorAll(".event[open] .view")) openView(view);
  document.documentElement.dataset.ready = "1";
}, 0);
})();
