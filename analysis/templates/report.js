"use strict";
// Unpacks plotly and the data of the pictures, and draws each picture in the colours of light or dark paper.
const dark = matchMedia("(prefers-color-scheme: dark)");
const narrow = matchMedia("(max-width: 30rem)");

// A printed page shows the folded details too.
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((one) => { one.open = true; }));

async function unpacked(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), (char) => char.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

// The contents of a picture (analysis.apps.report.chart) as traces and layout of plotly. The colours come later.
function plotted(picture, looks) {
  if (picture.frame === "sphere") return sphere(picture);
  if (picture.frame === "arm") return arm(picture, looks);
  if (picture.frame === "polar") return polar(picture, looks);
  const full = { yref: "paper", y0: 0, y1: 1 };
  const mark = { type: "line", ...full, line: { dash: "dot", width: 1 } };
  const shade = { type: "rect", ...full, line: { width: 0 }, opacity: 0.25, layer: "below", shade: true };
  const word = { yref: "paper", y: 1, yanchor: "bottom", xanchor: "left", textangle: -45, font: { size: 10 } };
  const layout = {
    xaxis: { title: { text: picture.x_label }, zeroline: false },
    yaxis: { title: { text: picture.y_label }, zeroline: true, automargin: true },
    hovermode: picture.frame === "straight" ? "x unified" : "closest",
    shapes: [
      ...picture.marks.map(([at]) => ({ ...mark, x0: at, x1: at })),
      ...picture.shaded.map(([low, high]) => ({ ...shade, x0: low, x1: high })),
    ],
    annotations: picture.marks.map(([x, text]) => ({ ...word, x, text, showarrow: false })),
  };
  if (picture.frame === "plane") layout.yaxis.scaleanchor = "x";
  if (picture.frame === "straight") Object.assign(layout.xaxis, { range: [0, 360], dtick: 30, ticksuffix: "°" });
  if (picture.steps) layout.yaxis.range = picture.reach;
  if (picture.ticks.length) {
    layout.xaxis.tickvals = picture.ticks.map(([at]) => at);
    layout.xaxis.ticktext = picture.ticks.map(([, name]) => name);
  }
  const data = picture.lines.map((line) => ({
    ...named(line, looks), type: "scatter", mode: line.points ? "markers" : "lines",
    x: numbers(line.x), y: numbers(line.y), marker: { symbol: looks[line.role].symbol, size: 7 },
    hovertemplate: `%{y:.4~g} ${picture.unit}`,
    ...(line.steps && { steps: line.steps.map(numbers) }),
    ...(line.half && { error_y: { type: "data", array: numbers(line.half), thickness: 1 } }),
  }));
  return { data, layout, height: picture.frame === "plane" ? 520 : 340 };
}

const named = ({ name, role }, looks) =>
  ({ name, role, line: { dash: looks[role].dash, width: 1.5 * looks[role].width } });

// Numbers of single precision in base64.
function numbers(text) {
  return new Float32Array(Uint8Array.from(atob(text), (char) => char.charCodeAt(0)).buffer);
}

// Deviations around the circle, drawn outwards from a circle of zero; the lines are closed.
function polar({ lines, unit, hole, largest, largest_shown }, looks) {
  const data = lines.map((line) => {
    const [x, y] = [line.x, line.y].map(numbers).map((values) => [...values, values[0]]);
    return {
      ...named(line, looks), type: "scatterpolar", mode: "lines", theta: x, r: y.map((value) => hole + value),
      customdata: y, hovertemplate: `φ %{theta:.0f}°: %{customdata:.4~g} ${unit}`,
    };
  });
  const theta = Array.from({ length: 181 }, (_, k) => 2 * k);
  data.push({
    type: "scatterpolar", mode: "lines", role: "quiet", showlegend: false, hoverinfo: "skip", theta,
    r: theta.map(() => hole), line: { width: 1, dash: "dot" },
  });
  const ticks = { tickvals: [hole, hole + largest], ticktext: ["", `+${largest_shown} ${unit}`] };
  const radialaxis = { range: [0, hole + 1.4 * largest], angle: 45, ...ticks };
  return { data, layout: { polar: { radialaxis, angularaxis: { dtick: 30, ticksuffix: "°" } } }, height: 420 };
}

