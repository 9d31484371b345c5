"use strict";
// Draws the figures of the page with plotly and keeps their colours in step with light and dark mode.
const charts = (() => {
  // Only the map of cases is worth zooming; elsewhere the tool bar would hide what it belongs to.
  const config = { responsive: true, displayModeBar: false };
  const zoomable = {
    responsive: true, displayModeBar: true, displaylogo: false,
    modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
  };
  const drawn = new Map(); // element -> figure with unresolved colours

  // A copy of the figure in which "css:ink" and the like have become colours.
  function resolve(node) {
    if (typeof node === "string") return node.startsWith("css:") ? scene.css(node.slice(4)) : node;
    if (Array.isArray(node)) return node.map(resolve);
    if (node && typeof node === "object") {
      return Object.fromEntries(Object.entries(node).map(([key, value]) => [key, resolve(value)]));
    }
    return node;
  }

  function draw(element, figure) {
    drawn.set(element, figure);
    const { data, layout } = resolve(figure);
    return Plotly.react(element, data, layout, figure.layout.dragmode === "zoom" ? zoomable : config);
  }

  scene.dark.addEventListener("change", () => drawn.forEach((figure, element) => draw(element, figure)));

  const figures = JSON.parse(document.getElementById("figures").textContent);
  document.querySelectorAll("[data-figure]").forEach((element) => draw(element, figures[element.dataset.figure]));

  return { draw };
})();
