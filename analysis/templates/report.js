"use strict";
// Unpacks plotly and the data of the pictures, and draws each picture in the colours of light or dark paper.
const dark = matchMedia("(prefers-color-scheme: dark)");

async function unpacked(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), (char) => char.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

function painted(picture, colours, ink) {
  const data = picture.data.map((trace) => {
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
    margin: { l: 60, r: 20, t: given.annotations?.length ? 42 : 24, b: 50 },
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
    layout.xaxis = { ...axis, ...given.xaxis };
    layout.yaxis = { ...axis, ...given.yaxis };
  }
  return { data, layout };
}

function paint({ pictures, colours }) {
  const style = getComputedStyle(document.documentElement);
  const [text, quiet, rule, paper] = ["--ink", "--quiet", "--rule", "--paper"].map((name) => style.getPropertyValue(name));
  for (const [id, picture] of Object.entries(pictures)) {
    const { data, layout } = painted(picture, dark.matches ? colours.dark : colours.light, { text, quiet, rule, paper });
    Plotly.react(id, data, layout, { responsive: true, displaylogo: false });
  }
}

async function draw() {
  const [library, data] = await Promise.all(["plotly", "data"].map(unpacked));
  const script = document.createElement("script");
  script.textContent = library;
  document.head.append(script);
  document.documentElement.classList.add("drawn");
  const given = JSON.parse(data);
  paint(given);
  dark.addEventListener("change", () => paint(given));
}

if ("DecompressionStream" in window) draw();
else document.getElementById("too-old").hidden = false;