// The measured surface, the translucent least-squares sphere, and the targets.
function sphere(picture) {
  const [sphere, surface, targets] = picture.words, limit = picture.limit, grey = "#9a9a9a";
  const data = [
    { type: "surface", name: sphere, opacity: 0.35, showscale: false, hoverinfo: "skip", showlegend: true,
      colorscale: [[0, grey], [1, grey]], ...picture.sphere },
    { type: "surface", name: surface, surfacecolor: picture.deviation, showlegend: true, cmin: -limit, cmax: limit,
      colorscale: "Cividis", hoverinfo: "skip", colorbar: { title: { text: "mm" }, thickness: 12, len: 0.7 },
      ...picture.surface },
    { type: "scatter3d", mode: "markers", name: targets, marker: { size: 3, color: "#000000" }, text: picture.names,
      hovertemplate: "%{text}<extra></extra>", ...picture.targets },
  ];
  return space(data, { eye: { x: 1.5, y: -1.5, z: 1 }, center: { x: 0, y: 0, z: -0.15 } });
}

// The links of the arm in one posture, and the magnified error vectors of the poses.
function arm(picture, looks) {
  const grey = "#a6a6a6", scatter = { type: "scatter3d" };
  const data = [
    { ...scatter, mode: "lines", name: picture.arm, hoverinfo: "skip", line: { color: grey, width: 12 }, ...picture.links },
    { ...scatter, mode: "markers", showlegend: false, hoverinfo: "skip", marker: { size: 3 }, ...picture.joints },
    ...picture.vectors.map(({ x, y, z, ...vectors }) => ({
      ...scatter, ...named(vectors, looks), mode: "lines", hoverinfo: "skip", line: { width: 5 },
      x: numbers(x), y: numbers(y), z: numbers(z),
    })),
    { ...scatter, mode: "markers", showlegend: false, role: "quiet", marker: { size: 1.5 }, text: picture.names,
      hovertemplate: "%{text}<extra></extra>", ...picture.places },
  ];
  const turn = picture.azimuth_deg * Math.PI / 180, far = narrow.matches ? 2.7 : 1.8;
  const eye = { x: far * Math.cos(turn), y: far * Math.sin(turn), z: 0.45 * far };
  return space(data, { eye, center: { x: 0, y: 0, z: -0.22 } });
}

function space(data, camera) {
  const axes = ["x", "y", "z"].map((name) => [`${name}axis`, { title: { text: `${name} / mm` } }]);
  return { data, layout: { scene: { ...Object.fromEntries(axes), aspectmode: "data", camera } }, height: 520 };
}

// Lines of a legend whose entries stand in columns as wide as the longest name.
function legendRows(data, width) {
  const names = data.filter((trace) => trace.showlegend !== false && trace.name).map((trace) => trace.name);
  const columns = Math.max(1, Math.floor(width / (50 + 7 * Math.max(0, ...names.map((name) => name.length)))));
  return Math.ceil(names.length / columns);
}

// Marks too near for separate labels share the label of the first: "axis 3, 2, 5".
function readable(annotations, range, width) {
  const near = 20 * (range[1] - range[0]) / width;
  const kept = [];
  for (const mark of annotations.filter(({ text }) => text).sort((a, b) => a.x - b.x)) {
    const last = kept.at(-1);
    const axes = mark.text.replace(/^[^0-9]*/, "").split(", ");
    if (last && mark.x - last.at < near) {
      const added = axes.filter((axis) => !last.axes.includes(axis));
      Object.assign(last, { text: [last.text, ...added].join(", "), axes: [...last.axes, ...added], at: mark.x });
    } else kept.push({ ...mark, axes, at: mark.x });
  }
  return kept.map(({ at, axes, ...mark }) => mark);
}

