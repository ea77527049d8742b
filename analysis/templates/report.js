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

function painted(picture, colours, ink, step) {
  const data = picture.data.map(({ steps, ...found }) => (steps ? { ...found, y: steps[step] } : found)).map((trace) => {
    if (!trace.role) return trace.marker ? { ...trace, marker: { ...trace.marker, color: ink.text } } : trace;
    const { role, ...rest } = trace;
    const color = colours[role];
    return { ...rest, line: { ...rest.line, color }, marker: { ...rest.marker, color } };
  });
  const axis = { gridcolor: ink.rule, zerolinecolor: ink.quiet, linecolor: ink.rule, color: ink.text };
  const given = picture.layout;
  const shapes = (given.shapes || []).map(({ shade, ...shape }) =>
    shade ? { ...shape, fillcolor: "#f2c14e" } : { ...shape, line: { ...shape.line, color: ink.quiet } });
  const layout = {
    ...given, shapes, height: picture.height, autosize: true,
    margin: { l: 60, r: given.annotations?.length ? 44 : 20, t: given.annotations?.length ? 54 : 24, b: 50 },
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

function paint({ pictures, colours }, step, all = true) {
  const style = getComputedStyle(document.documentElement);
  const [text, quiet, rule, paper] = ["--ink", "--quiet", "--rule", "--paper"].map((name) => style.getPropertyValue(name));
  for (const [id, picture] of Object.entries(pictures)) {
    if (!all && !picture.data.some((trace) => trace.steps)) continue;
    const inks = [dark.matches ? colours.dark : colours.light, { text, quiet, rule, paper }];
    const { data, layout } = painted(picture, ...inks, step);
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