function painted(picture, looks, ink, step) {
  const data = picture.data.map(({ steps, ...found }) => (steps ? { ...found, y: steps[step] } : found)).map((trace) => {
    if (!trace.role) return trace.marker ? { ...trace, marker: { ...trace.marker, color: ink.text } } : trace;
    const { role, ...rest } = trace;
    const color = looks[role][dark.matches ? "dark" : "light"];
    return { ...rest, line: { ...rest.line, color }, marker: { ...rest.marker, color } };
  });
  const axis = { gridcolor: ink.rule, zerolinecolor: ink.quiet, linecolor: ink.rule, color: ink.text };
  const given = picture.layout;
  const shapes = (given.shapes || []).map(({ shade, ...shape }) =>
    shade ? { ...shape, fillcolor: "#f2c14e" } : { ...shape, line: { ...shape.line, color: ink.quiet } });
  const layout = {
    ...given, shapes, height: picture.height, autosize: true,
    margin: given.scene ? { l: 0, r: 0, t: 0, b: 40 }
      : { l: 60, r: given.annotations?.length ? 44 : 20, t: given.annotations?.length ? 54 : 24, b: 50 },
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: ink.text, family: "system-ui, sans-serif" },
    legend: { orientation: "h", y: given.polar || given.scene ? -0.08 : -0.22 },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: ink.quiet, activecolor: ink.text },
    hoverlabel: { bgcolor: ink.paper, font: { color: ink.text } },
  };
  if (given.polar) {
    layout.polar = { bgcolor: "rgba(0,0,0,0)", angularaxis: { ...axis, ...given.polar.angularaxis },
      radialaxis: { ...axis, ...given.polar.radialaxis } };
  } else if (given.scene) {
    const sides = ["xaxis", "yaxis", "zaxis"].map((name) => [name, { ...axis, ...given.scene[name] }]);
    layout.scene = { ...given.scene, ...Object.fromEntries(sides) };
  } else {
    // A telephone has no room for a number each 30°. The legend stands below the axis' name, however many lines it has.
    const coarse = narrow.matches && given.xaxis.dtick ? { dtick: 90 } : {};
    layout.xaxis = { ...axis, ...given.xaxis, ...coarse };
    const width = Math.min(innerWidth, 1100) - 110, rows = legendRows(data, width);
    Object.assign(layout, { height: picture.height + 20 * rows, margin: { ...layout.margin, b: 66 + 20 * rows } });
    layout.legend = { orientation: "h", y: 0, yref: "container", yanchor: "bottom" };
    const range = given.xaxis.range;
    if (given.annotations?.length && range) layout.annotations = readable(given.annotations, range, width);
    layout.yaxis = { ...axis, ...given.yaxis };
  }
  return { data, layout };
}

function paint({ pictures, looks }, step, all = true) {
  const style = getComputedStyle(document.documentElement);
  const [text, quiet, rule, paper] = ["--ink", "--quiet", "--rule", "--paper"].map((name) => style.getPropertyValue(name));
  for (const [id, picture] of Object.entries(pictures)) {
    if (!all && !picture.data.some((trace) => trace.steps)) continue;
    const { data, layout } = painted(picture, looks, { text, quiet, rule, paper }, step);
    Plotly.react(id, data, layout, { responsive: true, displaylogo: false, displayModeBar: narrow.matches ? false : undefined });
  }
}

async function draw() {
  const [library, data] = await Promise.all(["plotly", "data"].map(unpacked));
  const script = document.createElement("script");
  script.textContent = library;
  document.head.append(script);
  document.documentElement.classList.add("drawn");
  const given = JSON.parse(data);
  for (const [id, picture] of Object.entries(given.pictures)) given.pictures[id] = plotted(picture, given.looks);
  const step = stepper((now) => paint(given, now, false));
  paint(given, step());
  for (const screen of [dark, narrow]) screen.addEventListener("change", () => paint(given, step()));
}

// Buttons, slider and arrow keys go through the steps of the pictures; returns what says which step it is.
function stepper(changed) {
  const own = document.querySelector(".stepper");
  if (!own) return () => 0;
  const [back, on] = own.querySelectorAll("button");
  const slider = own.querySelector("input"), output = own.querySelector("output");
  const names = JSON.parse(own.dataset.names), rows = document.querySelectorAll("table.steps tbody tr");
  const show = () => {
    const now = Number(slider.value);
    output.textContent = names[now];
    slider.setAttribute("aria-valuetext", names[now]);
    [back.disabled, on.disabled] = [now === 0, now === names.length - 1];
    rows.forEach((row, place) => row.classList.toggle("now", place === now));
    return now;
  };
  const go = () => changed(show());
  slider.addEventListener("input", go);
  back.addEventListener("click", () => { slider.value = Number(slider.value) - 1; go(); });
  on.addEventListener("click", () => { slider.value = Number(slider.value) + 1; go(); });
  show();
  return () => Number(slider.value);
}

if ("DecompressionStream" in window) draw();
else document.getElementById("too-old").hidden = false;
